"""Contacts: separating axes against shapely, and against the collision checker of CommonRoad."""

from __future__ import annotations

import numpy as np
import shapely

from sandra.evaluation.rollouts.contact import separation
from sandra.evaluation.rollouts.ego import rectangle


def pairs(count: int) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    rng = np.random.default_rng(3)
    at = rng.uniform(-4, 4, (2, count, 2))
    heading = rng.uniform(-np.pi, np.pi, (2, count))
    a = rectangle(at[0], heading[0], 4.5, 1.8)
    b = rectangle(at[1], heading[1], 5.0, 2.0)
    return a, b, at, heading


def test_separation_decides_overlap_and_bounds_the_distance() -> None:
    a, b, _, _ = pairs(2000)
    gaps = separation(a, b)
    exact = shapely.distance(shapely.polygons(a), shapely.polygons(b))
    assert np.array_equal(gaps <= 0.0, exact == 0.0)
    assert (gaps <= exact + 1e-9).all()
    assert 200 < (gaps <= 0.0).sum() < 1800


def test_separation_agrees_with_commonroad() -> None:
    from commonroad_dc import pycrcc

    a, b, at, heading = pairs(500)
    gaps = separation(a, b)
    for i in range(len(a)):
        one = pycrcc.RectOBB(2.25, 0.9, heading[0, i], *at[0, i])
        other = pycrcc.RectOBB(2.5, 1.0, heading[1, i], *at[1, i])
        if abs(gaps[i]) > 1e-6:
            assert one.collide(other) == (gaps[i] < 0.0)
