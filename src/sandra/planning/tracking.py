"""Following a reference with the single-track model: steering by feed-forward and feedback.

The acceleration is given and applied as it is, so speed and distance driven are known beforehand;
only the steering is found here. At each step the steering angle of its end is chosen such that
the course (heading + slip) there is that of the reference, turned back towards it by the distance
to it; then the limits are enforced, that of the lateral acceleration on the course, too. The result
is a simulation of the model, not the reference.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import asin, atan, ceil, cos, pi, sin, tan

import numpy as np
from numpy.typing import NDArray

from sandra.planning.limits import Limits
from sandra.planning.single_track import MOST_SUBSTEP

Array = NDArray[np.float64]

LONGEST_STEP = 0.05
"""Longest step of a trajectory [s]."""
GAIN = 0.2
"""The course is turned back by atan(GAIN e) at a distance e from the reference [1/m]."""
NEWTON = 2
"""Iterations for the slip angle at the end of a step."""


@dataclass(frozen=True, slots=True, eq=False)
class Reference:
    """What N trajectories follow at the grid points i tau, i = 0..n.

    `points` (N, n+1, 2) of the body's centre [m]; `course` (N, n+1), direction of motion there
    [rad]; `acceleration` (N, n), the input in each step [m/s^2].
    """

    points: Array
    course: Array
    acceleration: Array

    def __getitem__(self, rows: NDArray[np.int_] | slice) -> Reference:
        return Reference(self.points[rows], self.course[rows], self.acceleration[rows])


def fine_step(dt: float) -> tuple[float, int]:
    """(tau [s], number of tau per dt): the fewest equal steps of at most `LONGEST_STEP`."""
    count = max(1, ceil(dt / LONGEST_STEP - 1e-9))
    return dt / count, count


def follow(
    start: Array, reference: Reference, tau: float, wheelbase: float, limits: Limits
) -> tuple[Array, Array]:
    """Trajectories of the single-track model along a reference.

    Steering angle, steering rate and lateral acceleration are kept to `limits` where the state
    allows it (the rate always); the acceleration is not checked here.

    Args:
        start: (5,) or (N, 5) state at the first grid point.

    Returns:
        states (N, n+1, 5) and inputs (N, n, 2), as in `Trajectory`.
    """
    count, n = reference.acceleration.shape
    starts = np.broadcast_to(start, (count, 5))
    states, inputs = np.empty((count, n + 1, 5)), np.empty((count, n, 2))
    for row in range(count):
        states[row], inputs[row] = _follow_one(
            starts[row].tolist(),
            reference.points[row].tolist(),
            reference.course[row].tolist(),
            reference.acceleration[row].tolist(),
            (tau, wheelbase, limits),
        )
    return states, inputs


def _follow_one(
    state: list[float],
    points: list[list[float]],
    courses: list[float],
    accelerations: list[float],
    model: tuple[float, float, Limits],
) -> tuple[list[list[float]], list[tuple[float, float]]]:
    """One trajectory, in plain Python: each step needs the one before, and N is small."""
    tau, wheelbase, limits = model
    sharpest = atan(tan(limits.steering_angle_max) / 2)
    turn = limits.steering_rate_max * tau
    states, inputs = [state], []
    for i, wanted in enumerate(accelerations):
        x, y, theta, v0, delta = states[-1]
        # The last step before a standstill ends at 0, not below.
        acceleration = max(wanted, -v0 / tau)
        v1 = v0 + acceleration * tau
        (u, w), course = points[i], courses[i]
        away = (y - w) * cos(course) - (x - u) * sin(course)
        goal = courses[i + 1] - atan(GAIN * away)
        missing = (goal - theta + pi) % (2 * pi) - pi
        # The course turns by heading and slip together: what the body's centre feels across.
        slip, swing = atan(tan(delta) / 2), limits.a_lat_max * tau / max(v0, v1, 1e-9)
        missing = min(max(missing, slip - swing), slip + swing)
        # The heading at the end is theta + tau/wb (v0 sin beta0 + v1 sin beta1), by trapezoids.
        rest = missing - tau / wheelbase * v0 * sin(slip)
        ratio = tau / wheelbase * v1
        beta = rest / (1.0 + ratio)
        for _ in range(NEWTON):
            beta -= (beta + ratio * sin(beta) - rest) / (1.0 + ratio * cos(beta))
        grip = limits.a_lat_max * wheelbase / max(2 * max(v0, v1) ** 2, 1e-9)
        most = min(sharpest, asin(min(grip, 1.0)))
        beta = min(max(beta, -most), most)
        change = min(max(atan(2 * tan(beta)) - delta, -turn), turn)
        inputs.append((acceleration, change / tau))
        states.append(advance(states[-1], inputs[-1], tau, wheelbase))
    return states, inputs


def advance(
    state: list[float], inputs: tuple[float, float], tau: float, wheelbase: float
) -> list[float]:
    """The state after one step: the same numbers as `single_track.step`, in fewer operations.

    Speed and steering angle are known functions of time, so the heading is a quadrature
    (Simpson's rule is what Runge-Kutta does with it), and then the position.
    """
    x, y, theta, v, delta = state
    a, w = inputs
    count = max(1, ceil(tau / MOST_SUBSTEP - 1e-9))
    h = tau / count
    beta = atan(tan(delta) / 2)
    rate = 2 * v * sin(beta) / wheelbase
    for _ in range(count):
        v_half, v_end = v + h / 2 * a, v + h * a
        beta_half = atan(tan(delta + h / 2 * w) / 2)
        beta_end = atan(tan(delta + h * w) / 2)
        rate_half = 2 * v_half * sin(beta_half) / wheelbase
        rate_end = 2 * v_end * sin(beta_end) / wheelbase
        first, second = theta + beta, theta + h / 2 * rate + beta_half
        third, fourth = theta + h / 2 * rate_half + beta_half, theta + h * rate_half + beta_end
        x += (
            h / 6 * (v * cos(first) + 2 * v_half * (cos(second) + cos(third)) + v_end * cos(fourth))
        )
        y += (
            h / 6 * (v * sin(first) + 2 * v_half * (sin(second) + sin(third)) + v_end * sin(fourth))
        )
        theta += h / 6 * (rate + 4 * rate_half + rate_end)
        v, delta, beta, rate = v_end, delta + h * w, beta_end, rate_end
    return [x, y, theta, v, delta]
