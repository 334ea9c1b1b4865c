"""Which stretch of which lanelet each vehicle's centre may be on, step by step.

A vehicle is followed through the lanelets' graph: on to every successor, across to every lane of
its own direction. Per lanelet and step the set is kept as a least progress m (it never falls: no
reversing), an interval of y (bounded lateral speed), and the cells from the first to the last one
that the acceleration-bounded set of that step or interval touches. Each of the three is a bound
from outside, so is their product. A change of lanes keeps m, because lanelets side by side measure
progress on one scale: who changes lanes and returns is not behind where it was.

All vehicles are followed at once. Within a step the sets grow along the links of the graph
(`lane_graph`) until nothing changes any more; as all bounds only ever loosen there, the order does
not matter.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from sandra.prediction.lane_graph import LaneGraph, Stretches
from sandra.prediction.lane_table import LaneTable
from sandra.prediction.lanes import START_ERROR

Array = NDArray[np.float64]
Ints = NDArray[np.int_]
Mask = NDArray[np.bool_]


def follow(table: LaneTable, graph: LaneGraph, first: Ints, last: Ints, dt: float) -> Stretches:
    """Follow all vehicles over h steps.

    Args:
        first, last: (T, G) the first and last cell that is touched of each segment, T = 2 h + 1:
            at t_0..t_h, then during each step. Where there is none, first > last.
        dt: time step [s].

    Returns:
        The stretches in these rows.
    """
    horizon = len(first) // 2
    now = graph.start
    points, intervals = [now], []
    growth = graph.lateral_speed * dt * graph.stretch
    # It is in a lane at some time of a step, and beyond the lane's border by then at most as far as
    # it moves across in one step: so much is handed on to the lane beside.
    most = graph.half + growth
    gains = _gains(table, graph, dt)
    for k in range(horizon):
        here = now.m < np.inf
        wider = _where(
            here,
            Stretches(
                now.m,
                np.maximum(np.where(here, now.low, 0.0) - growth, -most),
                np.minimum(np.where(here, now.high, 0.0) + growth, most),
            ),
        )
        cells = first[horizon + 1 + k], last[horizon + 1 + k]
        moved, then = _spread(table, graph, wider, *cells, most, gains[k] if len(gains) else 0.0)
        during = Stretches(
            moved.m, np.maximum(moved.low, -graph.half), np.minimum(moved.high, graph.half)
        )
        begin = _begin(table, graph, then, first[k + 1])
        here = begin <= last[k + 1][graph.segment]
        rear = np.maximum(then, table.behind[np.where(here, begin, 0)])
        m = np.where(graph.reversing, then, rear)
        now = _where(here, Stretches(m, during.low, during.high))
        intervals.append(during)
        points.append(now)
    rows = points + intervals
    return Stretches(*(np.stack(x) for x in zip(*rows, strict=True)))


def _gains(table: LaneTable, graph: LaneGraph, dt: float) -> Array:
    """(h, n) progress that is made at least in each step on each node; (0, n): none for sure."""
    if graph.ways is None:
        return np.empty((0, len(graph.segment)))
    pace, drift = (x[graph.lanelet] for x in table.pace())
    # Who has no bound on its speed across drives no way for sure.
    across = np.where(np.isfinite(graph.lateral_speed), graph.lateral_speed, 0.0)
    return np.maximum(pace * graph.ways - drift * across * dt, 0.0)


def _begin(table: LaneTable, graph: LaneGraph, m: Array, first: Ints) -> Ints:
    """The first cell of each node that is touched and holds points of progress m or more."""
    begin: Ints = np.maximum(table.at_progress(graph.lanelet, m), first[graph.segment])
    return begin


def _spread(
    table: LaneTable,
    graph: LaneGraph,
    now: Stretches,
    first: Ints,
    last: Ints,
    most: Array,
    gain: Array | float,
) -> tuple[Stretches, Array]:
    """Everything that can be entered within one step, from `now`; y at most `most` (n,) [m].

    Also the least progress at the end of the step (n,): who stays on a lanelet, or changes to one
    beside it on the same scale, makes `gain` [m].
    """
    last = last[graph.segment]
    m, low, high = now.m, now.low, now.high
    then = m + gain
    while True:
        begin = _begin(table, graph, m, first)
        here = begin <= last
        free = np.where(here, last, -1)
        found = _entered(table, graph, Stretches(m, low, high), then, begin, free, most)
        if found is None:
            break
        entered, new_then = found
        new_then = np.minimum(then, new_then)
        new_m = np.minimum(m, entered.m)
        new_low, new_high = np.minimum(low, entered.low), np.maximum(high, entered.high)
        old, new = (m, low, high, then), (new_m, new_low, new_high, new_then)
        if all((a == b).all() for a, b in zip(old, new, strict=True)):
            break
        m, low, high, then = new
    return _where(here, Stretches(m, low, high)), np.where(here, then, np.inf)


def _entered(
    table: LaneTable,
    graph: LaneGraph,
    now: Stretches,
    then: Array,
    begin: Ints,
    last: Ints,
    most: Array,
) -> tuple[Stretches, Array] | None:
    """What can be entered from each node by one link, united by the node that is entered.

    Args:
        then: (n,) least progress at the end of the step; given for the nodes entered, too.
        begin, last: (n,) the cells that each node can be left from; last -1: none.
        most: (n,) y is kept within this on both sides of each node [m].
    """
    # On to the next lanelet from its last cell, or to the one before from its first.
    ends, sides = graph.ends, graph.sides
    source = ends.source
    passable = np.where(
        ends.forward,
        last[source] == table.cell[graph.lanelet[source] + 1] - 1,
        (begin[source] == table.cell[graph.lanelet[source]]) & (last[source] >= 0),
    )
    rows = np.flatnonzero(passable)
    source = source[rows]
    parts = [
        (
            ends.target[rows],
            np.full(len(rows), -np.inf),
            np.full(len(rows), -np.inf),
            now.low[source] + ends.lowest[rows],
            now.high[source] + ends.highest[rows],
        )
    ]
    # Sideways, from as much as reaches the lane's edge somewhere.
    rows = np.flatnonzero(last[sides.source] >= 0)
    source, left = sides.source[rows], sides.left[rows]
    narrowest = table.narrowest(graph.lanelet[source], begin[source], last[source])
    excess = np.where(left, now.high[source], -now.low[source]) - narrowest
    out = excess >= -START_ERROR
    rows, source, left = rows[out], source[out], left[out]
    excess = np.maximum(excess[out], 0.0) + START_ERROR
    rear = np.maximum(now.m[source], table.behind[begin[source]])
    inner, widest = excess - sides.least[rows], sides.widest[rows]
    parts.append(
        (
            sides.target[rows],
            np.where(sides.keeps_progress[rows], rear, -np.inf),
            np.where(sides.keeps_progress[rows], np.maximum(then[source], rear), -np.inf),
            np.where(left, -widest, -inner),
            np.where(left, inner, widest),
        )
    )
    target, m, later, low, high = (np.concatenate(x) for x in zip(*parts, strict=True))
    if not len(target):
        return None
    order = np.argsort(target, kind="stable")
    target = target[order]
    starts = np.flatnonzero(np.diff(target, prepend=-1))
    united = _nowhere(len(graph.segment))
    nodes = target[starts]
    bound = most[nodes]
    united.m[nodes] = np.minimum.reduceat(m[order], starts)
    united_then = np.full(len(graph.segment), np.inf)
    united_then[nodes] = np.minimum.reduceat(later[order], starts)
    united.low[nodes] = np.maximum(np.minimum.reduceat(low[order], starts), -bound)
    united.high[nodes] = np.minimum(np.maximum.reduceat(high[order], starts), bound)
    return united, united_then


def _where(here: Mask, those: Stretches) -> Stretches:
    """The stretches of the nodes in `here`; the vehicle is nowhere on the others."""
    return Stretches(
        np.where(here, those.m, np.inf),
        np.where(here, those.low, np.inf),
        np.where(here, those.high, -np.inf),
    )


def _nowhere(count: int) -> Stretches:
    return Stretches(np.full(count, np.inf), np.full(count, np.inf), np.full(count, -np.inf))
