"""Conditions `grid`, `initial-state` and `continuity`: where the trajectories begin and end."""

from __future__ import annotations

import numpy as np

from sandra.certificate.report import Checked, Violation
from sandra.certificate.types import Certificate

LONGEST_TAU = 0.05
"""Longest step of a trajectory [s]."""
SHORTEST_TAU = 1e-4
"""Shortest step of a trajectory [s]."""
ROUNDING = 1e-9
"""Times may differ by so much [s]."""
SAME = 1e-9
"""Entries of one state, written twice, may differ by so much [m, rad, m/s]."""

_ENTRIES = ("x", "y", "heading", "speed", "steering angle")
_UNITS = ("m", "m", "rad", "m/s", "rad")


def steps_per_dt(c: Certificate) -> int:
    """Grid points per prediction step; only where `grid` holds."""
    return round(c.dt / c.witness.tau)


def decision_point(c: Certificate) -> int:
    """Index of the witness's grid point at `t_dec`; only where `grid` holds."""
    return round(c.t_dec / c.witness.tau)


def grid(c: Certificate) -> Checked | Violation:
    """tau divides dt; the witness covers [0, h dt]; the fail-safe begins at t_dec, on the grid."""
    if not 1e-3 <= c.dt <= 10.0:
        return _wrong("dt must be between 0.001 and 10 s", c.dt, None)
    tau = c.witness.tau
    if not SHORTEST_TAU <= tau <= LONGEST_TAU + ROUNDING:
        return _wrong(f"the witness's step must be at most {LONGEST_TAU} s", tau, LONGEST_TAU)
    n = round(c.dt / tau)
    if n < 1 or abs(n * tau - c.dt) > ROUNDING:
        return _wrong("the witness's step must divide dt", tau, c.dt / max(n, 1))
    if abs(c.fail_safe.tau - tau) > ROUNDING / len(c.witness.states):
        return _wrong("the fail-safe's step must be the witness's", c.fail_safe.tau, tau)
    if abs(c.witness.start) > ROUNDING:
        return _wrong("the witness must begin at time 0", c.witness.start, 0.0)
    steps = len(c.witness.inputs)
    if steps != n * c.horizon:
        return _wrong(
            f"the witness must cover the horizon of {c.horizon} steps", steps, n * c.horizon
        )
    i = round(c.t_dec / tau)
    if abs(i * tau - c.t_dec) > ROUNDING * max(1, i):
        return _wrong("t_dec must be a grid point of the witness", c.t_dec, i * tau)
    if not 1 <= i <= steps:
        return _wrong("t_dec must lie after 0 and not after the witness's end", c.t_dec, tau)
    if abs(c.fail_safe.start - c.t_dec) > ROUNDING:
        return _wrong("the fail-safe must begin at t_dec", c.fail_safe.start, c.t_dec)
    end = c.fail_safe.start + tau * len(c.fail_safe.inputs)
    return Checked(
        "grid",
        f"witness to {steps * tau:.2f} s, fail-safe from {c.t_dec:.2f} s to {end:.2f} s, "
        f"{n} grid points per step",
    )


def _wrong(sentence: str, measured: float, allowed: float | None) -> Violation:
    text = f"{sentence}: it is {measured:g}" + ("" if allowed is None else f", not {allowed:g}")
    return Violation("grid", text, measured=float(measured), allowed=allowed)


def initial_state(c: Certificate) -> Checked | Violation:
    """The witness begins in the recorded initial state."""
    return _same("initial-state", "the witness's first state", c.witness.states[0], c.initial, 0.0)


def continuity(c: Certificate) -> Checked | Violation:
    """The fail-safe begins in the witness's state at t_dec."""
    there = c.witness.states[decision_point(c)]
    return _same("continuity", "the fail-safe's first state", c.fail_safe.states[0], there, c.t_dec)


def _same(
    condition: str,
    what: str,
    found: np.ndarray[tuple[int], np.dtype[np.float64]],
    wanted: np.ndarray[tuple[int], np.dtype[np.float64]],
    time: float,
) -> Checked | Violation:
    gaps = np.abs(found - wanted)
    i = int(np.argmax(gaps))
    if not gaps[i] <= SAME:
        return Violation(
            condition,
            f"{what} has {_ENTRIES[i]} {found[i]:.6f} {_UNITS[i]} at {time:.2f} s, "
            f"it must be {wanted[i]:.6f}",
            step=0,
            time=time,
            measured=float(found[i]),
            allowed=float(wanted[i]),
        )
    return Checked(condition, f"{what} is as recorded", SAME - float(gaps[i]))
