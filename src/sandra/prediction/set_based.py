"""Set-based prediction: everything the others may do under the stated assumptions.

After Koschi & Althoff, "Set-based prediction of traffic participants considering occlusions and
traffic rules", 2020 (paper Sec. III-E). The occupancy of a vehicle is the intersection of

* the acceleration-based set: |a| <= a_max in any direction, |v| <= v_max (`motion`);
* the lane-based set: lanes of its own direction in reach, no reversing, bounded lateral speed
  (`lane_sets`), all branches at forks;

widened by the body at every heading it can have by then, and clipped at the carriageway's edge.
Every step over-approximates; nothing is rounded inwards.

Two assumptions are about the ego (`observed.towards_ego`). `no_rear_end`: a vehicle behind the ego
in its lane gives no region in that lane while it stays in it; the ego may brake, or stay, without
asking whether that vehicle reacts. `legal_cut_in`: who is beside or behind the ego, or ahead by
less than the safe distance, gives no region in the ego's lane; if it gets in front legally later,
it leaves the ego the safe distance, and is seen in the ego's lane at the next decision. Both
concern the ego's *current* lane only: in a neighbouring lane, nothing is left out.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from sandra.prediction import lane_sets
from sandra.prediction.geometry import (
    clip,
    clip_all,
    directions,
    distances,
    minkowski,
    polygons_from_support,
    stack,
    unpadded,
)
from sandra.prediction.lane_sets import LaneSets, Node, Rules, Stretch
from sandra.prediction.lanes import LaneMap, Place, Slice, Strip, build_map
from sandra.prediction.motion import (
    MARGIN,
    POSITION_DIRECTIONS,
    bodies,
    circumscribed,
    heading_change,
    position_offsets,
    travelled,
)
from sandra.prediction.observed import (
    NOTHING,
    Observed,
    TowardsEgo,
    check_assumptions,
    is_fixed,
    observe,
    towards_ego,
)
from sandra.prediction.types import PredictedObstacle
from sandra.scene.types import Obstacle, Region, Scene, State
from sandra.settings import Settings

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Regions = tuple[tuple[Region, ...], ...]

ROUNDING = 1e-9
"""Half-planes are this much wider than computed [m]."""


def predict_sets(
    scene: Scene, likely: tuple[PredictedObstacle, ...], horizon: int, settings: Settings
) -> tuple[tuple[PredictedObstacle, ...], tuple[str, ...]]:
    """The set-based prediction of all others.

    Args:
        scene: the scene.
        likely: the most likely prediction of the same obstacles; gives `states`.
        horizon: number of steps h.
        settings: for the assumptions, and R_G1's safe distance in `legal_cut_in`.

    Returns:
        The predictions, and notes in words.

    Raises:
        SettingsError: if a bound of the assumptions is negative or not finite.
        ScenarioError: if a lanelet's border is not finite.
    """
    check_assumptions(settings.assumptions)
    a = settings.assumptions
    fastest = max([a.max_speed, *(abs(o.state.speed) for o in scene.obstacles)])
    top = max((abs(o.state.speed) for o in scene.obstacles if o.speed_is_known), default=0.0)
    start = fastest if any(not o.speed_is_known for o in scene.obstacles) else top
    time = np.array(horizon * scene.dt)
    reach = float(travelled(np.array(start), a.max_acceleration, fastest, time))
    lane_map = build_map(scene.lanelets, reach + 1.0)
    found = []
    relied_on: dict[str, list[int]] = {"no_rear_end": [], "legal_cut_in": []}
    for each in likely:
        prediction = _predict_one(scene, each, lane_map, horizon, settings)
        found.append(prediction)
        for name, ids in relied_on.items():
            if name in prediction.assumptions:
                ids.append(prediction.obstacle.id)
    notes = []
    for name, sentence in (
        ("no_rear_end", "behind the ego in its lane, assumed not to drive into it"),
        ("legal_cut_in", "assumed not to cut in before the ego within the safe distance"),
    ):
        if relied_on[name]:
            notes.append(f"{sentence}: {', '.join(map(str, relied_on[name]))}")
    return tuple(found), tuple(notes)


def _predict_one(
    scene: Scene, likely: PredictedObstacle, lane_map: LaneMap, horizon: int, settings: Settings
) -> PredictedObstacle:
    obstacle = likely.obstacle
    if is_fixed(obstacle):
        return likely
    first, state = _first_seen(obstacle, horizon)
    if first > horizon:
        return PredictedObstacle(
            obstacle, ((),) * (horizon + 1), ((),) * horizon, likely.states, (), ()
        )
    steps = horizon - first
    seen = observe(obstacle, state, lane_map, settings.assumptions)
    law = towards_ego(scene, obstacle, state, seen, settings) if first == 0 else NOTHING
    now = (obstacle.outline.placed(state.x, state.y, state.heading),)
    at: Regions = (now,)
    between: Regions = ()
    if steps:
        normals = directions(POSITION_DIRECTIONS, state.heading)
        times: Array = scene.dt * np.arange(steps + 1, dtype=np.float64)
        offsets = position_offsets(state, seen.bounds, times, normals)
        # For each direction the support is convex in time: an interval's is that of an end.
        during = np.maximum(offsets[:-1], offsets[1:])
        body = bodies(obstacle.outline, state.heading, heading_change(seen.bounds, times))
        if seen.places:
            overhang = settings.assumptions.max_overhang
            follower = _Follower(obstacle, state, seen, law, lane_map, overhang, scene)
            at_sets, between = follower.occupancies(normals, offsets, during, body)
            at = (now, *at_sets[1:])
        else:
            at = (now, *_free(normals, offsets[1:], body[1:]))
            between = _free(normals, during, body[1:])
    absent: Regions = ((),) * first
    # In the step before it is first seen it must come from somewhere: it is there already.
    arrival: Regions = (now,) if first else ()
    return PredictedObstacle(
        obstacle,
        absent + at,
        absent[: max(first - 1, 0)] + arrival + between,
        likely.states,
        seen.assumptions + law.holds,
        seen.dropped + law.dropped,
    )


def _first_seen(obstacle: Obstacle, horizon: int) -> tuple[int, State]:
    """The step at which a recording begins, and the state there."""
    if obstacle.states is None or not len(obstacle.states):
        return 0, obstacle.state
    present = np.isfinite(obstacle.states[:, 0])
    if present[0] or not present.any():
        return 0, obstacle.state
    first = int(present.argmax())
    x, y, heading, speed = obstacle.states[first, :4].tolist()
    return first, State(x, y, heading, speed)


def _free(normals: Array, offsets: Array, body: Array) -> Regions:
    """The acceleration-based occupancy alone, for each row of offsets (K, J), bodies (K, V, 2)."""
    centres = polygons_from_support(normals, offsets + ROUNDING)
    return tuple((Region(polygon),) for polygon in unpadded(minkowski(centres, body)))


class _Follower:
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
                    if close and stretch.m < strip.s[part.last]
                ]
                if not wanted:
                    continue
                across = np.array([-part.along[1], part.along[0]])
                limits = _limits(strip, part, across, [stretch for _, stretch in wanted])
                low, high = _support_near(road, part, across, self.radius)
                low -= 0.0 if strip.right_id in shut else overhang
                high += 0.0 if strip.left_id in shut else overhang
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
        out = distances(corners, road[near]).min(axis=1)
        return max(self.max_overhang, float(out.max()) + self.start_body.radius + MARGIN)


def _touched(cells: Array, normals: Array, offsets: Array) -> Mask:
    """(K, n) whether each convex cell (n, v, 2) may meet each {p : normals . p <= offsets[k]}."""
    nearest = np.einsum("nvi,ji->njv", cells, normals).min(axis=2)
    result = np.ones((len(offsets), len(cells)), dtype=bool)
    for j in range(len(normals)):
        result &= nearest[None, :, j] <= offsets[:, j, None] + ROUNDING
    return result


def _limits(strip: Strip, part: Slice, across: Array, stretches: list[Stretch]) -> Array:
    """For each of K stretches the bounds (rear, right, left) of its points in one slice, (K, 3).

    Rear is measured along the slice, right and left across it [m]; they are the extremes over the
    cross-sections from station m on, each shortened to y within [low, high].
    """
    index = slice(part.first, part.last + 1)
    s, half = strip.s[index], strip.half[index]
    m, lowest, highest = np.array(stretches).T
    ends = np.stack([strip.right[index] @ part.along, strip.left[index] @ part.along])
    # The rearmost point of the sections from each one on; of those after m, and of the one at m.
    least = np.minimum.accumulate(ends.min(axis=0)[::-1])[::-1]
    i = np.clip(np.searchsorted(s, m, side="right") - 1, 0, len(s) - 2)
    share = np.clip((m - s[i]) / np.maximum(s[i + 1] - s[i], 1e-12), 0.0, 1.0)
    at_m = ((1 - share) * ends[:, i] + share * ends[:, i + 1]).min(axis=0)
    rear = np.minimum(at_m, least[i + 1])
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
