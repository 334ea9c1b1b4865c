"""The kinematic single-track model that witnesses and fail-safe trajectories obey.

Reference point is the centre of the body, midway between the axles, as in highway-env:

    beta = atan(tan(delta) / 2),  x' = v cos(theta + beta),  y' = v sin(theta + beta),
    theta' = 2 v sin(beta) / wheelbase,  v' = a,  delta' = w,

with the longitudinal acceleration a and the steering rate w constant within each step.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

X, Y, HEADING, SPEED, STEERING = range(5)
"""Columns of a state: [m], [m], [rad], [m/s], [rad]."""

MOST_SUBSTEP = 0.02
"""Longest substep of the Runge-Kutta integration [s]."""


def derivative(states: Array, inputs: Array, wheelbase: float) -> Array:
    """(..., 5) time derivatives for states (..., 5) and inputs (..., 2)."""
    beta = np.arctan(np.tan(states[..., STEERING]) / 2)
    course = states[..., HEADING] + beta
    speed = states[..., SPEED]
    return np.stack(
        [
            speed * np.cos(course),
            speed * np.sin(course),
            2 * speed * np.sin(beta) / wheelbase,
            inputs[..., 0],
            inputs[..., 1],
        ],
        axis=-1,
    )


def step(states: Array, inputs: Array, tau: float, wheelbase: float) -> Array:
    """States (..., 5) after `tau` seconds with constant inputs (..., 2) (classical Runge-Kutta)."""
    count = max(1, int(np.ceil(tau / MOST_SUBSTEP - 1e-9)))
    h = tau / count
    for _ in range(count):
        k1 = derivative(states, inputs, wheelbase)
        k2 = derivative(states + h / 2 * k1, inputs, wheelbase)
        k3 = derivative(states + h / 2 * k2, inputs, wheelbase)
        k4 = derivative(states + h * k3, inputs, wheelbase)
        states = states + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
    return states


def lateral_acceleration(states: Array, wheelbase: float) -> Array:
    """(...,) v theta' [m/s^2], positive to the left."""
    beta = np.arctan(np.tan(states[..., STEERING]) / 2)
    return np.asarray(2 * states[..., SPEED] ** 2 * np.sin(beta) / wheelbase)
