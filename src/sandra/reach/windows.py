"""Which cells the others forbid: where the disc in the ego's body meets them for sure.

A cell is forbidden if its four corners are within reach of one convex region: then, up to the bulge
that the reach is shortened by, so is all of the cell. The corners of a column's border stand on a
straight line, and a line meets a convex region, widened by the reach, in one interval: so nothing
is computed per cell, only one interval per region and line.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from sandra.prediction.geometry import stack
from sandra.prediction.types import Prediction
from sandra.reach.lattice import Mask, Masks
from sandra.scene.types import Region

Array = NDArray[np.float64]
Ints = NDArray[np.int_]
Window = tuple[int, int, int, int, Mask]
"""Cells i0 <= i < i1, j0 <= j < j1 and which of them are forbidden."""
Windows = tuple[tuple[Window, ...], ...]
"""The windows of one obstacle at each step."""

BLOCK = 8
"""So many neighbouring lines are compared with a region at once, to see whether they are near."""
BATCH = 2048
"""About so many pairs of a region and a line are measured at once: they stay in the cache."""


def windows(prediction: Prediction, corners: Array, reach: Array) -> tuple[Windows, ...]:
    """The forbidden windows of each obstacle at each step.

    Args:
        prediction: its regions at each step.
        corners: (columns + 1, rows + 1, 2) corners of the lattice's cells in the plane [m]; those
            of each column are evenly spaced on a straight line.
        reach: (columns,) how near a cell's corners must be to a region to forbid the cell [m].
            On a line between two columns the smaller one counts for both.
    """
    return on_lines(prediction, Lines.of(corners, reach))


def on_lines(prediction: Prediction, lines: Lines) -> tuple[Windows, ...]:
    """The same for the lines on which the corners stand."""
    regions = distinct(prediction)
    found: dict[int, list[Window]] = {key: [] for key in regions}
    if regions:
        several = list(regions.values())
        for number, window in _windows(several, lines):
            found[id(several[number])].append(window)
    return tuple(
        tuple(tuple(w for region in at for w in found[id(region)]) for at in obstacle.at)
        for obstacle in prediction.obstacles
    )


def distinct(prediction: Prediction) -> dict[int, Region]:
    """Each region once, by its identity: what does not move has the same one at every step."""
    return {
        id(region): region
        for obstacle in prediction.obstacles
        for at in obstacle.at
        for region in at
    }


def union(off_road: Mask, occupied: Sequence[Windows], horizon: int) -> Masks:
    """All forbidden cells of each step 0..horizon, read-only."""
    # Rows of cells along s lie together in memory, which is how they are packed.
    masks = [np.array(off_road, order="F") for _ in range(horizon + 1)]
    for steps in occupied:
        for mask, step in zip(masks, steps, strict=True):
            for i0, i1, j0, j1, cells in step:
                mask[i0:i1, j0:j1] |= cells
    for mask in masks:
        mask.setflags(write=False)
    return Masks(masks)


@dataclass(frozen=True, slots=True, eq=False)
class Lines:
    """n lines across the road, on which the corners of the cells stand."""

    start: Array
    """(n, 2) first corner of each."""
    along: Array
    """(n, 2) unit vectors towards the last one."""
    spacing: Array
    """(n,) distance between two corners [m]."""
    reach: Array
    """(n,)"""
    rows: int

    @staticmethod
    def of(corners: Array, reach: Array) -> Lines:
        return Lines.between(corners[:, 0], corners[:, -1], corners.shape[1] - 1, reach)

    @staticmethod
    def between(first: Array, last: Array, rows: int, reach: Array) -> Lines:
        """From the first corner of each line (n, 2) to its last; `reach` (n - 1,) of columns."""
        way = last - first
        length = np.hypot(way[:, 0], way[:, 1])
        per_line = np.minimum(np.append(reach, np.inf), np.append(np.inf, reach))
        return Lines(first, way / length[:, None], length / rows, per_line, rows)

    def near(self, middle: Array, radius: Array) -> tuple[Ints, Ints]:
        """Pairs of a disc and a line that may meet, the lines of each disc ascending.

        Args:
            middle: (R, 2), radius: (R,) of the discs [m], without the lines' reach.
        """
        count = len(self.start)
        # Each block of lines has the axes of one of them.
        block = np.arange(0, count, BLOCK)
        own = np.minimum(block + BLOCK // 2, count - 1)
        mine = np.minimum(block[:, None] + np.arange(BLOCK), count - 1)
        ends = np.stack([self.start, self.start + self.along * (self.spacing * self.rows)[:, None]])
        around = ends[:, mine] - self.start[own][None, :, None]
        margin = radius + self.reach.max()
        near = np.ones((len(middle), len(block)), dtype=bool)
        for axis in (self.along[own], self.along[own][:, ::-1] * (-1.0, 1.0)):
            at = (around * axis[:, None]).sum(axis=3)
            place = middle @ axis.T - (self.start[own] * axis).sum(axis=1)
            near &= place >= at.min(axis=(0, 2)) - margin[:, None]
            near &= place <= at.max(axis=(0, 2)) + margin[:, None]
        disc, some = np.nonzero(near)
        line = (block[some][:, None] + np.arange(BLOCK)).ravel()
        there = line < count
        return np.repeat(disc, BLOCK)[there], line[there]


def _windows(regions: list[Region], lines: Lines) -> list[tuple[int, Window]]:
    """The windows of regions, with the region's number."""
    found: list[tuple[int, Window]] = []
    sizes = np.array([len(region.vertices) for region in regions])
    radii = np.array([region.radius for region in regions])
    # Those with about as many corners together: batches are as wide as their widest polygon.
    width = np.maximum(4, 1 << np.ceil(np.log2(sizes)).astype(int))
    for each in sorted(set(width.tolist())):
        group = np.flatnonzero(width == each)
        corners = np.ascontiguousarray(stack([regions[i].vertices for i in group.tolist()]).T)
        middle = (corners.min(axis=1) + corners.max(axis=1)) / 2
        size = np.hypot(*(corners - middle[:, None])).max(axis=0)
        region, line = lines.near(middle.T, size + radii[group])
        for part in _batches(region):
            r, i = region[part], line[part]
            low, high = _intervals(corners[:, :, r], radii[group[r]], lines, i)
            found += _collected(group[r], i, low, high, lines.rows)
    return found


