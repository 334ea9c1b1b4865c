"""How fast, how hard and how tightly vehicles move, by finite differences over a recording's step.

The velocity is the recorded speed in the direction of the recorded heading. `max_acceleration` is
asked for |dv| / dt, and for 2 e / dt^2, where e is the distance of the next position from where
the velocity leads, less `noise`, which is granted to the recording. If both are at most a in every
step, then after n steps a vehicle is within a (n dt)^2 / 2 of where its first velocity leads: what
the prediction holds. Peaks within a step are not seen. `max_braking` and `max_driving` are asked
for differences of speeds alone.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from sandra.evaluation.conformance.recording import Recording

Array = NDArray[np.float64]

TURN_NOISE = 1e-3
"""A heading that changes by less in a step has not changed [rad]."""
MOVED = 0.5
"""Steps shorter than this tell no direction of motion [m]."""


def motion(r: Recording, noise: float) -> dict[str, Array]:
    """By assumption, (m, n) how much of it a vehicle needs at a step; NaN: nothing is told.

    max_acceleration, max_braking, max_driving [m/s^2], max_speed [m/s], min_turning_radius (as
    curvature of the body's turning [rad/m]), max_slip_angle (spread so far [rad]), and the same of
    pedestrians.
    """
    m, n = r.there.shape
    x, heading, speed = r.states[:, :, :2], r.states[:, :, 2], r.states[:, :, 3]
    there = r.there
    both = there[:, 1:] & there[:, :-1]

    def later(values: Array) -> Array:
        found = np.full((m, n), np.nan)
        found[:, 1:] = np.where(both, values, np.nan)
        return found

    velocity = _velocity(r)
    change = np.linalg.norm(np.diff(velocity, axis=1), axis=2) / r.dt
    led_away = 2 * np.maximum(_led_away(r, velocity[:, :-1]) - noise, 0.0) / r.dt**2
    push = later(np.maximum(change, led_away))
    gain = later(np.diff(np.abs(speed), axis=1) / r.dt)
    turn = np.maximum(np.abs(_wrap(np.diff(heading, axis=1))) - TURN_NOISE, 0.0)
    step = np.diff(x, axis=1)
    gone = np.linalg.norm(step, axis=2)
    way = np.maximum(gone, np.abs(speed[:, 1:] + speed[:, :-1]) / 2 * r.dt)
    fast = np.where(there, np.abs(speed), np.nan)
    fast[:, 1:] = np.fmax(fast[:, 1:], np.where(both, (gone - noise) / r.dt, np.nan))
    with np.errstate(divide="ignore", invalid="ignore"):
        curvature = later(np.where(turn > 0.0, turn / way, 0.0))
    found = {
        "max_acceleration": _of(push, r.others),
        "max_braking": _of(-gain, r.on_lanes),
        "max_driving": _of(gain, r.on_lanes),
        "max_speed": _of(fast, r.others),
        "min_turning_radius": _of(curvature, r.on_lanes),
        "max_slip_angle": _of(later(_slip(step, heading, both)), r.on_lanes),
        "pedestrian_max_speed": _of(fast, r.walking),
        "pedestrian_max_acceleration": _of(push, r.walking),
    }
    return found


def position_error(r: Recording) -> float:
    """How far positions are from where the mean of the velocities before and after leads [m]."""
    v = _velocity(r)
    both = r.there[:, 1:] & r.there[:, :-1] & ~_ego_row(r)[:, None]
    errors = _led_away(r, (v[:, :-1] + v[:, 1:]) / 2)
    return float(errors[both].max(initial=0.0))


def _velocity(r: Recording) -> Array:
    """(m, n, 2) [m/s]"""
    speed, heading = r.states[:, :, 3], r.states[:, :, 2]
    return np.asarray(speed[:, :, None] * np.stack([np.cos(heading), np.sin(heading)], axis=2))


def _led_away(r: Recording, velocity: Array) -> Array:
    """(m, n-1) distances of the next positions from where velocities (m, n-1, 2) lead [m]."""
    return np.asarray(np.linalg.norm(np.diff(r.states[:, :, :2], axis=1) - r.dt * velocity, axis=2))


def _slip(step: Array, heading: Array, both: NDArray[np.bool_]) -> Array:
    """(m, n-1) largest minus smallest angle from body to motion so far [rad]."""
    middle = heading[:, :-1] + _wrap(np.diff(heading, axis=1)) / 2
    slip = _wrap(np.arctan2(step[:, :, 1], step[:, :, 0]) - middle)
    # Backwards is no slip.
    slip = np.where(np.abs(slip) > np.pi / 2, _wrap(slip + np.pi), slip)
    known = both & (np.linalg.norm(step, axis=2) >= MOVED)
    low = np.minimum.accumulate(np.where(known, slip, np.inf), axis=1)
    high = np.maximum.accumulate(np.where(known, slip, -np.inf), axis=1)
    return np.where(known, high - low, np.nan)


def _of(values: Array, rows: NDArray[np.bool_]) -> Array:
    return np.where(rows[:, None], values, np.nan)


def _ego_row(r: Recording) -> NDArray[np.bool_]:
    mask = np.zeros(len(r.ids), dtype=bool)
    if r.has_ego:
        mask[-1] = True
    return mask


def _wrap(angle: Array) -> Array:
    return np.asarray((angle + np.pi) % (2 * np.pi) - np.pi)
