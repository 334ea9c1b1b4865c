"""On which side of its bound a value is: each question once, for numbers and arrays alike.

A NaN is neither clear nor within bounds.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Values = float | Array
Bools = NDArray[np.bool_]

STILL = 1e-9
"""Speeds below this are rounding: a standstill [m/s]."""
MOVING = 0.1
"""Only faster than this a velocity tells a direction [m/s]."""


def clear(distance: Values, margin: float) -> Bools:
    """Whether bodies at this distance keep clear by `margin` [m]; just the margin is contact."""
    return np.asarray(distance > margin)


def within(values: Values, low: Values, high: Values, slack: Values = 0.0) -> Bools:
    """Whether values are in [low, high], or beyond it by no more than `slack`."""
    return np.asarray((values >= low - slack) & (values <= high + slack))


def overlap(low: Array, high: Array, other_low: Array, other_high: Array) -> Bools:
    """(R,) whether boxes, by their lowest and highest corners (R, 2), meet others [m].

    The others: one for each, or one for all (2,). Boxes that touch meet.
    """
    return np.asarray(((low <= other_high) & (high >= other_low)).all(axis=1))


def stands(speed: Values) -> Bools:
    """Whether a speed is a standstill [m/s]."""
    return np.asarray(np.abs(speed) < STILL)


def moves(speed: Values) -> Bools:
    """Whether who is so fast moves in a direction worth telling [m/s]."""
    return np.asarray(speed > MOVING)


def whole_steps(time: float, step: float, tolerance: float) -> int | None:
    """How many steps make up a time [s]; None if it is no multiple of them up to `tolerance`."""
    count = round(time / step)
    return count if abs(count * step - time) <= tolerance else None
