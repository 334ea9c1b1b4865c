"""Set-based prediction: everything the others may do under the stated assumptions.

After Koschi & Althoff, "Set-based prediction of traffic participants considering occlusions and
traffic rules", 2020 (paper Sec. III-E). The occupancy of a vehicle is the intersection of

* the acceleration-based set: |a| <= a_max in any direction, |v| <= v_max, and no longer a way than
  with `max_driving` (`motion`);
* the lane-based set: lanes of its own direction in reach, no reversing, bounded lateral speed, no
  shorter a way than with `max_braking` (`lane_sets`), all branches at forks;

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

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sandra.prediction.bodies import with_bodies
from sandra.prediction.geometry import directions
from sandra.prediction.lane_cutting import build_map
from sandra.prediction.lane_table import LaneTable
from sandra.prediction.lanes import LaneMap
from sandra.prediction.most_likely import Likely
from sandra.prediction.motion import (
    MARGIN,
    POSITION_DIRECTIONS,
    bodies,
    circumscribed,
    heading_change,
    least_way,
    position_offsets,
    travelled,
)
from sandra.prediction.observed import (
    NOTHING,
    along_lane,
    check_assumptions,
    ego_lane,
    is_fixed,
    motion_bounds,
    observe,
    towards_ego,
)
from sandra.prediction.occupancy import (
    Occupancy,
    Regions,
    Scope,
    free_occupancies,
    lane_occupancies,
)
from sandra.prediction.straight import Driver, closed_form, road_occupancies
from sandra.prediction.straight_road import StraightRoad
from sandra.prediction.touched import Vehicle
from sandra.prediction.types import PredictedObstacle
from sandra.scene.types import Obstacle, Region, Scene, State
from sandra.settings import Assumptions, Settings

Array = NDArray[np.float64]


def predict_sets(
    scene: Scene,
    likely: tuple[Likely, ...],
    horizon: int,
    settings: Settings,
    instants: bool = True,
    near: Array | None = None,
) -> tuple[tuple[PredictedObstacle, ...], tuple[str, ...]]:
    """The set-based prediction of all others.

    Args:
        scene: the scene.
        likely: the most likely trajectories of the same obstacles; gives `states`.
        horizon: number of steps h.
        settings: for the assumptions, and R_G1's safe distance in `legal_cut_in`.
        instants: whether tight regions at each t_k are wanted; else those of the step before.
        near: (h,) who cannot come as near to the ego's present position in a step gets a disc [m].

    Returns:
        The predictions, and notes in words.

    Raises:
        SettingsError: if a bound of the assumptions is negative or not finite.
        ScenarioError: if a lanelet's border is not finite.
    """
    check_assumptions(settings.assumptions)
    maps = _Maps(scene, _reach(scene, horizon, settings) + 1.0)
    states = (scene.ego.state, *(_first_seen(each.obstacle)[1] for each in likely))
    s_ego, *s = along_lane(scene, np.array([(x.x, x.y) for x in states])).tolist()
    plans = [
        _plan(scene, each, maps, horizon, settings, near, (s_ego, s_other))
        for each, s_other in zip(likely, s, strict=True)
    ]
    lane = ego_lane(scene)
    scope = Scope(
        scene.dt,
        frozenset(lane.lanelets) if lane is not None else frozenset(),
        settings.assumptions.max_overhang,
        instants,
    )
    moving = [plan.participant for plan in plans if isinstance(plan, _Plan)]
    occupancies = _occupancies(moving, maps, horizon, scope)
    found: list[PredictedObstacle] = []
    relied_on: dict[str, list[int]] = {"no_rear_end": [], "legal_cut_in": []}
    for each, plan in zip(likely, plans, strict=True):
        if plan is None:
            found += with_bodies([each], scene.dt)
            continue
        if isinstance(plan, PredictedObstacle):
            found.append(plan)
            continue
        occupancy = next(occupancies)
        prediction = _prediction(each, plan, occupancy, horizon, instants)
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


def _reach(scene: Scene, horizon: int, settings: Settings) -> float:
    """The farthest that any vehicle may come [m]."""
    a = settings.assumptions
    speeds = [
        abs(_first_seen(o)[1].speed) if o.speed_is_known else a.max_speed for o in scene.obstacles
    ]
    start = max(speeds, default=0.0)
    time = np.array(horizon * scene.dt)
    return float(travelled(np.array(start), a.max_acceleration, max(start, a.max_speed), time))


class _Maps:
    """The lanelets as a straight road, if they are one; and cut into cells, if anybody asks."""

    def __init__(self, scene: Scene, reach: float) -> None:
        self._scene, self._reach = scene, reach
        self._cut: LaneMap | None = None
        lane = ego_lane(scene)
        road = StraightRoad.of(scene.lanelets, reach)
        # Who keeps out of the ego's lane must know where that is.
        known = road is not None and (lane is None or road.band(lane.lanelets) is not None)
        self.road = road if known else None

    @property
    def cut(self) -> LaneMap:
        """The lanelets cut into cells."""
        if self._cut is None:
            self._cut = build_map(self._scene.lanelets, self._reach)
        return self._cut


def _occupancies(
    several: list[Vehicle | Driver], maps: _Maps, horizon: int, scope: Scope
) -> Iterator[Occupancy]:
    """The occupancy of each, in order."""
    drivers = [x for x in several if isinstance(x, Driver)]
    vehicles = [x for x in several if isinstance(x, Vehicle)]
    on_road: Iterator[Occupancy] = iter(())
    bound: Iterator[Occupancy] = iter(())
    if drivers and maps.road is not None:
        on_road = iter(road_occupancies(maps.road, drivers, horizon, scope))
    on_lanes = [x for x in vehicles if x.seen.places]
    if on_lanes:
        bound = iter(lane_occupancies(LaneTable.of(maps.cut), on_lanes, scope))
    free = iter(free_occupancies([x for x in vehicles if not x.seen.places]))
    for x in several:
        if isinstance(x, Driver):
            yield next(on_road)
        else:
            yield next(bound) if x.seen.places else next(free)


@dataclass(frozen=True, slots=True, eq=False)
class _Plan:
    """One participant that moves; it is first seen at step `first` (beyond the horizon: never).

    `discs` are its regions as long as it is far away.
    """

    first: int
    participant: Vehicle | Driver
    discs: Regions


def _plan(
    scene: Scene,
    likely: Likely,
    maps: _Maps,
    horizon: int,
    settings: Settings,
    near: Array | None = None,
    s: tuple[float, float] | None = None,
) -> _Plan | PredictedObstacle | None:
    """None for what does not move; the prediction itself for what stays far away."""
    obstacle = likely.obstacle
    if is_fixed(obstacle):
        return None
    first, state = _first_seen(obstacle)
    discs: Regions = ()
    if near is not None and first == 0:
        anywhere = _discs(likely, state, scene.dt, horizon, settings.assumptions)
        away = math.dist((state.x, state.y), (scene.ego.state.x, scene.ego.state.y))
        far = away > near + np.array([disc.radius for (disc,) in anywhere.between])
        if far.all():
            return anywhere
        discs = anywhere.between[: int(far.argmin())]
    now = obstacle.outline.placed(state.x, state.y, state.heading)
    if maps.road is not None and first == 0:
        seen = observe(obstacle, state, maps.road, settings.assumptions)
        law = towards_ego(scene, obstacle, state, seen, settings, s)
        if closed_form(seen, law):
            return _Plan(0, Driver(seen, law, state, obstacle.outline, now, len(discs)), discs)
    seen = observe(obstacle, state, maps.cut, settings.assumptions)
    law = towards_ego(scene, obstacle, state, seen, settings, s) if first == 0 else NOTHING
    normals = directions(POSITION_DIRECTIONS, state.heading)
    times: Array = scene.dt * np.arange(horizon + 1, dtype=np.float64)
    offsets = position_offsets(state, seen.bounds, times, normals)
    # For each direction the support is convex in time: an interval's is that of an end.
    during = np.maximum(offsets[:-1], offsets[1:])
    steps = max(horizon - first, 0)
    offsets[steps + 1 :], during[steps:] = -np.inf, -np.inf
    rows = np.concatenate([offsets, during])
    body = bodies(obstacle.outline, state.heading, heading_change(seen.bounds, times))
    ways = None
    if math.isfinite(seen.braking):
        ways = np.diff(least_way(state.speed, seen.braking, seen.lateral_speed, times))
    vehicle = Vehicle(seen, law, obstacle.outline, now, normals, rows, body, len(discs), ways)
    return _Plan(first, vehicle, discs)


def _discs(
    likely: Likely, state: State, dt: float, horizon: int, assumptions: Assumptions
) -> PredictedObstacle:
    """The farthest that a participant may come in any direction, by its assumptions on motion."""
    obstacle = likely.obstacle
    bounds, holds, dropped = motion_bounds(obstacle, state, assumptions)
    times: Array = dt * np.arange(horizon + 1, dtype=np.float64)
    radii = bounds.way(times) if bounds.speed is not None else bounds.v_max * times
    radii = radii + circumscribed(obstacle.outline) + MARGIN
    centre = np.array([[state.x, state.y]])
    discs = tuple((Region(centre, radius),) for radius in radii.tolist())
    return PredictedObstacle(
        obstacle, discs, discs[1:], likely.states, tuple(holds), tuple(dropped)
    )


def _prediction(
    likely: Likely, plan: _Plan, occupancy: Occupancy, horizon: int, instants: bool
) -> PredictedObstacle:
    """Put a prediction together."""
    obstacle, first, vehicle = likely.obstacle, plan.first, plan.participant
    if first > horizon:
        return PredictedObstacle(obstacle, ((),) * (horizon + 1), ((),) * horizon, likely.states)
    steps = horizon - first
    between = plan.discs + occupancy.rows[horizon + 1 + len(plan.discs) : horizon + 1 + steps]
    later = occupancy.rows[1 : steps + 1] if instants else between
    now: Regions = ((vehicle.start_body,),)
    absent: Regions = ((),) * first
    # In the step before it is first seen it must come from somewhere: it is there already.
    arrival: Regions = now if first else ()
    relied_on = tuple(name for name in vehicle.law.holds if name in occupancy.relied_on)
    return PredictedObstacle(
        obstacle,
        absent + now + later,
        absent[: max(first - 1, 0)] + arrival + between,
        likely.states,
        vehicle.seen.assumptions + relied_on,
        vehicle.seen.dropped + vehicle.law.dropped,
    )


def _first_seen(obstacle: Obstacle) -> tuple[int, State]:
    """The step at which a recording begins, and the state there."""
    if obstacle.states is None or not len(obstacle.states):
        return 0, obstacle.state
    present = np.isfinite(obstacle.states[:, 0])
    if present[0] or not present.any():
        return 0, obstacle.state
    first = int(present.argmax())
    return first, State(*obstacle.states[first, :5].tolist())
