"""Lanes in the frame of the current lane: their borders, their vehicles, their limits along s."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from math import inf
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sandra.prediction.types import Prediction
from sandra.reach.lattice import Lattice
from sandra.scene.frame import Frame
from sandra.scene.types import Lane, Scene
from sandra.settings import Settings

Array = NDArray[np.float64]

BORDER_STEP = 0.25
"""Resolution at which lane borders are read [m]."""
BORDER_MARGIN = 0.02
"""Added outwards for what lies between two such points [m]."""
BORDER_MERGE = 0.1
"""Neighbouring stretches of a border are merged up to this difference [m]."""
NOT_IN_TRAFFIC = frozenset({"pedestrian", "trafficIsland", "building", "pillar", "median_strip"})
"""Kinds of obstacles that precede nobody in a lane; collisions with them are still checked."""


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
    """A lane's borders along the lattice's columns, for a body within `radius` [m] of its centre.

    The body reaches beyond its own column, and a border need not be parallel to the frame: the
    outer bounds are those of all columns within reach. Borders are read every `BORDER_STEP`;
    where they are not functions of s (a lanelet that crosses), the highest and lowest d count.
    """
    lines = lattice.corners()[0]
    on_right, on_left = (frame.to_curvilinear(_dense(line)) for line in (right, left))
    ring = frame.to_curvilinear(_dense(np.vstack([right, left[::-1], right[:1]])))
    outer = _within_reach(*_per_column(ring, lines), frame, lattice, radius)
    right_low, right_high = _per_column(on_right, lines)
    left_low, left_high = _per_column(on_left, lines)
    # On an opposite lane the left border is the one with the lower d. Columns in which the lane
    # begins or ends are not all in it.
    start = max(on_right[:, 0].min(), on_left[:, 0].min())
    end = min(on_right[:, 0].max(), on_left[:, 0].max())
    whole = (lines[:-1] >= start) & (lines[1:] <= end)
    inner_low = np.where(whole, np.minimum(right_high, left_high), np.nan)
    inner_high = np.where(whole, np.maximum(right_low, left_low), np.nan)
    bounds = np.column_stack(
        [
            outer[0] - BORDER_MARGIN,
            np.nan_to_num(inner_low, nan=inf) + BORDER_MARGIN,
            np.nan_to_num(inner_high, nan=-inf) - BORDER_MARGIN,
            outer[1] + BORDER_MARGIN,
        ]
    )
    found: list[Stretch] = []
    first = -1
    for i in np.flatnonzero(np.isfinite(bounds[:, 0])).tolist():
        part = bounds[first : i + 1]
        if first >= 0 and found[-1].s_high == lines[i] and _alike(part):
            found.pop()
        else:
            first, part = i, bounds[i : i + 1]
        outermost, innermost = part.min(axis=0), part.max(axis=0)
        found.append(
            Stretch(
                float(lines[first]),
                float(lines[i + 1]),
                float(outermost[0]),
                float(innermost[1]),
                float(outermost[2]),
                float(innermost[3]),
            )
        )
    return tuple(found)


def _alike(bounds: Array) -> bool:
    """Whether no bound changes by more than `BORDER_MERGE` / 2, nor between finite and infinite."""
    bounds = np.clip(bounds, -1e6, 1e6)
    return bool((np.abs(bounds - bounds[0]) <= BORDER_MERGE / 2).all())


def _within_reach(
    low: Array, high: Array, frame: Frame, lattice: Lattice, radius: float
) -> tuple[Array, Array]:
    """Lowest and highest d over all columns that a body in each column can reach."""
    bend = float(np.abs(frame.curvature(lattice.corners()[0])).max())
    # On the inside of a bend a metre of body spans more than a metre of the reference line.
    shrunk = 1.0 - bend * np.nan_to_num(np.maximum(np.abs(low), np.abs(high)))
    reach = np.ceil(radius / np.maximum(shrunk, 0.2) / lattice.ds).astype(int)
    lowest, highest = np.full_like(low, np.inf), np.full_like(high, -np.inf)
    for i in np.flatnonzero(np.isfinite(low)).tolist():
        near = slice(max(0, i - int(reach[i])), i + int(reach[i]) + 1)
        lowest[near] = np.minimum(lowest[near], low[i])
        highest[near] = np.maximum(highest[near], high[i])
    return lowest, highest


def _dense(line: Array) -> Array:
    """The polyline with points at most `BORDER_STEP` apart."""
    lengths = np.linalg.norm(np.diff(line, axis=0), axis=1)
    counts = np.maximum(1, np.ceil(lengths / BORDER_STEP).astype(int))
    index = np.concatenate([np.arange(n) / n + i for i, n in enumerate(counts)] + [[len(counts)]])
    return np.column_stack([np.interp(index, np.arange(len(line)), line[:, i]) for i in (0, 1)])


def _per_column(points: Array, lines: Array) -> tuple[Array, Array]:
    """Lowest and highest d of a border in each column; NaN where it does not pass."""
    columns = len(lines) - 1
    low, high = np.full(columns, np.inf), np.full(columns, -np.inf)
    s, d = points[:, 0], points[:, 1]
    start, end = np.minimum(s[:-1], s[1:]), np.maximum(s[:-1], s[1:])
    first = np.searchsorted(lines, start, side="right") - 1
    last = np.searchsorted(lines, end, side="left") - 1
    down, up = np.minimum(d[:-1], d[1:]), np.maximum(d[:-1], d[1:])
    for offset in range(int((last - first).max(initial=0)) + 1):
        column = first + offset
        here = (column <= np.maximum(first, last)) & (column >= 0) & (column < columns)
        np.minimum.at(low, column[here], down[here])
        np.maximum.at(high, column[here], up[here])
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
    areas = [_area(scene, lane) for lane in lanes]
    found: list[list[list[Leader]]] = [[[] for _ in range(prediction.horizon + 1)] for _ in lanes]
    exempt = round(settings.t_c / scene.dt) if settings.cut_in_exception else 0
    for predicted in prediction.obstacles:
        obstacle = predicted.obstacle
        rows = predicted.states
        present = np.flatnonzero(np.isfinite(rows[:, :4]).all(axis=1))
        if obstacle.kind in NOT_IN_TRAFFIC or present.size == 0:
            continue
        bodies = np.vstack([obstacle.outline.placed(*rows[k, :3]).vertices for k in present])
        corners = scene.frame.to_curvilinear(bodies).reshape(len(present), -1, 2)
        radius = obstacle.outline.radius
        rear = corners[:, :, 0].min(axis=1) - radius
        middle = corners[:, :, 0].mean(axis=1)
        heading = scene.frame.heading(middle)
        speed = np.maximum(rows[present, 3] * np.cos(rows[present, 2] - heading), 0.0)
        for of_lane, area in zip(found, areas, strict=True):
            inside = _touches(area, bodies.reshape(len(present), -1, 2), radius)
            entered = -exempt
            for i in np.flatnonzero(inside).tolist():
                k = int(present[i])
                if i > 0 and not inside[i - 1]:
                    entered = k
                asked = k - entered >= exempt
                of_lane[k].append(Leader(float(rear[i]), float(speed[i]) if asked else inf))
    # Of two side by side the slower one precedes: it asks for more distance.
    return tuple(
        tuple(tuple(sorted(step, key=lambda x: (x.rear, x.speed))) for step in steps)
        for steps in found
    )


def _area(scene: Scene, lane: Lane) -> Any:
    """The lanelets of a lane, as a shapely geometry."""
    import shapely

    area = shapely.union_all(
        [lanelet.area() for lanelet in scene.lanelets if lanelet.id in lane.lanelets]
    )
    shapely.prepare(area)
    return area


def _touches(area: Any, bodies: Array, radius: float) -> NDArray[np.bool_]:
    """Whether convex bodies (m, n, 2), widened by `radius`, touch an area."""
    import shapely

    hulls = shapely.convex_hull(shapely.multipoints(shapely.points(bodies)))
    return np.asarray(shapely.dwithin(area, hulls, radius), dtype=np.bool_)


def limits(scene: Scene, lanes: tuple[Lane, ...]) -> tuple[Limit, ...]:
    """The signed limits along s over several lanes; unknown where any of them is unknown."""
    by_id = {lanelet.id: lanelet for lanelet in scene.lanelets}
    spans: list[tuple[float, float, float | None]] = []
    for lane in lanes:
        for lanelet_id, limit in zip(lane.lanelets, lane.speed_limits, strict=True):
            s = scene.frame.to_curvilinear(by_id[lanelet_id].center[[0, -1]])[:, 0]
            spans.append((float(s.min()), float(s.max()), limit))
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
