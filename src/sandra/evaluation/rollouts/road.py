"""The lanelets as areas and links: where bodies may be, and which way leads on."""

from __future__ import annotations

import math
from collections.abc import Iterable
from functools import cached_property
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray

from sandra.scene.types import Lanelet, Scene

Array = NDArray[np.float64]
Bools = NDArray[np.bool_]

WRONG_WAY = math.radians(60.0)
"""A vehicle whose heading leaves a lanelet's by more does not follow it."""
ON_LANE = 0.02
"""Points this close to a lanelet are on it [m]."""


class Road:
    """All lanelets of a scene, and which of them are the ego's current lane."""

    def __init__(self, scene: Scene) -> None:
        self.lanelets: dict[int, Lanelet] = {x.id: x for x in scene.lanelets}
        self.ids = np.array(list(self.lanelets), dtype=int)
        self.areas: dict[int, Any] = {x.id: x.area() for x in scene.lanelets}
        self.shapes = np.array([self.areas[i] for i in self.lanelets], dtype=object)
        lane = next((lane for lane in scene.lanes if lane.relation == "current"), None)
        self.ego_lane = frozenset(lane.lanelets) if lane is not None else frozenset()
        self.reference = scene.frame.line if lane is not None else None
        self._lines: dict[int, tuple[Array, Array, Any]] = {}

    @cached_property
    def tree(self) -> Any:
        """Of all lanelets."""
        return shapely.STRtree(self.shapes)

    def around(self, x: float, y: float, heading: float) -> list[int]:
        """The lanelets that a vehicle may be following at this place."""
        near = self.tree.query(shapely.Point(x, y), predicate="dwithin", distance=ON_LANE)
        found = []
        for i in self.ids[np.sort(near)].tolist():
            course = self.course(i, np.array([[x, y]]))[0]
            if abs(math.remainder(heading - course, 2 * math.pi)) <= WRONG_WAY:
                found.append(i)
        return found

    def course(self, lanelet: int, points: Array) -> Array:
        """(m,) direction of a lanelet's centre line nearest to points (m, 2) [rad]."""
        known = self._lines.get(lanelet)
        if known is None:
            line = self.lanelets[lanelet].center
            edge = np.diff(line, axis=0)
            length = np.hypot(edge[:, 0], edge[:, 1])
            edge, length = edge[length > 1e-9], length[length > 1e-9]
            angle = np.arctan2(edge[:, 1], edge[:, 0])
            known = np.cumsum(length), angle, shapely.LineString(line)
            self._lines[lanelet] = known
        ends, angle, shape = known
        along = shapely.line_locate_point(shape, shapely.points(points))
        index = np.minimum(np.searchsorted(ends, along), len(angle) - 1)
        return np.asarray(angle[index])

    def beside(self, lanelet: int) -> list[int]:
        """The lanelets next to one that have its direction."""
        x = self.lanelets[lanelet]
        sides = (x.adjacent_left, x.adjacent_right)
        return [side[0] for side in sides if side and side[1] and side[0] in self.lanelets]

    def onward(self, lanelets: Iterable[int], closed: frozenset[int] = frozenset()) -> set[int]:
        """One link further: successors, and lanes beside but for `closed` ones."""
        found = set(lanelets)
        for i in tuple(found):
            found |= {j for j in self.lanelets[i].successors if j in self.lanelets}
            if i in closed:
                found |= set(self.beside(i))
            else:
                found |= {j for j in self.beside(i) if j not in closed}
        return found

    def reachable(
        self, lanelets: Iterable[int], closed: frozenset[int] = frozenset()
    ) -> frozenset[int]:
        """All lanelets that links lead to."""
        found = set(lanelets)
        while (more := self.onward(found, closed)) != found:
            found = more
        return frozenset(found)

    def carriageway(self, start: Iterable[int]) -> Any:
        """Where bodies may be that follow lanes from `start` on (shapely)."""
        begin = set(start)
        found = set(self.reachable(begin))
        for i in begin:
            found |= {j for j in self.lanelets[i].predecessors if j in self.lanelets}
        found |= self.onward(found)
        return shapely.union_all([self.areas[i] for i in sorted(found)])

    def shut(self, start: Iterable[int]) -> tuple[frozenset[int], frozenset[int]]:
        """The part of the ego's lane that is entered only by cutting in, and all that is not.

        For a vehicle that starts on the lanelets `start`; if these are the ego's own, from when
        it has left them sideways.
        """
        begin = set(start)
        outside = begin - self.ego_lane
        if not outside:
            outside = {j for i in begin for j in self.beside(i)} - self.ego_lane
        free = self.reachable(outside, self.ego_lane)
        return self.ego_lane - free, free

    def shut_area(self, start: Iterable[int]) -> Any:
        """What belongs to `shut` lanelets and to none that is entered otherwise (shapely)."""
        shut, free = self.shut(start)
        if not shut:
            return shapely.Polygon()
        closed = shapely.union_all([self.areas[i] for i in sorted(shut)])
        return shapely.difference(closed, shapely.union_all([self.areas[i] for i in sorted(free)]))
