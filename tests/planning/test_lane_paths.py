"""Paths of the rear axle: what is driven is the model, from the state on, to the offset."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from reach_scenes import Course
from sandra.planning import lane_paths
from sandra.planning.lane_paths import Guide, Paths, _foot, drive, guide, paths
from sandra.planning.single_track import HEADING, STEERING, step

WHEELBASE = 2.6
TAU = 0.05


def state_on(
    course: Course, d: float, relative: float, speed: float, steering: float
) -> np.ndarray:
    x, y = course.at(0.0, d)
    return np.array([x, y, course.heading(0.0) + relative, speed, steering])


def braking(speed: float, level: float, n: int) -> np.ndarray:
    return np.maximum(speed - level * TAU * np.arange(n + 1), 0.0)


def rear_offsets(course: Course, states: np.ndarray) -> np.ndarray:
    """d of the rear axle, by the arc's own geometry."""
    heading = states[..., HEADING]
    rear = states[..., :2] - WHEELBASE / 2 * np.stack([np.cos(heading), np.sin(heading)], axis=-1)
    if course.kappa == 0.0:
        return np.asarray(rear[..., 1])
    centre = np.array([0.0, 1.0 / course.kappa])
    distance = np.linalg.norm(rear - centre, axis=-1)
    return np.asarray(1.0 / course.kappa - np.sign(course.kappa) * distance)


@settings(max_examples=40, deadline=None)
@given(
    kappa=st.sampled_from([0.0, 0.02, -0.02, 0.05]),
    d=st.floats(-1.5, 1.5),
    relative=st.floats(-0.3, 0.3),
    speed=st.floats(0.5, 25.0),
    steering=st.floats(-0.1, 0.1),
)
def test_driving_is_the_single_track_model(
    kappa: float, d: float, relative: float, speed: float, steering: float
) -> None:
    course = Course(kappa)
    state = state_on(course, d, relative, speed, steering)
    line = guide(course.lane("current", 1, -1.75, 1.75).frame, state, WHEELBASE, 40.0)
    assert line is not None
    along = paths(line, np.array([0.0, np.nan]), np.array([15.0, 25.0]), WHEELBASE)
    speeds = np.stack([braking(speed, 2.0, 60), braking(speed, 6.0, 60)])
    states, inputs = drive(state, along, speeds, TAU, WHEELBASE)
    assert states.shape == (2, 2, 61, 5)
    assert inputs.shape == (2, 2, 60, 2)
    now = np.broadcast_to(state, (2, 2, 5))
    for i in range(60):
        now = step(now, inputs[:, :, i], TAU, WHEELBASE)
        assert np.abs(now - states[:, :, i + 1]).max() < 5e-5


@pytest.mark.parametrize("kappa", [0.0, 0.02, -0.02])
@pytest.mark.parametrize("target", [-1.0, 0.0, 3.5])
def test_the_offset_is_reached_and_kept(kappa: float, target: float) -> None:
    course = Course(kappa)
    state = state_on(course, 0.4, 0.1, 10.0, 0.02)
    line = guide(course.lane("current", 1, -1.75, 1.75).frame, state, WHEELBASE, 60.0)
    assert line is not None
    along = paths(line, np.array([target]), np.array([25.0]), WHEELBASE)
    speeds = braking(10.0, 1.0, 200)[None]
    states, _ = drive(state, along, speeds, TAU, WHEELBASE)
    offsets = rear_offsets(course, states[0, 0])
    assert offsets[-40:] == pytest.approx(target, abs=0.06)


def test_the_path_starts_with_the_steering_angle_of_the_state() -> None:
    course = Course(0.03)
    for steering in (-0.05, 0.0, 0.08):
        state = state_on(course, 0.3, 0.05, 8.0, steering)
        line = guide(course.lane("current", 1, -1.75, 1.75).frame, state, WHEELBASE, 30.0)
        assert line is not None
        along = paths(line, np.array([0.0]), np.array([20.0]), WHEELBASE)
        assert along.steering[0, 0] == pytest.approx(steering, abs=1e-9)


def test_straightening_does_not_swing_back() -> None:
    course = Course()
    state = state_on(course, 0.0, 0.1, 10.0, 0.0)
    line = guide(course.lane("current", 1, -1.75, 1.75).frame, state, WHEELBASE, 40.0)
    assert line is not None
    along = paths(line, np.array([np.nan]), np.array([20.0]), WHEELBASE)
    states, _ = drive(state, along, braking(10.0, 2.0, 100)[None], TAU, WHEELBASE)
    assert (np.diff(rear_offsets(course, states[0, 0])) > -1e-6).all()
    assert abs(states[0, 0, -1, HEADING]) < 1e-3


