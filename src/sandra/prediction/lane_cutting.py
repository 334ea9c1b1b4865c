"""Cutting the map into cells: from lanelets to a `LaneMap`."""

from __future__ import annotations

from collections.abc import Callable, Iterator
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
    strips = {strip.id: strip for strip in _strips(lanelets, known, reach)}
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


def _strips(lanelets: tuple[Lanelet, ...], known: set[int], reach: float) -> Iterator[Strip]:
    """Cut all lanelets at once: arrays over all cross-sections, one lanelet after another."""
    if not lanelets:
        return
    borders = [_borders(lanelet, known, reach) for lanelet in lanelets]
    sizes = np.array([len(right) for right, _, _ in borders])
    begins = np.cumsum(sizes) - sizes
    edges = np.delete(np.arange(sizes.sum()), begins + sizes - 1)
    sides = [np.concatenate([each[side] for each in borders]) for side in (0, 1)]
    longest = np.maximum(*(_lengths(side[edges + 1] - side[edges]) for side in sides))
    counts = np.concatenate([each for _, _, each in borders])
    counts = np.where(counts > 0, counts, np.maximum(1, np.ceil(longest / CELL))).astype(int)
    right, left = (_divided(side, begins, sizes, edges, counts) for side in sides)
    per_lanelet = np.add.reduceat(counts, begins - np.arange(len(sizes)))
    ends = np.cumsum(per_lanelet + 1)
    firsts = ends - per_lanelet - 1

    centre = (right + left) / 2
    ways = _lengths(np.diff(centre, axis=0))
    s = np.zeros(len(centre))
    for first, end in zip(firsts.tolist(), ends.tolist(), strict=True):
        np.cumsum(ways[first : end - 1], out=s[first + 1 : end])
    tangent = np.empty_like(centre)
    tangent[1:-1] = (centre[2:] - centre[:-2]) / 2
    tangent[firsts] = centre[firsts + 1] - centre[firsts]
    tangent[ends - 1] = centre[ends - 1] - centre[ends - 2]
    tangent /= np.maximum(_lengths(tangent), 1e-12)[:, None]
    width = _lengths(left - right)
    sideways = np.column_stack([-tangent[:, 1], tangent[:, 0]])
    across = np.where(
        width[:, None] > 1e-6, (left - right) / np.maximum(width, 1e-6)[:, None], sideways
    )
    upright = np.clip((across * sideways).sum(axis=1), 0.2, 1.0)
    stretch = 1.0 / np.minimum.reduceat(upright, firsts)
    # How far the ends of a slanted cross-section are ahead of its middle.
    lead = width / 2 * (across * tangent).sum(axis=1)
    progress = np.column_stack([s - lead, s + lead])
    low, high = progress.min(axis=1), progress.max(axis=1)
    behind, ahead = np.minimum(low[:-1], low[1:]), np.maximum(high[:-1], high[1:])
    cells = np.stack([right[:-1], right[1:], left[1:], left[:-1]], axis=1)
    for number, lanelet in enumerate(lanelets):
        own = slice(int(firsts[number]), int(ends[number]))
        between = slice(own.start, own.stop - 1)
        steps = counts[begins[number] - number :][: sizes[number] - 1]
        same = (lanelet.adjacent_left, lanelet.adjacent_right)
        left_id, right_id = (a[0] if a and a[1] and a[0] in known else None for a in same)
        yield Strip(
            id=lanelet.id,
            s=s[own],
            right=right[own],
            left=left[own],
            centre=centre[own],
            across=across[own],
            half=width[own] / 2,
            progress=progress[own],
            behind=behind[between],
            ahead=ahead[between],
            stretch=float(stretch[number]),
            cells=cells[between],
            corners=np.concatenate([[0], np.cumsum(steps)]).astype(np.int64),
            successors=tuple(i for i in lanelet.successors if i in known),
            predecessors=tuple(i for i in lanelet.predecessors if i in known),
            left_id=left_id,
            right_id=right_id,
            shared=frozenset(),
        )


def _borders(lanelet: Lanelet, known: set[int], reach: float) -> tuple[Array, Array, Array]:
    """The right and left border, continued where the map ends, and how to divide their edges.

    The third array has for each edge the number of its cells, 0 where its length decides.
    """
    right = np.asarray(lanelet.right, dtype=float)
    left = np.asarray(lanelet.left, dtype=float)
    if not (np.isfinite(right).all() and np.isfinite(left).all()):
        raise ScenarioError(
            f"lanelet {lanelet.id}: its borders hold NaN or infinite coordinates; correct the map"
        )
    counts = [0] * (len(right) - 1)
    if known.isdisjoint(lanelet.predecessors):
        shift = _end_direction(right[::-1], left[::-1]) * BACKWARD_EXTENSION
        right = np.vstack([right[0] + shift, right])
        left = np.vstack([left[0] + shift, left])
        counts = [int(np.ceil(BACKWARD_EXTENSION / EXTENSION_CELL)), *counts]
    if known.isdisjoint(lanelet.successors) and reach > 0:
        shift = _end_direction(right, left) * reach
        right = np.vstack([right, right[-1] + shift])
        left = np.vstack([left, left[-1] + shift])
        counts = [*counts, int(np.ceil(reach / EXTENSION_CELL))]
    return right, left, np.array(counts)


def _divided(line: Array, begins: Index, sizes: Index, edges: Index, counts: Index) -> Array:
    """Polylines one after another, each edge divided evenly into so many parts.

    Args:
        line: (n, 2) all corners. begins, sizes: of each polyline. edges: the corners at which
            edges begin. counts: parts of each edge.
    """
    owner = np.repeat(np.arange(len(sizes)), sizes - 1)
    part_of = np.repeat(np.arange(len(edges)), counts)
    number = np.arange(len(part_of)) - np.repeat(np.cumsum(counts) - counts, counts) + 1
    local = (edges - begins[owner])[part_of]
    start = edges[part_of]
    share = (local + number / counts[part_of]) - local
    parts = line[start] + share[:, None] * (line[start + 1] - line[start])
    last = number == counts[part_of]
    parts[last] = line[start[last] + 1]
    found = np.empty((len(parts) + len(sizes), 2))
    places = np.arange(len(parts)) + owner[part_of] + 1
    found[places] = parts
    is_first = np.ones(len(found), dtype=bool)
    is_first[places] = False
    found[is_first] = line[begins]
    return found


def _lengths(vectors: Array) -> Array:
    return np.asarray(np.sqrt(vectors[:, 0] ** 2 + vectors[:, 1] ** 2))


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
