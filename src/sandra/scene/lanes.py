"""The lanes around the ego, each with its relation to the ego's lane (paper Sec. II-A)."""

from __future__ import annotations

import itertools
from collections.abc import Collection, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sandra.scene.network import (
    Network,
    angle_between,
    beside,
    follow,
    for_cars,
    length,
    make_lane,
    neighbour,
)
from sandra.scene.types import Lane

Array = NDArray[np.float64]

AHEAD = 360.0
"""The current lane goes on at least so far, where the map does: 30 m/s for 12 s [m]."""
BEHIND = 150.0
"""... and begins so far behind the ego's lanelet [m]."""
_APPROACH = 100.0
"""Incoming lanes begin so far before the place where they meet the ego's lane [m]."""
_OVERLAP = 1.0
"""A lanelet that shares less area than this with the ego's lane does not cross it [m^2]."""
_SIDE = 15.0
"""An incoming lane comes from the side on which it is so far before the place of meeting [m]."""


def current_lane(network: Network, ego: int, route: Sequence[int]) -> tuple[int, ...]:
    """Ids of the ego's lane: straight behind it; ahead along the route, then straight on.

    A lane has no lane changes: where the route changes lanes, this one goes on beside the route as
    long as it can.
    """
    on_route = set(route)
    by_route = {
        other.id
        for i in route
        for side in ("left", "right")
        if (other := neighbour(network, network[i], side, same=True)) is not None
    }

    def prefer(i: int) -> int:
        return 0 if i in on_route else 1 if i in by_route else 2

    distance = max(AHEAD, sum(length(network[i]) for i in route))
    forth = follow(network, ego, length(network[ego]) + distance, prefer=prefer)
    back = follow(network, ego, BEHIND, backwards=True, avoid=forth)
    return (*back, ego, *forth)


@dataclass(frozen=True, slots=True, eq=False)
class Meeting:
    """Where an incoming lane meets the current one."""

    lane: Lane
    s: float
    """Where it enters the current lane, along that lane [m]."""
    angle: float
    """Between the two directions of travel there, in [0, pi] [rad]."""


def lanes_around(
    network: Network, ego: int, route: Sequence[int], speed: float
) -> tuple[tuple[Lane, ...], tuple[Meeting, ...]]:
    """The current lane, then left, right, other and opposite lanes; and where others come in.

    Args:
        network: all lanelets. ego: the ego's lanelet. route: lanelets from there to the goal.
        speed: the ego's speed [m/s]; neighbours that begin within 3 s count (at least 30 m), and
            lanes that meet the ego's within 6 s (at least 100 m).
    """
    soon = max(30.0, 3.0 * speed)
    ids = current_lane(network, ego, route)
    lanes = [make_lane(network, "current", ids)]
    for side in ("left", "right"):
        lane, base, relation = ids, ego, side
        while (found := beside(network, lane, base, side, soon)) is not None:
            if any(found[1] in known.lanelets for known in lanes):
                break
            lane, base = found
            lanes.append(make_lane(network, relation, lane))
            relation = "other"
    along = {i for lane in lanes for i in lane.lanelets}
    for side in ("left", "right"):
        opposite = _opposite(network, ids, ego, side, soon)
        if opposite and not any(set(opposite) & set(known.lanelets) for known in lanes):
            lanes.append(make_lane(network, "opposite", opposite, side))
    order = {"current": 0, "left": 1, "right": 2, "other": 3, "opposite": 4}
    lanes.sort(key=lambda lane: order[lane.relation])
    against = {i for lane in lanes if lane.relation == "opposite" for i in lane.lanelets}
    ahead = _within(network, ids[ids.index(ego) :], max(100.0, 6.0 * speed))
    meetings = tuple(
        _meeting(network, chain, place, lanes[0])
        for chain, place in _incoming(network, ahead, along, against)
    )
    return tuple(lanes), meetings


def _within(network: Network, ids: Sequence[int], distance: float) -> tuple[int, ...]:
    """The first lanelet and those that begin within a distance of its end."""
    starts = np.cumsum([0.0, *(length(network[i]) for i in ids[1:])])
    return tuple(i for i, s in zip(ids, starts, strict=True) if s <= distance)


def _opposite(
    network: Network, current: Sequence[int], ego: int, side: str, distance: float
) -> tuple[int, ...]:
    for i in _within(network, current[current.index(ego) :], distance):
        other = neighbour(network, network[i], side, same=False)
        if other is not None and for_cars(other):
            forth = follow(network, other.id, BEHIND)
            back = follow(network, other.id, AHEAD, backwards=True, avoid=forth)
            return (*back, other.id, *forth)
    return ()


def _incoming(
    network: Network, ahead: Sequence[int], along: Collection[int], against: Collection[int]
) -> list[tuple[tuple[int, ...], Array]]:
    """Lanes that lead into or cross the lanelets ahead, and where they enter them, (1, 2) [m].

    `along` are the lanelets of the ego's own direction, `against` those of opposite lanes: neither
    is incoming itself, but a car on an opposite lane may turn across the ego's.
    """
    merging = {
        p: network[p].center[-1:]
        for before, i in itertools.pairwise(ahead)
        for p in network[i].predecessors
        if p != before and p in network and p not in along and for_cars(network[p])
    }
    crossing = _crossing(network, ahead, along, {*along, *against, *merging})
    found = []
    for i, place in [*sorted(merging.items()), *crossing.items()]:
        back = follow(network, i, _APPROACH, backwards=True, avoid=along)
        found.append(((*back, i), place))
    return [
        (ids, place) for ids, place in found if not any(set(ids) < set(other) for other, _ in found)
    ]


def _crossing(
    network: Network, ahead: Sequence[int], along: Collection[int], known: Collection[int]
) -> dict[int, Array]:
    """Lanelets, not `known`, whose area crosses the lanelets ahead, and where they enter it (1, 2).

    Lanelets that fork off from the ego's own direction overlap it too, but do not come in.
    """
    from shapely import unary_union
    from shapely.geometry import Point

    lane = unary_union([network[i].area() for i in ahead])
    beside_it = {
        adjacent[0]
        for i in ahead
        for adjacent in (network[i].adjacent_left, network[i].adjacent_right)
        if adjacent is not None
    }
    places: dict[int, Array] = {}
    for i in sorted(network):
        lanelet = network[i]
        forks = not set(lanelet.predecessors).isdisjoint(along)
        if i in known or i in beside_it or forks or not for_cars(lanelet):
            continue
        shared = network[i].area().intersection(lane)
        if shared.area < _OVERLAP:
            continue
        center = lanelet.center
        inside = [lane.contains(Point(point)) for point in center]
        first = inside.index(True) if any(inside) else len(center) // 2
        places[i] = center[first : first + 1]
    return places


def _meeting(network: Network, ids: Sequence[int], place: Array, current: Lane) -> Meeting:
    frame = make_lane(network, "incoming", ids).frame
    own = current.frame
    here, there = frame.to_curvilinear(place)[0, 0], own.to_curvilinear(place)[0, 0]
    before = frame.to_cartesian(np.array([[here - _SIDE, 0.0]]))
    side = "left" if own.to_curvilinear(before)[0, 1] >= 0 else "right"
    angle = angle_between(
        float(frame.heading(np.array([here]))[0]), float(own.heading(np.array([there]))[0])
    )
    return Meeting(make_lane(network, f"incoming-{side}", ids), float(there), angle)
