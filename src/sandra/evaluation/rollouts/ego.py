"""The ego executes its certificate: the witness until `t_dec`, then the fail-safe to standstill.

Shares no code with the planner or the checker: the inputs are integrated anew, one after another
from the initial state, so an error in the states that the certificate claims is not taken over.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sandra.certificate import Certificate

Array = NDArray[np.float64]

FINE = 0.02
"""Longest step of a rollout [s]."""
_PARTS = 4
"""Runge-Kutta steps per step of a rollout."""


@dataclass(frozen=True, slots=True, eq=False)
class Drive:
    """The ego's motion on the fine grid i * `step`, i = 0..n.

    `states` (n+1, 5) x, y, heading, speed, steering angle; `acceleration` (n,) in each step;
    `corners` (n+1, 4, 2) of the body; `decision` the grid point of `t_dec`; `per_dt` grid points
    per step of the predictions; `deviation` how far the claimed positions are from these [m].
    """

    step: float
    states: Array
    acceleration: Array
    corners: Array
    decision: int
    per_dt: int
    deviation: float

    @property
    def times(self) -> Array:
        """(n+1,) [s]."""
        return np.asarray(self.step * np.arange(len(self.states)), dtype=np.float64)


def execute(c: Certificate) -> Drive:
    """Drive a certificate to its end."""
    tau = c.witness.tau
    parts = max(1, int(np.ceil(tau / FINE - 1e-9)))
    until = round(c.t_dec / tau)
    inputs = np.vstack([c.witness.inputs[:until], c.fail_safe.inputs])
    claimed = np.vstack([c.witness.states[: until + 1], c.fail_safe.states[1:]])
    step = tau / parts
    state = np.array(c.initial, dtype=float)
    states = [state]
    for u in inputs:
        for _ in range(parts):
            state = _after(state, u, step, c.ego.wheelbase)
            states.append(state)
    driven = np.array(states)
    deviation = float(np.abs(driven[::parts, :2] - claimed[:, :2]).max())
    return Drive(
        step,
        driven,
        np.repeat(inputs[:, 0], parts),
        rectangle(driven[:, :2], driven[:, 2], c.ego.length, c.ego.width),
        until * parts,
        round(c.dt / step),
        deviation,
    )


def rectangle(centre: Array, heading: Array, length: float, width: float) -> Array:
    """(..., 4, 2) corners of rectangles, counter-clockwise, from the rear right one on."""
    body = np.array([[-length, -width], [length, -width], [length, width], [-length, width]]) / 2
    return placed(body, centre, heading)


def placed(vertices: Array, centre: Array, heading: Array) -> Array:
    """(..., m, 2) points (m, 2) of a body, at positions (..., 2) and headings (...)."""
    cos, sin = np.cos(heading)[..., None], np.sin(heading)[..., None]
    x, y = vertices[:, 0], vertices[:, 1]
    turned = np.stack([cos * x - sin * y, sin * x + cos * y], axis=-1)
    return np.asarray(turned + centre[..., None, :])


def _after(state: Array, u: Array, duration: float, wheelbase: float) -> Array:
    h = duration / _PARTS
    for _ in range(_PARTS):
        k1 = _rate(state, u, wheelbase)
        k2 = _rate(state + h / 2 * k1, u, wheelbase)
        k3 = _rate(state + h / 2 * k2, u, wheelbase)
        k4 = _rate(state + h * k3, u, wheelbase)
        state = state + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
    return state


def _rate(state: Array, u: Array, wheelbase: float) -> Array:
    """Kinematic single track about the centre of the body, midway between the axles."""
    _, _, heading, speed, steering = state
    slip = np.arctan(0.5 * np.tan(steering))
    return np.array(
        [
            speed * np.cos(heading + slip),
            speed * np.sin(heading + slip),
            speed * np.sin(slip) / (wheelbase / 2),
            u[0],
            u[1],
        ]
    )
