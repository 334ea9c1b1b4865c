"""Lanes in the frame of the current lane: their borders, their vehicles, their limits along s."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from math import ceil, inf

import numpy as np
from numpy.typing import NDArray

from sandra.prediction.types import Prediction
from sandra.reach.lattice import Lattice
from sandra.reach.traffic import in_traffic
from sandra.scene.frame import Frame
from sandra.scene.types import Lane, Scene
from sandra.settings import Settings

Array = NDArray[np.float64]

BORDER_STEP = 0.25
"""Resolution at which lane borders are read [m]."""
LONG = 400
"""Of edges of more pieces than this only the near ones are read."""
BORDER_MARGIN = 0.02
"""Added outwards for what lies between two such points [m]."""
BORDER_MERGE = 0.1
"""Neighbouring stretches of a border are merged up to this difference [m]."""
NARROWEST = 0.2
"""On the inside of a bend a metre of body is taken for at most 1 / this metres of the lane."""
BEYOND = 10.0
"""Borders are read so much further than a body in the lattice reaches [m]."""


@dataclass(frozen=True, slots=True)
class Stretch:
    """Part of a lane in the frame of the current lane: bounds of its two borders there [m].

    Whoever is here and touches the lane, touches it between `right_low` and `left_high`. Between
    `right_high` and `left_low` all points are in the lane (there are none if the first is larger).
    """

    s_low: float
    s_high: float
    right_low: float
    right_high: float
    left_low: float
    left_high: float


@dataclass(frozen=True, slots=True)
class Leader:
    """Rear end [m] and speed [m/s] of a vehicle in a lane at some step.

    An infinite speed stands for one that precedes, but to which no distance is asked.
    """

    rear: float
    speed: float


Band = tuple[Stretch, ...]
"""A lane's stretches, ascending in s; empty where the lane is elsewhere."""

Limit = tuple[float, float, float | None, float | None]
"""(s_low, s_high, lowest, highest limit [m/s] or None) over the lanes that the ego may use."""


def band(frame: Frame, lattice: Lattice, left: Array, right: Array, radius: float) -> Band:
    """The band of one lane with these borders, see `bands`."""
    return bands(frame, lattice, [(left, right)], radius)[0]


def bands(
    frame: Frame, lattice: Lattice, borders: Sequence[tuple[Array, Array]], radius: float
) -> list[Band]:
    """Lanes along the lattice's columns, for a body within `radius` [m] of its centre.

    Args:
        borders: (left, right) of each lane.

    The body reaches beyond its own column, and a border need not be parallel to the frame: the
    outer bounds are those of all columns within reach. Borders are read every `BORDER_STEP`;
    where they are not functions of s (a lanelet that crosses), the highest and lowest d count.
    """
    several = []
    for left, right in borders:
        several += [right, left, *(np.array([right[i], left[i]]) for i in (0, -1))]
    projected = _projected(frame, lattice, several, radius)
    return [
        _band(frame, lattice, projected[i : i + 4], radius) for i in range(0, len(projected), 4)
    ]


def _band(
    frame: Frame, lattice: Lattice, ring: Sequence[tuple[Array, Array]], radius: float
) -> Band:
    """The band of a lane whose `ring` are its right and left border and both its ends."""
    lines = lattice.corners()[0]
    on_right, on_left, *others = ring
    # A body in the first or last column touches what is behind or ahead of the lattice.
    more_columns = ceil(radius / NARROWEST / lattice.ds)
    beyond = lattice.ds * np.arange(1, more_columns + 1)
    wide = np.concatenate([lines[0] - beyond[::-1], lines, lines[-1] + beyond])
    own = slice(more_columns, more_columns + lattice.columns)
    (right_low, right_high), (left_low, left_high), *more = (
        _per_column(*each, wide) for each in (on_right, on_left, *others)
    )
    low, high = np.fmin(right_low, left_low), np.fmax(right_high, left_high)
    for lowest, highest in more:
        low, high = np.fmin(low, lowest), np.fmax(high, highest)
    outer = [x[own] for x in _within_reach(low, high, frame, lattice, radius)]
    # On an opposite lane the left border is the one with the lower d. Columns in which the lane
    # begins or ends are not all in it.
    s = [np.concatenate(side)[:, 0] for side in (on_right, on_left)]
    start, end = max(x.min(initial=inf) for x in s), min(x.max(initial=-inf) for x in s)
    whole = (lines[:-1] >= start) & (lines[1:] <= end)
    inner_low = np.where(whole, np.minimum(right_high, left_high)[own], np.nan)
    inner_high = np.where(whole, np.maximum(right_low, left_low)[own], np.nan)
    bounds = np.column_stack(
        [
            outer[0] - BORDER_MARGIN,
            np.nan_to_num(inner_low, nan=inf) + BORDER_MARGIN,
            np.nan_to_num(inner_high, nan=-inf) - BORDER_MARGIN,
            outer[1] + BORDER_MARGIN,
        ]
    )
    return tuple(_stretches(lines, bounds))


