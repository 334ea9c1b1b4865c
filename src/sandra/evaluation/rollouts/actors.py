"""Who else is there, and what the certificate lists as assumed of each: no more, no less."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sandra.certificate import Certificate
from sandra.evaluation.rollouts.ego import Drive
from sandra.evaluation.rollouts.road import Road
from sandra.scene.types import Obstacle, Region, Scene, State

Array = NDArray[np.float64]

FIXED, LANES, FREE = "fixed", "lanes", "free"


@dataclass(frozen=True, slots=True)
class Actor:
    """One of the others, with the bounds that it must keep.

    `moves`: "fixed" stands; "lanes" keeps to its carriageway; "free" may go anywhere. `appears` is
    the fine step at which it is first there. A bound that is not listed is inf (`turning_radius`:
    0); `listed` are the names in the certificate.
    """

    id: int
    kind: str
    outline: Region
    start: State
    appears: int
    moves: str
    listed: frozenset[str]
    a_max: float
    v_max: float
    lateral: float
    turning_radius: float
    slip: float
    speed_is_known: bool
    braking: float = math.inf
    driving: float = math.inf
    """Its speed falls, and grows, no faster [m/s^2]."""

    @property
    def keeps_out(self) -> bool:
        """Whether it is assumed to cut in before the ego only by the law."""
        return "legal_cut_in" in self.listed

    @property
    def yields(self) -> bool:
        """Whether it is assumed not to drive into the ego from behind in the ego's lane."""
        return "no_rear_end" in self.listed

    @property
    def radius(self) -> float:
        """Of a circle around the centre that holds the body [m]."""
        return float(np.hypot(*self.outline.vertices.T).max()) + self.outline.radius

    @property
    def length(self) -> float:
        """Along the body [m]."""
        x = self.outline.vertices[:, 0]
        return float(np.ptp(x)) + 2 * self.outline.radius

    @property
    def width(self) -> float:
        """Across the body [m]."""
        y = self.outline.vertices[:, 1]
        return float(np.ptp(y)) + 2 * self.outline.radius


def actors_of(c: Certificate, scene: Scene, drive: Drive, road: Road) -> tuple[Actor, ...]:
    """All that the certificate speaks of and that appear before the ego stands."""
    by_id = {obstacle.id: obstacle for obstacle in scene.obstacles}
    found = []
    for each in c.obstacles:
        obstacle = by_id[each.id]
        row, start = _first(obstacle)
        appears = row * drive.per_dt
        if appears >= len(drive.states):
            continue
        a = c.settings.assumptions
        listed = frozenset(each.assumptions)
        walks = "pedestrian_max_acceleration" in listed
        fastest = a.pedestrian_max_speed if walks else a.max_speed
        named = {"max_speed", "pedestrian_max_speed"} & listed
        across = _across(start, road) if "follow_lanes" in listed else math.inf
        moves = FREE
        if each.is_static or listed & {"static", "parked"}:
            moves = FIXED
        elif "stay_on_carriageway" in listed:
            moves = LANES
        found.append(
            Actor(
                each.id,
                each.kind,
                each.outline,
                start,
                appears,
                moves,
                listed,
                a.pedestrian_max_acceleration if walks else a.max_acceleration,
                fastest if named else max(fastest, abs(start.speed)),
                a.max_lateral_speed
                if "max_lateral_speed" in listed
                else max(a.max_lateral_speed, across),
                a.min_turning_radius if "bounded_heading" in listed else 0.0,
                a.max_slip_angle,
                obstacle.speed_is_known,
                a.max_braking if "max_braking" in listed else math.inf,
                a.max_driving if "max_driving" in listed else math.inf,
            )
        )
    return tuple(found)


def _first(obstacle: Obstacle) -> tuple[int, State]:
    """The first row at which it is there, and its state then."""
    rows = obstacle.states
    if rows is None or not np.isfinite(rows[:, 0]).any() or np.isfinite(rows[0, 0]):
        return 0, obstacle.state
    row = int(np.flatnonzero(np.isfinite(rows[:, 0]))[0])
    x, y, heading, speed = rows[row, :4].tolist()
    return row, State(x, y, heading, speed)


def _across(start: State, road: Road) -> float:
    """Its speed across the lane that it follows best [m/s]; 0 where it is on none."""
    point = np.array([[start.x, start.y]])
    found = [
        abs(start.speed * math.sin(start.heading - float(road.course(i, point)[0])))
        for i in road.around(start.x, start.y, start.heading)
    ]
    return min(found, default=0.0)
