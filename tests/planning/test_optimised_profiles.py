"""Speed profiles from the optimisation: where no constant deceleration holds, and nowhere else."""

from __future__ import annotations

import numpy as np
import pytest

from certified import constant, drive, initial
from fail_safe_scenes import (
    SETTINGS,
    STRAIGHT,
    assert_holds,
    before_crossing,
    by_hand,
    junction,
    road,
    state_of,
)
from reach_scenes import CAR, Course
from sandra.actions import ActionPair
from sandra.certificate import certificate, check
from sandra.logic import specification
from sandra.planning import path_gaps
from sandra.planning.fail_safe_candidates import Task, lateral_paths, simulate
from sandra.planning.fail_safe_checks import Failures, mildest_that_holds
from sandra.planning.fail_safe_rounds import SAMPLED, optimising
from sandra.planning.fail_safe_search import FailSafe, Miss, fail_safe, fail_safe_horizon
from sandra.planning.limits import within_limits
from sandra.planning.optimised_profiles import profiles
from sandra.planning.path_gaps import Track
from sandra.planning.single_track import SPEED
from sandra.planning.strategies import OPTIMISE, stopping_aims
from sandra.planning.surroundings import Surroundings
from sandra.planning.validity import CLEARANCE
from sandra.prediction import Prediction, predict
from sandra.scene.types import Obstacle, Region, Scene, State

HORIZON = 60
FULL = -SETTINGS.a_lon_min


def wall(low: float, high: float) -> Region:
    """Across the lane, from `low` to `high` along it [m]."""
    return Region.rectangle(high - low, 3.0).placed((low + high) / 2, 0.0, 0.0)


def sampled(scene: Scene, prediction: Prediction) -> FailSafe | Miss:
    """What is found without the optimisation."""
    return fail_safe(scene, state_of(scene), 0.0, prediction, SETTINGS, rounds=SAMPLED)


def only_optimised(scene: Scene, prediction: Prediction) -> FailSafe:
    """What the optimisation finds where nothing else is found; it holds."""
    assert isinstance(sampled(scene, prediction), Miss)
    found = fail_safe(scene, state_of(scene), 0.0, prediction, SETTINGS)
    assert isinstance(found, FailSafe), found
    assert found.strategy == OPTIMISE
    assert_holds(scene, prediction, found, state_of(scene), 0.0)
    assert found.deceleration <= FULL
    return found


def task_of(scene: Scene, prediction: Prediction) -> Task:
    shared = Surroundings.of(scene, prediction)
    state = state_of(scene)
    return Task.of(scene, state, 0.0, 0, prediction.horizon, SETTINGS, shared)


def track_of(scene: Scene, prediction: Prediction, distance: float = 100.0) -> Track:
    """Along the first path in the lane."""
    task = task_of(scene, prediction)
    aims = stopping_aims(scene, task.state, task.now)[:1]
    ((_, along),) = lateral_paths(task, aims, distance)
    assert along is not None
    track = Track.of(task, along)
    assert track is not None
    return track


# Where constant decelerations fail.


def crossing_car(y: float, speed: float = 8.0) -> Obstacle:
    """On the lane that crosses at x = 9 m, towards the ego's lane."""
    return Obstacle(7, "car", CAR, State(9.0, y, -np.pi / 2, speed))


def test_it_passes_before_a_crossing_car_and_stands_beyond_the_conflict_area() -> None:
    # From 9 m/s it would stop with its front at 9.0, amid the area from 7 to 11.
    scene = before_crossing(9.0, 9.0, crossing_car(22.0))
    prediction = predict(scene, "set-based", HORIZON, SETTINGS)
    found = only_optimised(scene, prediction)
    inputs, states = found.trajectory.inputs, found.trajectory.states
    assert inputs[0, 0] > 3.0, "harder than any acceleration that is sampled"
    assert states[-1, 0] - 2.25 > 11.0


def test_it_stops_short_of_a_conflict_area_braking_late() -> None:
    """What follows behind is past 3.15 m after 0.8 s: what brakes at once is in its way."""
    scene = before_crossing(12.2, 8.0)
    beyond, behind = wall(14.5, 60.0), wall(-20.0, 3.15)
    between = {k: (beyond,) if k < 8 else (beyond, behind) for k in range(HORIZON)}
    found = only_optimised(scene, by_hand(scene, between, HORIZON))
    inputs, states = found.trajectory.inputs[:, 0], found.trajectory.states
    assert 5.4 < states[-1, 0] < 10.2 - 2.25
    # As mild as can be: 4.0 m/s^2 from the beginning would be too early.
    assert inputs[0] > inputs.min() + 0.5
    assert found.margins.conflict < 0.5


