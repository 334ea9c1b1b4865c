"""Which stretch of which lanelet a vehicle's centre may be on, step by step.

A vehicle is followed through the lanelets' graph: on to every successor, across to every lane of
its own direction. Per lanelet and step the set is kept as a least progress m (it never falls: no
reversing), an interval of y (bounded lateral speed), and the cells that the acceleration-bounded
set of that step or interval touches. Each of the three is a bound from outside, so is their
product. A change of lanes keeps m, because lanelets side by side measure progress on one scale:
who changes lanes and returns is not behind where it was.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sandra.prediction.lanes import START_ERROR, LaneMap, Place, Strip

Mask = NDArray[np.bool_]

PLAIN, OWN, CUT = "plain", "own", "cut"


class Node(NamedTuple):
    """A lanelet, and how the vehicle came there.

    `how`: OWN while it has never left the ego's lane, in which it started behind the ego; CUT
    when it changed sideways into the ego's lane; PLAIN otherwise.
    """

    lanelet: int
    how: str


class Stretch(NamedTuple):
    """Part of a lanelet: progress m or more, y within [low, high] [m]."""

    m: float
    low: float
    high: float


@dataclass(frozen=True, slots=True)
class LaneSets:
    """`at[k]` at t_k (k = 0..h), `between[k]` during [t_k, t_k+1] (k = 0..h-1)."""

    at: tuple[dict[Node, Stretch], ...]
    between: tuple[dict[Node, Stretch], ...]


@dataclass(frozen=True, slots=True)
class Rules:
    """What is assumed of this vehicle, and the ego's lane."""

    dt: float
    lateral_speed: float
    """inf: not bounded [m/s]."""
    reversing: bool
    ego_lane: frozenset[int]
    starts_behind_ego: bool


def follow(
    lane_map: LaneMap,
    start: list[Place],
    at: dict[int, Mask],
    between: dict[int, Mask],
    rules: Rules,
) -> LaneSets:
    """Follow one vehicle.

    Args:
        start: the lanelets that its centre is on.
        at: per lanelet (h+1, cells), True where the cell may be touched at t_k.
        between: per lanelet (h, cells), the same for [t_k, t_k+1].
        rules: see `Rules`.
    """
    horizon = len(next(iter(between.values())))
    now: dict[Node, Stretch] = {}
    for place in start:
        strip = lane_map.strips[place.lanelet]
        behind = rules.starts_behind_ego and place.lanelet in rules.ego_lane
        rear = -np.inf if rules.reversing else place.p - START_ERROR
        now[Node(place.lanelet, OWN if behind else PLAIN)] = Stretch(
            rear, place.y - START_ERROR, place.y + START_ERROR
        )
    points, intervals = [now], []
    for k in range(horizon):
        touched = {i: mask[k] for i, mask in between.items()}
        during = _spread(lane_map, now, touched, rules)
        intervals.append(during)
        now = {}
        for node, stretch in during.items():
            strip = lane_map.strips[node.lanelet]
            inside = _inside(strip, at[node.lanelet][k + 1], stretch.m)
            if len(inside):
                rear = float(strip.behind[inside].min())
                m = stretch.m if rules.reversing else max(stretch.m, rear)
                now[node] = Stretch(m, stretch.low, stretch.high)
        points.append(now)
    return LaneSets(tuple(points), tuple(intervals))


def _inside(strip: Strip, touched: Mask, m: float) -> NDArray[np.int64]:
    """Cells touched that hold points of progress m or more."""
    return np.flatnonzero(touched & (strip.ahead >= m))


def _spread(
    lane_map: LaneMap,
    now: dict[Node, Stretch],
    touched: dict[int, Mask],
    rules: Rules,
) -> dict[Node, Stretch]:
    """Everything that can be entered within one step, from `now`."""
    found: dict[Node, Stretch] = {}
    todo: list[Node] = []

    def enter(node: Node, new: Stretch) -> None:
        half = float(lane_map.strips[node.lanelet].half.max())
        new = Stretch(new.m, max(new.low, -half), min(new.high, half))
        old = found.get(node)
        if old is not None:
            merged = Stretch(min(old.m, new.m), min(old.low, new.low), max(old.high, new.high))
            if merged == old:
                return
            new = merged
        found[node] = new
        if node not in todo:
            todo.append(node)

    for node, stretch in now.items():
        growth = rules.lateral_speed * rules.dt * lane_map.strips[node.lanelet].stretch
        enter(node, Stretch(stretch.m, stretch.low - growth, stretch.high + growth))
    kept: dict[Node, Stretch] = {}
    while todo:
        node = todo.pop()
        strip, stretch = lane_map.strips[node.lanelet], found[node]
        inside = _inside(strip, touched[node.lanelet], stretch.m)
        if not len(inside):
            continue
        kept[node] = stretch
        first, last = int(inside[0]), int(inside[-1])
        if last == len(touched[node.lanelet]) - 1:
            for i in strip.successors:
                enter(_onward(node, i, rules), _to_end(stretch, strip, lane_map.strips[i], True))
        if rules.reversing and first == 0:
            for i in strip.predecessors:
                enter(_onward(node, i, rules), _to_end(stretch, strip, lane_map.strips[i], False))
        narrowest = float(strip.half[first : last + 2].min())
        m = max(stretch.m, float(strip.behind[inside].min()))
        for other_id, excess, side in (
            (strip.left_id, stretch.high - narrowest, 1),
            (strip.right_id, -stretch.low - narrowest, -1),
        ):
            if other_id is None or excess < -START_ERROR:
                continue
            other = lane_map.strips[other_id]
            excess = max(excess, 0.0) + START_ERROR
            widest, least = float(other.half.max()), float(other.half.min())
            low, high = (-widest, excess - least) if side > 0 else (least - excess, widest)
            rear = m if other_id in strip.shared and not rules.reversing else -np.inf
            enter(_sideways(node, other_id, rules), Stretch(rear, low, high))
    return kept


def _to_end(stretch: Stretch, strip: Strip, other: Strip, forward: bool) -> Stretch:
    """Enter the next lanelet at its start (or the one before at its end): y is carried over."""
    end, begin = (-1, 0) if forward else (0, -1)
    gap = strip.centre[end] - other.centre[begin]
    shift = float(gap @ other.across[begin])
    low, high = stretch.low + shift - START_ERROR, stretch.high + shift + START_ERROR
    turn = abs(float(strip.across[end] @ other.across[begin]))
    if turn < 0.99 or float(np.hypot(*gap)) > float(strip.half[end]):
        # The cross-sections do not meet edge to edge: nothing is known of y.
        low, high = -np.inf, np.inf
    return Stretch(-np.inf, low, high)


def _onward(node: Node, lanelet: int, rules: Rules) -> Node:
    """Along the lane: what began in the ego's lane goes on so while it stays there."""
    stays = lanelet in rules.ego_lane
    return Node(lanelet, node.how if stays else PLAIN)


def _sideways(node: Node, lanelet: int, rules: Rules) -> Node:
    if lanelet not in rules.ego_lane:
        return Node(lanelet, PLAIN)
    return Node(lanelet, node.how if node.lanelet in rules.ego_lane else CUT)
