"""From what vehicles' centres can reach to regions that hold their whole bodies.

The lane-based set comes as slices of lanelets, the acceleration-based one as half-planes: each
slice is cut by them, widened by the body, and cut again at the edge of the carriageway. The pieces
of all vehicles, for all times, go through this together.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sandra.prediction.carriageway import Carriageway, cells_of, road_of
from sandra.prediction.geometry import minkowski, polygons_from_support, unpadded
from sandra.prediction.lane_graph import CUT, OWN, LaneGraph, Rules
from sandra.prediction.lane_sets import follow
from sandra.prediction.lane_table import LaneTable
from sandra.prediction.motion import MARGIN, circumscribed
from sandra.prediction.pieces import Entries, Pieces, cut
from sandra.prediction.touched import ROUNDING, Touched, Vehicle, bodies_of, touch
from sandra.scene.convex import distance
from sandra.scene.types import Region

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Regions = tuple[tuple[Region, ...], ...]

TO_CUT_IN = frozenset({"legal_cut_in", "no_rear_end"})
"""Who does not change into the ego's lane in front of it, nor behind it to drive into it."""


@dataclass(frozen=True, slots=True)
class Scope:
    """What all vehicles of one scene share: time step [s], the ego's lane, `max_overhang` [m].

    Without `instants` only the regions during the steps are wanted.
    """

    dt: float
    ego_lane: frozenset[int]
    max_overhang: float
    instants: bool


@dataclass(frozen=True, slots=True)
class Occupancy:
    """Regions in each of T rows (see `Vehicle`; empty where not wanted).

    `relied_on`: the assumptions towards the ego that left something out.
    """

    rows: Regions
    relied_on: frozenset[str]


def free_occupancies(vehicles: Sequence[Vehicle]) -> list[Occupancy]:
    """The acceleration-based occupancies alone, of participants that are not bound to lanes."""
    if not vehicles:
        return []
    offsets = np.stack([x.offsets for x in vehicles])
    here = offsets.max(axis=2) > -np.inf
    here[:, 0] = False
    found: list[list[tuple[Region, ...]]] = [[()] * offsets.shape[1] for _ in vehicles]
    if here.any():
        vehicle, row = np.nonzero(here)
        normals = np.stack([x.normals for x in vehicles])[vehicle]
        centres = polygons_from_support(normals, offsets[here] + ROUNDING)
        polygons = unpadded(minkowski(centres, bodies_of(vehicles, vehicle, row)))
        for v, k, polygon in zip(vehicle.tolist(), row.tolist(), polygons, strict=True):
            found[v][k] = (Region(polygon),)
    return [Occupancy(tuple(rows), frozenset()) for rows in found]


def lane_occupancies(
    table: LaneTable, vehicles: Sequence[Vehicle], scope: Scope
) -> list[Occupancy]:
    """The regions of all vehicles on lanes; all have the same number of rows."""
    if not vehicles:
        return []
    radii = np.array([circumscribed(x.outline) for x in vehicles])
    touched = touch(table, vehicles, radii)
    entries, relied_on = _followed(table, vehicles, touched, scope)
    rows = len(vehicles[0].offsets)
    begin = 1 if scope.instants else rows // 2 + 1
    first_row = np.array([begin + x.skipped for x in vehicles])
    pieces = Pieces.of(table, touched, entries, first_row)
    edges = _edges(table, vehicles, radii, touched, entries, pieces, scope, relied_on)
    found: list[list[list[Region]]] = [[[] for _ in range(rows)] for _ in vehicles]
    for vehicle, row, polygon in cut(table, vehicles, touched, pieces, edges):
        found[vehicle][row].append(Region(polygon))
    return [
        Occupancy(tuple(map(tuple, several)), frozenset(names))
        for several, names in zip(found, relied_on, strict=True)
    ]


def _followed(
    table: LaneTable, vehicles: Sequence[Vehicle], touched: Touched, scope: Scope
) -> tuple[Entries, list[set[str]]]:
    """Where the vehicles may be, without what they do not do to the ego.

    Also names, for each vehicle, the assumptions that left something out.
    """
    rules = [
        Rules(x.seen.places, x.seen.lateral_speed, x.seen.reversing, x.law.behind, segments, x.ways)
        for x, segments in zip(vehicles, touched.segments, strict=True)
    ]
    graph = LaneGraph.of(table, rules, scope.ego_lane)
    sets = follow(table, graph, touched.first, touched.last, scope.dt)
    here = sets.m < np.inf
    owner = touched.vehicle[graph.segment]
    relied_on: list[set[str]] = [set() for _ in vehicles]
    for how, names, drops in (
        (OWN, frozenset({"no_rear_end"}), [x.law.drop_own for x in vehicles]),
        (CUT, TO_CUT_IN, [x.law.drop_cut for x in vehicles]),
    ):
        dropped = (graph.how == how) & np.array(drops)[owner]
        for v in owner[dropped & here.any(axis=0)].tolist():
            relied_on[v] |= names
        here[:, dropped] = False
    row, node = np.nonzero(here)
    entries = Entries(
        owner[node], row, graph.lanelet[node], sets.m[here], sets.low[here], sets.high[here]
    )
    return entries, relied_on


def _edges(
    table: LaneTable,
    vehicles: Sequence[Vehicle],
    radii: Array,
    touched: Touched,
    entries: Entries,
    pieces: Pieces,
    scope: Scope,
    relied_on: list[set[str]],
) -> Array:
    """(P, 2) how far to the right and left each piece's body may be, across its slice [m]."""
    used = np.zeros((len(vehicles), len(table.strips)), dtype=bool)
    used[entries.vehicle, entries.lanelet] = True
    cut_up = np.zeros((len(vehicles), len(table.slices)), dtype=bool)
    cut_up[pieces.vehicle, pieces.slice] = True
    some = np.flatnonzero(cut_up.any(axis=0))
    if not len(some):
        return np.empty((0, 2))
    beside = Carriageway.of(table, some, float(radii.max()) + MARGIN)
    found = np.empty((len(vehicles), len(table.slices), 2))
    for v, (x, radius) in enumerate(zip(vehicles, radii.tolist(), strict=True)):
        ids = {table.strips[i].id for i in np.flatnonzero(used[v]).tolist()}
        lanelets = road_of(table, (p.lanelet for p in x.seen.places), ids, 2 * radius)
        road = cells_of(table, lanelets) & touched.around[v]
        overhang = _overhang(table, x, road, radius, scope.max_overhang)
        shut = scope.ego_lane - ids if x.law.drop_cut else frozenset()
        road &= ~cells_of(table, shut)
        low, high = beside.edges(road, radius + MARGIN)
        found[v, some, 0], found[v, some, 1] = low - overhang, high + overhang
        # A lane that is shut ends the body at its border, whatever road lies beyond it.
        for side, borders in enumerate(table.beside(shut)):
            found[v, borders, side] = table.sides[borders, side]
            if cut_up[v, borders].any():
                relied_on[v] |= TO_CUT_IN
    return found[pieces.vehicle, pieces.slice]


def _overhang(table: LaneTable, vehicle: Vehicle, road: Mask, radius: float, most: float) -> float:
    """How far the body may stick out: as far as it does now, if that is farther [m]."""
    corners = vehicle.start_body.vertices
    middle, reach = corners.mean(axis=0), 3 * radius + 5.0
    cells = np.flatnonzero(table.map.near(middle - reach, middle + reach) & road)
    if not len(cells):
        return most
    out = distance(corners[:, None], table.cells[cells]).min(axis=1)
    return max(most, float(out.max()) + vehicle.start_body.radius + MARGIN)
