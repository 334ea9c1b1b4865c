"""From what a vehicle's centre can reach to regions that hold its whole body.

The lane-based set comes as slices of lanelets, the acceleration-based one as half-planes: each
slice is cut by them, widened by the body, and cut again at the edge of the carriageway. All pieces
of one vehicle, for all times, go through this as one batch.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from sandra.prediction import lane_sets
from sandra.prediction.geometry import (
    clip,
    clip_all,
    minkowski,
    polygons_from_support,
    stack,
    unpadded,
)
from sandra.prediction.lane_sets import LaneSets, Node, Rules, Stretch
from sandra.prediction.lanes import LaneMap, Place, Slice, Strip
from sandra.prediction.motion import MARGIN, circumscribed
from sandra.prediction.observed import Observed, TowardsEgo
from sandra.scene.convex import distance
from sandra.scene.types import Obstacle, Region, Scene, State

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Regions = tuple[tuple[Region, ...], ...]

FAR = 1e9
"""Stands for "not bounded" [m]."""
ROUNDING = 1e-9
"""Half-planes are this much wider than computed [m]."""


def free_occupancies(normals: Array, offsets: Array, body: Array) -> Regions:
    """The acceleration-based occupancy alone, for each row of offsets (K, J), bodies (K, V, 2)."""
    centres = polygons_from_support(normals, offsets + ROUNDING)
    return tuple((Region(polygon),) for polygon in unpadded(minkowski(centres, body)))


class Follower:
    """One vehicle on lanes: from lane sets to regions."""

    def __init__(
        self,
        obstacle: Obstacle,
        state: State,
        seen: Observed,
        law: TowardsEgo,
        lane_map: LaneMap,
        max_overhang: float,
        scene: Scene,
    ) -> None:
        lane = next((lane for lane in scene.lanes if lane.relation == "current"), None)
        self.map = lane_map
        self.law = law
        self.places: tuple[Place, ...] = seen.places
        self.rules = Rules(
            dt=scene.dt,
            lateral_speed=seen.lateral_speed,
            reversing=seen.reversing,
            ego_lane=frozenset(lane.lanelets) if lane is not None else frozenset(),
            starts_behind_ego=law.behind,
        )
        self.radius = circumscribed(obstacle.outline)
        self.start_body = obstacle.outline.placed(state.x, state.y, state.heading)
        self.max_overhang = max_overhang
        self.relied_on: set[str] = set()
        """The assumptions towards the ego that left something out."""

    def occupancies(
        self, normals: Array, offsets: Array, during: Array, body: Array
    ) -> tuple[Regions, Regions]:
        """Regions at t_0..t_h and during each step.

        Args:
            normals: (J, 2).
            offsets: (h+1, J) of the reachable positions at each t_k.
            during: (h, J) of those during each step.
            body: (h+1, V, 2) batch of bodies around the origin, growing.
        """
        horizon = len(during)
        start = [p.lanelet for p in self.places]
        lanelets = self.map.reachable(start, self.rules.reversing)
        widest = np.concatenate([offsets, during]).max(axis=0)
        touched: dict[int, Mask] = {}
        touched_during: dict[int, Mask] = {}
        for i in lanelets:
            cells = self.map.strips[i].cells
            ever = np.flatnonzero(_touched(cells, normals, widest[None])[0])
            if not len(ever) and i not in start:
                continue
            near = slice(ever[0], ever[-1] + 1) if len(ever) else slice(0, 0)
            for masks, bounds in ((touched, offsets), (touched_during, during)):
                masks[i] = np.zeros((len(bounds), len(cells)), dtype=bool)
                masks[i][:, near] = _touched(cells[near], normals, bounds)
        lanelets = list(touched)
        sets = lane_sets.follow(
            self.map.restricted(lanelets), list(self.places), touched, touched_during, self.rules
        )
        hows = {node.how for nodes in (*sets.at, *sets.between) for node in nodes}
        if self.law.drop_own and lane_sets.OWN in hows:
            self.relied_on.add("no_rear_end")
        if self.law.drop_cut and lane_sets.CUT in hows:
            self.relied_on.add("legal_cut_in")
        sets = LaneSets(
            tuple(map(self._without_dropped, sets.at)),
            tuple(map(self._without_dropped, sets.between)),
        )
        rows: list[dict[Node, Stretch]] = [*sets.at, *sets.between]
        all_offsets = np.concatenate([offsets, during])
        all_bodies = np.concatenate([body, body[1:]])
        regions = self._regions(rows, normals, all_offsets, all_bodies)
        return tuple(regions[: horizon + 1]), tuple(regions[horizon + 1 :])

    def _without_dropped(self, nodes: dict[Node, Stretch]) -> dict[Node, Stretch]:
        out = set()
        if self.law.drop_own:
            out.add(lane_sets.OWN)
        if self.law.drop_cut:
            out.add(lane_sets.CUT)
        return {node: stretch for node, stretch in nodes.items() if node.how not in out}

    def _regions(
        self, rows: list[dict[Node, Stretch]], normals: Array, offsets: Array, bodies: Array
    ) -> list[tuple[Region, ...]]:
        """One list of regions per row (a time or an interval), all cut in one batch."""
        used = {node.lanelet for nodes in rows for node in nodes}
        road = self._carriageway(used, normals, offsets)
        overhang = self._overhang(road)
        shut: frozenset[int] = frozenset()
        if self.law.drop_cut:
            shut = self.rules.ego_lane - used
            road = self._carriageway(used, normals, offsets, shut)
        pieces: list[Array] = []
        owner: list[int] = []
        cuts: list[tuple[Array, Array]] = []
        edges: list[tuple[float, float]] = []
        by_lanelet: dict[int, list[tuple[int, Stretch]]] = {}
        for row, nodes in enumerate(rows):
            for node, stretch in nodes.items():
                by_lanelet.setdefault(node.lanelet, []).append((row, stretch))
        for lanelet, uses in by_lanelet.items():
            strip = self.map.strips[lanelet]
            for part in strip.slices:
                near = _touched(part.hull[None], normals, offsets[[row for row, _ in uses]])[:, 0]
                wanted = [
                    (row, stretch)
                    for (row, stretch), close in zip(uses, near.tolist(), strict=True)
                    if close and stretch.m <= part.ahead
                ]
                if not wanted:
                    continue
                across = np.array([-part.along[1], part.along[0]])
                limits = _limits(strip, part, across, [stretch for _, stretch in wanted])
                low, high = _support_near(road, part, across, self.radius)
                sides = part.hull @ across
                # A lane that is shut ends the body at its border, whatever road lies beyond it.
                low = sides.min() if strip.right_id in shut else low - overhang
                high = sides.max() if strip.left_id in shut else high + overhang
                if {strip.right_id, strip.left_id} & shut:
                    self.relied_on.add("legal_cut_in")
                for (row, _), limit in zip(wanted, limits, strict=True):
                    pieces.append(part.hull)
                    owner.append(row)
                    cuts.append((part.along, limit))
                    edges.append((low, high))
        out: list[list[Region]] = [[] for _ in rows]
        if not pieces:
            return [tuple(r) for r in out]
        rows_of = np.array(owner)
        batch, kept = clip_all(stack(pieces), normals, offsets[rows_of] + ROUNDING)
        along = np.array([c[0] for c in cuts])
        limit = np.array([c[1] for c in cuts])
        across = np.column_stack([-along[:, 1], along[:, 0]])
        for normal, column, sign in ((along, 0, -1), (across, 1, -1), (across, 2, 1)):
            batch, alive = clip(batch, sign * normal[kept], sign * limit[kept, column])
            kept = kept[alive]
        if len(kept):
            batch = minkowski(batch, bodies[rows_of[kept]])
        for column, sign in ((0, -1), (1, 1)):
            bound = np.array([e[column] for e in edges])
            batch, alive = clip(batch, sign * across[kept], sign * bound[kept])
            kept = kept[alive]
        for polygon, row in zip(unpadded(batch), rows_of[kept].tolist(), strict=True):
            out[row].append(Region(polygon))
        return [tuple(r) for r in out]

    def _carriageway(
        self, used: set[int], normals: Array, offsets: Array, shut: frozenset[int] = frozenset()
    ) -> Array:
        """(n, 4, 2) cells of the lanelets that the body may be on; those in `shut` left out."""
        ids = set(self.map.behind([p.lanelet for p in self.places], 2 * self.radius))
        for lanelet in used:
            strip = self.map.strips[lanelet]
            ids |= {i for i in (lanelet, strip.left_id, strip.right_id) if i is not None}
            ids |= set(strip.predecessors) | set(strip.successors)
        ids -= shut
        if not ids:
            return np.empty((0, 4, 2))
        road = np.concatenate([self.map.strips[i].cells for i in sorted(ids)])
        widest = offsets.max(axis=0) + 2 * self.radius + 1.0
        near: Mask = _touched(road, normals, widest[None])[0]
        return np.asarray(road[near])

    def _overhang(self, road: Array) -> float:
        """How far the body may stick out: as far as it does now, if that is farther [m]."""
        corners = self.start_body.vertices
        near = np.abs(road - corners.mean(axis=0)).max(axis=2).min(axis=1) < 3 * self.radius + 5.0
        if not near.any():
            return self.max_overhang
        out = distance(corners[:, None], road[near]).min(axis=1)
        return max(self.max_overhang, float(out.max()) + self.start_body.radius + MARGIN)


def _touched(cells: Array, normals: Array, offsets: Array) -> Mask:
    """(K, n) whether each convex cell (n, v, 2) may meet each {p : normals . p <= offsets[k]}."""
    nearest = (cells @ normals.T).min(axis=1)
    result = np.ones((len(offsets), len(cells)), dtype=bool)
    for j in range(len(normals)):
        result &= nearest[None, :, j] <= offsets[:, j, None] + ROUNDING
    return result


def _limits(strip: Strip, part: Slice, across: Array, stretches: list[Stretch]) -> Array:
    """For each of K stretches the bounds (rear, right, left) of its points in one slice, (K, 3).

    Rear is measured along the slice, right and left across it [m]; the latter are the extremes
    over all its cross-sections, each shortened to y within [low, high].
    """
    index = slice(part.first, part.last + 1)
    half = strip.half[index]
    m, lowest, highest = np.array(stretches).T
    rear = np.maximum(m - part.lag, -FAR)
    centre, unit = strip.centre[index] @ across, strip.across[index] @ across
    right = (centre + np.clip(lowest[:, None], -half, half) * unit).min(axis=1)
    left = (centre + np.clip(highest[:, None], -half, half) * unit).max(axis=1)
    return np.column_stack([rear, right, left])


def _support_near(road: Array, part: Slice, across: Array, radius: float) -> tuple[float, float]:
    """Extent across a slice of the carriageway within `radius` of it [m]."""
    if not len(road):
        return -np.inf, np.inf
    along_hull, across_hull = part.hull @ part.along, part.hull @ across
    along, sideways = road @ part.along, road @ across
    margin = radius + MARGIN
    near = (along.max(axis=1) >= along_hull.min() - margin) & (
        along.min(axis=1) <= along_hull.max() + margin
    )
    near &= (sideways.max(axis=1) >= across_hull.min() - margin) & (
        sideways.min(axis=1) <= across_hull.max() + margin
    )
    if not near.any():
        return -np.inf, np.inf
    return float(sideways[near].min()), float(sideways[near].max())
