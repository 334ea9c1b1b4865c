"""Small scenes for the tests of the reachable set: straight, bent, widening, coarsely drawn."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from sandra.prediction import PredictedObstacle, Prediction
from sandra.scene.frame import Frame
from sandra.scene.types import Ego, Lane, Lanelet, Obstacle, Region, Scene, State

WIDTH = 3.5
CAR = Region.rectangle(4.5, 1.8)
Border = Callable[[np.ndarray], np.ndarray]
"""d of a border [m] at s [m]."""


class Course:
    """A road along an arc of curvature `kappa` (0: straight), through the origin at s = 0.

    `step` is the distance between the points of its lines [m]: large ones make kinks.
    """

    def __init__(self, kappa: float = 0.0, step: float = 1.0, angle: float = 0.0) -> None:
        self.kappa, self.step, self.angle = kappa, step, angle

    def at(self, s: Any, d: Any) -> np.ndarray:
        """(m, 2) points s along and d to the left of the ideal arc."""
        s, d = np.broadcast_arrays(np.asarray(s, dtype=float), np.asarray(d, dtype=float))
        turn = self.kappa * s
        if self.kappa == 0.0:
            x, y = s, d
        else:
            x = np.sin(turn) / self.kappa - d * np.sin(turn)
            y = (1.0 - np.cos(turn)) / self.kappa + d * np.cos(turn)
        c, t = np.cos(self.angle), np.sin(self.angle)
        return np.stack([c * x - t * y, t * x + c * y], axis=-1)

    def heading(self, s: float) -> float:
        return self.angle + self.kappa * s

    def lane(
        self,
        relation: str,
        number: int,
        right: float | Border,
        left: float | Border,
        start: float = -40.0,
        end: float = 160.0,
        limit: float | None = 30.0,
    ) -> Lane:
        """A lane of one lanelet between two borders."""
        s = np.linspace(start, end, max(2, round((end - start) / self.step) + 1))

        def line(border: float | Border) -> np.ndarray:
            return self.at(s, border(s) if callable(border) else border)

        lines = line(left), line(right)
        center = (lines[0] + lines[1]) / 2
        return Lane(relation, (number,), *lines, center, (limit,), Frame(center))

    def lanes(self, left: int = 1, right: int = 1, **options: Any) -> tuple[Lane, ...]:
        """The ego's lane about d = 0 and neighbours on both sides."""
        found = []
        for place in range(-right, left + 1):
            relation = {0: "current", 1: "left", -1: "right"}.get(place, "other")
            low, high = (place - 0.5) * WIDTH, (place + 0.5) * WIDTH
            found.append(self.lane(relation, 100 + place, low, high, **options))
        return tuple(sorted(found, key=lambda x: abs(x.lanelets[0] - 100)))

    def car(
        self,
        number: int,
        s: float,
        d: float,
        speed: float = 0.0,
        angle: float = 0.0,
        kind: str = "car",
        outline: Region = CAR,
    ) -> Obstacle:
        x, y = self.at(s, d)
        return Obstacle(
            number, kind, outline, State(float(x), float(y), self.heading(s) + angle, speed)
        )

    def scene(
        self,
        lanes: Sequence[Lane] | None = None,
        obstacles: Sequence[Obstacle] = (),
        speed: float = 10.0,
        d: float = 0.0,
        angle: float = 0.0,
        dt: float = 0.1,
        more_lanelets: Sequence[Lane] = (),
    ) -> Scene:
        """A scene with the ego at s = 0; `more_lanelets` belong to the map but to no lane."""
        lanes = tuple(self.lanes() if lanes is None else lanes)
        x, y = self.at(0.0, d)
        ego = Ego(1, State(float(x), float(y), self.heading(0.0) + angle, speed), 4.5, 1.8, 2.6)
        lanelets = tuple(
            Lanelet(
                lane.lanelets[0],
                lane.left,
                lane.right,
                (),
                (),
                (),
                None,
                None,
                lane.speed_limits[0],
            )
            for lane in (*lanes, *more_lanelets)
        )
        return Scene("TST_Course-1_1_T-1", dt, ego, lanes, tuple(obstacles), lanelets, "urban")

    def drive(self, obstacle: Obstacle, s: float, d: float, horizon: int, dt: float) -> np.ndarray:
        """(h+1, 5) states of an obstacle that keeps its speed and its d."""
        t = np.arange(horizon + 1) * dt
        along = s + obstacle.state.speed / (1.0 - self.kappa * d) * t
        xy = self.at(along, np.full_like(along, d))
        heading = np.array([self.heading(x) for x in along])
        speed = np.full_like(t, obstacle.state.speed)
        return np.column_stack([xy, heading, speed, np.zeros_like(t)])


def prediction(
    scene: Scene, horizon: int, paths: dict[int, np.ndarray] | None = None
) -> Prediction:
    """A prediction from (h+1, 5) states by obstacle id; all others stand still."""
    found = []
    for obstacle in scene.obstacles:
        state = obstacle.state
        still = np.tile([state.x, state.y, state.heading, state.speed, 0.0], (horizon + 1, 1))
        states = (paths or {}).get(obstacle.id, still)
        at = tuple((obstacle.outline.placed(*row[:3]),) for row in states)
        found.append(PredictedObstacle(obstacle, at, at[:-1], states))
    return Prediction("recorded", scene.dt, horizon, tuple(found))