def test_no_line_across_or_against_the_lane() -> None:
    frame = Course().lane("current", 1, -1.75, 1.75).frame
    for heading in (np.pi / 2, np.pi, -1.3):
        assert guide(frame, np.array([0.0, 0.0, heading, 5.0, 0.0]), WHEELBASE, 20.0) is None


def test_paths_through_the_centre_of_a_bend_are_left_out() -> None:
    course = Course(1 / 12.0)
    state = state_on(course, 0.0, 0.0, 3.0, 0.0)
    line = guide(course.lane("current", 1, -1.75, 1.75, end=30.0).frame, state, WHEELBASE, 20.0)
    assert line is not None
    along = paths(line, np.array([0.0, 11.5]), np.array([10.0, 10.0]), WHEELBASE)
    assert along.valid.tolist() == [True, False]


def test_steering_stays_while_standing() -> None:
    along = Paths(np.array([[0.0, 10.0]]), np.array([[0.0, 0.1]]), np.array([True], dtype=bool))
    state = np.array([0.0, 0.0, 0.0, 2.0, 0.0])
    speeds = np.array([[2.0, 1.0, 0.0, 0.0, 0.0]])
    states, inputs = drive(state, along, speeds, 0.5, WHEELBASE)
    assert (states[0, 0, 2:] == states[0, 0, 2]).all()
    assert (inputs[0, 0, 2:] == 0.0).all()
    assert states[0, 0, 2, STEERING] == pytest.approx(0.01)


# Bounds at their last bit.


def straight_on(d: float = 0.0) -> np.ndarray:
    return np.array([0.0, d, 0.0, 8.0, 0.0])


def test_who_heads_as_far_away_as_may_be_has_a_line(monkeypatch: pytest.MonkeyPatch) -> None:
    frame = Course().lane("current", 1, -1.75, 1.75).frame
    for most, found in ((0.0, True), (-1e-300, False)):
        monkeypatch.setattr(lane_paths, "MOST_TURNED", most)
        assert (guide(frame, straight_on(), WHEELBASE, 20.0) is not None) == found


def test_a_line_where_the_normals_are_as_near_as_may_be(monkeypatch: pytest.MonkeyPatch) -> None:
    """On the line itself 1 - kappa d is 1."""
    frame = Course().lane("current", 1, -1.75, 1.75).frame
    for narrowest, found in ((1.0, True), (float(np.nextafter(1.0, 2.0)), False)):
        monkeypatch.setattr(lane_paths, "NARROWEST", narrowest)
        assert (guide(frame, straight_on(), WHEELBASE, 20.0) is not None) == found


def test_a_path_where_the_normals_are_nearer_than_that_is_none(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    u, one, none = np.arange(9.0), np.ones(9), np.zeros(9)
    line = Guide(u, np.column_stack([u, none]), none, one, none, none, none, (0.0, 0.0, 0.0))
    for narrowest, valid in ((1.0, False), (float(np.nextafter(1.0, 0.0)), True)):
        monkeypatch.setattr(lane_paths, "NARROWEST", narrowest)
        found = paths(line, np.array([0.0]), np.array([4.0]), WHEELBASE)
        assert found.valid.tolist() == [valid]


def test_the_search_for_the_foot_point_ends_where_it_is_too_flat(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """On a straight line the derivative is 1; from the nearest of its points the foot is 0.25 m."""

    def curve(u: float, k: int) -> np.ndarray:
        return np.array([[u, 0.0], [1.0, 0.0], [0.0, 0.0]][k])

    chord = np.arange(4.0)
    line = np.column_stack([chord, np.zeros(4)])
    for flattest, foot in ((1.0, 2.0), (float(np.nextafter(1.0, 0.0)), 2.25)):
        monkeypatch.setattr(lane_paths, "FLATTEST", flattest)
        assert _foot(curve, chord, line, np.array([2.25, 3.0])) == foot


def test_some_of_the_paths() -> None:
    all_three = Paths(np.arange(6.0).reshape(3, 2), np.ones((3, 2)), np.array([True, False, True]))
    some = all_three.only([2, 1])
    assert some.way.tolist() == [[4.0, 5.0], [2.0, 3.0]]
    assert some.valid.tolist() == [True, False]
