"""The map as the set-based prediction needs it: lanelets cut into cells and slices.

Position on a lanelet is (p, y). y is the signed distance from the centre line along the
cross-section, y > 0 to the left. The progress p is the station of the point's foot on the centre
line; who does not drive backwards never loses any. Cross-sections may be slanted, so p differs
along one: it is given at both its ends and linear in between. Lanelets side by side share one
scale of p, so that a change of lanes leaves it as it is. All in metres.

Cells (about 1 m) decide which stretch of a lanelet can be reached.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sandra.scene.convex import distance

Array = NDArray[np.float64]
Index = NDArray[np.int64]

START_ERROR = 0.1
"""Bound on the error of the (p, y) found for a point [m]."""


@dataclass(frozen=True, slots=True, eq=False)
class Strip:
    """One lanelet with n cross-sections, continued straight on where the map ends."""

    id: int
    s: Array
    """(n,) station of each cross-section [m]."""
    right: Array
    left: Array
    centre: Array
    across: Array
    """(n, 2) unit vectors from right to left."""
    half: Array
    """(n,) half width [m]."""
    progress: Array
    """(n, 2) progress of the right and left ends of each cross-section [m]."""
    behind: Array
    ahead: Array
    """(n-1,) smallest and largest progress in each cell [m]."""
    stretch: float
    """A speed across the lane changes y at most this much faster (slanted cross-sections)."""
    cells: Array
    """(n-1, 4, 2) quadrilaterals [m]."""
    corners: Index
    """Indices of the cross-sections that the map gives; between them the borders are straight."""
    successors: tuple[int, ...]
    predecessors: tuple[int, ...]
    left_id: int | None
    """The lanelet to the left, if it has the same direction."""
    right_id: int | None
    shared: frozenset[int]
    """Those of the two whose progress is on the same scale."""


@dataclass(frozen=True, slots=True, eq=False)
class Place:
    """A point on a lanelet."""

    lanelet: int
    s: float
    """Station on this lanelet's centre line."""
    p: float
    y: float
    relative_heading: float
    """Heading relative to the lane, in (-pi, pi] [rad]."""


@dataclass(frozen=True, slots=True, eq=False)
class LaneMap:
    """All lanelets by id, L with N cells in all."""

    strips: dict[int, Strip]
    cell: Index
    """(L + 1,) first cell of each lanelet, in the order of `strips`; the last entry is N."""
    low: Array
    high: Array
    """(N, 2) corners of the box around each cell [m]."""

    @staticmethod
    def of(strips: dict[int, Strip]) -> LaneMap:
        """Put strips together."""
        cells = [x.cells for x in strips.values()] or [np.empty((0, 4, 2))]
        every = np.concatenate(cells)
        first = np.concatenate([[0], np.cumsum([len(x) for x in cells])])
        return LaneMap(strips, first, every.min(axis=1), every.max(axis=1))

    def near(self, low: Array, high: Array) -> NDArray[np.bool_]:
        """(N,) the cells whose boxes meet the box between two corners (2,) [m]."""
        (x0, y0), (x1, y1) = self.low.T, self.high.T
        return np.asarray((x0 <= high[0]) & (y0 <= high[1]) & (x1 >= low[0]) & (y1 >= low[1]))

    def places(self, x: float, y: float, heading: float, tolerance: float) -> list[Place]:
        """Every lanelet that holds the point (up to `tolerance` [m])."""
        point = np.array([x, y])
        within = np.flatnonzero(self.near(point - tolerance, point + tolerance))
        owner = self.cell.searchsorted(within, side="right") - 1
        strips = tuple(self.strips.values())
        found = []
        for number in np.unique(owner).tolist():
            strip = strips[number]
            boxes = within[owner == number] - self.cell[number]
            near = distance(point, strip.cells[boxes])
            i = int(boxes[near.argmin()])
            if near.min() > tolerance:
                continue
            s, p, offset = _locate(strip, i, point)
            along = strip.centre[i + 1] - strip.centre[i]
            relative = heading - float(np.arctan2(along[1], along[0]))
            relative = (relative + np.pi) % (2 * np.pi) - np.pi
            found.append(Place(strip.id, s, p, offset, relative))
        return found

    def reachable(self, start: Iterable[int], reversing: bool) -> list[int]:
        """Ids in reach by successors and lanes of the same direction (and predecessors)."""
        found = list(dict.fromkeys(start))
        for lanelet in found:
            strip = self.strips[lanelet]
            onward = [*strip.successors, strip.left_id, strip.right_id]
            onward += strip.predecessors if reversing else ()
            found += [i for i in dict.fromkeys(onward) if i is not None and i not in found]
        return found

    def behind(self, start: Iterable[int], length: float) -> list[int]:
        """Ids of the lanelets on which a body of this length [m] before `start` may still be."""
        found: dict[int, float] = {}
        todo = [(i, 0.0) for i in start]
        while todo:
            lanelet, way = todo.pop()
            if way > length or found.get(lanelet, np.inf) <= way:
                continue
            found[lanelet] = way
            strip = self.strips[lanelet]
            todo += [(i, way) for i in (strip.left_id, strip.right_id) if i is not None]
            # Those before the start are behind at once; further ones by the lanelets between.
            further = way + float(strip.s[-1]) if way else 1e-6
            todo += [(i, further) for i in strip.predecessors]
        return list(found)


def _locate(strip: Strip, i: int, point: Array) -> tuple[float, float, float]:
    """(s, p, y) of a point in cell i."""
    before = _beyond(strip, i, point)
    after = -_beyond(strip, i + 1, point)
    total = before + after
    share = min(max(before / total, 0.0), 1.0) if total > 0 else 0.0
    right, left, centre, across, progress = (
        (1 - share) * a[i] + share * a[i + 1]
        for a in (strip.right, strip.left, strip.centre, strip.across, strip.progress)
    )
    y = float((point - centre) @ across / np.hypot(*across))
    width = max(float(np.hypot(*(left - right))), 1e-9)
    station = float((1 - share) * strip.s[i] + share * strip.s[i + 1])
    return station, float(progress.mean() + y / width * (progress[1] - progress[0])), y


def _beyond(strip: Strip, i: int, point: Array) -> float:
    """Distance of a point beyond the line through cross-section i [m]."""
    ahead = np.array([strip.across[i, 1], -strip.across[i, 0]])
    return float((point - strip.centre[i]) @ ahead)