def _stretches(lines: Array, bounds: Array) -> Iterator[Stretch]:
    """Neighbouring columns whose `bounds` (columns, 4) are alike, put together."""
    used = np.isfinite(bounds[:, 0])
    first = 0
    while first < len(used):
        if not used[first]:
            first += 1
            continue
        alike = used[first:] & _alike(bounds[first:])
        end = first + (len(alike) if alike.all() else int(alike.argmin()))
        outermost, innermost = bounds[first:end].min(axis=0), bounds[first:end].max(axis=0)
        yield Stretch(
            float(lines[first]),
            float(lines[end]),
            float(outermost[0]),
            float(innermost[1]),
            float(outermost[2]),
            float(innermost[3]),
        )
        first = end


def _alike(bounds: Array) -> NDArray[np.bool_]:
    """(n,) in which rows of (n, 4) no bound differs much from that of the first row.

    Not by more than `BORDER_MERGE` / 2, nor between finite and infinite.
    """
    bounds = np.clip(bounds, -1e6, 1e6)
    return np.asarray((np.abs(bounds - bounds[0]) <= BORDER_MERGE / 2).all(axis=1))


def _within_reach(
    low: Array, high: Array, frame: Frame, lattice: Lattice, radius: float
) -> tuple[Array, Array]:
    """Lowest and highest d over all columns that a body in each column can reach.

    `low` and `high` go beyond the lattice by as many columns as it can reach at most.
    """
    bend = float(np.abs(frame.curvature(lattice.corners()[0])).max())
    # On the inside of a bend a metre of body spans more than a metre of the reference line.
    shrunk = 1.0 - bend * np.nan_to_num(np.maximum(np.abs(low), np.abs(high)))
    reach = np.ceil(radius / np.maximum(shrunk, NARROWEST) / lattice.ds).astype(int)
    down, up = np.nan_to_num(low, nan=inf), np.nan_to_num(high, nan=-inf)
    lowest, highest = down.copy(), up.copy()
    for away in range(1, int(reach.max()) + 1):
        far = reach >= away
        lower, higher = np.where(far, down, inf), np.where(far, up, -inf)
        for here, there in ((slice(away, None), slice(-away)), (slice(-away), slice(away, None))):
            np.minimum(lowest[here], lower[there], out=lowest[here])
            np.maximum(highest[here], higher[there], out=highest[here])
    return lowest, highest


def _projected(
    frame: Frame, lattice: Lattice, several: Sequence[Array], radius: float
) -> list[tuple[Array, Array]]:
    """Polylines (n, 2) in the lane frame: (m, 2) where pieces of `BORDER_STEP` begin and end.

    Without those that no body in the lattice comes near to.
    """
    s, d = lattice.corners()
    sides = np.stack([np.stack([s, np.full_like(s, x)], axis=1) for x in (d[0], d[-1])])
    sides = frame.to_cartesian(sides.reshape(-1, 2))
    middle = (sides.min(axis=0) + sides.max(axis=0)) / 2
    farthest = float(np.hypot(*(sides - middle).T).max()) + radius + BEYOND
    points, joined, line = _dense(several, middle, farthest)
    every = frame.to_curvilinear(points)
    pieces = [joined & (line[:-1] == number) for number in range(len(several))]
    return [(every[:-1][mine], every[1:][mine]) for mine in pieces]


def _dense(
    several: Sequence[Array], middle: Array, farthest: float
) -> tuple[Array, NDArray[np.bool_], NDArray[np.int_]]:
    """(m, 2) points of polylines at most `BORDER_STEP` apart.

    Only of the edges that come as near to `middle` as `farthest`. Also which neighbours belong
    together (m - 1,), and the number of each point's polyline (m,).
    """
    corners = np.concatenate(several)
    owner = np.repeat(np.arange(len(several)), [len(line) for line in several])
    edge = np.diff(corners, axis=0)
    lengths = np.hypot(edge[:, 0], edge[:, 1])
    away = np.hypot(*(corners - middle).T)
    comes_near = np.minimum(away[:-1], away[1:]) - lengths <= farthest
    near = np.flatnonzero(comes_near & (owner[:-1] == owner[1:]))
    counts = np.maximum(1, np.ceil(lengths[near] / BORDER_STEP).astype(int))
    # Of a long edge only what is near: a straight lane may be one edge of many kilometres.
    along = edge[near] / np.maximum(lengths[near], 1e-12)[:, None]
    foot = ((middle - corners[near]) * along).sum(axis=1)
    pieces = np.maximum(lengths[near], 1e-12) / counts
    begin = np.clip(np.floor((foot - farthest) / pieces), 0, counts - 1).astype(int)
    end = np.clip(np.ceil((foot + farthest) / pieces), begin + 1, counts).astype(int)
    is_long = counts > LONG
    begin, end = np.where(is_long, begin, 0), np.where(is_long, end, counts)
    # After the last of neighbouring edges, and after a long one, comes its end.
    size = end - begin + (is_long | (np.diff(near, append=-1) != 1))
    edge_of = np.repeat(np.arange(len(near)), size)
    number = np.arange(len(edge_of)) - (np.cumsum(size) - size)[edge_of] + begin[edge_of]
    index = number / counts[edge_of] + near[edge_of]
    at = np.arange(len(corners))
    points = np.column_stack([np.interp(index, at, corners[:, i]) for i in (0, 1)])
    return points, (number < end[edge_of])[:-1], owner[near[edge_of]]


