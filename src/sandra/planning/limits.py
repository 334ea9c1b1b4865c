"""The bounds that every planned trajectory keeps, at and between its grid points."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sandra.planning.bounds import within
from sandra.planning.single_track import SPEED, STEERING
from sandra.settings import Settings

Array = NDArray[np.float64]

MARGIN = 1e-3
"""A planned trajectory keeps this distance from each bound [m/s^2, m/s, rad, rad/s], so that a
checker whose numbers are rounded differently agrees."""
ROUNDING = 1e-9
"""Speeds down to minus this count as 0 [m/s]."""


@dataclass(frozen=True, slots=True)
class Limits:
    """Bounds on the inputs and the state of the single-track model; SI units, angles in rad."""

    a_lon_min: float
    a_lon_max: float
    a_lat_max: float
    v_max: float
    steering_angle_max: float
    steering_rate_max: float

    @staticmethod
    def of(settings: Settings, margin: float = MARGIN) -> Limits:
        """The bounds of `settings`, each tightened by `margin`."""
        return Limits(
            settings.a_lon_min + margin,
            settings.a_lon_max - margin,
            settings.a_lat_max - margin,
            settings.v_max - margin,
            settings.steering_angle_max - margin,
            settings.steering_rate_max - margin,
        )


def slip(steering: Array) -> Array:
    """Angle between the heading and the course of the body's centre [rad]."""
    return np.asarray(np.arctan(np.tan(steering) / 2))


def within_limits(
    states: Array, inputs: Array, wheelbase: float, limits: Limits
) -> NDArray[np.bool_]:
    """(N,) whether trajectories (N, n+1, 5) with inputs (N, n, 2) keep the limits at every instant.

    Speed and steering angle are linear within each step, so both are extreme at its ends; the
    lateral acceleration v theta' is bounded by the larger speed with the larger angle.
    """
    speed, steering = states[..., SPEED], states[..., STEERING]
    acceleration, rate = inputs[..., 0], inputs[..., 1]
    faster = np.maximum(speed[:, :-1], speed[:, 1:])
    sine = np.sin(np.abs(slip(steering)))
    sharper = np.maximum(sine[:, :-1], sine[:, 1:])
    lateral = 2 * faster**2 * sharper / wheelbase
    kept = np.isfinite(states).all(axis=(1, 2))
    for values, low, high in (
        (acceleration, limits.a_lon_min, limits.a_lon_max),
        (rate, -limits.steering_rate_max, limits.steering_rate_max),
        (steering, -limits.steering_angle_max, limits.steering_angle_max),
        (lateral, 0.0, limits.a_lat_max),
        (speed, 0.0, limits.v_max),
    ):
        kept &= within(values, low, high, ROUNDING).all(axis=1)
    return np.asarray(kept)
