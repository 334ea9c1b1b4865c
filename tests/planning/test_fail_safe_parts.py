"""Parts of the fail-safe search by themselves: its task, its rounds, and its reasons."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from fail_safe_scenes import (
    SETTINGS,
    STRAIGHT,
    before_crossing,
    by_hand,
    road,
    state_of,
)
from sandra.errors import SettingsError
from sandra.planning import strategies
from sandra.planning.fail_safe_candidates import Task
from sandra.planning.fail_safe_checks import Failures
from sandra.planning.fail_safe_rounds import _in_reach, braking, evading, leaving, optimising
from sandra.planning.fail_safe_search import (
    FailSafe,
    Miss,
    fail_safe,
    fail_safe_horizon,
)
from sandra.planning.surroundings import Surroundings
from sandra.scene.types import Region, Scene
from sandra.settings import Settings

HORIZON = 60


def task_of(scene: Scene, settings: Settings = SETTINGS, first: int = 0) -> Task:
    shared = Surroundings.of(scene, by_hand(scene, {}, HORIZON))
    return Task.of(scene, state_of(scene), 0.1 * first, first, HORIZON - first, settings, shared)


@pytest.mark.parametrize(
    ("limit", "speed", "top"),
    [(12.0, 8.0, 12.0), (12.0, 14.0, 14.0), (40.0, 8.0, 29.999)],
)
def test_no_maneuver_is_faster_than_the_limit_or_the_ego(
    limit: float, speed: float, top: float
) -> None:
    scene = STRAIGHT.scene(STRAIGHT.lanes(left=0, right=0, limit=limit), speed=speed)
    assert task_of(scene).top == pytest.approx(top)


def test_without_a_sign_the_settings_bound_the_speed() -> None:
    scene = STRAIGHT.scene(STRAIGHT.lanes(left=0, right=0, limit=None), speed=8.0)
    assert task_of(scene).top == pytest.approx(29.999)
    fast = STRAIGHT.scene(speed=31.0)
    assert task_of(fast).top == 31.0
    assert task_of(fast).limits.v_max == 31.0


def test_a_task_counts_from_its_own_time() -> None:
    task = task_of(road(STRAIGHT, speed=8.0), first=4)
    assert (task.steps, task.most, task.per_step, task.tau) == (56, 112, 2, 0.05)
    assert task.driven(np.array([8.0, 8.0, 6.0, 0.0])) == pytest.approx(0.05 * 18.0)


@pytest.mark.parametrize(("speed", "moves"), [(0.0, False), (1e-6, False), (2e-6, True)])
def test_who_stands_need_not_brake(speed: float, moves: bool) -> None:
    task = task_of(road(STRAIGHT, speed=speed))
    assert bool(braking(task).attempts) == moves
    assert bool(evading(task).attempts) == moves
    found = fail_safe(task.scene, task.state, 0.0, by_hand(task.scene, {}, HORIZON), SETTINGS)
    assert isinstance(found, FailSafe)
    assert bool(len(found.trajectory.inputs)) == moves


def test_rolling_back_is_refused_and_rounding_is_none() -> None:
    scene = road(STRAIGHT, speed=0.0)
    prediction = by_hand(scene, {}, HORIZON)
    state = state_of(scene)
    for speed, good in ((-1e-6, True), (-1.1e-6, False)):
        state[3] = speed
        if good:
            assert isinstance(fail_safe(scene, state, 0.0, prediction, SETTINGS), FailSafe)
            continue
        with pytest.raises(ValueError, match="speed >= 0"):
            fail_safe(scene, state, 0.0, prediction, SETTINGS)


@pytest.mark.parametrize("t_dec", [-0.1, 0.05, 0.1 + 2e-6, 0.1 - 2e-6])
def test_a_decision_is_due_at_a_step(t_dec: float) -> None:
    scene = road(STRAIGHT, speed=5.0)
    with pytest.raises(SettingsError, match="multiple of dt"):
        fail_safe(scene, state_of(scene), t_dec, by_hand(scene, {}, HORIZON), SETTINGS)


def test_a_prediction_of_another_time_step_or_kind_is_refused() -> None:
    scene = road(STRAIGHT, speed=5.0)
    prediction = by_hand(scene, {}, HORIZON)
    for other in (0.1 + 2e-9, 0.1 - 2e-9, 0.2):
        with pytest.raises(SettingsError, match="predict again"):
            fail_safe(scene, state_of(scene), 0.0, replace(prediction, dt=other), SETTINGS)
    with pytest.raises(SettingsError, match="set-based"):
        fail_safe(scene, state_of(scene), 0.0, replace(prediction, kind="recorded"), SETTINGS)


def test_leaving_a_conflict_area_straight_on_or_to_the_lanes_centre() -> None:
    scene = before_crossing(7.0, 6.0)
    (attempt,) = leaving(task_of(scene)).attempts
    assert {a.strategy for a in attempt.aims} == {strategies.LEAVE}
    targets = [a.target for a in attempt.aims]
    assert np.isnan(targets[: len(targets) // 2]).all()
    assert targets[len(targets) // 2 :] == [0.0] * (len(targets) // 2)


def test_conflict_areas_behind_or_out_of_reach_are_no_matter() -> None:
    """In 8 s at 2 m/s nobody comes to 50 m; and what is behind is left already."""
    for x, speed in ((50.0, 2.0), (-20.0, 6.0)):
        assert leaving(task_of(before_crossing(x, speed))).attempts == ()


def test_a_contact_in_the_first_step_is_one() -> None:
    """Whatever it does later, at the start something is in the way for a moment."""
    scene = road(STRAIGHT, speed=8.0)
    here = Region.rectangle(0.5, 0.5).placed(2.4, 0.0, 0.0)
    found = fail_safe(scene, state_of(scene), 0.0, by_hand(scene, {0: here}, HORIZON), SETTINGS)
    assert isinstance(found, Miss)
    assert any("may meet obstacle 7 0.00 s from now" in reason for reason in found.reasons)


def test_of_the_failures_the_nearest_to_success_is_kept() -> None:
    failures = Failures()
    assert failures.best("a") == ()
    failures.add("a", "first", 1.0, 2.0)
    failures.add("a", "worse", 1.0, 1.0)
    failures.add("b", "other", 0.0)
    assert failures.best("a") == (1.0, 2.0)
    failures.add("a", "the same", 1.0, 2.0)
    assert failures.reasons() == ("a: first", "b: other")
    failures.add("a", "better", 2.0)
    assert failures.reasons() == ("a: better", "b: other")


@pytest.mark.parametrize(
    ("speed", "t_dec", "mildest", "a_min", "a_max", "steps"),
    [
        # 10 m/s and 2 m/s^2: 5 s, one step more.
        (10.0, 0.0, 2.0, -6.0, 6.0, 51),
        # At most 8 s.
        (20.0, 0.0, 2.0, -6.0, 6.0, 81),
        # But what full braking takes, 0.998 m/s^2.
        (20.0, 0.0, 2.0, -1.0, 6.0, 202),
        # After 0.5 s with 6 m/s^2 more: 13 m/s, 6.5 s.
        (10.0, 0.5, 2.0, -6.0, 6.0, 71),
        (10.0, 0.5, 2.0, -6.0, 0.0, 56),
        (10.0, 0.0, 4.0, -6.0, 6.0, 26),
        (0.0, 0.0, 2.0, -6.0, 6.0, 1),
    ],
)
def test_how_long_a_prediction_is_needed(
    speed: float, t_dec: float, mildest: float, a_min: float, a_max: float, steps: int
) -> None:
    settings = Settings(a_lon_min=a_min, a_lon_max=a_max)
    scene = road(STRAIGHT, speed=speed)
    assert fail_safe_horizon(scene, settings, t_dec, mildest) == steps


def test_why_it_cannot_stay_in_a_conflict_area() -> None:
    """Standing within it, and no time is predicted for leaving."""
    scene = before_crossing(2.0, 0.0)
    found = fail_safe(scene, state_of(scene), 0.0, by_hand(scene, {}, 3), SETTINGS)
    assert isinstance(found, Miss)
    assert found.reasons[:2] == (
        f"{strategies.BRAKE}: would stand in a conflict area at (0.0, 0.0)",
        f"{strategies.LEAVE}: no way out of it in the time predicted",
    )
    assert leaving(replace(task_of(scene), steps=3)).missing == (
        (strategies.LEAVE, "no way out of it in the time predicted"),
    )
    assert leaving(replace(task_of(road(STRAIGHT, speed=6.0)), steps=3)).missing == ()


def test_speeds_are_optimised_on_paths_that_are_not_too_abrupt() -> None:
    """Over the second of the lengths, where there is more than one."""
    for speed, length in ((8.0, 12.8), (1.0, 4.0)):
        attempts = optimising(task_of(road(STRAIGHT, speed=speed))).attempts
        assert {aim.length for each in attempts for aim in each.aims} == {length}
        assert {aim.strategy for each in attempts for aim in each.aims} == {strategies.OPTIMISE}


def test_areas_that_the_body_just_touches_or_just_comes_to_are_left_alone() -> None:
    """2 m of the body to the front and the rear, 8 m ahead."""

    def within_reach(low: float, high: float) -> bool:
        return _in_reach(np.array([low, high, low]), 2.0, 8.0)

    assert not within_reach(-5.0, -2.0)
    assert within_reach(-5.0, float(np.nextafter(-2.0, 0.0)))
    assert not within_reach(10.0, 12.0)
    assert within_reach(float(np.nextafter(10.0, 0.0)), 12.0)
    assert within_reach(-5.0, 12.0)


def test_why_there_is_no_path_at_all() -> None:
    """Across the lane there is no line to follow; with the wheel turned far at speed no grip."""
    scene = road(STRAIGHT, speed=12.0)
    for column, value, words in (
        (2, np.pi / 2, "the lane is too crooked, or not the ego's direction"),
        (4, 0.3, "no path within the limits of steering and grip"),
    ):
        state = state_of(scene)
        state[column] = value
        found = fail_safe(scene, state, 0.0, by_hand(scene, {}, HORIZON), SETTINGS)
        assert isinstance(found, Miss)
        assert found.reasons[0] == f"{strategies.BRAKE}: {words}"


def test_a_state_of_whole_numbers_is_one_of_floats() -> None:
    scene = road(STRAIGHT, speed=0.0)
    found = fail_safe(scene, np.zeros(5, int), 0.0, by_hand(scene, {}, HORIZON), SETTINGS)
    assert isinstance(found, FailSafe)
    assert found.trajectory.states.dtype == np.float64
