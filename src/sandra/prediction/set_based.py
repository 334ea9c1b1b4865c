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

from sandra.prediction.geometry import directions
from sandra.prediction.lanes import LaneMap, build_map
from sandra.prediction.motion import (
    POSITION_DIRECTIONS,
    bodies,
    heading_change,
    position_offsets,
    travelled,
)
from sandra.prediction.observed import NOTHING, check_assumptions, is_fixed, observe, towards_ego
from sandra.prediction.occupancy import Follower, Regions, free_occupancies
from sandra.prediction.types import PredictedObstacle
from sandra.scene.types import Obstacle, Scene, State
from sandra.settings import Settings

Array = NDArray[np.float64]


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
    speeds = [
        abs(_first_seen(o)[1].speed) if o.speed_is_known else a.max_speed for o in scene.obstacles
    ]
    start = max(speeds, default=0.0)
    fastest = max(start, a.max_speed)
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
    first, state = _first_seen(obstacle)
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
    relied_on: tuple[str, ...] = ()
    if steps:
        normals = directions(POSITION_DIRECTIONS, state.heading)
        times: Array = scene.dt * np.arange(steps + 1, dtype=np.float64)
        offsets = position_offsets(state, seen.bounds, times, normals)
        # For each direction the support is convex in time: an interval's is that of an end.
        during = np.maximum(offsets[:-1], offsets[1:])
        body = bodies(obstacle.outline, state.heading, heading_change(seen.bounds, times))
        if seen.places:
            overhang = settings.assumptions.max_overhang
            follower = Follower(obstacle, state, seen, law, lane_map, overhang, scene)
            at_sets, between = follower.occupancies(normals, offsets, during, body)
            at = (now, *at_sets[1:])
            relied_on = tuple(name for name in law.holds if name in follower.relied_on)
        else:
            at = (now, *free_occupancies(normals, offsets[1:], body[1:]))
            between = free_occupancies(normals, during, body[1:])
    absent: Regions = ((),) * first
    # In the step before it is first seen it must come from somewhere: it is there already.
    arrival: Regions = (now,) if first else ()
    return PredictedObstacle(
        obstacle,
        absent + at,
        absent[: max(first - 1, 0)] + arrival + between,
        likely.states,
        seen.assumptions + relied_on,
        seen.dropped + law.dropped,
    )


def _first_seen(obstacle: Obstacle) -> tuple[int, State]:
    """The step at which a recording begins, and the state there."""
    if obstacle.states is None or not len(obstacle.states):
        return 0, obstacle.state
    present = np.isfinite(obstacle.states[:, 0])
    if present[0] or not present.any():
        return 0, obstacle.state
    first = int(present.argmax())
    x, y, heading, speed = obstacle.states[first, :4].tolist()
    return first, State(x, y, heading, speed)
