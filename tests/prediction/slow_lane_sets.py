"""The lane-based set of one vehicle, lanelet by lanelet in plain Python."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from sandra.prediction.lane_graph import CUT, OWN, PLAIN, Rules
from sandra.prediction.lanes import START_ERROR, LaneMap, Strip


class Stretch(NamedTuple):
    m: float
    low: float
    high: float
    then: float = -np.inf
    """Least progress at the end of the step."""


Node = tuple[int, int]
"""A lanelet's id, and how the vehicle came there."""
Cells = dict[int, tuple[int, int]]
"""The first and last cell of each lanelet that is touched; first > last: none."""


def follow_one(
    lane_map: LaneMap,
    vehicle: Rules,
    ego_lane: frozenset[int],
    at: list[Cells],
    between: list[Cells],
    dt: float,
    gains: dict[int, list[float]],
) -> tuple[list[dict[Node, Stretch]], list[dict[Node, Stretch]]]:
    """At each t_k and during each step, where the vehicle may be; `gains` [m] by lanelet, step."""
    strips = lane_map.strips
    now: dict[Node, Stretch] = {}
    for place in vehicle.places:
        behind = vehicle.starts_behind_ego and place.lanelet in ego_lane
        rear = -np.inf if vehicle.reversing else place.p - START_ERROR
        y = place.y
        now[place.lanelet, OWN if behind else PLAIN] = Stretch(
            rear, y - START_ERROR, y + START_ERROR
        )
    points, intervals = [now], []
    for k, touched in enumerate(between):
        gain = {i: steps[k] for i, steps in gains.items()}
        during = _spread(lane_map, now, touched, vehicle, ego_lane, dt, gain)
        intervals.append(during)
        now = {}
        for node, stretch in during.items():
            strip = strips[node[0]]
            inside = _inside(strip, at[k + 1][node[0]], stretch.then)
            if inside:
                rear = float(strip.behind[inside].min())
                m = stretch.then if vehicle.reversing else max(stretch.then, rear)
                now[node] = Stretch(m, stretch.low, stretch.high)
        points.append(now)
    return points, intervals


def _inside(strip: Strip, touched: tuple[int, int], m: float) -> list[int]:
    return [i for i in range(touched[0], touched[1] + 1) if strip.ahead[i] >= m]


def _spread(
    lane_map: LaneMap,
    now: dict[Node, Stretch],
    touched: Cells,
    vehicle: Rules,
    ego_lane: frozenset[int],
    dt: float,
    gain: dict[int, float],
) -> dict[Node, Stretch]:
    strips = lane_map.strips
    found: dict[Node, Stretch] = {}
    todo: list[Node] = []

    def enter(node: Node, new: Stretch) -> None:
        strip = strips[node[0]]
        most = float(strip.half.max()) + vehicle.lateral_speed * dt * strip.stretch
        new = Stretch(new.m, max(new.low, -most), min(new.high, most), new.then)
        if node in found:
            old = found[node]
            new = Stretch(
                min(old.m, new.m),
                min(old.low, new.low),
                max(old.high, new.high),
                min(old.then, new.then),
            )
            if new == old:
                return
        found[node] = new
        if node not in todo:
            todo.append(node)

    for node, stretch in now.items():
        growth = vehicle.lateral_speed * dt * strips[node[0]].stretch
        low, high = stretch.low - growth, stretch.high + growth
        enter(node, Stretch(stretch.m, low, high, stretch.m + gain[node[0]]))
    kept: dict[Node, Stretch] = {}
    while todo:
        lanelet, how = node = todo.pop()
        strip, stretch = strips[lanelet], found[node]
        inside = _inside(strip, touched[lanelet], stretch.m)
        if not inside:
            continue
        half = float(strip.half.max())
        kept[node] = Stretch(
            stretch.m, max(stretch.low, -half), min(stretch.high, half), stretch.then
        )
        onward = [(i, True) for i in strip.successors if inside[-1] == len(strip.cells) - 1]
        if vehicle.reversing and inside[0] == 0:
            onward += [(i, False) for i in strip.predecessors]
        for i, forward in onward:
            if i in touched:
                stays = how if i in ego_lane else PLAIN
                enter((i, stays), _to_end(stretch, strip, strips[i], forward))
        narrowest = float(strip.half[inside[0] : inside[-1] + 2].min())
        least = float(strip.behind[inside].min())
        m, then = max(stretch.m, least), max(stretch.then, least)
        for i, excess, side in (
            (strip.left_id, stretch.high - narrowest, 1),
            (strip.right_id, -stretch.low - narrowest, -1),
        ):
            if i is None or i not in touched or excess < -START_ERROR:
                continue
            excess = max(excess, 0.0) + START_ERROR
            widest, narrow = float(strips[i].half.max()), float(strips[i].half.min())
            y = (-widest, excess - narrow) if side > 0 else (narrow - excess, widest)
            keeps = i in strip.shared and not vehicle.reversing
            rear = (m, then) if keeps else (-np.inf, -np.inf)
            came = PLAIN if i not in ego_lane else how if lanelet in ego_lane else CUT
            enter((i, came), Stretch(rear[0], *y, rear[1]))
    return kept


def _to_end(stretch: Stretch, strip: Strip, other: Strip, forward: bool) -> Stretch:
    end, begin = (-1, 0) if forward else (0, -1)
    gap = strip.centre[end] - other.centre[begin]
    shift = float(gap @ other.across[begin])
    turn = abs(float(strip.across[end] @ other.across[begin]))
    if turn < 0.99 or float(np.hypot(*gap)) > float(strip.half[end]):
        return Stretch(-np.inf, -np.inf, np.inf)
    return Stretch(-np.inf, stretch.low + shift - START_ERROR, stretch.high + shift + START_ERROR)