def _per_column(start: Array, end: Array, lines: Array) -> tuple[Array, Array]:
    """Lowest and highest d of a border's pieces in each column; NaN where it does not pass."""
    columns = len(lines) - 1
    low, high = np.full(columns, np.inf), np.full(columns, -np.inf)
    near, far = np.minimum(start, end), np.maximum(start, end)
    first = np.searchsorted(lines, near[:, 0], side="right") - 1
    last = np.searchsorted(lines, far[:, 0], side="left") - 1
    for offset in range(int((last - first).max(initial=0)) + 1):
        column = first + offset
        here = (column <= np.maximum(first, last)) & (column >= 0) & (column < columns)
        np.minimum.at(low, column[here], near[here, 1])
        np.maximum.at(high, column[here], far[here, 1])
    missing = ~np.isfinite(low)
    low[missing], high[missing] = np.nan, np.nan
    return low, high


def leaders(
    scene: Scene, prediction: Prediction, settings: Settings, lanes: tuple[Lane, ...]
) -> tuple[tuple[tuple[Leader, ...], ...], ...]:
    """For each lane and each step, the vehicles in it, rear ends ascending (most likely).

    A vehicle is in a lane if its body touches one of its lanelets. With
    `settings.cut_in_exception`, no distance is asked to one that entered less than `t_c` ago.
    """
    import shapely

    areas = [
        shapely.union_all([x.area() for x in scene.lanelets if x.id in lane.lanelets])
        for lane in lanes
    ]
    found: list[list[list[Leader]]] = [[[] for _ in range(prediction.horizon + 1)] for _ in lanes]
    exempt = round(settings.t_c / scene.dt) if settings.cut_in_exception else 0
    for traffic in in_traffic(prediction):
        inside = traffic.touches(areas)
        rear, speed = traffic.measured(scene.frame, np.asarray(inside.any(axis=0)))
        for of_lane, here in zip(found, inside, strict=True):
            entered = -exempt
            for row in np.flatnonzero(here).tolist():
                k = int(traffic.step[row])
                if traffic.is_first[row]:
                    entered = -exempt
                elif not here[row - 1]:
                    entered = k
                asked = k - entered >= exempt
                of_lane[k].append(Leader(rear[row], speed[row] if asked else inf))
    # Of two side by side the slower one precedes: it asks for more distance.
    return tuple(
        tuple(tuple(sorted(step, key=lambda x: (x.rear, x.speed))) for step in steps)
        for steps in found
    )


def limits(scene: Scene, lanes: tuple[Lane, ...]) -> tuple[Limit, ...]:
    """The signed limits along s over several lanes; unknown where any of them is unknown."""
    by_id = {lanelet.id: lanelet for lanelet in scene.lanelets}
    ids = [i for lane in lanes for i in lane.lanelets]
    signed = [limit for lane in lanes for limit in lane.speed_limits]
    ends = [(line[0], line[-1]) for line in (by_id[i].center for i in ids)]
    s = scene.frame.to_curvilinear(np.reshape(ends, (-1, 2)))[:, 0].reshape(-1, 2)
    spans = list(zip(s.min(axis=1).tolist(), s.max(axis=1).tolist(), signed, strict=True))
    found: list[Limit] = []
    edges = [-inf, *sorted({x for a, b, _ in spans for x in (a, b)}), inf]
    for a, b in pairwise(edges):
        here = [limit for low, high, limit in spans if low <= a + 1e-6 and high >= b - 1e-6]
        known = [limit for limit in here if limit is not None]
        complete = bool(here) and len(known) == len(here)
        lowest, highest = (min(known), max(known)) if complete else (None, None)
        if found and found[-1][2:] == (lowest, highest):
            found[-1] = (found[-1][0], b, lowest, highest)
        elif b - a > 1e-9:
            found.append((a, b, lowest, highest))
    return tuple(found)