def test_it_brakes_hard_first_and_then_rolls_on_gently() -> None:
    """The way ahead opens slowly, and it must not stand where it would stop behind it."""
    scene = before_crossing(9.0, 8.0)
    between = {k: wall(9.0 + 0.1 * k + 0.35 * max(0, k - 15), 60.0) for k in range(HORIZON)}
    found = only_optimised(scene, by_hand(scene, between, HORIZON))
    inputs, states = found.trajectory.inputs[:, 0], found.trajectory.states
    assert inputs[:30].max() < -3.0
    assert inputs[35:].min() > -2.0
    assert states[-1, 0] - 2.25 > 11.0


def test_on_a_bend_the_speed_stays_within_the_grip() -> None:
    """9 m/s on a radius of 25 m need 3.2 of 4 m/s^2: there is little room to speed up."""
    course = Course(0.04)
    scene = road(course, speed=9.0)
    beta = np.arcsin(0.04 * 2.6 / 2)
    state = np.array([0.0, 0.0, -beta, 9.0, np.arctan(2 * np.tan(beta))])
    behind = Region.disc(1.0).placed(-2.0, 0.0, 0.0)
    prediction = by_hand(scene, dict.fromkeys(range(6, HORIZON), behind), HORIZON)
    shared = Surroundings.of(scene, prediction)
    task = Task.of(scene, state, 0.0, 0, HORIZON, SETTINGS, shared)
    candidates, _ = simulate(task, optimising(task).attempts)
    assert candidates is not None
    assert candidates.states[..., SPEED].max() < np.sqrt(4.0 / 0.04) * 1.02
    assert within_limits(candidates.states, candidates.inputs, 2.6, task.limits).all()
    assert mildest_that_holds(task, candidates, Failures()) is not None


def test_at_junctions_it_finds_what_samples_miss_and_all_of_it_holds() -> None:
    gained = 0
    for seed in range(30):
        scene = junction(seed)
        horizon = fail_safe_horizon(scene, SETTINGS, 0.0, 4.0)
        prediction = predict(scene, "set-based", horizon, SETTINGS)
        found = fail_safe(scene, state_of(scene), 0.0, prediction, SETTINGS)
        if isinstance(found, FailSafe) and found.strategy == OPTIMISE:
            gained += 1
            assert_holds(scene, prediction, found, state_of(scene), 0.0)
            assert found.deceleration <= FULL
            assert isinstance(sampled(scene, prediction), Miss)
    assert gained >= 2


# Where nothing holds.


def test_a_car_that_comes_sooner_leaves_nothing() -> None:
    scene = before_crossing(9.0, 9.0, crossing_car(18.0))
    prediction = predict(scene, "set-based", HORIZON, SETTINGS)
    found = fail_safe(scene, state_of(scene), 0.0, prediction, SETTINGS)
    assert isinstance(found, Miss)
    assert f"{OPTIMISE}: at any speed it may meet obstacle 7" in found.reasons[-1]


def test_a_wall_that_closes_leaves_nothing() -> None:
    scene = road(STRAIGHT, speed=8.0)
    near = by_hand(scene, dict.fromkeys(range(HORIZON), wall(7.5, 60.0)), HORIZON)
    assert isinstance(fail_safe(scene, state_of(scene), 0.0, near, SETTINGS), Miss)


def test_without_a_place_to_stand_that_is_the_reason() -> None:
    """An area that begins under the ego and ends at a wall."""
    scene = before_crossing(4.0, 3.0)
    shut = by_hand(scene, dict.fromkeys(range(HORIZON), wall(8.0, 60.0)), HORIZON)
    found = fail_safe(scene, state_of(scene), 0.0, shut, SETTINGS)
    assert isinstance(found, Miss)
    assert found.reasons[-1].startswith(OPTIMISE)
    assert "no place to stand" in found.reasons[-1]


def test_a_solver_that_fails_finds_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    """It gives up at once: a miss that says so, never an answer."""
    monkeypatch.setattr("sandra.planning.optimised_profiles.MOST_ITERATIONS", 0)
    scene = before_crossing(9.0, 9.0, crossing_car(22.0))
    prediction = predict(scene, "set-based", HORIZON, SETTINGS)
    found = fail_safe(scene, state_of(scene), 0.0, prediction, SETTINGS)
    assert isinstance(found, Miss)
    assert f"{OPTIMISE}: the solver gave up" in found.reasons[-1]