def _batches(region: Ints) -> list[slice]:
    """Parts of ascending numbers, so many that they stay in the cache, cut between two of them."""
    ends = [0]
    while ends[-1] < len(region):
        last = region[min(ends[-1] + BATCH, len(region) - 1)]
        end = int(np.searchsorted(region, last))
        ends.append(end if end > ends[-1] else int(np.searchsorted(region, last, side="right")))
    return [slice(a, b) for a, b in pairwise(ends)]


def _intervals(corners: Array, radius: Array, lines: Lines, line: Ints) -> tuple[Array, Array]:
    """(P,) where each line is within reach of its own convex region, as numbers of corners.

    The border of a widened polygon consists of arcs about its corners and of edges, moved
    outwards; the interval ends where the line meets one of them. low > high where it meets none.

    Args:
        corners: (2, V, P) of the polygons, turning either way [m].
        radius: (P,) of the regions [m].
        line: (P,) numbers of the lines.
    """
    (start_x, start_y), (along_x, along_y) = lines.start[line].T, lines.along[line].T
    away_x, away_y = corners[0] - start_x, corners[1] - start_y
    # In the line's own axes it is y = 0.
    x, y = away_x * along_x + away_y * along_y, away_y * along_x - away_x * along_y
    reach = radius + lines.reach[line]
    squared = reach**2 - y**2
    squared[:, reach < 0.0] = -np.inf
    meets = squared >= 0.0
    half = np.sqrt(np.maximum(squared, 0.0))
    low, high = np.where(meets, x - half, np.inf), np.where(meets, x + half, -np.inf)
    edge_x, edge_y = np.roll(x, -1, axis=0) - x, np.roll(y, -1, axis=0) - y
    area = (x * edge_y - y * edge_x).sum(axis=0)
    length = np.sqrt(edge_x**2 + edge_y**2)
    outwards = np.where(area < 0.0, -reach, reach) / np.maximum(length, 1e-9)
    # The moved edge begins at (x + edge_y outwards, y - edge_x outwards).
    with np.errstate(divide="ignore", invalid="ignore"):
        share = (edge_x * outwards - y) / edge_y
    crossed = (share >= 0.0) & (share <= 1.0) & (reach >= 0.0)
    at = x + edge_y * outwards + np.where(crossed, share, 0.0) * edge_x
    low = np.minimum(low, np.where(crossed, at, np.inf)).min(axis=0)
    high = np.maximum(high, np.where(crossed, at, -np.inf)).max(axis=0)
    return low / lines.spacing[line], high / lines.spacing[line]


def _collected(
    region: Ints, line: Ints, low: Array, high: Array, rows: int
) -> list[tuple[int, Window]]:
    """Put the columns of each region together to windows; neighbours in `line` are neighbours.

    A cell is forbidden if all four corners are: those of its column's two lines.
    """
    first = np.ceil(np.clip(np.maximum(low[:-1], low[1:]), 0.0, rows)).astype(int)
    last = np.floor(np.clip(np.minimum(high[:-1], high[1:]), 0.0, rows)).astype(int)
    beside = (region[:-1] == region[1:]) & (line[:-1] + 1 == line[1:])
    kept = np.flatnonzero(beside & (first < last))
    if not len(kept):
        return []
    region, column, first, last = region[kept], line[kept], first[kept], last[kept]
    begins = np.flatnonzero((np.diff(region, prepend=-1) != 0) | (np.diff(column, prepend=-2) != 1))
    lowest, highest = np.minimum.reduceat(first, begins), np.maximum.reduceat(last, begins)
    ends = np.append(begins[1:], len(kept))
    row = np.repeat(lowest, ends - begins)[:, None] + np.arange((highest - lowest).max())
    cells = (row >= first[:, None]) & (row < last[:, None])
    return [
        (r, (i0, i0 + b - a, j0, j1, cells[a:b, : j1 - j0]))
        for r, i0, j0, j1, a, b in zip(
            *(x.tolist() for x in (region[begins], column[begins], lowest, highest, begins, ends)),
            strict=True,
        )
    ]
