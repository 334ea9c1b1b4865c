"""Condition `motion`, and one condition per bound: the car can drive this.

The model is the kinematic single-track model with the centre of the body as reference:

    x' = v cos(theta + beta),  y' = v sin(theta + beta),  theta' = 2 v sin(beta) / wheelbase,
    v' = a,  delta' = w,  beta = atan(tan(delta) / 2),

with a and w constant in each step. Then v and delta are linear in time, theta' is a known function
of time, and so, once theta is integrated, are x' and y': no differential equation is left to be
solved. Both integrals are taken by Gauss-Legendre quadrature.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from sandra.certificate.report import Checked, Violation
from sandra.certificate.types import Certificate
from sandra.planning.types import Trajectory

Array = NDArray[np.float64]

NODES = 8
"""Quadrature points in each step; exact to rounding for steps of at most 0.05 s."""
TOLERANCE = np.array([1e-6, 1e-6, 1e-7, 1e-8, 1e-8])
"""A state may differ by so much from where the model leads [m, m, rad, m/s, rad]."""
SLACK = 1e-6
"""A bound may be exceeded by so much, for rounding [m/s^2, m/s, rad, rad/s]."""
PIECES = 16
"""Each step is cut into so many pieces to bound the lateral acceleration."""

_UNITS = ("m", "m", "rad", "m/s", "rad")
_ENTRIES = ("x", "y", "heading", "speed", "steering angle")


def successors(t: Trajectory, wheelbase: float) -> Array:
    """(n, 5) where the model leads in one step from each of the first n states."""
    nodes, weights, inner = _quadrature()
    start, tau = t.states[:-1], t.tau
    a, w = t.inputs[:, 0], t.inputs[:, 1]
    time = tau * nodes
    v = start[:, 3:4] + a[:, None] * time
    beta = np.arctan(np.tan(start[:, 4:5] + w[:, None] * time) / 2)
    turning = 2 * v * np.sin(beta) / wheelbase
    course = start[:, 2:3] + tau * turning @ inner.T + beta
    moved = [v * np.cos(course), v * np.sin(course), turning]
    change = [tau * each @ weights for each in moved]
    return start + np.column_stack([*change, tau * a, tau * w])


def _quadrature() -> tuple[Array, Array, Array]:
    """Nodes and weights on [0, 1], and the matrix of integrals from 0 to each node.

    Row i of the matrix integrates the interpolating polynomial from 0 to node i.
    """
    nodes, weights = np.polynomial.legendre.leggauss(NODES)
    nodes, weights = (nodes + 1) / 2, weights / 2
    powers = np.arange(NODES)
    values = nodes[:, None] ** powers
    integrals = nodes[:, None] ** (powers + 1) / (powers + 1)
    return nodes, weights, np.asarray(np.linalg.solve(values.T, integrals.T).T, dtype=np.float64)


def trajectories(c: Certificate) -> Iterator[tuple[str, Trajectory]]:
    """Both, with the names that sentences use."""
    yield "witness", c.witness
    yield "fail-safe", c.fail_safe


def motion(c: Certificate) -> Checked | Violation:
    """Each state follows from the one before by the model, within `TOLERANCE`."""
    # Steering angles beyond the bound could have no tangent; `steering-angle` names them later.
    worst = 0.0
    for name, t in trajectories(c):
        gaps = np.abs(t.states[1:] - successors(t, c.ego.wheelbase))
        ratio = gaps / TOLERANCE
        # What is not a number is not within the tolerance.
        beyond = ~(ratio <= 1.0)
        if beyond.any():
            step = int(np.argmax(beyond.any(axis=1)))
            entry = int(np.argmax(ratio[step]))
            return Violation(
                "motion",
                f"{name}, step {step}: its {_ENTRIES[entry]} is {gaps[step, entry]:.3g} "
                f"{_UNITS[entry]} away from where the model leads",
                step,
                t.start + (step + 1) * t.tau,
                float(gaps[step, entry]),
                float(TOLERANCE[entry]),
            )
        worst = max(worst, float(ratio.max(initial=0.0)))
    return Checked("motion", f"at most {100 * worst:.2g} % of the tolerance used", 1.0 - worst)


def acceleration(c: Certificate) -> Checked | Violation:
    """a_lon_min <= a <= a_lon_max."""
    s = c.settings
    return _within(
        c,
        "acceleration",
        "m/s^2",
        s.a_lon_min,
        s.a_lon_max,
        [t.inputs[:, 0] for _, t in trajectories(c)],
    )


def steering_rate(c: Certificate) -> Checked | Violation:
    """|w| <= steering_rate_max."""
    bound = c.settings.steering_rate_max
    values = [t.inputs[:, 1] for _, t in trajectories(c)]
    return _within(c, "steering-rate", "rad/s", -bound, bound, values)


def speed(c: Certificate) -> Checked | Violation:
    """0 <= v <= v_max at grid points, and so between them, where v is linear."""
    values = [t.states[:, 3] for _, t in trajectories(c)]
    return _within(c, "speed", "m/s", 0.0, c.settings.v_max, values)


def steering_angle(c: Certificate) -> Checked | Violation:
    """|delta| <= steering_angle_max at grid points, and so between them, where delta is linear."""
    bound = c.settings.steering_angle_max
    values = [t.states[:, 4] for _, t in trajectories(c)]
    return _within(c, "steering-angle", "rad", -bound, bound, values)


def lateral_acceleration(c: Certificate) -> Checked | Violation:
    """|v theta'| <= a_lat_max at every instant."""
    bound = c.settings.a_lat_max
    values = [highest_lateral(t, c.ego.wheelbase) for _, t in trajectories(c)]
    return _within(c, "lateral-acceleration", "m/s^2", -bound, bound, values)


