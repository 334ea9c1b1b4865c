"""What makes one valid trajectory better than another; it never makes one valid."""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import inf, isfinite

import numpy as np
from numpy.typing import NDArray

from sandra.errors import SettingsError

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Weights:
    """Weights of the cost terms; each term is about 1 for a clearly unpleasant trajectory.

    cost = jerk (rms jerk / 5 m/s^3)^2 + lateral (rms lateral acceleration / 2 m/s^2)^2
         + centre (mean distance to the centre of the wanted lane over the last half / 1 m)^2
         + speed (mean |v - desired speed| / 5 m/s) + change (duration of the change / 5 s)
         + clearance (1 - smallest distance to others / 1 m, if positive)^2.
    """

    jerk: float = 1.0
    lateral: float = 1.0
    centre: float = 4.0
    speed: float = 1.0
    change: float = 0.3
    clearance: float = 2.0
    desired_speed: float | None = None
    """[m/s]; None: the speed limit where it is known, else the present speed."""
    faster: float = 0.0
    """Added to the desired speed [m/s]."""

    def __post_init__(self) -> None:
        for name in ("jerk", "lateral", "centre", "speed", "change", "clearance"):
            if not 0.0 <= getattr(self, name) < inf:
                raise SettingsError(f"weight {name} = {getattr(self, name)!r} must be finite, >= 0")
        if self.desired_speed is not None and not 0.0 <= self.desired_speed < inf:
            raise SettingsError(
                f"desired speed = {self.desired_speed!r} must be a finite number >= 0 [m/s]"
            )
        if not isfinite(self.faster):
            raise SettingsError(f"faster = {self.faster!r} must be a finite number [m/s]")

    @staticmethod
    def for_command(text: str | None) -> Weights:
        """Weights for the driver's command; they rank trajectories and change no verdict.

        English and German keywords: faster or hurry, slower, comfort or smooth, distance or
        careful. Anything else leaves the weights as they are.
        """
        weights = Weights()
        words = (text or "").lower()

        def told(*keys: str) -> bool:
            return any(key in words for key in keys)

        if told("fast", "hurry", "quick", "schnell", "beeil"):
            weights = replace(weights, speed=3.0, jerk=0.5, faster=5.0)
        if told("slow", "langsam"):
            weights = replace(weights, speed=2.0, faster=-5.0)
        if told("comfort", "smooth", "gentl", "sick", "komfort", "sanft"):
            weights = replace(weights, jerk=4.0, lateral=4.0)
        if told("distance", "careful", "cautious", "abstand", "vorsicht"):
            weights = replace(weights, clearance=8.0)
        return weights


@dataclass(frozen=True, slots=True, eq=False)
class Course:
    """What the cost is of: N trajectories at steps k = 0..h.

    `acceleration` (N, h) [m/s^2]; `speed`, `lateral` (acceleration) and `off_centre` (distance to
    the centre of the wanted lane) (N, h+1); `duration` (N,) of the lateral motion [s].
    """

    acceleration: Array
    speed: Array
    lateral: Array
    off_centre: Array
    duration: Array


def costs(
    course: Course, weights: Weights, desired_speed: float, acceleration: float, dt: float
) -> Array:
    """(N,) costs without the clearance; `acceleration` [m/s^2] is the present one."""
    before = np.full((len(course.acceleration), 1), acceleration)
    jerk = np.diff(np.hstack([before, course.acceleration]), axis=1) / dt
    half = course.off_centre.shape[1] // 2
    return np.asarray(
        weights.jerk * (jerk**2).mean(axis=1) / 25.0
        + weights.lateral * (course.lateral**2).mean(axis=1) / 4.0
        + weights.centre * np.abs(course.off_centre[:, half:]).mean(axis=1) ** 2
        + weights.speed * np.abs(course.speed - desired_speed).mean(axis=1) / 5.0
        + weights.change * course.duration / 5.0
    )


def clearance_cost(gap: Array, weights: Weights) -> Array:
    """(N,) cost of passing others at a distance `gap` [m]."""
    return np.asarray(weights.clearance * np.maximum(1.0 - gap, 0.0) ** 2)
