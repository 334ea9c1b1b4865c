"""The model: against its equations written out, closed forms, and a solver of another kind."""

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from sandra.planning import single_track
from sandra.planning.single_track import derivative, lateral_acceleration, step

WHEELBASE = 2.6


def equations(state: np.ndarray, a: float, w: float) -> list[float]:
    """Right-hand side in the words of the module's docstring, in plain Python."""
    _, _, theta, v, delta = state.tolist()
    beta = math.atan(math.tan(delta) / 2)
    return [
        v * math.cos(theta + beta),
        v * math.sin(theta + beta),
        2 * v * math.sin(beta) / WHEELBASE,
        a,
        w,
    ]


STATES = [
    [0.0, 0.0, 0.0, 10.0, 0.0],
    [1.0, -2.0, 0.7, 8.0, 0.2],
    [5.0, 3.0, -2.5, 15.0, -0.1],
    [0.0, 0.0, 3.0, 0.5, 0.9],
]


@pytest.mark.parametrize("state", STATES)
@pytest.mark.parametrize(("a", "w"), [(0.0, 0.0), (-3.0, 0.2), (2.0, -0.4)])
def test_derivative(state: list[float], a: float, w: float) -> None:
    found = derivative(np.array(state), np.array([a, w]), WHEELBASE)
    assert found == pytest.approx(equations(np.array(state), a, w))


def test_the_columns_are_those_of_a_state() -> None:
    columns = "X", "Y", "HEADING", "SPEED", "STEERING"
    assert [getattr(single_track, name) for name in columns] == [0, 1, 2, 3, 4]


@pytest.mark.parametrize("tau", [0.01, 0.02, 0.05, 0.3])
@pytest.mark.parametrize("state", STATES)
@pytest.mark.parametrize(("a", "w"), [(0.0, 0.0), (-3.0, 0.2), (2.0, -0.4)])
def test_a_step_solves_the_equations(state: list[float], a: float, w: float, tau: float) -> None:
    found = step(np.array(state), np.array([a, w]), tau, WHEELBASE)
    answer = solve_ivp(
        lambda _, x: equations(x, a, w), (0.0, tau), state, method="DOP853", rtol=1e-12, atol=1e-13
    )
    # With substeps of at most 0.02 s the rest of Runge-Kutta is far below a micrometre.
    assert found == pytest.approx(answer.y[:, -1], abs=1e-7)


def test_long_steps_are_cut_into_substeps() -> None:
    """One call for 0.06 s is three calls for 0.02 s: no step is longer than that."""
    state, inputs = np.array(STATES[1]), np.array([-3.0, 0.4])
    at_once = step(state, inputs, 0.06, WHEELBASE)
    for _ in range(3):
        state = step(state, inputs, 0.02, WHEELBASE)
    assert at_once == pytest.approx(state, abs=1e-14)
    halves = np.array(STATES[1])
    for _ in range(2):
        halves = step(halves, inputs, 0.0125, WHEELBASE)
    assert step(np.array(STATES[1]), inputs, 0.025, WHEELBASE) == pytest.approx(halves, abs=1e-14)


def test_a_steady_turn_is_a_circle() -> None:
    """Radius wheelbase / (2 sin beta) of the centre, a full turn."""
    delta, speed = 0.3, 5.0
    radius = WHEELBASE / (2 * math.sin(math.atan(math.tan(delta) / 2)))
    state = np.array([0.0, 0.0, 0.0, speed, delta])
    whole = 2 * math.pi * radius / speed
    after = step(state, np.zeros(2), whole, WHEELBASE)
    assert after == pytest.approx([0.0, 0.0, 2 * math.pi, speed, delta], abs=1e-6)
    half = step(state, np.zeros(2), whole / 2, WHEELBASE)
    assert math.hypot(half[0], half[1]) == pytest.approx(2 * radius)


def test_lateral_acceleration_is_speed_times_yaw_rate() -> None:
    for state in np.array(STATES):
        yaw_rate = derivative(state, np.zeros(2), WHEELBASE)[2]
        assert lateral_acceleration(state, WHEELBASE) == pytest.approx(state[3] * yaw_rate)
    assert lateral_acceleration(np.array(STATES), WHEELBASE).shape == (4,)


def test_many_at_once_are_each_for_itself() -> None:
    states = np.array(STATES).reshape(2, 2, 5)
    inputs = np.array([[[1.0, 0.1], [-1.0, 0.2]], [[0.0, 0.0], [2.0, -0.3]]])
    found = step(states, inputs, 0.05, WHEELBASE)
    for i in range(2):
        for j in range(2):
            assert found[i, j] == pytest.approx(step(states[i, j], inputs[i, j], 0.05, WHEELBASE))
