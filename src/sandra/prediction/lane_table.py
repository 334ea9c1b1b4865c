"""All lanelets of a map in flat arrays, for passes over many vehicles at once.

Lanelets are numbered 0, 1, ... in the order of the map; the cells, cross-sections and slices of all
of them stand one after another. A lanelet of n cells has n + 1 cross-sections, so cell i of
lanelet l lies between cross-sections i + l and i + l + 1.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sandra.prediction.lanes import LaneMap, Strip
from sandra.prediction.slicing import Slice, slices_of

Array = NDArray[np.float64]
Ints = NDArray[np.int_]

_ROUNDING = 1e-6
"""Progress is looked up this much further back [m]."""


@dataclass(frozen=True, slots=True, eq=False)
class LaneTable:
    """L lanelets, N cells, N + L cross-sections, S slices with H corners."""

    map: LaneMap
    strips: tuple[Strip, ...]
    number: dict[int, int]
    """Of each lanelet, by id."""
    cell: Ints
    """(L + 1,) first cell of each lanelet; the last entry is N."""
    cells: Array
    """(N, 4, 2)"""
    right: Array
    left: Array
    """(N + L, 2) ends of the cross-sections [m]."""
    behind: Array
    """(N,) smallest progress in each cell and those after it, in the same lanelet [m]."""
    _ahead: NDArray[Any]
    """(N,) ascending keys: largest progress in each cell and those before it, by lanelet."""
    _key: Array
    """(L,) what is added to a lanelet's progress to make a key."""
    _span: tuple[float, float]
    _narrowest: Array
    """(levels, N + L) smallest half width of 2^level cross-sections from each one on [m]."""
    slice: Ints
    """(L + 1,) first slice of each lanelet; the last entry is S."""
    slices: tuple[Slice, ...]
    along: Array
    across: Array
    """(S, 2) unit vectors along each slice, and to its left."""
    hulls: Array
    """(H, 2)"""
    hull: Ints
    """(S,) first corner of each slice."""

    @staticmethod
    def of(lane_map: LaneMap) -> LaneTable:
        """Make the arrays; the map must have a lanelet."""
        strips = tuple(lane_map.strips.values())
        by_strip = slices_of(strips)
        slices = tuple(part for several in by_strip for part in several)
        along = np.array([part.along for part in slices])
        low = min(float(x.behind.min()) for x in strips) - 1.0
        high = max(float(x.ahead.max()) for x in strips) + 1.0
        key = np.arange(len(strips)) * (high - low)
        half = np.concatenate([x.half for x in strips])
        levels: list[Array] = [half]
        for level in range(int(np.log2(len(half)))):
            wide = levels[-1].copy()
            wide[: -(1 << level)] = np.minimum(wide[: -(1 << level)], wide[1 << level :])
            levels.append(wide)
        return LaneTable(
            lane_map,
            strips,
            {x.id: number for number, x in enumerate(strips)},
            lane_map.cell,
            np.concatenate([x.cells for x in strips]),
            np.concatenate([x.right for x in strips]),
            np.concatenate([x.left for x in strips]),
            np.concatenate([np.minimum.accumulate(x.behind[::-1])[::-1] for x in strips]),
            np.concatenate(
                [np.maximum.accumulate(x.ahead) + k for x, k in zip(strips, key, strict=True)]
            ),
            key,
            (low, high),
            np.array(levels, dtype=np.float64),
            _first([len(several) for several in by_strip]),
            slices,
            along,
            np.column_stack([-along[:, 1], along[:, 0]]),
            np.concatenate([part.hull for part in slices]),
            _first([len(part.hull) for part in slices])[:-1],
        )

    def nearest(self, normals: Array) -> Array:
        """(J, N) smallest normal . p in each cell, for normals (J, 2) [m]."""
        both = np.minimum(normals @ self.right.T, normals @ self.left.T)
        starts = np.arange(len(self.cells)) + np.repeat(
            np.arange(len(self.strips)), np.diff(self.cell)
        )
        found: Array = np.minimum(both[:, :-1], both[:, 1:])[:, starts]
        return found

    def extent(self, normals: Array) -> tuple[Array, Array]:
        """(J, S) smallest and largest normal . p in each slice, for normals (J, 2) [m]."""
        along = normals @ self.hulls.T
        return (
            np.minimum.reduceat(along, self.hull, axis=1),
            np.maximum.reduceat(along, self.hull, axis=1),
        )

    @property
    def hull_sizes(self) -> Ints:
        """(S,) number of corners of each slice."""
        return np.diff(self.hull, append=len(self.hulls))

    def sides(self) -> tuple[Array, Array]:
        """(S,) smallest and largest coordinate across each slice [m]."""
        at = (np.repeat(self.across, self.hull_sizes, axis=0) * self.hulls).sum(axis=1)
        return np.minimum.reduceat(at, self.hull), np.maximum.reduceat(at, self.hull)

    def at_progress(self, lanelet: Ints, progress: Array) -> Ints:
        """The first cell of each lanelet that holds points of this progress [m] or more.

        The first cell of the next lanelet, where there are none.
        """
        sought = np.clip(progress - _ROUNDING, *self._span) + self._key[lanelet]
        return np.clip(
            np.searchsorted(self._ahead, sought), self.cell[lanelet], self.cell[lanelet + 1]
        )

    def narrowest(self, lanelet: Ints, first: Ints, last: Ints) -> Array:
        """Smallest half width over cells first..last, first <= last [m]."""
        level = np.log2(last - first + 2).astype(int)
        start, end = first + lanelet, last + lanelet + 2
        found: Array = np.minimum(
            self._narrowest[level, start], self._narrowest[level, end - (1 << level)]
        )
        return found


def _first(sizes: list[int]) -> Ints:
    return np.concatenate([[0], np.cumsum(sizes)])
