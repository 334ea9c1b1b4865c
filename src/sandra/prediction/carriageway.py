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
    """P pairs of one of U slices and a cell beside it, by slice.

    `gap` (P,): the cell comes that near to the slice, along it and across [m]; `low` and `high`
    (P,): where the cell lies across the slice [m].
    """

    cell: Ints
    gap: Array
    low: Array
    high: Array
    first: Ints
    """(U,) first pair of each slice; every slice has one."""

    @staticmethod
    def of(table: LaneTable, slices: Ints, margin: float) -> Carriageway:
        """All pairs of some slices (U,) with cells no farther from them than `margin` [m]."""
        low, high = table.boxes()
        # Boxes first: a margin on both axes of the slice is within twice as much on x and y.
        low, high = low[slices] - 2 * margin, high[slices] + 2 * margin
        close = np.ones((len(slices), len(table.cells)), dtype=bool)
        for axis in (0, 1):
            close &= table.map.low[:, axis] <= high[:, axis, None]
            close &= table.map.high[:, axis] >= low[:, axis, None]
        part, cell = np.nonzero(close)
        owner = np.repeat(np.arange(len(table.slices)), table.hull_sizes)
        starts, ends, gaps = [], [], []
        for each in (table.along, table.across):
            own = (each[owner] * table.hulls).sum(axis=1)
            near_end = np.minimum.reduceat(own, table.hull)[slices][part]
            far_end = np.maximum.reduceat(own, table.hull)[slices][part]
            axis_x, axis_y = each[slices][part].T
            at = [axis_x * x + axis_y * y for x, y in table.cells[cell].transpose(1, 2, 0)]
            starts.append(np.minimum.reduce(at))
            ends.append(np.maximum.reduce(at))
            gaps.append(np.maximum(near_end - ends[-1], starts[-1] - far_end))
        gap = np.maximum(*gaps)
        near = gap <= margin
        part, cell, gap = part[near], cell[near], gap[near]
        first = np.searchsorted(part, np.arange(len(slices)))
        return Carriageway(cell, gap, starts[1][near], ends[1][near], first)

    def edges(self, road: Mask, margin: float) -> tuple[Array, Array]:
        """(U,) extent across each slice of the road's cells (N,) within `margin` of it [m].

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
