"""Which cells the others forbid: where the disc in the ego's body meets them for sure.

A cell is forbidden if its four corners are within reach of one convex region: then, up to the bulge
that the reach is shortened by, so is all of the cell. Most cells are far from a region or well
within it, and one look at a block of them tells; corners are measured one by one only in the
blocks along its border.
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
"""A block has so many cells along s, and along d."""
BATCH = 512
"""So many pairs of a region and a block are measured at once: they stay in the cache."""


def windows(prediction: Prediction, corners: Array, reach: Array) -> tuple[Windows, ...]:
    """The forbidden windows of each obstacle at each step.

    Args:
        prediction: its regions at each step.
        corners: (columns + 1, rows + 1, 2) corners of the lattice's cells in the plane [m].
        reach: (columns,) how near a cell's corners must be to a region to forbid the cell [m].
    """
    found: list[list[list[Window]]] = [
        [[] for _ in range(prediction.horizon + 1)] for _ in prediction.obstacles
    ]
    places: list[list[Window]] = []
    regions: list[Region] = []
    for mine, obstacle in zip(found, prediction.obstacles, strict=True):
        for at_step, several in zip(mine, obstacle.at, strict=True):
            places += [at_step] * len(several)
            regions += several
    if regions:
        for place, window in zip(places, _windows(regions, corners, reach), strict=True):
            if window is not None:
                place.append(window)
    return tuple(tuple(map(tuple, steps)) for steps in found)


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
class _Blocks:
    """B blocks of cells. The lattice is filled up to whole blocks with cells that never count."""

    column: Ints
    row: Ints
    """(B,) first cell of each."""
    corners: Array
    """(B, BLOCK + 1, BLOCK + 1, 2)"""
    reach: Array
    """(B, BLOCK) of the block's columns; -inf where there is no column."""
    middle: Array
    """(B, 2)"""
    radius: Array
    """(B,) all corners of the block are that near to its middle."""

    @staticmethod
    def of(corners: Array, reach: Array) -> _Blocks:
        columns, rows = corners.shape[0] - 1, corners.shape[1] - 1
        missing = (-columns % BLOCK, -rows % BLOCK)
        corners = np.pad(corners, ((0, missing[0]), (0, missing[1]), (0, 0)), mode="edge")
        reach = np.pad(reach, (0, missing[0]), constant_values=-np.inf)
        first = np.meshgrid(*(np.arange(0, n, BLOCK) for n in (columns, rows)), indexing="ij")
        column, row = (each.ravel() for each in first)
        step = np.arange(BLOCK + 1)
        mine = corners[(column[:, None] + step)[:, :, None], (row[:, None] + step)[:, None, :]]
        middle = (mine.min(axis=(1, 2)) + mine.max(axis=(1, 2))) / 2
        away = mine - middle[:, None, None]
        radius = np.hypot(away[..., 0], away[..., 1]).max(axis=(1, 2))
        return _Blocks(column, row, mine, reach[column[:, None] + step[:-1]], middle, radius)


@dataclass(frozen=True, slots=True, eq=False)
class _Edges:
    """The edges of R convex polygons; those without length of a polygon with area never count.

    A point's `height` over an edge is normal . p - offset, positive outside. It is positive
    everywhere for polygons without area, which have no inside.
    """

    start: Array
    edge: Array
    normal: Array
    """(R, V, 2)"""
    squared: Array
    offset: Array
    """(R, V)"""

    @staticmethod
    def of(polygons: Array) -> _Edges:
        edge = np.roll(polygons, -1, axis=1) - polygons
        squared = (edge**2).sum(axis=2)
        away = polygons - polygons[:, :1]
        area = (away[..., 0] * edge[..., 1] - away[..., 1] * edge[..., 0]).sum(axis=1)
        turn = np.where(np.abs(area) > 1e-12, np.sign(area), 0.0)
        length = np.sqrt(np.maximum(squared, 1e-18))
        right = np.stack([edge[..., 1], -edge[..., 0]], axis=2)
        normal = right * (turn[:, None] / length)[..., None]
        offset = (normal * polygons).sum(axis=2)
        offset[squared < 1e-18] = np.inf
        offset[turn == 0.0] = -1e-9
        return _Edges(polygons, edge, normal, np.maximum(squared, 1e-18), offset)


def _windows(regions: list[Region], corners: Array, reach: Array) -> list[Window | None]:
    """The window of each region, None where it forbids nothing."""
    blocks = _Blocks.of(corners, reach)
    polygons = stack([region.vertices for region in regions])
    radius = np.array([region.radius for region in regions])
    region, block = _near(polygons, radius, blocks)
    edges = _Edges.of(polygons)
    height = np.empty((len(region), polygons.shape[1]))
    for part in _batches(len(region), BATCH * 16):
        r, b = region[part], block[part]
        height[part] = (
            edges.normal[r, :, 0] * blocks.middle[b, :1]
            + edges.normal[r, :, 1] * blocks.middle[b, 1:]
            - edges.offset[r]
        )
    highest = height.max(axis=1)
    size = blocks.radius[block]
    most = radius[region] + blocks.reach.max(axis=1)[block]
    near = highest <= size + most
    height, highest = height[near], highest[near]
    region, block, size = region[near], block[near], size[near]
    least = np.where(np.isfinite(blocks.reach), blocks.reach, np.inf).min(axis=1)[block]
    within = (highest <= 0.0) & (highest + size <= radius[region] + least)
    cells = np.empty((len(region), BLOCK, BLOCK), dtype=bool)
    cells[within] = np.isfinite(blocks.reach[block[within]])[:, :, None]
    unclear = np.flatnonzero(~within)
    for part in _batches(len(unclear), BATCH):
        i = unclear[part]
        # Over other edges no point of the block is outside.
        counts = height[i] > -size[i, None]
        allowed = radius[region[i], None] + blocks.reach[block[i]]
        cells[i] = _measured(blocks.corners[block[i]], edges, region[i], counts, allowed)
    return _collected(len(regions), region, block, cells, blocks, corners)


