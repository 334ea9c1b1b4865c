"""How far the road goes to either side of each slice: bodies are clipped there."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sandra.prediction.lane_table import LaneTable

Array = NDArray[np.float64]
Ints = NDArray[np.int_]
Mask = NDArray[np.bool_]


@dataclass(frozen=True, slots=True, eq=False)
class Carriageway:
    """P pairs of a slice and a cell beside it, by slice.

    `gap` (P,): the cell comes that near to the slice, along it and across [m]; `low` and `high`
    (P,): where the cell lies across the slice [m].
    """

    cell: Ints
    gap: Array
    low: Array
    high: Array
    first: Ints
    """(S,) first pair of each slice; every slice has one."""

    @staticmethod
    def of(table: LaneTable, margin: float) -> Carriageway:
        """All pairs no farther from each other than `margin` [m]."""
        axes = np.stack([table.along, table.across], axis=1)
        owner = np.repeat(np.arange(len(axes)), table.hull_sizes)
        own = np.einsum("hkx,hx->hk", axes[owner], table.hulls)
        inner = np.minimum.reduceat(own, table.hull), np.maximum.reduceat(own, table.hull)
        # Boxes first: a margin on both axes of the slice is within twice as much on x and y.
        boxes = (
            np.minimum.reduceat(table.hulls, table.hull) - 2 * margin,
            np.maximum.reduceat(table.hulls, table.hull) + 2 * margin,
        )
        low, high = table.cells.min(axis=1), table.cells.max(axis=1)
        close = np.ones((len(axes), len(low)), dtype=bool)
        for axis in (0, 1):
            close &= low[:, axis] <= boxes[1][:, axis, None]
            close &= high[:, axis] >= boxes[0][:, axis, None]
        part, cell = np.nonzero(close)
        at = np.einsum("pkx,pvx->pkv", axes[part], table.cells[cell])
        outer = at.min(axis=2), at.max(axis=2)
        gap = np.maximum(inner[0][part] - outer[1], outer[0] - inner[1][part]).max(axis=1)
        near = gap <= margin
        part, cell, gap = part[near], cell[near], gap[near]
        first = np.searchsorted(part, np.arange(len(axes)))
        return Carriageway(cell, gap, outer[0][near, 1], outer[1][near, 1], first)

    def edges(self, road: Mask, margin: float) -> tuple[Array, Array]:
        """(S,) extent across each slice of the road's cells (N,) within `margin` of it [m].

        -inf to inf where there are none.
        """
        counts = road[self.cell] & (self.gap <= margin)
        low = np.minimum.reduceat(np.where(counts, self.low, np.inf), self.first)
        high = np.maximum.reduceat(np.where(counts, self.high, -np.inf), self.first)
        return np.where(low < np.inf, low, -np.inf), np.where(high > -np.inf, high, np.inf)


def road_of(
    table: LaneTable, places: Iterable[int], used: Iterable[int], length: float
) -> set[int]:
    """Ids of the lanelets on which a body may be whose centre starts on `places`, is on `used`.

    `length` [m] of the body may still be on the lanelets before `places`.
    """
    found = set(table.map.behind(places, length))
    for lanelet in used:
        strip = table.map.strips[lanelet]
        found |= {i for i in (lanelet, strip.left_id, strip.right_id) if i is not None}
        found |= set(strip.predecessors) | set(strip.successors)
    return found


def cells_of(table: LaneTable, lanelets: Iterable[int]) -> Mask:
    """(N,) the cells of these lanelets."""
    found = np.zeros(len(table.cells), dtype=bool)
    for i in lanelets:
        number = table.number[i]
        found[table.cell[number] : table.cell[number + 1]] = True
    return found
