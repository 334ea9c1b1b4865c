"""A cubic spline through points in the plane, without SciPy: loading that costs 0.4 s."""

from __future__ import annotations

from dataclasses import dataclass
from math import perm

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Spline:
    """Cubics between n knots, twice continuously differentiable; the outer ones go on beyond.

    At the second knot and the last but one the third derivative is continuous too ("not a knot").
    """

    knots: Array
    """(n,) ascending."""
    coefficients: Array
    """(4, n - 1, m) of (u - knot)^0..3."""

    @staticmethod
    def through(knots: Array, points: Array) -> Spline:
        """The spline with values `points` (n, m) at `knots` (n,), n >= 4."""
        h = np.diff(knots)
        slope = np.diff(points, axis=0) / h[:, None]
        # The derivatives at the knots solve a system with three entries per row, after the first
        # and last one have been rid of their third unknown.
        below, above = np.append(h[1:], h[-2] + h[-1]), np.append(h[0] + h[1], h[:-1])
        middle = np.concatenate([h[1:2], 2 * (h[:-1] + h[1:]), h[-2:-1]])
        right = np.empty_like(points)
        right[1:-1] = 3 * (h[1:, None] * slope[:-1] + h[:-1, None] * slope[1:])
        for end, inner in ((0, 1), (-1, -2)):
            a, both = h[end], h[end] + h[inner]
            right[end] = (a + 2 * both) * h[inner] * slope[end] + a**2 * slope[inner]
            right[end] /= both
        derivative = _solved(below, middle, above, right)
        bend = (derivative[:-1] + derivative[1:] - 2 * slope) / h[:, None]
        second = (slope - derivative[:-1]) / h[:, None] - bend
        return Spline(knots, np.stack([points[:-1], derivative[:-1], second, bend / h[:, None]]))

    def __call__(self, u: ArrayLike, order: int = 0) -> Array:
        """The derivative of this order (0: the points) at u (k,) or one number: (k, m) or (m,)."""
        at = np.asarray(u, dtype=float)
        i = np.searchsorted(self.knots[1:-1], at, side="right")
        along = (at - self.knots[i])[..., None]
        value = perm(3, order) * self.coefficients[3, i]
        for power in range(2, order - 1, -1):
            value = value * along + perm(power, order) * self.coefficients[power, i]
        return np.asarray(value)


def _solved(below: Array, middle: Array, above: Array, right: Array) -> Array:
    """x (n, m) with below[i-1] x[i-1] + middle[i] x[i] + above[i] x[i+1] = right[i]."""
    pivot, rows = middle.tolist(), list(right)
    low, high = below.tolist(), above.tolist()
    for i in range(1, len(pivot)):
        share = low[i - 1] / pivot[i - 1]
        pivot[i] -= share * high[i - 1]
        rows[i] = rows[i] - share * rows[i - 1]
    rows[-1] = rows[-1] / pivot[-1]
    for i in range(len(pivot) - 2, -1, -1):
        rows[i] = (rows[i] - high[i] * rows[i + 1]) / pivot[i]
    return np.array(rows)
