"""Time-to-collision in the lane frame, in closed form.

Two boxes [s_min, s_max] x [d_min, d_max] that keep their velocities touch while they overlap along
the lane and across it. On each axis that is an interval of time; the time-to-collision is the
first non-negative time in both.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from sandra.scene.types import Region


@dataclass(frozen=True, slots=True)
class Box:
    """A body in the lane frame: its extent [m] and velocity [m/s] along s and d."""

    s_min: float
    s_max: float
    d_min: float
    d_max: float
    v_s: float
    v_d: float

    @staticmethod
    def around(outline: Region, s: float, d: float, heading: float, speed: float) -> Box:
        """The box around a body whose centre is (s, d), turned by `heading` against the lane.

        The lane is taken as straight over the length of the body.
        """
        placed = outline.placed(s, d, heading)
        low = placed.vertices.min(axis=0) - placed.radius
        high = placed.vertices.max(axis=0) + placed.radius
        v_s, v_d = speed * float(np.cos(heading)), speed * float(np.sin(heading))
        return Box(float(low[0]), float(high[0]), float(low[1]), float(high[1]), v_s, v_d)


def signed_gap(a_min: float, a_max: float, b_min: float, b_max: float) -> float:
    """Distance from interval a to interval b: > 0 if b lies above, < 0 below, 0 if they touch."""
    if b_min > a_max:
        return b_min - a_max
    if b_max < a_min:
        return b_max - a_min
    return 0.0


def time_to_collision(a: Box, b: Box, *, along_lane: bool = False) -> float:
    """First time at which a and b touch if both keep their velocity [s]; inf if they never do.

    With `along_lane` both follow one lane: only the motion along s counts. NaN if a speed is NaN.
    """
    enter, leave = _overlap(b.s_min - a.s_max, b.s_max - a.s_min, b.v_s - a.v_s)
    if not along_lane:
        enter_d, leave_d = _overlap(b.d_min - a.d_max, b.d_max - a.d_min, b.v_d - a.v_d)
        if math.isnan(enter_d):
            return math.nan
        enter, leave = max(enter, enter_d), min(leave, leave_d)
    if math.isnan(enter):
        return math.nan
    time = max(enter, 0.0)
    return time if time <= leave else math.inf


def _overlap(lower: float, upper: float, rate: float) -> tuple[float, float]:
    """When lower + rate t <= 0 <= upper + rate t: (first, last) time, (inf, -inf) for never."""
    if math.isnan(rate):
        return math.nan, math.nan
    if rate == 0.0:
        return (-math.inf, math.inf) if lower <= 0.0 <= upper else (math.inf, -math.inf)
    first, last = -lower / rate, -upper / rate
    return (first, last) if first <= last else (last, first)
