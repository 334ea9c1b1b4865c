"""Lanes in the frame of the current lane: their borders, their vehicles, their limits along s."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from math import inf

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
    """Part of a lane in the frame of the current lane: bounds of its two borders there [m]."""

    s_low: float
    s_high: float
    right_low: float
    right_high: float
    left_low: float
    left_high: float


@dataclass(frozen=True, slots=True)
class Leader:
    """Rear end [m] and speed [m/s] of a vehicle in a lane at some step."""

    rear: float
    speed: float


Band = tuple[Stretch, ...]
"""A lane's stretches, ascending in s; empty where the lane is elsewhere."""

Limit = tuple[float, float, float | None, float | None]
"""(s_low, s_high, lowest, highest limit [m/s] or None) over the lanes that the ego may use."""


def band(frame: Frame, lattice: Lattice, left: Array, right: Array) -> Band:
    """A lane's borders along the lattice's columns.

    Borders are read every `BORDER_STEP`; where they are not functions of s (a lanelet that
    crosses), the highest and lowest d per column bound the touching region from outside.
    """
    lines = lattice.corners()[0]
    right_low, right_high = _per_column(frame.to_curvilinear(_dense(right)), lines)
    left_low, left_high = _per_column(frame.to_curvilinear(_dense(left)), lines)
    low = np.minimum(right_low, left_low) - BORDER_MARGIN
    high = np.maximum(right_high, left_high) + BORDER_MARGIN
    found: list[Stretch] = []
    for i in np.flatnonzero(np.isfinite(low) & np.isfinite(high)).tolist():
        new = Stretch(
            float(lines[i]),
            float(lines[i + 1]),
            float(low[i]),
            float(right_high[i]) + BORDER_MARGIN,
            float(left_low[i]) - BORDER_MARGIN,
            float(high[i]),
        )
        joined = _join(found[-1], new) if found else None
        if joined is None:
            found.append(new)
        else:
            found[-1] = joined
    return tuple(found)


def _join(a: Stretch, b: Stretch) -> Stretch | None:
    if abs(a.s_high - b.s_low) > 1e-6:
        return None
    right = (min(a.right_low, b.right_low), max(a.right_high, b.right_high))
    left = (min(a.left_low, b.left_low), max(a.left_high, b.left_high))
    if right[1] - right[0] > BORDER_MERGE or left[1] - left[0] > BORDER_MERGE:
        return None
    return Stretch(a.s_low, b.s_high, *right, *left)


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
    scene: Scene, prediction: Prediction, settings: Settings, bands: tuple[Band, ...]
) -> tuple[tuple[tuple[Leader, ...], ...], ...]:
    """For each band and each step, the vehicles in it, rear ends ascending (most likely).

    A vehicle is in a lane where its body overlaps the lane's band at the body's middle. With
    `settings.cut_in_exception`, a vehicle that entered less than `t_c` ago is left out.
    """
    found: list[list[list[Leader]]] = [[[] for _ in range(prediction.horizon + 1)] for _ in bands]
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
        low, high = corners.min(axis=1) - radius, corners.max(axis=1) + radius
        middle = corners[:, :, 0].mean(axis=1)
        heading = scene.frame.heading(middle)
        speed = np.maximum(rows[present, 3] * np.cos(rows[present, 2] - heading), 0.0)
        for of_band, lane in zip(found, bands, strict=True):
            inside = _inside(lane, middle, low[:, 1], high[:, 1])
            entered = -exempt
            for i in np.flatnonzero(inside).tolist():
                k = int(present[i])
                if i > 0 and not inside[i - 1]:
                    entered = k
                if k - entered >= exempt:
                    of_band[k].append(Leader(float(low[i, 0]), float(speed[i])))
    return tuple(
        tuple(tuple(sorted(step, key=lambda x: x.rear)) for step in steps) for steps in found
    )


def _inside(lane: Band, middle: Array, low: Array, high: Array) -> NDArray[np.bool_]:
    inside = np.zeros(len(middle), dtype=np.bool_)
    if lane:
        index = np.searchsorted([x.s_low for x in lane], middle, side="right") - 1
        for i in np.flatnonzero(index >= 0).tolist():
            x = lane[int(index[i])]
            inside[i] = middle[i] <= x.s_high and high[i] > x.right_high and low[i] < x.left_low
    return inside


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