def test_what_the_solver_says_is_checked(monkeypatch: pytest.MonkeyPatch) -> None:
    """With gaps that are none its profiles fail the checks of every candidate."""

    def everything(self: Track, step: int, low: float, high: float) -> list[path_gaps.Stretch]:
        return [(0.0, self.length)]

    monkeypatch.setattr(Track, "free", everything)
    scene = before_crossing(9.0, 9.0, crossing_car(18.0))
    prediction = predict(scene, "set-based", HORIZON, SETTINGS)
    found = fail_safe(scene, state_of(scene), 0.0, prediction, SETTINGS)
    assert isinstance(found, Miss)
    assert "may meet obstacle 7" in found.reasons[-1]


# The certificate.


def test_the_independent_checker_accepts_it() -> None:
    scene = before_crossing(9.0, 9.0, crossing_car(24.0))
    witness = drive(initial(scene), constant(0.0, 20))
    possible = predict(scene, "set-based", HORIZON, SETTINGS)
    found = fail_safe(scene, witness.states[2], 0.1, possible, SETTINGS)
    assert isinstance(found, FailSafe)
    assert found.strategy == OPTIMISE
    spec = specification(ActionPair.parse("keep,follow-lane"), (), SETTINGS, dt=0.1)
    likely = predict(scene, "most-likely", 10, SETTINGS)
    stop = found.trajectory
    proposed = certificate(scene, spec, (), likely, possible, witness, 0.1, stop, SETTINGS)
    report = check(proposed)
    assert report.accepted, report


# Gaps.


@pytest.mark.parametrize("seed", range(6))
def test_free_stretches_are_free_and_taken_ones_are_not(seed: int) -> None:
    """Against the body, placed densely on the path, and the distance by shapely."""
    import shapely

    rng = np.random.default_rng(seed)
    course = Course(float(rng.choice([0.0, 0.02, -0.02])))
    scene = road(course, speed=8.0)
    regions = tuple(
        Region.rectangle(*rng.uniform(0.5, 6.0, 2)).placed(
            *course.at(rng.uniform(4.0, 40.0), rng.uniform(-4.0, 4.0)).ravel(),
            rng.uniform(0.0, 3.0),
        )
        for _ in range(3)
    )
    track = track_of(scene, by_hand(scene, dict.fromkeys(range(HORIZON), regions), HORIZON), 40.0)
    gaps = track.free(0, 0.0, 38.0)
    shapes = [shapely.convex_hull(shapely.MultiPoint(r.vertices)) for r in regions]
    bodies = shapely.polygons(track.bodies)
    distance = np.min([shapely.distance(bodies, x) for x in shapes], axis=0)
    for s, gap in zip(track.distance, distance, strict=True):
        if s > 38.0:
            break
        if any(low <= s <= high for low, high in gaps):
            assert gap > CLEARANCE
        elif all(abs(s - end) > 2 * path_gaps.CELL for x in gaps for end in x):
            # Blocks within a taken run are not looked at more closely.
            around = np.abs(track.distance - s) <= 2 * path_gaps.BLOCK * path_gaps.CELL
            assert distance[around].min() <= CLEARANCE + path_gaps.SLACK + path_gaps.CELL


# Whatever is optimised keeps the limits and is no harder than full braking.


@pytest.mark.parametrize("seed", range(8))
def test_profiles_keep_the_limits_and_end_at_rest(seed: int) -> None:
    rng = np.random.default_rng(seed)
    scene = before_crossing(rng.uniform(6.0, 14.0), rng.uniform(2.0, 12.0))
    closing = float(rng.uniform(9.0, 25.0)), float(rng.uniform(-0.1, 0.3))
    between = {k: wall(max(closing[0] + closing[1] * k, 6.0), 90.0) for k in range(HORIZON)}
    prediction = by_hand(scene, between, HORIZON)
    track = track_of(scene, prediction)
    found, reason = profiles(track)
    assert found or reason
    for speeds in found:
        assert speeds[0] == track.task.speed
        assert speeds[-1] == 0.0
        assert (speeds[1:-1] > 0.0).all()
        acceleration = np.diff(speeds) / track.task.tau
        assert np.abs(acceleration).max() <= FULL
        travelled = track.task.driven(speeds)
        assert any(low - 1e-6 <= travelled <= high + 1e-6 for low, high in track.places)
        # The mildest standstill there could be needs v^2 / 2s.
        assert -acceleration.min() >= speeds[0] ** 2 / (2 * travelled) - 1e-3
