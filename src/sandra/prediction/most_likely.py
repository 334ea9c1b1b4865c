"""One trajectory per participant: recorded, or constant velocity along the lane.

Along the lane: the lanelet under the centre whose direction is nearest to the heading, then always
the straightest successor; the offset from its centre line, the heading relative to it and the
speed along the resulting path stay as they are. Who is on no lane, or not along it (pedestrians,
heading more than 45 degrees away), goes straight on.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray

from sandra.prediction.lane_cutting import build_map
from sandra.prediction.lanes import LaneMap, Place, Strip
from sandra.prediction.observed import FIXED_KINDS, is_fixed
from sandra.prediction.straight_road import StraightRoad
from sandra.scene.types import Obstacle, Scene

Array = NDArray[np.float64]

RECORDED_SETS = "recorded occupancies"
"""The assumption of what is recorded as sets."""
ALONG_LANE = math.radians(45.0)
"""A vehicle whose heading leaves its lane's by more does not drive along it."""
ON_LANE = 0.02
"""Points this close to a lanelet are on it [m]."""
_SHORTEST = 0.05
"""Points of a path are at least this far apart [m]."""


@dataclass(frozen=True, slots=True, eq=False)
class Likely:
    """The most likely trajectory of one participant: (h+1, 5) `states`, and what was assumed."""

    obstacle: Obstacle
    states: Array
    assumptions: tuple[str, ...]


def trajectories(
    scene: Scene, horizon: int, use_recordings: bool
) -> tuple[tuple[Likely, ...], tuple[str, ...]]:
    """The most likely trajectory of every other participant.

    Args:
        scene: the scene.
        horizon: number of steps h.
        use_recordings: follow the recorded trajectories, and the recorded occupancies of
            obstacles that are recorded as sets; False: constant velocity for all.

    Returns:
        The trajectories, and notes in words about what had to be assumed.
    """

    @cache
    def lane_map() -> LaneMap | StraightRoad:
        straight = StraightRoad.of(scene.lanelets, 0.0)
        return straight or build_map(scene.lanelets, 0.0, shared=False)

    found: list[Likely] = []
    ended: dict[int, list[int]] = {}
    absent: list[int] = []
    late: list[int] = []
    as_sets: list[tuple[int, int]] = []
    unknown: list[int] = []
    for obstacle in scene.obstacles:
        if is_fixed(obstacle):
            how = "parked" if obstacle.kind in FIXED_KINDS else "static"
            found.append(Likely(obstacle, _standing(obstacle, horizon), (how,)))
            continue
        recorded = obstacle.states if use_recordings else None
        if use_recordings and obstacle.occupancies:
            states = _within_sets(obstacle, horizon)
            found.append(Likely(obstacle, states, (RECORDED_SETS,)))
            last = len(obstacle.occupancies) - 1
            if last < horizon:
                as_sets.append((obstacle.id, last))
            continue
        if use_recordings and (recorded is None or not np.isfinite(recorded[:, 0]).any()):
            absent.append(obstacle.id)
            recorded = None
        if recorded is None and not obstacle.speed_is_known:
            unknown.append(obstacle.id)
        states, last = _trajectory(obstacle, recorded, scene.dt, horizon, lane_map)
        if recorded is not None:
            if last < horizon:
                ended.setdefault(last, []).append(obstacle.id)
            first = int(np.isfinite(states[:, 0]).argmax())
            if first > 0 or not np.isfinite(states[:, 0]).any():
                late.append(obstacle.id)
        how = "recorded trajectory" if recorded is not None else "constant velocity along the lane"
        found.append(Likely(obstacle, states, (how,)))
    return tuple(found), _notes(horizon, ended, absent, late, as_sets, unknown)


def _notes(
    horizon: int,
    ended: dict[int, list[int]],
    absent: list[int],
    late: list[int],
    as_sets: list[tuple[int, int]],
    unknown: list[int],
) -> tuple[str, ...]:
    notes = []
    for last in sorted(ended):
        count = len(ended[last])
        one = count == 1
        notes.append(
            f"recording ends at step {last} of {horizon}; beyond it {count} "
            f"obstacle{' is' if one else 's are'} assumed to keep "
            f"{'its' if one else 'their'} velocity along {'its' if one else 'their'} lane"
        )
    for identifier, last in as_sets:
        notes.append(
            f"recorded occupancies of obstacle {identifier} end at step {last} of {horizon}; "
            "beyond it they are assumed to spread at its speed in all directions"
        )
    if absent:
        notes.append(f"no recording of {_ids(absent)}; assumed to keep the velocity along the lane")
    if unknown:
        notes.append(f"speed unknown, taken for standing: {_ids(unknown)}")
    if late:
        notes.append(f"recorded later than step 0 and absent until then: {_ids(late)}")
    return tuple(notes)


def _ids(identifiers: list[int]) -> str:
    shown = ", ".join(map(str, identifiers[:12]))
    return f"obstacles {shown}" + (", ..." if len(identifiers) > 12 else "")


def _standing(obstacle: Obstacle, horizon: int) -> Array:
    """(h+1, 5) states of what stays where it is."""
    s = obstacle.state
    return np.tile(np.array([s.x, s.y, s.heading, 0.0, 0.0]), (horizon + 1, 1))


