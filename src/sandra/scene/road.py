"""The type of road, derived from the map."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence

from sandra.scene.lanes import Meeting
from sandra.scene.network import length, neighbour
from sandra.scene.types import Lane, Lanelet

_NEAR = 60.0
"""An intersection or merge is near when it begins within this distance of the ego [m]."""
_CROSSING = math.radians(30.0)
"""Lanes that meet at a smaller angle merge [rad]."""
_KINDS = (
    ("interstate", "highway"),
    ("highway", "highway"),
    ("driveWay", "residential"),
    ("country", "rural"),
    ("urban", "urban"),
)
_TAGS = (
    ("interstate", "highway"),
    ("highway", "highway"),
    ("rural", "rural"),
    ("urban", "urban"),
)


def road_type(
    lanes: Sequence[Lane],
    meetings: Sequence[Meeting],
    by_id: Mapping[int, Lanelet],
    *,
    ego_lanelet: int,
    ego_s: float,
    in_intersections: Collection[int],
    tags: Collection[str],
) -> str:
    """One of `Scene.road_type`'s values, by the first rule that applies.

    1. "intersection": within 60 m the current lane is an intersection lanelet (by its type or by
       the map's intersections), or an incoming lane crosses it at 30 degrees or more.
    2. "merge": within 60 m another lane runs into the current one at a smaller angle, or the ego
       is on an access ramp, or one runs beside it.
    3. The type of the ego's lanelet: interstate and highway are "highway", driveWay is
       "residential", country is "rural", urban is "urban".
    4. The tags of the scenario (interstate, highway, rural, urban).
    5. The speed limit: up to 30 km/h "residential", up to 50 km/h "urban", up to 100 km/h "rural",
       above "highway".
    6. Three or more lanes in the ego's direction and none against it: "highway".
    7. "unknown".

    On a road that is a highway by rules 3 and 4, rule 1 does not apply: lanes that overlap there
    are ramps, not crossings.

    Args:
        lanes: the lanes around the ego. meetings: where incoming lanes meet the current one.
        by_id: all lanelets. ego_lanelet: the ego's.
        ego_s: the ego's position on the current lane [m].
        in_intersections: lanelets that the map's intersections name as their inside.
        tags: the scenario's tags.
    """
    current = next(lane for lane in lanes if lane.relation == "current")
    ego = by_id[ego_lanelet]
    named = _first(_KINDS, ego.kinds) or _first(_TAGS, tags)
    near = _near(current, by_id, ego_lanelet, ego_s)
    soon = [meeting for meeting in meetings if meeting.s - ego_s <= _NEAR]
    crossed = any(meeting.angle >= _CROSSING for meeting in soon)
    inside = any("intersection" in by_id[i].kinds or i in in_intersections for i in near)
    if named != "highway" and (inside or crossed):
        return "intersection"
    ramps = [i for i in near if "accessRamp" in by_id[i].kinds]
    for i in near:
        for side in ("left", "right"):
            other = neighbour(by_id, by_id[i], side, same=True)
            if other is not None and "accessRamp" in other.kinds:
                ramps.append(other.id)
    if ramps or any(meeting.angle < _CROSSING for meeting in soon):
        return "merge"
    if named is not None:
        return named
    if ego.speed_limit is not None:
        kmh = ego.speed_limit * 3.6
        for limit, kind in ((31.0, "residential"), (51.0, "urban"), (101.0, "rural")):
            if kmh <= limit:
                return kind
        return "highway"
    along = sum(lane.relation in ("current", "left", "right", "other") for lane in lanes)
    against = any(lane.relation == "opposite" for lane in lanes)
    return "highway" if along >= 3 and not against else "unknown"


def _first(table: Sequence[tuple[str, str]], names: Collection[str]) -> str | None:
    return next((kind for name, kind in table if name in names), None)


def _near(
    current: Lane, by_id: Mapping[int, Lanelet], ego_lanelet: int, ego_s: float
) -> tuple[int, ...]:
    """The ego's lanelet and those of the current lane that begin near."""
    start = 0.0
    near = []
    reached = False
    for i in current.lanelets:
        reached |= i == ego_lanelet
        if reached and start - ego_s <= _NEAR:
            near.append(i)
        start += length(by_id[i])
    return tuple(near)
