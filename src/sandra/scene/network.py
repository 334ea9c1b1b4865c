"""The lanelet graph: which lanelet the ego is on, its route, and lanes as chains of lanelets.

Pure functions on `Lanelet`s, keyed by id; every choice between several lanelets ends with the
lowest id, so the same map always gives the same lanes.
"""

from __future__ import annotations

import heapq
import math
from collections.abc import Callable, Collection, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from sandra.errors import ScenarioError
from sandra.scene.frame import Frame, smoothed
from sandra.scene.types import Lane, Lanelet

Array = NDArray[np.float64]
Network = Mapping[int, Lanelet]

LANE_CHANGE_COST = 100.0
"""A route takes a detour of up to this length rather than one more lane change [m]."""
_NOT_FOR_CARS = frozenset(
    {"sidewalk", "crosswalk", "bicycleLane", "busLane", "busStop", "parking", "restricted"}
    | {"restricted_area", "border", "shoulder"}
)
_OFF_ROAD = 0.25
"""The ego's centre may lie this far beside a lanelet and still be on it [m]."""
_JOINT = 0.05
"""A first point closer than this to the last point of the lanelet before is the same point [m]."""
_CLEARANCE = 8.0
"""A centre line is smoothed where its frame does not map one to one up to this distance [m]."""
_DEVIATION = 0.15
"""... but by no more than this [m]."""


def start_heading(lanelet: Lanelet) -> float:
    """Direction of travel at the start of the lanelet [rad]."""
    return _heading(lanelet.center)


def end_heading(lanelet: Lanelet) -> float:
    """Direction of travel at the end of the lanelet [rad]."""
    return _heading(lanelet.center[::-1]) + math.pi


def _heading(line: Array) -> float:
    away = line - line[0]
    far = np.nonzero(np.hypot(away[:, 0], away[:, 1]) > 0.5)[0]
    x, y = away[far[0]] if len(far) else away[-1]
    return math.atan2(y, x)


def length(lanelet: Lanelet) -> float:
    """Arc length of the lanelet's centre line [m]."""
    return float(np.linalg.norm(np.diff(lanelet.center, axis=0), axis=1).sum())


def angle_between(a: float, b: float) -> float:
    """|a - b| on the circle, in [0, pi] [rad]."""
    return abs((a - b + math.pi) % (2 * math.pi) - math.pi)


def for_cars(lanelet: Lanelet) -> bool:
    """Whether motor vehicles of any kind drive on the lanelet."""
    return _NOT_FOR_CARS.isdisjoint(lanelet.kinds)


def neighbour(network: Network, lanelet: Lanelet, side: str, *, same: bool) -> Lanelet | None:
    """The adjacent lanelet on that side ("left", "right") with that direction, or None."""
    adjacent = lanelet.adjacent_left if side == "left" else lanelet.adjacent_right
    if adjacent is None or adjacent[1] is not same:
        return None
    return network.get(adjacent[0])


def lanelets_near(network: Network, x: float, y: float, margin: float = 0.0) -> list[int]:
    """Ids of the lanelets whose area lies within `margin` [m] of a point, in ascending order."""
    from shapely import Point, Polygon

    point = Point(x, y)
    found = []
    for lanelet in network.values():
        outline = np.vstack([lanelet.right, lanelet.left[::-1]])
        low, high = outline.min(axis=0) - margin, outline.max(axis=0) + margin
        inside = low[0] <= x <= high[0] and low[1] <= y <= high[1]
        if inside and Polygon(outline).buffer(0).distance(point) <= margin:
            found.append(lanelet.id)
    return sorted(found)


def ego_lanelet(
    network: Network, x: float, y: float, heading: float, goals: Collection[int]
) -> int:
    """The lanelet that the ego drives on.

    Of the lanelets that hold its centre, in this order: one for cars, one whose direction differs
    by less than 90 degrees, one from which a goal can be reached, the one with the best
    direction. A car on the wrong side of the road belongs to the adjacent lanelet of its own
    direction.

    Raises:
        ScenarioError: no lanelet holds the ego's centre.
    """
    found = lanelets_near(network, x, y) or lanelets_near(network, x, y, _OFF_ROAD)
    if not found:
        raise ScenarioError(
            f"the ego at ({x:.2f}, {y:.2f}) is off the road: no lanelet holds its centre; "
            "move the initial position of the planning problem onto a lanelet"
        )

    def score(i: int) -> tuple[bool, bool, bool, float, int]:
        lanelet = network[i]
        frame = Frame(lanelet.center)
        s, _ = frame.to_curvilinear(np.array([[x, y]]))[0]
        turn = angle_between(float(frame.heading(np.array([s]))[0]), heading)
        unreachable = bool(goals) and route_to(network, i, goals) is None
        return not for_cars(lanelet), turn > math.pi / 2, unreachable, round(turn, 3), i

    best = min(found, key=score)
    if score(best)[1]:
        for side in ("left", "right"):
            other = neighbour(network, network[best], side, same=False)
            if other is not None and for_cars(other):
                return other.id
    return best