def _within_sets(obstacle: Obstacle, horizon: int) -> Array:
    """(h+1, 5) states in the middle of recorded occupancies, with the observed velocity."""
    sets = obstacle.occupancies or ()
    s = obstacle.state
    states = np.full((horizon + 1, 5), np.nan)
    for k in range(horizon + 1):
        regions = sets[min(k, len(sets) - 1)]
        if regions:
            points = np.vstack([r.vertices for r in regions])
            x, y = (points.min(axis=0) + points.max(axis=0)) / 2
            states[k] = x, y, s.heading, s.speed, 0.0
    return states


def _trajectory(
    obstacle: Obstacle,
    recorded: Array | None,
    dt: float,
    horizon: int,
    lane_map: Callable[[], LaneMap | StraightRoad],
) -> tuple[Array, int]:
    """(h+1, 5) states, and the last recorded step."""
    states = np.full((horizon + 1, 5), np.nan)
    last = 0
    if recorded is not None:
        given = recorded[: horizon + 1]
        states[: len(given)] = given
        present = np.flatnonzero(np.isfinite(recorded[:, 0]))
        if present[0] > horizon:
            return states, horizon
        last = int(present[present <= horizon][-1])
        states[: last + 1] = _bridged(states[: last + 1])
    else:
        s = obstacle.state
        speed = s.speed if obstacle.speed_is_known else 0.0
        states[0] = s.x, s.y, s.heading, speed, np.nan_to_num(s.acceleration)
    if last < horizon:
        states[last + 1 :] = _along_lane(states[last], dt, horizon - last, lane_map())
    return states, last


def _bridged(states: Array) -> Array:
    """Fill gaps inside a recording linearly; acceleration that is missing is 0."""
    states = states.copy()
    present = np.isfinite(states[:, 0])
    index = np.arange(len(states))
    first = int(present.argmax())
    states[present, 4] = np.nan_to_num(states[present, 4])
    gap = ~present & (index > first)
    if gap.any():
        known = states[present].copy()
        known[:, 2] = np.unwrap(known[:, 2])
        for column in range(5):
            states[gap, column] = np.interp(index[gap], index[present], known[:, column])
    return states


def _along_lane(state: Array, dt: float, steps: int, lane_map: LaneMap | StraightRoad) -> Array:
    """(steps, 5) states at constant speed along the lane."""
    x, y, heading, speed = state[:4].tolist()
    way = speed * dt * np.arange(1, steps + 1)
    result = np.zeros((steps, 5))
    result[:, 3] = speed
    places = [
        p for p in lane_map.places(x, y, heading, ON_LANE) if abs(p.relative_heading) <= ALONG_LANE
    ]
    drives = bool(places) and speed > 0.0
    if isinstance(lane_map, StraightRoad) or not drives:
        # Straight on: along the road, or where no lane is known as it points.
        course = lane_map.course if isinstance(lane_map, StraightRoad) and drives else heading
        result[:, 0] = x + way * math.cos(course)
        result[:, 1] = y + way * math.sin(course)
        result[:, 2] = heading
        return result
    place = min(places, key=lambda p: abs(p.relative_heading))
    path = _path(lane_map, place, np.array([x, y]), heading, float(way[-1]))
    edge = np.diff(path, axis=0)
    length = np.linalg.norm(edge, axis=1)
    arc = np.concatenate([[0.0], np.cumsum(length)])
    result[:, 0] = np.interp(way, arc, path[:, 0])
    result[:, 1] = np.interp(way, arc, path[:, 1])
    courses = np.unwrap(np.arctan2(edge[:, 1], edge[:, 0]))
    # Between the middles of its edges the path turns evenly; its first edge sets the reference.
    turned = np.interp(way, arc[:-1] + length / 2, courses) - courses[0]
    result[:, 2] = heading + turned
    return result


def _path(lane_map: LaneMap, place: Place, start: Array, heading: float, length: float) -> Array:
    """(n, 2) points from `start` at a constant distance beside the lane, for `length` at least.

    Only points ahead of the ones before are taken: cross-sections may be slanted, and lanelets
    overlap where they meet. Beyond the end of the map the path goes straight on.
    """
    points = [start]
    strip, y = lane_map.strips[place.lanelet], place.y
    along = np.array([math.cos(heading), math.sin(heading)])
    ahead = strip.corners[strip.s[strip.corners] > place.s]
    way = 0.0
    seen = {strip.id}
    while way <= length:
        for point in strip.centre[ahead] + y * strip.across[ahead]:
            step = point - points[-1]
            size = float(np.hypot(*step))
            if float(step @ along) > max(0.5 * size, _SHORTEST):
                points.append(point)
                way += size
                along = step / size
                # Enough if the edge that the last place turns towards is there.
                if way - size > length:
                    break
        onward = [i for i in strip.successors if i not in seen]
        if not onward:
            break
        following = min((lane_map.strips[i] for i in onward), key=lambda other: _bend(strip, other))
        gap = strip.centre[-1] + y * strip.across[-1] - following.centre[0]
        y = float(gap @ following.across[0])
        strip, ahead = following, following.corners
        seen.add(strip.id)
    points.append(points[-1] + along * (max(length - way, 0.0) + 1.0))
    return np.array(points)


def _bend(now: Strip, following: Strip) -> float:
    """How far the following lanelet turns away in all [rad]."""
    before = now.centre[-1] - now.centre[-2]
    after = following.centre[-1] - following.centre[0]
    turn = math.atan2(after[1], after[0]) - math.atan2(before[1], before[0])
    return abs((turn + math.pi) % (2 * math.pi) - math.pi)
