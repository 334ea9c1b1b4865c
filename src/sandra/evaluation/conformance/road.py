"""Where vehicles are on the map: on their carriageway, along their lanes, how fast across them."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
import shapely
from numpy.typing import NDArray

from sandra.evaluation.conformance.recording import Recording
from sandra.prediction.observed import ON_LANE, WRONG_WAY
from sandra.scene.frame import Frame
from sandra.scene.network import lane_frame
from sandra.scene.types import Lanelet, areas

Array = NDArray[np.float64]
Ids = frozenset[int]


class Map:
    """The lanelets of a scene: areas, courses, and where they lead."""

    def __init__(self, lanelets: tuple[Lanelet, ...]) -> None:
        self.lanelets = {lanelet.id: lanelet for lanelet in lanelets}
        self.ids = np.array(list(self.lanelets), dtype=int)
        self.tree = shapely.STRtree(areas(list(self.lanelets.values())))
        self._area = dict(zip(self.lanelets, self.tree.geometries, strict=True))
        self._frames: dict[int, Frame] = {}
        self._carriageways: dict[Ids, shapely.Geometry] = {}

    def area(self, ids: Iterable[int]) -> shapely.Geometry:
        """Their union."""
        return shapely.union_all([self._area[i] for i in ids])

    def frame(self, lanelet: int) -> Frame:
        """Along its centre line."""
        if lanelet not in self._frames:
            self._frames[lanelet] = lane_frame(self.lanelets[lanelet].center)
        return self._frames[lanelet]

    def onward(self, ids: Iterable[int]) -> Ids:
        """These, their successors, and their neighbours of the same direction."""
        found = set(ids)
        for i in ids:
            lanelet = self.lanelets[i]
            found.update(lanelet.successors)
            found.update(
                x[0] for x in (lanelet.adjacent_left, lanelet.adjacent_right) if x and x[1]
            )
        return frozenset(found & self.lanelets.keys())

    def carriageway(self, start: Ids) -> shapely.Geometry:
        """The area on which a body may be that starts on these lanelets."""
        if start not in self._carriageways:
            found, more = start, self.onward(start)
            while more != found:
                found, more = more, self.onward(more)
            behind = {j for i in start for j in self.lanelets[i].predecessors}
            every = self.onward(found | (behind & self.lanelets.keys()))
            area = self.area(every)
            shapely.prepare(area)
            self._carriageways[start] = area
        return self._carriageways[start]


def on_road(r: Recording, road: Map, noise: float) -> tuple[dict[str, Array], int]:
    """By assumption, (m, n) how much of it a vehicle needs at a step; NaN: nothing is told.

    no_reversing: speed against the lane [m/s]. stay_on_carriageway: distance of the centre from it
    [m]. follow_lanes: distance of the centre from the lanelets that follow, or lie beside, those of
    the step before [m]. max_lateral_speed: of the velocity, and of the positions less `noise`
    [m/s]. max_overhang [m].

    Who is on no lane of its direction when first seen (second result: how many) is not asked: the
    prediction does not assume lanes of it either.
    """
    shape = r.there.shape
    names = (
        "no_reversing",
        "stay_on_carriageway",
        "follow_lanes",
        "max_lateral_speed",
        "max_overhang",
    )
    found = {name: np.full(shape, np.nan) for name in names}
    off = 0
    for row in np.flatnonzero(r.on_lanes & r.there.any(axis=1)):
        steps = np.flatnonzero(r.there[row])
        told = _vehicle(r, road, int(row), steps, noise)
        if told is None:
            off += 1
            continue
        for name, values in zip(names, told, strict=True):
            found[name][row, steps] = values
    return found, off


def _vehicle(
    r: Recording, road: Map, row: int, steps: NDArray[np.int_], noise: float
) -> tuple[Array, ...] | None:
    states = r.states[row, steps]
    around, course = _around(road, states)
    relative = _wrap(states[0, 2] - course[0])
    start = frozenset(
        int(i) for i, x in zip(around[0], relative, strict=True) if abs(x) <= WRONG_WAY
    )
    if not start:
        return None
    area = road.carriageway(start)
    points = shapely.points(states[:, :2])
    away = shapely.distance(area, points)
    away[away <= ON_LANE] = 0.0
    corners = r.corners(np.full(len(steps), row), steps)
    if r.radii[row] > 0.0:
        beyond = _round_overhang(area, corners, float(r.radii[row]))
    else:
        beyond = np.asarray(shapely.distance(area, shapely.points(corners)).max(axis=1))
    against, across, left = (np.full(len(steps), np.nan) for _ in range(3))
    lanes = np.full(len(steps), -1)
    now = start
    for k in range(len(steps)):
        here = dict(zip(around[k].tolist(), course[k].tolist(), strict=True))
        reach = now if k == 0 else road.onward(road.onward(now))
        kept = frozenset(here) & reach
        if k and steps[k] - steps[k - 1] == 1:
            left[k] = 0.0 if kept else shapely.distance(road.area(reach), points[k])
        if not kept:
            kept = frozenset(here)
        if kept:
            chosen = sorted(kept)
            turned = _wrap(states[k, 2] - np.array([here[i] for i in chosen]))
            along = states[k, 3] * np.cos(turned)
            against[k] = max(-float(along.max()), 0.0)
            sideways = np.abs(states[k, 3] * np.sin(turned))
            across[k] = float(sideways.min())
            lanes[k] = chosen[int(np.argmin(sideways))]
            now = frozenset(i for i, x in zip(chosen, along, strict=True) if x >= 0.0) or kept
    moved = (_moved_across(road, states, lanes) - noise) / r.dt
    across[1:] = np.fmax(across[1:], np.where(np.diff(steps) == 1, moved, np.nan))
    return against, away, left, across, beyond


def _moved_across(road: Map, states: Array, lanes: NDArray[np.int_]) -> Array:
    """(n-1,) change of d in each step [m], in the lane before or after it, whichever is less."""
    found = np.full(len(states) - 1, np.inf)
    for shift in (0, 1):
        lane = lanes[shift : len(states) - 1 + shift]
        for i in np.unique(lane[lane >= 0]):
            rows = np.flatnonzero(lane == i)
            frame = road.frame(int(i))
            d = [frame.to_curvilinear(states[rows + j, :2])[:, 1] for j in (0, 1)]
            found[rows] = np.minimum(found[rows], np.abs(d[1] - d[0]))
    return np.where(np.isfinite(found), found, np.nan)


def _around(road: Map, states: Array) -> tuple[list[NDArray[np.int_]], list[Array]]:
    """For each state the lanelets that its centre is on, and their courses there [rad]."""
    points = shapely.points(states[:, :2])
    step, lanelet = road.tree.query(points, predicate="dwithin", distance=ON_LANE)
    course = np.empty(len(step))
    for i in np.unique(lanelet):
        here = lanelet == i
        frame = road.frame(int(road.ids[i]))
        course[here] = frame.heading(frame.to_curvilinear(states[step[here], :2])[:, 0])
    order = np.argsort(step, kind="stable")
    cuts = np.searchsorted(step[order], np.arange(1, len(states)))
    return np.split(road.ids[lanelet[order]], cuts), np.split(course[order], cuts)


def _round_overhang(area: shapely.Geometry, corners: Array, radius: float) -> Array:
    bodies = shapely.buffer(shapely.convex_hull(shapely.polygons(corners)), radius)
    out = shapely.difference(bodies, area)
    found = np.zeros(len(bodies))
    for k in np.flatnonzero(~shapely.is_empty(out)):
        points = shapely.points(shapely.get_coordinates(out[k]))
        found[k] = float(shapely.distance(area, points).max())
    return found


def _wrap(angle: Array) -> Array:
    return np.asarray((angle + np.pi) % (2 * np.pi) - np.pi)
