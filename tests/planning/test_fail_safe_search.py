"""Fail-safe trajectories: found where physics allows one, missed where not, and truly safe."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest
import shapely

import sandra
from fail_safe_scenes import (
    FINE,
    SETTINGS,
    STRAIGHT,
    assert_holds,
    before_crossing,
    bodies,
    by_hand,
    dense,
    road,
    search,
    state_of,
    still,
)
from reach_scenes import WIDTH, Course
from sandra.errors import SettingsError
from sandra.planning.fail_safe_search import FailSafe, Miss, fail_safe, fail_safe_horizon
from sandra.planning.single_track import STEERING
from sandra.planning.surroundings import Surroundings
from sandra.prediction import predict
from sandra.scene.types import Obstacle, Region, Scene

# Following: the closed form of the distance for braking to a standstill behind a leader that
# brakes with 12 m/s^2 at once.


@pytest.mark.parametrize(
    ("speed", "other"), [(8.0, 4.0), (12.0, 12.0), (15.0, 8.0), (20.0, 20.0), (10.0, 0.0)]
)
def test_found_just_above_the_distance_that_physics_needs_and_missed_just_below(
    speed: float, other: float
) -> None:
    needed = speed**2 / 12.0 - other**2 / 24.0

    def behind(gap: float) -> FailSafe | Miss:
        return search(road(STRAIGHT, STRAIGHT.car(7, gap + 4.5, 0.0, other), speed=speed))

    # The prediction rounds outwards: bodies may turn while they brake, lanes are cut into cells.
    above = behind(needed + 1.2)
    assert isinstance(above, FailSafe)
    assert above.deceleration == pytest.approx(6.0, abs=0.01)
    below = behind(needed - 0.02)
    assert isinstance(below, Miss)
    assert all("may meet obstacle 7" in reason for reason in below.reasons[:2])
    assert {reason.split(":")[0] for reason in below.reasons} == {
        "brake in the lane",
        "evade within the lane",
        "optimise the speed",
    }


@pytest.mark.parametrize(("level", "gap"), [(2.0, 26.0), (3.0, 17.5), (4.0, 13.5), (5.0, 11.0)])
def test_the_mildest_deceleration_that_holds_is_kept(level: float, gap: float) -> None:
    """10 m/s needs 50 / level metres before a standing car."""
    found = search(road(STRAIGHT, STRAIGHT.car(7, gap + 4.5, 0.0), speed=10.0))
    assert isinstance(found, FailSafe)
    assert found.strategy == "brake in the lane"
    assert found.deceleration == pytest.approx(level, abs=0.01)


def test_an_empty_road_is_braked_on_mildly_and_straight() -> None:
    found = search(road(STRAIGHT, speed=6.0))
    assert isinstance(found, FailSafe)
    assert found.deceleration == pytest.approx(2.0)
    assert found.trajectory.end == pytest.approx(3.0, abs=0.051)
    assert found.trajectory.states[-1, 0] == pytest.approx(9.0, abs=0.05)
    assert np.abs(found.trajectory.states[:, 1]).max() < 1e-6
    assert found.margins.clearance == 5.0


def test_standing_already_needs_no_motion() -> None:
    near = STRAIGHT.car(7, 5.0, 0.0)
    found = search(road(STRAIGHT, near, speed=0.0))
    assert isinstance(found, FailSafe)
    assert found.trajectory.inputs.shape == (0, 2)
    assert found.trajectory.states.shape == (1, 5)
    assert found.deceleration == 0.0


def test_half_a_lane_blocked_is_evaded_within_the_lane() -> None:
    """A pole on the right of the lane, too near to stop before it."""
    pole = dataclasses.replace(
        STRAIGHT.car(7, 9.0, -1.6, outline=Region.disc(0.2), kind="pillar"), is_static=True
    )
    wide = STRAIGHT.lane("current", 100, -2.6, 2.6)
    found = search(STRAIGHT.scene([wide], [pole], speed=12.0, d=-1.0))
    assert isinstance(found, FailSafe)
    ahead = found.trajectory.states[-1]
    assert ahead[0] > 9.0
    assert ahead[1] > -0.6


# Changing lanes.


def changing(course: Course, *obstacles: Obstacle, d: float, speed: float = 12.0) -> Scene:
    return road(course, *obstacles, lanes=2, d=d, angle=0.08, speed=speed)


BENDS = (Course(), Course(0.01), Course(-0.01))


@pytest.mark.parametrize("course", BENDS)
def test_a_lane_change_is_completed_where_the_old_lane_is_blocked(course: Course) -> None:
    scene = changing(course, still(course.car(7, 14.0, 0.9)), d=1.5)
    found = search(scene)
    assert isinstance(found, FailSafe)
    assert found.strategy == "complete the lane change"
    assert scene.left is not None
    end = scene.left.frame.to_curvilinear(found.trajectory.states[-1:, :2])[0, 1]
    assert abs(end) < 0.8


@pytest.mark.parametrize("course", BENDS)
def test_a_lane_change_is_aborted_where_the_new_lane_is_blocked(course: Course) -> None:
    scene = changing(course, still(course.car(7, 20.0, 2.8)), d=0.9)
    found = search(scene)
    assert isinstance(found, FailSafe)
    assert found.strategy == "abort the lane change"
    end = scene.frame.to_curvilinear(found.trajectory.states[-1:, :2])[0, 1]
    assert abs(end) < 0.6


def test_no_way_back_into_a_lane_that_the_body_has_left() -> None:
    """Traffic behind may have closed up there: `no_rear_end` holds for who stays in the lane."""
    scene = changing(Course(), still(Course().car(7, 12.0, WIDTH)), d=WIDTH)
    found = search(scene)
    assert isinstance(found, Miss)
    assert not any(reason.startswith("abort") for reason in found.reasons)


# Intersections.


def test_it_stops_before_a_conflict_area_if_need_be_harder() -> None:
    # 10 m/s and 2 m/s^2 would end within it: the front at 27.25.
    found = search(before_crossing(27.0, 10.0))
    assert isinstance(found, FailSafe)
    assert found.strategy == "brake in the lane"
    assert found.deceleration == pytest.approx(3.0, abs=0.01)
    assert found.trajectory.states[-1, 0] + 2.25 < 25.0


def test_it_leaves_a_conflict_area_that_no_braking_avoids() -> None:
    # Full braking from 6 m/s ends with the front at 5.25, the mildest with the rear at 6.75.
    scene = before_crossing(7.0, 6.0)
    found = search(scene)
    assert isinstance(found, FailSafe)
    assert found.strategy == "leave the conflict area"
    assert found.trajectory.states[-1, 0] - 2.25 > 9.0


def test_standing_in_a_conflict_area_is_no_safe_state() -> None:
    scene = before_crossing(2.0, 0.0)
    prediction = predict(scene, "set-based", 60, SETTINGS)
    found = fail_safe(scene, state_of(scene), 0.0, prediction, SETTINGS)
    assert isinstance(found, FailSafe)
    assert found.strategy == "leave the conflict area"
    assert_holds(scene, prediction, found, state_of(scene), 0.0)
    blocked = before_crossing(2.0, 0.0, still(STRAIGHT.car(7, 7.0, 0.0)))
    prediction = predict(blocked, "set-based", 60, SETTINGS)
    miss = fail_safe(blocked, state_of(blocked), 0.0, prediction, SETTINGS)
    assert isinstance(miss, Miss)
    assert "would stand in a conflict area at (0.0, 0.0)" in str(miss)
    assert "leave the conflict area: " in str(miss)


# Time.


def test_only_what_is_there_from_the_next_decision_on_counts() -> None:
    scene = road(STRAIGHT, speed=5.0)
    wall = Region.rectangle(0.5, 3.0).placed(3.5, 0.0, 0.0)
    horizon = 30
    for t_dec, k, safe in ((0.0, 3, False), (0.4, 3, True), (0.4, 7, False)):
        state = state_of(scene)
        prediction = by_hand(scene, {k: wall}, horizon)
        found = fail_safe(scene, state, t_dec, prediction, SETTINGS)
        assert isinstance(found, FailSafe) == safe
        if isinstance(found, FailSafe):
            assert_holds(scene, prediction, found, state, t_dec)


def test_after_standstill_nothing_is_checked() -> None:
    """Others do not drive into a standing car."""
    scene = road(STRAIGHT, speed=4.0)
    everywhere = Region.rectangle(50.0, 10.0)
    late = dict.fromkeys(range(7, 40), everywhere)
    found = fail_safe(scene, state_of(scene), 0.0, by_hand(scene, late, 40), SETTINGS)
    assert isinstance(found, FailSafe)
    assert found.trajectory.end <= 0.7 + 1e-9
    late[6] = everywhere
    assert isinstance(
        fail_safe(scene, state_of(scene), 0.0, by_hand(scene, late, 40), SETTINGS), Miss
    )


def test_a_prediction_that_ends_too_early_is_the_reason() -> None:
    scene = road(STRAIGHT, speed=10.0)
    prediction = predict(scene, "set-based", 10, SETTINGS)
    miss = fail_safe(scene, state_of(scene), 0.0, prediction, SETTINGS)
    assert isinstance(miss, Miss)
    assert "the prediction ends 1.00 s after the decision" in str(miss)


@pytest.mark.parametrize("speed", [0.0, 3.0, 14.0, 29.0])
@pytest.mark.parametrize("dt", [0.04, 0.1, 0.2])
def test_the_horizon_covers_the_mildest_braking_or_eight_seconds(speed: float, dt: float) -> None:
    scene = road(STRAIGHT, speed=speed, dt=dt)
    for mildest in (2.0, 4.0, 10.0):
        steps = fail_safe_horizon(scene, SETTINGS, dt, mildest)
        fastest = speed + 6.0 * dt
        level = min(mildest, 6.0)
        assert steps * dt >= dt + min(fastest / level, 8.0) - 1e-9
        assert steps * dt <= dt + max(min(fastest / level, 8.0), fastest / 5.9) + 2.1 * dt
    assert fail_safe_horizon(scene, SETTINGS) == fail_safe_horizon(scene, SETTINGS, dt, 2.0)


# Input that is refused.


def test_input_that_is_refused() -> None:
    scene = road(STRAIGHT, speed=5.0)
    state = state_of(scene)
    prediction = by_hand(scene, {}, 30)
    likely = dataclasses.replace(prediction, kind="most-likely")
    with pytest.raises(SettingsError, match="needs a set-based prediction"):
        fail_safe(scene, state, 0.0, likely, SETTINGS)
    with pytest.raises(SettingsError, match="predict again"):
        fail_safe(scene, state, 0.0, dataclasses.replace(prediction, dt=0.2), SETTINGS)
    for t_dec in (0.05, -0.1):
        with pytest.raises(SettingsError, match="multiple of dt"):
            fail_safe(scene, state, t_dec, prediction, SETTINGS)
    for bad in (np.full(5, np.nan), np.array([0.0, 0.0, 0.0, -1.0, 0.0]), np.zeros(4)):
        with pytest.raises(ValueError, match="five finite numbers"):
            fail_safe(scene, bad, 0.0, prediction, SETTINGS)


def test_an_ego_that_cannot_brake_has_no_fail_safe() -> None:
    scene = road(STRAIGHT, speed=5.0)
    weak = SETTINGS.replace(a_lon_min=0.0)
    found = fail_safe(scene, state_of(scene), 0.0, by_hand(scene, {}, 30), weak)
    assert isinstance(found, Miss)
    assert "allows no braking" in str(found)


def test_a_state_off_the_road_has_no_fail_safe() -> None:
    scene = road(STRAIGHT, speed=5.0, d=1.2)
    found = search(scene)
    assert isinstance(found, Miss)
    assert "leaves the road" in str(found)


def test_nothing_carries_over_from_one_search_to_the_next() -> None:
    scene = road(STRAIGHT, STRAIGHT.car(7, 25.0, 0.0, 5.0), speed=10.0)
    prediction = predict(scene, "set-based", 50, SETTINGS)
    shared = Surroundings.of(scene, prediction)
    first = fail_safe(scene, state_of(scene), 0.0, prediction, SETTINGS, shared)
    later = state_of(scene) + np.array([3.0, 0.2, 0.0, 2.0, 0.0])
    fail_safe(scene, later, 0.2, prediction, SETTINGS, shared)
    again = fail_safe(scene, state_of(scene), 0.0, prediction, SETTINGS, shared)
    alone = fail_safe(scene, state_of(scene), 0.0, prediction, SETTINGS)
    assert isinstance(first, FailSafe)
    for other in (again, alone):
        assert isinstance(other, FailSafe)
        assert np.array_equal(first.trajectory.states, other.trajectory.states)
        assert first.margins == other.margins


# Whatever is found holds.


@pytest.mark.parametrize("seed", range(14))
def test_whatever_is_found_holds(seed: int) -> None:
    rng = np.random.default_rng(seed)
    course = Course(float(rng.choice([0.0, 0.015, -0.015])), step=2.0)
    others = [
        course.car(10 + i, rng.uniform(6.0, 50.0), rng.choice([0.0, WIDTH]), rng.uniform(0.0, 15.0))
        for i in range(int(rng.integers(0, 3)))
    ]
    d, angle = rng.uniform(-0.7, WIDTH + 0.7), rng.uniform(-0.12, 0.12)
    scene = road(course, *others, lanes=2, speed=rng.uniform(0.0, 16.0), d=d, angle=angle)
    state = state_of(scene)
    state[STEERING] = rng.uniform(-0.05, 0.05)
    found = search(scene, state=state)
    assert isinstance(found, FailSafe) or found.reasons


@pytest.mark.parametrize("lanes", [1, 2])
def test_no_adversary_collides(lanes: int) -> None:
    """Others that brake, speed up, swerve at random within the bounds; the leader brakes hard."""
    rng = np.random.default_rng(lanes)
    found_some = 0
    for case in range(14):
        speed, gap = rng.uniform(5.0, 18.0), rng.uniform(8.0, 35.0)
        cars = [STRAIGHT.car(10, gap + 4.5, 0.0, rng.uniform(0.0, 18.0))]
        if lanes == 2:
            cars.append(STRAIGHT.car(11, rng.uniform(15.0, 60.0), WIDTH, rng.uniform(0.0, 18.0)))
        scene = road(STRAIGHT, *cars, lanes=lanes, speed=float(speed))
        horizon = fail_safe_horizon(scene, SETTINGS, 0.0, 4.0)
        prediction = predict(scene, "set-based", horizon, SETTINGS)
        found = fail_safe(scene, state_of(scene), 0.0, prediction, SETTINGS)
        if isinstance(found, Miss):
            continue
        found_some += 1
        driven = dense(found.trajectory, scene.ego.wheelbase)
        ego = bodies(driven, scene)
        for run in range(6):
            for car in cars:
                poses = adversary(car, len(ego), found.trajectory.tau / FINE, rng, run == 0)
                for body, pose in zip(ego, poses, strict=True):
                    other = shapely.Polygon(car.outline.placed(*pose).vertices)
                    assert not body.intersects(other), (case, run, car.id)
    assert found_some >= 4


def adversary(
    car: Obstacle, count: int, step_s: float, rng: np.random.Generator, brakes: bool
) -> np.ndarray:
    """(count, 3) poses x, y, heading; every (FINE + 1)-th repeats the one before, as `dense`."""
    x, y, psi, v = car.state.x, car.state.y, 0.0, car.state.speed
    lane = y
    poses = []
    push, bend = -12.0, 0.0
    for i in range(count):
        poses.append((x, y, psi))
        if i % (FINE + 1) == FINE:
            continue
        if not brakes and i % 20 == 0:
            push = float(rng.choice([-12.0, 12.0, rng.uniform(-12.0, 12.0)]))
            bend = float(rng.choice([-0.03, 0.0, 0.03]))
        turn = bend if abs(psi + bend * v * step_s) < 0.15 else 0.0
        # It stays on the road, and in lane, if it is in the ego's; others may come over.
        room = 0.3 if lane == 0.0 else 0.8
        outward = y - lane > room or (lane == 0.0 and y - lane < -room)
        if outward or y < -0.5:
            turn = float(np.clip(-psi, -0.03, 0.03))
        grip = np.sqrt(max(144.0 - (v * v * turn) ** 2, 0.0))
        after = max(0.0, v + float(np.clip(push, -grip, grip)) * step_s)
        way = (v + after) / 2 * step_s
        psi, v = psi + turn * way, after
        x, y = x + way * np.cos(psi), y + way * np.sin(psi)
        y = float(np.clip(y, lane - 0.6, lane + 0.6)) if lane == 0.0 else min(y, lane + 0.6)
    return np.array(poses)


# Real data.

EXAMPLES = ("intersection", "roadworks", "recorded-ego")


@pytest.mark.parametrize("name", EXAMPLES)
def test_examples_start_with_a_fail_safe(name: str) -> None:
    scene = sandra.load(sandra.example(name))
    horizon = fail_safe_horizon(scene, SETTINGS, 0.0, mildest=5.0)
    prediction = predict(scene, "set-based", horizon, SETTINGS)
    found = fail_safe(scene, state_of(scene), 0.0, prediction, SETTINGS)
    assert isinstance(found, FailSafe)
    assert_holds(scene, prediction, found, state_of(scene), 0.0)


def test_the_example_in_which_nothing_is_safe() -> None:
    scene = sandra.load(sandra.example("nothing-safe"))
    found = search(scene)
    assert isinstance(found, Miss)
    assert len(found.reasons) == 3


def test_the_case_study_starts_with_a_fail_safe(shared: Path) -> None:
    scene = sandra.load(shared / "data/scenarios/DEU_Goeppingen-37_1_T-4.xml")
    horizon = fail_safe_horizon(scene, SETTINGS, 0.0, mildest=4.0)
    prediction = predict(scene, "set-based", horizon, SETTINGS)
    found = fail_safe(scene, state_of(scene), 0.0, prediction, SETTINGS)
    assert isinstance(found, FailSafe)
    assert_holds(scene, prediction, found, state_of(scene), 0.0)
