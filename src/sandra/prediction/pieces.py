"""Pieces of slices: where a vehicle's centre may be, cut, widened by its body, and cut again."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sandra.prediction.geometry import clip, minkowski, stack, trimmed, unpadded
from sandra.prediction.lane_table import LaneTable
from sandra.prediction.touched import ROUNDING, Touched, Vehicle, bodies_of

Array = NDArray[np.float64]
Ints = NDArray[np.int_]
Mask = NDArray[np.bool_]

FAR = 1e9
"""Stands for "not bounded" [m]."""
BATCH = 2048
"""So many pieces are cut at once: they stay in the cache."""


@dataclass(frozen=True, slots=True, eq=False)
class Entries:
    """E lanelets (by number in the table) that vehicles may be on in some row (see `Vehicle`).

    Where on them: progress m or more, y within [low, high] [m].
    """

    vehicle: Ints
    row: Ints
    lanelet: Ints
    m: Array
    low: Array
    high: Array


@dataclass(frozen=True, slots=True, eq=False)
class Pieces:
    """P slices that vehicles may be on, and `bounds` (P, 3) of the centre there [m].

    They are (rear, right, left): the first along the slice, the others across it.
    """

    vehicle: Ints
    row: Ints
    slice: Ints
    bounds: Array

    @staticmethod
    def of(table: LaneTable, touched: Touched, entries: Entries, first_row: Ints) -> Pieces:
        """The slices of the entries' lanelets that are touched, from row `first_row` (V,) on."""
        counts = np.diff(table.slice)[entries.lanelet]
        entry = np.repeat(np.arange(len(counts)), counts)
        start = table.slice[entries.lanelet] - (np.cumsum(counts) - counts)
        part = start[entry] + np.arange(len(entry))
        ahead = np.array([x.ahead for x in table.slices])
        kept = touched.slices[entries.vehicle[entry], entries.row[entry], part]
        wanted = entries.row >= first_row[entries.vehicle]
        kept &= (entries.m[entry] <= ahead[part]) & wanted[entry]
        entry, part = entry[kept], part[kept]
        m, low, high = entries.m[entry], entries.low[entry], entries.high[entry]
        return Pieces(
            entries.vehicle[entry], entries.row[entry], part, _bounds(table, part, m, low, high)
        )


def _bounds(table: LaneTable, part: Ints, m: Array, low: Array, high: Array) -> Array:
    """Bounds (rear, right, left) of the points of progress m or more and y within [low, high].

    Right and left are the extremes over all cross-sections of a slice, each shortened to y within
    [low, high].
    """
    lag = np.array([x.lag for x in table.slices])
    bounds = np.column_stack([np.maximum(m - lag[part], -FAR), np.empty((len(part), 2))])
    order = np.argsort(part, kind="stable")
    starts = np.flatnonzero(np.diff(part[order], prepend=-1))
    lanelet = np.repeat(np.arange(len(table.strips)), np.diff(table.slice))
    for rows in np.split(order, starts[1:]) if len(part) else []:
        number = int(part[rows[0]])
        strip, mine = table.strips[lanelet[number]], table.slices[number]
        index = slice(mine.first, mine.last + 1)
        across = np.array([-mine.along[1], mine.along[0]])
        half = strip.half[index]
        centre, unit = strip.centre[index] @ across, strip.across[index] @ across
        # Most may be anywhere between the borders.
        for column, y, end, inside in (
            (1, low[rows], -half, low[rows] > -half.max()),
            (2, high[rows], half, high[rows] < half.max()),
        ):
            extreme = np.min if column == 1 else np.max
            bounds[rows, column] = extreme(centre + end * unit)
            some = np.clip(y[inside, None], -half, half)
            bounds[rows[inside], column] = extreme(centre + some * unit, axis=1)
    return bounds


def cut(
    table: LaneTable,
    vehicles: Sequence[Vehicle],
    touched: Touched,
    pieces: Pieces,
    edges: Array,
) -> Iterator[tuple[int, int, Array]]:
    """(vehicle, row, polygon) of each piece in which something is left.

    Args:
        edges: (P, 2) how far the body may reach to the right and left, across the slice [m].
    """
    # For each piece all half-planes: those of the acceleration-based set, then its own bounds.
    own = np.stack([-table.along, -table.across, table.across], axis=1)
    far_end = np.concatenate([touched.far_end, _own_ends(table, own, len(vehicles))], axis=1)
    normals = np.stack([x.normals for x in vehicles])
    offsets = np.stack([x.offsets for x in vehicles]) + ROUNDING
    hulls = stack([part.hull for part in table.slices])
    limits = np.hstack([offsets[pieces.vehicle, pieces.row], pieces.bounds * (-1.0, -1.0, 1.0)])
    needed = far_end[pieces.vehicle, :, pieces.slice] > limits
    # Those that need as many cuts together: batches are as wide as their widest polygon.
    order = np.argsort(needed.sum(axis=1), kind="stable")
    for begin in range(0, len(order), BATCH):
        rows = order[begin : begin + BATCH]
        vehicle, part = pieces.vehicle[rows], pieces.slice[rows]
        planes = np.concatenate([normals[vehicle], own[part]], axis=1)
        batch, left = _clipped(trimmed(hulls[part]), planes, limits[rows], needed[rows])
        rows = rows[left]
        if not len(rows):
            continue
        body = bodies_of(vehicles, pieces.vehicle[rows], pieces.row[rows])
        batch = minkowski(trimmed(batch), body)
        for side, sign in ((0, -1.0), (1, 1.0)):
            across = sign * table.across[pieces.slice[rows]]
            batch, alive = clip(batch, across, sign * edges[rows, side])
            rows = rows[alive]
        owners = zip(pieces.vehicle[rows].tolist(), pieces.row[rows].tolist(), strict=True)
        for (v, row), polygon in zip(owners, unpadded(batch), strict=True):
            yield v, row, polygon


def _own_ends(table: LaneTable, own: Array, count: int) -> Array:
    """(count, 3, S) how far each slice reaches along its own normals (S, 3, 2) [m]."""
    owner = np.repeat(np.arange(len(own)), table.hull_sizes)
    ends = np.einsum("hkx,hx->hk", own[owner], table.hulls)
    return np.broadcast_to(np.maximum.reduceat(ends, table.hull).T, (count, 3, len(own)))


def _clipped(batch: Array, planes: Array, limits: Array, needed: Mask) -> tuple[Array, Ints]:
    """Cut polygons by those of their half-planes (N, J, 2), limits (N, J), that are needed.

    Returns:
        What is left of (N, V, 2), and the indices (N',) of its rows.
    """
    order = np.argsort(~needed, axis=1, kind="stable")
    number = needed.sum(axis=1)
    alive = np.ones(len(batch), dtype=bool)
    for turn in range(int(number.max(initial=0))):
        rows = np.flatnonzero(alive & (number > turn))
        which = order[rows, turn]
        found, left = clip(batch[rows], planes[rows, which], limits[rows, which])
        alive[rows[~left]] = False
        more = found.shape[1] - batch.shape[1]
        if more > 0:
            batch = np.concatenate([batch, np.repeat(batch[:, -1:], more, axis=1)], axis=1)
        batch[rows[left]] = found
    return batch[alive], np.flatnonzero(alive)