def _near(polygons: Array, radius: Array, blocks: _Blocks) -> tuple[Ints, Ints]:
    """Pairs of a region and a block whose boxes come within reach of each other."""
    low, high = polygons.min(axis=1), polygons.max(axis=1)
    around = (blocks.radius + blocks.reach.max(axis=1))[:, None]
    left, right = blocks.middle - around, blocks.middle + around
    some = np.flatnonzero(
        (low - radius[:, None] <= right.max(axis=0)).all(axis=1)
        & (high + radius[:, None] >= left.min(axis=0)).all(axis=1)
    )
    pairs = []
    for part in _batches(len(some), BATCH):
        r = some[part]
        near = np.ones((len(r), len(blocks.radius)), dtype=bool)
        for axis in (0, 1):
            near &= (low[r, axis] - radius[r])[:, None] <= right[:, axis]
            near &= (high[r, axis] + radius[r])[:, None] >= left[:, axis]
        found, block = np.nonzero(near)
        pairs.append((r[found], block))
    if not pairs:
        return np.empty(0, dtype=int), np.empty(0, dtype=int)
    return np.concatenate([p[0] for p in pairs]), np.concatenate([p[1] for p in pairs])


def _measured(corners: Array, edges: _Edges, region: Ints, counts: Mask, allowed: Array) -> Mask:
    """(P, BLOCK, BLOCK) which cells of each pair's block are within reach of its region.

    Args:
        corners: (P, BLOCK + 1, BLOCK + 1, 2).
        region: (P,) the row of the pair's region in `edges`.
        counts: (P, V) the edges that some point of the block may be outside of; nearest to a point
            outside the polygon is always one of those that it is outside of.
        allowed: (P, BLOCK) how near the corners of cells in each column must be [m].
    """
    shape = corners.shape[:3]
    x, y = corners[..., 0].reshape(len(region), -1), corners[..., 1].reshape(len(region), -1)
    highest = np.full(x.shape, -np.inf)
    nearest = np.full(x.shape, np.inf)
    order = np.argsort(~counts, axis=1, kind="stable")
    number = counts.sum(axis=1)
    for turn in range(int(number.max(initial=0))):
        rows = np.flatnonzero(number > turn)
        r, e = region[rows], order[rows, turn]
        (edge_x, edge_y), (start_x, start_y) = edges.edge[r, e].T, edges.start[r, e].T
        normal_x, normal_y = edges.normal[r, e].T
        away_x, away_y = x[rows] - start_x[:, None], y[rows] - start_y[:, None]
        height = normal_x[:, None] * x[rows] + normal_y[:, None] * y[rows]
        height -= edges.offset[r, e][:, None]
        share = away_x * edge_x[:, None] + away_y * edge_y[:, None]
        share = np.clip(share / edges.squared[r, e][:, None], 0.0, 1.0)
        away_x -= share * edge_x[:, None]
        away_y -= share * edge_y[:, None]
        highest[rows] = np.maximum(highest[rows], height)
        nearest[rows] = np.minimum(nearest[rows], away_x**2 + away_y**2)
    away = np.where(highest <= 0.0, 0.0, np.sqrt(nearest)).reshape(shape)
    away = np.maximum(away[:, :-1], away[:, 1:])
    return np.asarray(np.maximum(away[:, :, :-1], away[:, :, 1:]) <= allowed[:, :, None])


def _collected(
    count: int, region: Ints, block: Ints, cells: Mask, blocks: _Blocks, corners: Array
) -> list[Window | None]:
    """Put the blocks of each region together to one window."""
    found: list[Window | None] = [None] * count
    used = cells.any(axis=(1, 2))
    region, block, cells = region[used], block[used], cells[used]
    columns, rows = corners.shape[0] - 1, corners.shape[1] - 1
    first = np.flatnonzero(np.diff(region, prepend=-1))
    for start, end in pairwise([*first.tolist(), len(region)]):
        i, j = blocks.column[block[start:end]], blocks.row[block[start:end]]
        i0, j0 = int(i.min()), int(j.min())
        i1, j1 = int(i.max()) + BLOCK, int(j.max()) + BLOCK
        mask = np.zeros(((i1 - i0) // BLOCK, BLOCK, (j1 - j0) // BLOCK, BLOCK), dtype=bool)
        mask[(i - i0) // BLOCK, :, (j - j0) // BLOCK] = cells[start:end]
        i1, j1 = min(i1, columns), min(j1, rows)
        whole = mask.reshape(mask.shape[0] * BLOCK, -1)[: i1 - i0, : j1 - j0]
        if whole.any():
            found[int(region[start])] = (i0, i1, j0, j1, whole)
    return found


def _batches(count: int, size: int) -> list[slice]:
    return [slice(i, i + size) for i in range(0, count, size)]
