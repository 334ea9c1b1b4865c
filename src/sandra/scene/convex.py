"""Convex hulls in the plane."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def hull(points: Array) -> Array:
    """Vertices of the convex hull of (n, 2) points, counter-clockwise, without collinear ones.

    Andrew's monotone chain. One or two distinct points are returned as they are.
    """
    distinct = np.unique(np.asarray(points, dtype=float)[:, :2], axis=0)
    if len(distinct) < 3:
        return distinct
    chains = []
    for side in (distinct, distinct[::-1]):
        chain: list[Array] = []
        for p in side:
            while len(chain) > 1 and _turn(chain[-2], chain[-1], p) <= 0:
                chain.pop()
            chain.append(p)
        chains.append(chain[:-1])
    return np.array(chains[0] + chains[1])


def _turn(a: Array, b: Array, c: Array) -> float:
    """Twice the signed area of a triangle; positive if it turns left."""
    return float((b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]))
