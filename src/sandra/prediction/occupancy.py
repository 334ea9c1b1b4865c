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
from sandra.prediction.touched import ROUNDING, Touched, Vehicle, touch
from sandra.scene.convex import distance
from sandra.scene.types import Region

Array = NDArray[np.float64]
Regions = tuple[tuple[Region, ...], ...]


@dataclass(frozen=True, slots=True)
class Scope:
    """What all vehicles of one scene share: time step [s], the ego's lane, `max_overhang` [m]."""

    dt: float
    ego_lane: frozenset[int]
    max_overhang: float


@dataclass(frozen=True, slots=True)
class Occupancy:
    """Regions in each of T rows (see `Vehicle`; the row of t_0 is empty).

    `relied_on`: the assumptions towards the ego that left something out.
    """

    rows: Regions
    relied_on: frozenset[str]


def free_occupancies(normals: Array, offsets: Array, body: Array) -> Regions:
    """The acceleration-based occupancy alone, for each row of offsets (K, J), bodies (K, V, 2)."""
    centres = polygons_from_support(normals, offsets + ROUNDING)
    return tuple((Region(polygon),) for polygon in unpadded(minkowski(centres, body)))


def lane_occupancies(
    table: LaneTable, vehicles: Sequence[Vehicle], scope: Scope
) -> list[Occupancy]:
    """The regions of all vehicles on lanes; all have the same number of rows."""
    if not vehicles:
        return []
    radii = np.array([circumscribed(x.outline) for x in vehicles])
    touched = touch(table, vehicles, radii)
    entries, relied_on = _followed(table, vehicles, touched, scope)
    pieces = Pieces.of(table, touched, entries)
    edges = _edges(table, vehicles, radii, touched, entries, pieces, scope, relied_on)
    found: list[list[list[Region]]] = [
        [[] for _ in range(len(vehicles[0].offsets))] for _ in vehicles
    ]
    for vehicle, row, polygon in cut(table, vehicles, touched, pieces, edges):
        found[vehicle][row].append(Region(polygon))
    return [
        Occupancy(tuple(map(tuple, rows)), frozenset(names))
        for rows, names in zip(found, relied_on, strict=True)
    ]


def _followed(
    table: LaneTable, vehicles: Sequence[Vehicle], touched: Touched, scope: Scope
) -> tuple[Entries, list[set[str]]]:
    """Where the vehicles may be, without what they do not do to the ego.

    Also names, for each vehicle, the assumptions that left something out.
    """
    rules = [
        Rules(x.seen.places, x.seen.lateral_speed, x.seen.reversing, x.law.behind, segments)
        for x, segments in zip(vehicles, touched.segments, strict=True)
    ]
    graph = LaneGraph.of(table, rules, scope.ego_lane)
    sets = follow(table, graph, touched.first, touched.last, scope.dt)
    here = sets.m < np.inf
    owner = touched.vehicle[graph.segment]
    relied_on: list[set[str]] = [set() for _ in vehicles]
    for how, name, drops in (
        (OWN, "no_rear_end", [x.law.drop_own for x in vehicles]),
        (CUT, "legal_cut_in", [x.law.drop_cut for x in vehicles]),
    ):
        dropped = (graph.how == how) & np.array(drops)[owner]
        for v in owner[dropped & here.any(axis=0)].tolist():
            relied_on[v].add(name)
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
    beside = Carriageway.of(table, float(radii.max()) + MARGIN)
    lanelet = np.repeat(np.arange(len(table.strips)), np.diff(table.slice))
    on_right = np.array([_id(table.strips[i].right_id) for i in lanelet.tolist()])
    on_left = np.array([_id(table.strips[i].left_id) for i in lanelet.tolist()])
    low_side, high_side = table.sides()
    found = np.empty((len(vehicles), len(table.slices), 2))
    for v, (x, radius) in enumerate(zip(vehicles, radii.tolist(), strict=True)):
        used = np.unique(entries.lanelet[entries.vehicle == v])
        used_ids = {table.strips[i].id for i in used.tolist()}
        ids = road_of(table, (p.lanelet for p in x.seen.places), used_ids, 2 * radius)
        road = cells_of(table, ids) & touched.around[v]
        overhang = _overhang(x, table.cells[road], radius, scope.max_overhang)
        shut = sorted(scope.ego_lane - used_ids) if x.law.drop_cut else []
        road &= ~cells_of(table, shut)
        low, high = beside.edges(road, radius + MARGIN)
        # A lane that is shut ends the body at its border, whatever road lies beyond it.
        right_shut, left_shut = np.isin(on_right, shut), np.isin(on_left, shut)
        found[v, :, 0] = np.where(right_shut, low_side, low - overhang)
        found[v, :, 1] = np.where(left_shut, high_side, high + overhang)
        if (right_shut | left_shut)[pieces.slice[pieces.vehicle == v]].any():
            relied_on[v].add("legal_cut_in")
    return found[pieces.vehicle, pieces.slice]


def _overhang(vehicle: Vehicle, road: Array, radius: float, most: float) -> float:
    """How far the body may stick out: as far as it does now, if that is farther [m]."""
    corners = vehicle.start_body.vertices
    near = np.abs(road - corners.mean(axis=0)).max(axis=2).min(axis=1) < 3 * radius + 5.0
    if not near.any():
        return most
    out = distance(corners[:, None], road[near]).min(axis=1)
    return max(most, float(out.max()) + vehicle.start_body.radius + MARGIN)


def _id(lanelet: int | None) -> int:
    """An id as a number, also where there is none."""
    return -1 if lanelet is None else lanelet
