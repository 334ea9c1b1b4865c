"""Small scenes for tests: straight parallel lanes, turned and moved at will."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from sandra.scene.frame import Frame
from sandra.scene.types import Ego, Lane, Lanelet, Obstacle, Region, Scene, State

WIDTH = 3.5
LENGTH = 400.0
CAR = Region.rectangle(4.5, 1.8)


class Road:
    """Lane n (0: the ego's, 1: left of it, -1: right, ...) of a straight road.

    `at(s, d)` is a point of the plane, s along the road from the ego's place, d to the left.
    """

    def __init__(self, angle: float = 0.0, x: float = 0.0, y: float = 0.0) -> None:
        self.angle = angle
        self.origin = np.array([x, y])
        c, s = math.cos(angle), math.sin(angle)
        self._axes = np.array([[c, s], [-s, c]])

    def at(self, s: float, d: float) -> np.ndarray:
        return self.origin + np.array([s, d]) @ self._axes

    def along(self, x: float, y: float) -> tuple[float, float]:
        """The inverse of `at`: (s, d) of a point of the plane."""
        s, d = self._axes @ (np.array([x, y]) - self.origin)
        return float(s), float(d)

    def lane(self, relation: str, place: int, *, reverse: bool = False, **changes: Any) -> Lane:
        ends = (-LENGTH / 2, LENGTH / 2)

        def line(d: float) -> np.ndarray:
            points = np.array([self.at(s, d) for s in np.linspace(*ends, 21)])
            return points[::-1] if reverse else points

        middle, half = place * WIDTH, WIDTH / 2 * (-1 if reverse else 1)
        left, right, center = line(middle + half), line(middle - half), line(middle)
        values: dict[str, Any] = {
            "relation": relation,
            "lanelets": (100 + place,),
            "left": left,
            "right": right,
            "center": center,
            "speed_limits": (13.89,),
            "frame": Frame(center),
        }
        return Lane(**{**values, **changes})

    def obstacle(
        self,
        id: int,
        s: float,
        d: float,
        speed: float = 0.0,
        heading: float = 0.0,
        kind: str = "car",
        outline: Region = CAR,
        **changes: Any,
    ) -> Obstacle:
        x, y = self.at(s, d)
        state = State(float(x), float(y), self.angle + heading, speed)
        return Obstacle(id, kind, outline, state, **changes)

    def scene(
        self,
        *obstacles: Obstacle,
        speed: float = 10.0,
        lanes: tuple[Lane, ...] | None = None,
        d: float = 0.0,
        heading: float = 0.0,
        **changes: Any,
    ) -> Scene:
        x, y = self.at(0.0, d)
        state = State(float(x), float(y), self.angle + heading, speed)
        ego = Ego(1, state, 4.5, 1.8, 2.6)
        lanes = (self.lane("current", 0),) if lanes is None else lanes
        lanelets = tuple(
            Lanelet(lane.lanelets[0], lane.left, lane.right, (), (), (), None, None, 13.89)
            for lane in lanes
        )
        values: dict[str, Any] = {"name": "TST_Straight-1_1_T-1", "dt": 0.1, "road_type": "urban"}
        return Scene(
            ego=ego, lanes=lanes, obstacles=obstacles, lanelets=lanelets, **{**values, **changes}
        )

    def three_lanes(self) -> tuple[Lane, ...]:
        return self.lane("current", 0), self.lane("left", 1), self.lane("right", -1)