def route_to(network: Network, start: int, goals: Collection[int]) -> tuple[int, ...] | None:
    """The shortest chain of lanelets to a goal, over successors and adjacent lanelets.

    A change to an adjacent lanelet of the same direction counts as `LANE_CHANGE_COST`. Returns the
    ids from `start` to the goal, or None where no goal can be reached.
    """
    queue = [(0.0, start, start)]
    before: dict[int, int] = {}
    while queue:
        cost, i, previous = heapq.heappop(queue)
        if i in before:
            continue
        before[i] = previous
        if i in goals:
            chain = [i]
            while chain[-1] != start:
                chain.append(before[chain[-1]])
            return tuple(reversed(chain))
        lanelet = network[i]
        for j in lanelet.successors:
            if j in network and j not in before:
                heapq.heappush(queue, (cost + length(lanelet), j, i))
        for side in ("left", "right"):
            other = neighbour(network, lanelet, side, same=True)
            if other is not None and other.id not in before and for_cars(other):
                heapq.heappush(queue, (cost + LANE_CHANGE_COST, other.id, i))
    return None


def follow(
    network: Network,
    start: int,
    distance: float,
    *,
    backwards: bool = False,
    prefer: Callable[[int], int] = lambda _: 0,
    avoid: Collection[int] = (),
) -> tuple[int, ...]:
    """The chain of successors (or predecessors) of a lanelet, without `start` itself.

    At each fork the lanelet with the lowest `prefer` is taken, then the straightest. The chain ends
    after `distance` [m], before a lanelet in `avoid`, and before it closes a circle. It is given
    in the direction of travel.
    """
    chain = [start]
    covered = 0.0
    while covered < distance:
        here = network[chain[-1]]
        steps = here.predecessors if backwards else here.successors
        free = [j for j in steps if j in network and j not in avoid and j not in chain]
        if not free:
            break

        def score(j: int, here: Lanelet = here) -> tuple[bool, int, float, int]:
            there = network[j]
            ends = (start_heading, start_heading) if backwards else (end_heading, end_heading)
            turn = angle_between(ends[0](here), ends[1](there))
            return not for_cars(there), prefer(j), round(turn, 3), j

        best = min(free, key=score)
        if not for_cars(network[best]):
            break
        chain.append(best)
        covered += length(network[best])
    return tuple(chain[:0:-1] if backwards else chain[1:])


def beside(
    network: Network, lane: Sequence[int], base: int, side: str, distance: float
) -> tuple[tuple[int, ...], int] | None:
    """The lane next to `lane` on one side, with the same direction: its ids in order, its start.

    It begins with the neighbour of `base`, or of the first lanelet after it within `distance` [m]
    that has one, and is extended both ways: beside `lane` as long as there are neighbours, then
    straight on. It never runs into `lane` itself. None if there is no such neighbour; the start is
    the neighbour that it began with.
    """
    ahead = 0.0
    first = None
    for i in lane[lane.index(base) :]:
        other = neighbour(network, network[i], side, same=True)
        if other is not None and for_cars(other) and other.id not in lane:
            first = other.id
            break
        ahead += length(network[i])
        if ahead > distance:
            break
    if first is None:
        return None
    neighbours = {
        other.id
        for i in lane
        if (other := neighbour(network, network[i], side, same=True)) is not None
    }

    def prefer(j: int) -> int:
        return 0 if j in neighbours else 1

    total = sum(length(network[i]) for i in lane)
    back = follow(network, first, total, backwards=True, prefer=prefer, avoid=lane)
    forth = follow(network, first, total, prefer=prefer, avoid=(*lane, *back))
    return (*back, first, *forth), first


def make_lane(network: Network, relation: str, ids: Sequence[int], side: str | None = None) -> Lane:
    """The lane made of these lanelets, its borders joined without repeated points."""
    left, right = _joined(network, ids)
    center = (left + right) / 2
    for line in (left, right, center):
        line.setflags(write=False)
    return Lane(
        relation=relation,
        lanelets=tuple(ids),
        left=left,
        right=right,
        center=center,
        speed_limits=tuple(network[i].speed_limit for i in ids),
        frame=lane_frame(center),
        side=side,
    )


def _joined(network: Network, ids: Sequence[int]) -> tuple[Array, Array]:
    left, right = network[ids[0]].left, network[ids[0]].right
    for i in ids[1:]:
        lanelet = network[i]
        here = (left[-1] + right[-1]) / 2
        course = _heading(((left + right) / 2)[::-1]) + math.pi
        step = lanelet.center - here
        # Where the next lanelet begins at or behind the end of this one, skip its first points.
        ahead = step @ np.array([math.cos(course), math.sin(course)])
        skip = int(np.argmax(ahead > _JOINT)) if (ahead > _JOINT).any() else len(step) - 1
        left = np.vstack([left, lanelet.left[skip:]])
        right = np.vstack([right, lanelet.right[skip:]])
    return left, right


def lane_frame(center: Array) -> Frame:
    """The frame of a centre line, smoothed only if its normals would meet close to it.

    Of the line itself and smoothed versions of it that stay within 0.15 m, the first that maps one
    to one up to `_CLEARANCE`, else the one that does so furthest. A tight bend thus keeps its
    radius, a jagged line loses its kinks.

    Raises:
        ScenarioError: as `Frame`, where smoothing does not help.
    """
    candidates: list[Frame] = []
    for passes in (None, 0, 1, 2, 4, 8, 16):
        line = center if passes is None else smoothed(center, passes=passes)
        try:
            frame = Frame(line)
        except ScenarioError:
            if passes == 16 and not candidates:
                raise
            continue
        if candidates and np.abs(frame.to_curvilinear(center)[:, 1]).max() > _DEVIATION:
            break
        if frame.clearance >= _CLEARANCE:
            return frame
        candidates.append(frame)
    return max(candidates, key=lambda frame: frame.clearance)
