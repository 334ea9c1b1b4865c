"""The bounds themselves: each is kept up to rounding, and no further."""

import numpy as np
import pytest

from sandra.planning.limits import MARGIN, ROUNDING, Limits, slip, within_limits
from sandra.planning.single_track import SPEED, STEERING
from sandra.settings import Settings

WHEELBASE = 2.5
WIDE = Limits(-6.0, 5.0, 4.0, 30.0, 1.0, 0.4)
BEYOND = 1e-7
"""More than rounding, and far less than the planner's margin."""


def kept(states: np.ndarray, inputs: np.ndarray, limits: Limits = WIDE) -> bool:
    found = within_limits(states[None], inputs[None], WHEELBASE, limits)
    assert found.shape == (1,)
    return bool(found[0])


def test_the_bounds_of_the_settings_with_and_without_a_margin() -> None:
    settings = Settings(
        a_lon_min=-5.0,
        a_lon_max=3.0,
        a_lat_max=2.0,
        v_max=20.0,
        steering_angle_max=0.5,
        steering_rate_max=0.25,
    )
    assert Limits.of(settings, 0.0) == Limits(-5.0, 3.0, 2.0, 20.0, 0.5, 0.25)
    assert Limits.of(settings, 0.1) == Limits(-4.9, 2.9, 1.9, 19.9, 0.4, 0.15)
    assert Limits.of(settings) == Limits.of(settings, MARGIN)
    assert MARGIN == 1e-3
    assert ROUNDING == 1e-9


@pytest.mark.parametrize("row", [0, 1])
@pytest.mark.parametrize(
    ("column", "bound", "sign"), [(0, -6.0, -1), (0, 5.0, 1), (1, 0.4, 1), (1, -0.4, -1)]
)
def test_each_input_in_each_step(row: int, column: int, bound: float, sign: int) -> None:
    states, inputs = np.zeros((3, 5)), np.zeros((2, 2))
    inputs[row, column] = bound
    assert kept(states, inputs)
    inputs[row, column] = bound + sign * BEYOND
    assert not kept(states, inputs)


@pytest.mark.parametrize("row", [0, 1, 2])
@pytest.mark.parametrize(
    ("column", "bound", "sign"),
    [(SPEED, 0.0, -1), (SPEED, 30.0, 1), (STEERING, 1.0, 1), (STEERING, -1.0, -1)],
)
def test_each_state_at_each_grid_point(row: int, column: int, bound: float, sign: int) -> None:
    states, inputs = np.zeros((3, 5)), np.zeros((2, 2))
    states[row, column] = bound
    assert kept(states, inputs)
    states[row, column] = bound + sign * BEYOND
    assert not kept(states, inputs)


def test_what_rounding_may_take_is_included() -> None:
    """A bound that lies beyond 0 by just the rounding is kept by 0."""
    nothing = Limits(ROUNDING, -ROUNDING, -ROUNDING, -ROUNDING, -ROUNDING, -ROUNDING)
    assert kept(np.zeros((3, 5)), np.zeros((2, 2)), nothing)
    states = np.zeros((2, 5))
    states[:, SPEED] = -ROUNDING
    assert kept(states, np.zeros((1, 2)))


@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize("speeds", [(10.0, 10.0), (10.0, 6.0), (6.0, 10.0)])
@pytest.mark.parametrize("angles", [(1.0, 1.0), (1.0, 0.0), (0.0, 1.0)])
def test_lateral_acceleration_of_the_larger_speed_with_the_larger_angle(
    sign: int, speeds: tuple[float, float], angles: tuple[float, float]
) -> None:
    # v theta' = 2 v^2 sin(beta) / wheelbase = 4 at 10 m/s: sin(beta) = 0.05.
    for share, expected in ((1.0 - 1e-6, True), (1.0 + 1e-6, False)):
        delta = np.arctan(2 * np.tan(np.arcsin(0.05 * share)))
        states = np.zeros((2, 5))
        states[:, SPEED] = speeds
        states[:, STEERING] = sign * delta * np.array(angles)
        assert kept(states, np.zeros((1, 2))) is expected


@pytest.mark.parametrize("column", range(5))
@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_what_is_not_finite_keeps_no_limit(column: int, value: float) -> None:
    states = np.zeros((2, 5))
    states[1, column] = value
    with np.errstate(invalid="ignore"):
        assert not kept(states, np.zeros((1, 2)))


@pytest.mark.parametrize("column", range(2))
def test_an_input_that_is_not_a_number_keeps_no_limit(column: int) -> None:
    inputs = np.zeros((1, 2))
    inputs[0, column] = np.nan
    assert not kept(np.zeros((2, 5)), inputs)


def test_each_trajectory_for_itself() -> None:
    """In every other one of eighteen something else is wrong."""
    states, inputs = np.zeros((18, 3, 5)), np.zeros((18, 2, 2))
    inputs[1, 1, 0], inputs[3, 1, 0] = 7.0, -7.0
    inputs[5, 0, 1] = 0.5
    states[7, 2, STEERING] = 1.1
    states[9, :, SPEED], states[9, :, STEERING] = 29.0, 0.5
    states[11, 0, SPEED], states[13, 1, SPEED] = 31.0, -1.0
    states[15, 2, 0], states[17, 0, 1] = np.inf, np.inf
    found = within_limits(states, inputs, WHEELBASE, WIDE)
    assert found.tolist() == [True, False] * 9


@pytest.mark.parametrize("delta", [-1.0, -0.1, 0.0, 0.3, 1.0])
def test_slip_is_that_of_the_middle_between_the_axles(delta: float) -> None:
    """Rear axle, centre and front axle turn about one point, in front of the rear axle's side."""
    beta = float(slip(np.array(delta)))
    assert np.tan(beta) == pytest.approx(np.tan(delta) / 2)
    assert slip(np.array([delta, 0.0])) == pytest.approx([beta, 0.0])
