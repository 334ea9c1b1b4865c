"""Cutting the map into cells: from lanelets to a `LaneMap`."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from sandra.errors import ScenarioError
from sandra.prediction.lanes import LaneMap, Strip
from sandra.scene.types import Lanelet

Array = NDArray[np.float64]
Index = NDArray[np.int64]

CELL = 1.0
"""Longest cell [m]."""
EXTENSION_CELL = 4.0
"""Longest cell beyond the end of the map [m]."""
BLOCK = 64
"""So many points of a border are projected onto another at once."""
BACKWARD_EXTENSION = 20.0
"""How far a lanelet without predecessor is continued backwards, for long bodies [m]."""


def build_map(lanelets: tuple[Lanelet, ...], reach: float, shared: bool = True) -> LaneMap:
    """Cut the lanelets into cells; `reach` [m] is how far ends of the map are continued.

    Unless `shared`, progress is left on a scale of its own for each lanelet.

    Raises:
        ScenarioError: if a border has NaN or infinite coordinates.
    """
    known = {lanelet.id for lanelet in lanelets}
    strips = {lanelet.id: _strip(lanelet, known, reach) for lanelet in lanelets}
    if shared:
        _share_progress(strips)
    return LaneMap.of(strips)


def _share_progress(strips: dict[int, Strip]) -> None:
    """Bring the progress of lanelets side by side onto the scale of one of them, in `strips`."""
    done: set[int] = set()
    for first in strips:
        if first in done:
            continue
        done.add(first)
        todo = [first]
        for i in todo:
            for side, j in ((0, strips[i].right_id), (1, strips[i].left_id)):
                if j is None or j in done:
                    continue
                done.add(j)
                todo.append(j)
                scale = _scale(strips[i], strips[j], side)
                if scale is not None:
                    strips[j] = _with_progress(strips[j], scale(strips[j].progress))
                    strips[i] = replace(strips[i], shared=strips[i].shared | {j})
                    strips[j] = replace(strips[j], shared=strips[j].shared | {i})


def _with_progress(strip: Strip, progress: Array) -> Strip:
    cells = np.stack([progress[:-1], progress[1:]], axis=1)
    return replace(
        strip,
        progress=progress,
        behind=cells.min(axis=(1, 2)),
        ahead=cells.max(axis=(1, 2)),
    )


def _strip(lanelet: Lanelet, known: set[int], reach: float) -> Strip:
    right = np.asarray(lanelet.right, dtype=float)
    left = np.asarray(lanelet.left, dtype=float)
    if not (np.isfinite(right).all() and np.isfinite(left).all()):
        raise ScenarioError(
            f"lanelet {lanelet.id}: its borders hold NaN or infinite coordinates; correct the map"
        )
    successors = tuple(i for i in lanelet.successors if i in known)
    predecessors = tuple(i for i in lanelet.predecessors if i in known)
    steps = _cell_counts(right, left, CELL)
    if not predecessors:
        shift = _end_direction(right[::-1], left[::-1]) * BACKWARD_EXTENSION
        right = np.vstack([right[0] + shift, right])
        left = np.vstack([left[0] + shift, left])
        steps = [int(np.ceil(BACKWARD_EXTENSION / EXTENSION_CELL)), *steps]
    if not successors and reach > 0:
        shift = _end_direction(right, left) * reach
        right = np.vstack([right, right[-1] + shift])
        left = np.vstack([left, left[-1] + shift])
        steps = [*steps, int(np.ceil(reach / EXTENSION_CELL))]
    knots = np.concatenate([[0.0], *(i + (np.arange(n) + 1) / n for i, n in enumerate(steps))])
    original = np.arange(len(right))
    right = np.column_stack([np.interp(knots, original, right[:, i]) for i in (0, 1)])
    left = np.column_stack([np.interp(knots, original, left[:, i]) for i in (0, 1)])
    centre = (right + left) / 2
    s = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(centre, axis=0), axis=1))])
    tangent = np.gradient(centre, axis=0)
    tangent /= np.maximum(np.linalg.norm(tangent, axis=1), 1e-12)[:, None]
    width = np.linalg.norm(left - right, axis=1)
    sideways = np.column_stack([-tangent[:, 1], tangent[:, 0]])
    across = np.where(
        width[:, None] > 1e-6, (left - right) / np.maximum(width, 1e-6)[:, None], sideways
    )
    upright = np.clip((across * sideways).sum(axis=1), 0.2, 1.0)
    # How far the ends of a slanted cross-section are ahead of its middle.
    lead = width / 2 * (across * tangent).sum(axis=1)
    progress = np.column_stack([s - lead, s + lead])
    cells = np.stack([right[:-1], right[1:], left[1:], left[:-1]], axis=1)
    same = (lanelet.adjacent_left, lanelet.adjacent_right)
    left_id, right_id = (a[0] if a and a[1] and a[0] in known else None for a in same)
    plain = Strip(
        id=lanelet.id,
        s=s,
        right=right,
        left=left,
        centre=centre,
        across=across,
        half=width / 2,
        progress=progress,
        behind=s[:-1],
        ahead=s[1:],
        stretch=float(1.0 / upright.min()),
        cells=cells,
        corners=np.concatenate([[0], np.cumsum(steps)]).astype(np.int64),
        successors=successors,
        predecessors=predecessors,
        left_id=left_id,
        right_id=right_id,
        shared=frozenset(),
    )
    return _with_progress(plain, progress)


def _cell_counts(right: Array, left: Array, longest: float) -> list[int]:
    sides = [np.linalg.norm(np.diff(side, axis=0), axis=1) for side in (right, left)]
    return [max(1, int(n)) for n in np.ceil(np.maximum(*sides) / longest)]


def _end_direction(right: Array, left: Array) -> Array:
    """Unit vector straight on from the end of a lanelet."""
    centre = (right + left) / 2
    length = np.linalg.norm(centre - centre[-1], axis=1)
    far = np.nonzero(length > 0.5)[0]
    start = int(far[-1]) if len(far) else 0
    along = centre[-1] - centre[start]
    unit: Array = along / max(float(np.hypot(*along)), 1e-12)
    return unit


def _scale(strip: Strip, other: Strip, side: int) -> Callable[[Array], Array] | None:
    """The map from another lanelet's progress to a strip's, along their common border.

    `side`: 0 if the other is to the right, 1 if to the left. None if the borders do not face each
    other over any length.
    """
    border = (strip.right, strip.left)[side]
    facing = (other.left, other.right)[side][other.corners]
    nearest, within = _projected(border, facing)
    # Cells divide the straight edges between the map's points evenly.
    index = other.corners[nearest] + within * np.diff(other.corners)[nearest]
    theirs = np.interp(index, np.arange(len(other.s)), other.progress[:, 1 - side])
    # Beyond the other border's ends all points have the same foot: they tell nothing.
    facing_it = (index > 0) & (index < len(other.s) - 1)
    facing_it[1:] |= facing_it[:-1].copy()
    facing_it[:-1] |= facing_it[1:].copy()
    x, y = theirs[facing_it], strip.progress[facing_it, side]
    rising = np.concatenate([[True], np.diff(np.maximum.accumulate(x)) > 1e-6])[: len(x)]
    x, y = x[rising], np.maximum.accumulate(y)[rising]
    if len(x) < 2:
        return None

    def scale(progress: Array) -> Array:
        ahead = np.maximum(progress - x[-1], 0.0) + np.minimum(progress - x[0], 0.0)
        return np.asarray(np.interp(progress, x, y) + ahead)

    return scale


def _projected(points: Array, line: Array) -> tuple[Index, Array]:
    """For each point (n, 2) the nearest segment of a polyline, and the share of it to the foot."""
    x, y = line[:-1].T
    edge_x, edge_y = np.diff(line, axis=0).T
    length2 = np.maximum(edge_x**2 + edge_y**2, 1e-12)

    def measured(several: Array, among: Index) -> tuple[Array, Array]:
        """Squared distances of points from some segments, and shares."""
        away_x, away_y = several[:, :1] - x[among], several[:, 1:] - y[among]
        share = (away_x * edge_x[among] + away_y * edge_y[among]) / length2[among]
        share = np.clip(share, 0.0, 1.0)
        gap2 = (away_x - share * edge_x[among]) ** 2 + (away_y - share * edge_y[among]) ** 2
        return gap2, share

    every = np.arange(len(x))
    nearest, within = np.empty(len(points), dtype=np.int64), np.empty(len(points))
    for start in range(0, len(points), BLOCK):
        part = points[start : start + BLOCK]
        middle = (part.min(axis=0) + part.max(axis=0)) / 2
        radius = float(np.hypot(*(part - middle).T).max())
        # What is nearest to one of them is nearly nearest to their middle.
        gap = np.sqrt(measured(middle[None], every)[0][0])
        among = np.flatnonzero(gap <= gap.min() + 2 * radius + 1e-6)
        gap2, share = measured(part, among)
        best = gap2.argmin(axis=1)
        nearest[start : start + BLOCK] = among[best]
        within[start : start + BLOCK] = share[np.arange(len(part)), best]
    return nearest, within
