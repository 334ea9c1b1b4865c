"""The tracker: its result is a simulation of the model, within limits, near its reference."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sandra.planning import single_track
from sandra.planning.limits import Limits, slip, within_limits
from sandra.planning.tracking import Reference, advance, fine_step, follow
from sandra.settings import Settings

WHEELBASE = 2.578
LIMITS = Limits.of(Settings())
TAU = 0.05


def lane_change(
    speed: float, width: float, length: float, n: int = 60, kappa: float = 0.0
) -> Reference:
    """A quintic across a lane of constant curvature, at constant speed."""
    s = speed * TAU * np.arange(n + 1)
    x = np.clip(s / length, 0.0, 1.0)
    d = width * x**3 * (10 - 15 * x + 6 * x**2)
    slope = width * x**2 * (30 - 60 * x + 30 * x**2) / length
    turn = kappa * s
    if kappa:
        base = np.column_stack([np.sin(turn) / kappa, (1 - np.cos(turn)) / kappa])
    else:
        base = np.column_stack([s, 0 * s])
    points = base + d[:, None] * np.column_stack([-np.sin(turn), np.cos(turn)])
    course = turn + np.arctan2(slope, 1.0 - kappa * d)
    return Reference(points[None], course[None], np.zeros((1, n)))


@given(
    st.floats(-3.0, 3.0),
    st.floats(0.0, 40.0),
    st.floats(-1.0, 1.0),
    st.floats(-6.0, 6.0),
    st.floats(-0.4, 0.4),
    st.floats(0.005, 0.2),
)
def test_advance_is_the_model(
    heading: float, speed: float, steering: float, a: float, w: float, tau: float
) -> None:
    state = [1.0, -2.0, heading, speed, steering]
    found = advance(state, (a, w), tau, WHEELBASE)
    expected = single_track.step(np.array(state), np.array([a, w]), tau, WHEELBASE)
    assert np.allclose(found, expected, rtol=0.0, atol=1e-11)


@settings(max_examples=60, deadline=None)
@given(
    st.floats(0.0, 29.0),
    st.floats(-5.0, 5.0),
    st.floats(5.0, 80.0),
    st.floats(-0.5, 0.5),
    st.floats(-0.3, 0.3),
    st.integers(0, 2**16),
)
def test_whatever_is_followed_the_result_keeps_model_and_rate(
    speed: float, width: float, length: float, heading: float, steering: float, seed: int
) -> None:
    reference = lane_change(max(speed, 1.0), width, length)
    rng = np.random.default_rng(seed)
    wanted = rng.uniform(-6.0, 1.0, reference.acceleration.shape)
    reference = Reference(reference.points, reference.course, wanted)
    start = np.array([0.0, 0.5, heading, speed, steering])
    states, inputs = follow(start, reference, TAU, WHEELBASE, LIMITS)
    again = single_track.step(states[:, :-1], inputs, TAU, WHEELBASE)
    assert np.allclose(again, states[:, 1:], rtol=0.0, atol=1e-9)
    assert np.array_equal(states[0, 0], start)
    assert np.abs(inputs[..., 1]).max() <= LIMITS.steering_rate_max + 1e-9
    assert np.abs(states[..., 4]).max() <= max(LIMITS.steering_angle_max, abs(steering)) + 1e-9
    assert states[..., 3].min() >= -1e-9
    assert (inputs[..., 0] >= wanted - 1e-12).all()  # raised only to end at a standstill
    raised = inputs[..., 0] > wanted + 1e-9
    assert np.allclose(states[:, 1:, 3][raised], 0.0, atol=1e-9)


@pytest.mark.parametrize("kappa", [0.0, 0.01, -0.01])
@pytest.mark.parametrize(("speed", "length"), [(4.0, 20.0), (10.0, 30.0), (25.0, 62.0)])
def test_a_feasible_lane_change_is_followed_closely(
    speed: float, length: float, kappa: float
) -> None:
    limits = Limits.of(Settings(a_lat_max=12.0))
    reference = lane_change(speed, 3.5, length, n=int(length / speed / TAU) + 20, kappa=kappa)
    beta = np.arcsin(WHEELBASE / 2 * kappa)
    start = np.array([0.0, 0.0, -beta, speed, np.arctan(2 * np.tan(beta))])
    states, _ = follow(start, reference, TAU, WHEELBASE, limits)
    # Along the lane the reference is not exact: its path is longer than its lane.
    course = reference.course[0]
    across = np.column_stack([-np.sin(course), np.cos(course)])
    error = np.abs(((states[0, :, :2] - reference.points[0]) * across).sum(axis=1))
    assert error.max() < 0.3
    assert error[-1] < 0.1
    assert abs(states[0, -1, 2] + slip(states[0, -1, 4]) - course[-1]) < 0.03


def test_an_initial_offset_and_heading_are_steered_back() -> None:
    reference = lane_change(15.0, 0.0, 10.0, n=120)
    start = np.array([0.0, 0.4, 0.03, 15.0, 0.01])
    states, inputs = follow(start, reference, TAU, WHEELBASE, LIMITS)
    assert abs(states[0, -1, 1]) < 0.05
    assert abs(states[0, -1, 2]) < 0.01
    assert within_limits(states, inputs, WHEELBASE, LIMITS)[0]


def test_standing_still_stays() -> None:
    reference = lane_change(1.0, 0.0, 10.0)
    start = np.array([3.0, 1.0, 0.2, 0.0, 0.1])
    states, _ = follow(start, reference, TAU, WHEELBASE, LIMITS)
    assert np.array_equal(states[0, :, :4], np.tile(start[:4], (61, 1)))


@pytest.mark.parametrize(
    ("column", "value", "kept"),
    [
        (3, 29.9, True),
        (3, 30.0, False),
        (3, -0.01, False),
        (4, 1.07, False),
        (3, np.nan, False),
    ],
)
def test_limits_on_states(column: int, value: float, kept: bool) -> None:
    states = np.zeros((1, 2, 5))
    states[0, 1, column] = value
    assert within_limits(states, np.zeros((1, 1, 2)), WHEELBASE, LIMITS)[0] == kept


@pytest.mark.parametrize(
    ("inputs", "kept"),
    [
        ([-5.99, 0.0], True),
        ([-6.0, 0.0], False),
        ([6.0, 0.0], False),
        ([0.0, 0.398], True),
        ([0.0, 0.4], False),
        ([0.0, -0.4], False),
    ],
)
def test_limits_on_inputs(inputs: list[float], kept: bool) -> None:
    found = within_limits(np.zeros((1, 2, 5)), np.array([[inputs]]), WHEELBASE, LIMITS)
    assert found[0] == kept


def test_lateral_acceleration_is_bounded_between_grid_points() -> None:
    # slow with a large angle, then fast with a small one: in between it is larger than at both
    states = np.zeros((1, 2, 5))
    states[0, :, 3], states[0, :, 4] = [8.0, 16.0], [0.16, 0.01]
    accelerations = single_track.lateral_acceleration(states, WHEELBASE)
    assert np.abs(accelerations).max() < LIMITS.a_lat_max
    assert not within_limits(states, np.zeros((1, 1, 2)), WHEELBASE, LIMITS)[0]


@pytest.mark.parametrize(("dt", "count"), [(0.04, 1), (0.05, 1), (0.1, 2), (0.2, 4), (0.12, 3)])
def test_fine_steps_divide_a_step(dt: float, count: int) -> None:
    tau, found = fine_step(dt)
    assert found == count
    assert tau * count == pytest.approx(dt)
    assert tau <= 0.05 + 1e-12