def highest_lateral(t: Trajectory, wheelbase: float) -> Array:
    """(n,) upper bound of |v theta'| = 2 v^2 |sin(beta)| / wheelbase in each step [m/s^2].

    In each of `PIECES` pieces of a step v^2 and |sin(beta)| are both at most the larger of their
    values at its ends, as v is linear and not negative, and sin(beta) is monotone in delta, which
    is linear. Their product exceeds the true maximum by less than 1 % for steps in which v changes
    by less than 7 %.
    """
    share = np.linspace(0.0, 1.0, PIECES + 1)
    v = t.states[:-1, 3:4] + t.tau * t.inputs[:, 0:1] * share
    delta = t.states[:-1, 4:5] + t.tau * t.inputs[:, 1:2] * share
    squared = v**2
    sine = np.abs(np.sin(np.arctan(np.tan(delta) / 2)))
    faster = np.maximum(squared[:, :-1], squared[:, 1:])
    sharper = np.maximum(sine[:, :-1], sine[:, 1:])
    return np.asarray(2 * (faster * sharper).max(axis=1) / wheelbase)


def _within(
    c: Certificate, condition: str, unit: str, low: float, high: float, values: list[Array]
) -> Checked | Violation:
    margin, largest = np.inf, 0.0
    for (name, t), value in zip(trajectories(c), values, strict=True):
        # What is not a number is not within the bounds.
        beyond = ~((value >= low - SLACK) & (value <= high + SLACK))
        if beyond.any():
            step = int(np.argmax(beyond))
            found = float(value[step])
            allowed = low if found < low else high
            return Violation(
                condition,
                f"{name}, step {step}: {condition.replace('-', ' ')} {found:.4g} {unit} is beyond "
                f"{allowed:.4g} {unit}",
                step,
                t.start + step * t.tau,
                found,
                allowed,
            )
        margin = min(margin, float(np.minimum(value - low, high - value).min(initial=np.inf)))
        largest = max(largest, float(np.abs(value).max(initial=0.0)))
    return Checked(condition, f"at most {largest:.3g} {unit} in magnitude", margin, unit)
