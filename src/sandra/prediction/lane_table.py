"""All lanelets of a map in flat arrays, for passes over many vehicles at once.

Lanelets are numbered 0, 1, ... in the order of the map; the cells, cross-sections and slices of all
of them stand one after another. A lanelet of n cells has n + 1 cross-sections, so cell i of
lanelet l lies between cross-sections i + l and i + l + 1.
"""

from __future__ import annotations

from dataclasses import dataclass

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
    _ahead: Array
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
    sides: Array
    """(S, 2) smallest and largest coordinate across each slice [m]."""
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
        hulls = np.concatenate([part.hull for part in slices])
        sizes = [len(part.hull) for part in slices]
        hull = _first(sizes)[:-1]
        along = np.array([part.along for part in slices])
        across = np.column_stack([-along[:, 1], along[:, 0]])
        low = min(float(x.behind.min()) for x in strips) - 1.0
        high = max(float(x.ahead.max()) for x in strips) + 1.0
        key = np.arange(len(strips), dtype=np.float64) * (high - low)
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
            np.concatenate([np.maximum.accumulate(x.ahead) for x in strips])
            + np.repeat(key, np.diff(lane_map.cell)),
            key,
            (low, high),
            np.stack(levels),
            _first([len(several) for several in by_strip]),
            slices,
            along,
            across,
            np.array([part.sides for part in slices]),
            hulls,
            hull,
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

    def boxes(self) -> tuple[Array, Array]:
        """(S, 2) corners of the box around each slice [m]."""
        return (
            np.minimum.reduceat(self.hulls, self.hull),
            np.maximum.reduceat(self.hulls, self.hull),
        )

    def beside(self, lanelets: frozenset[int]) -> tuple[Ints, Ints]:
        """Numbers of the slices that have one of these lanelets (ids) to their right, or left."""
        return (
            self._slices([x.right_id in lanelets for x in self.strips]),
            self._slices([x.left_id in lanelets for x in self.strips]),
        )

    def _slices(self, of: list[bool]) -> Ints:
        return np.flatnonzero(np.repeat(of, np.diff(self.slice)))

    def at_progress(self, lanelet: Ints, progress: Array) -> Ints:
        """The first cell of each lanelet that holds points of this progress [m] or more.

        The first cell of the next lanelet, where there are none.
        """
        sought = np.clip(progress - _ROUNDING, *self._span) + self._key[lanelet]
        return np.clip(
            np.searchsorted(self._ahead, sought), self.cell[lanelet], self.cell[lanelet + 1]
        )

    def pace(self) -> tuple[Array, Array]:
        """(L,) and (L,): progress along a lane, and lost to motion across it, per way driven.

        Who drives u along its lane and at most w across it makes at least pace u - drift w. Of
        lanelets whose progress is on the same scale, those of the worst one.
        """
        pace, drift = np.array([_pace(x) for x in self.strips]).T
        for strip in self.strips:
            group = {strip.id}
            todo = [strip.id]
            for i in todo:
                more = self.map.strips[i].shared - group
                group |= more
                todo += more
            rows = [self.number[i] for i in group]
            pace[rows], drift[rows] = pace[rows].min(), drift[rows].max()
        return pace, drift

    def narrowest(self, lanelet: Ints, first: Ints, last: Ints) -> Array:
        """Smallest half width over cells first..last, first <= last [m]."""
        level = np.log2(last - first + 2).astype(int)
        start, end = first + lanelet, last + lanelet + 2
        found: Array = np.minimum(
            self._narrowest[level, start], self._narrowest[level, end - (1 << level)]
        )
        return found


def _pace(strip: Strip) -> tuple[float, float]:
    """Of one lanelet, see `LaneTable.pace`.

    In a cell progress is bilinear, as the point is: the gradient is a quotient of bilinear
    functions, so its extremes are at the corners.
    """
    corners = np.stack([strip.right, strip.left], axis=1)
    along, ahead = np.diff(corners, axis=0), np.diff(strip.progress, axis=0)
    across, rise = strip.left - strip.right, strip.progress[:, 1] - strip.progress[:, 0]
    course = np.diff(strip.centre, axis=0)
    course /= np.maximum(np.hypot(*course.T), 1e-12)[:, None]
    kink = np.abs(course[1:, 0] * course[:-1, 1] - course[1:, 1] * course[:-1, 0])
    straight = (course[1:] * course[:-1]).sum(axis=1) > 0.0
    sine = float(kink.max(initial=0.0))
    lost, pace, swing = 0.0, np.inf, 0.0
    for end in (slice(None, -1), slice(1, None)):
        for side in (0, 1):
            a, b, up, over = along[:, side], across[end], ahead[:, side], rise[end]
            area = a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
            if not (area > 1e-9).all() or not straight.all():
                return 0.0, 0.0
            x = (up * b[:, 1] - over * a[:, 1]) / area
            y = (over * a[:, 0] - up * b[:, 0]) / area
            on = x * course[:, 0] + y * course[:, 1]
            off = np.abs(y * course[:, 0] - x * course[:, 1])
            pace, swing = min(pace, float(on.min())), max(swing, float(on.max()))
            lost = max(lost, float(off.max()))
    cosine = float(np.sqrt(max(1.0 - sine**2, 0.0)))
    return max(pace * cosine - lost * sine, 0.0), lost + max(swing, 0.0) * sine


def _first(sizes: list[int]) -> Ints:
    return np.concatenate([[0], np.cumsum(sizes)])
