"""Convex polygons in batches, against shapely."""

from __future__ import annotations

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from sandra.prediction.geometry import (
    clip,
    clip_all,
    directions,
    minkowski,
    polygons_around,
    polygons_from_support,
    stack,
    trimmed,
    unpadded,
)
from sandra.scene.convex import hull as convex_hull

coordinates = st.floats(-20, 20, allow_nan=False).map(lambda v: round(v, 3))
clouds = hnp.arrays(np.float64, st.tuples(st.integers(1, 9), st.just(2)), elements=coordinates)


def area(polygon: np.ndarray) -> float:
    x, y = polygon.T
    return float((x * np.roll(y, -1) - y * np.roll(x, -1)).sum() / 2)


@given(clouds)
@settings(max_examples=60, deadline=None)
def test_hull_is_shapelys(points: np.ndarray) -> None:
    hull = convex_hull(points)
    assert area(hull) == pytest.approx(shapely.MultiPoint(points).convex_hull.area, abs=1e-9)


@given(clouds, st.floats(0, 6.28), st.floats(-15, 15))
@settings(max_examples=80, deadline=None)
def test_clipping_is_shapelys(points: np.ndarray, angle: float, offset: float) -> None:
    hull = convex_hull(points)
    n = np.array([np.cos(angle), np.sin(angle)])
    t = np.array([-n[1], n[0]])
    half = shapely.Polygon([n * offset + 99 * t, n * offset - 99 * t, n * (offset - 99) - 99 * t,
                            n * (offset - 99) + 99 * t])  # fmt: skip
    expected = shapely.MultiPoint(hull).convex_hull.intersection(half)
    batch, alive = clip(hull[None], n, np.array([offset]))
    if not alive[0]:
        assert expected.area < 1e-6
    else:
        assert area(batch[0]) == pytest.approx(expected.area, abs=1e-6)
        assert (batch[0] @ n <= offset + 1e-6).all()


def test_a_batch_of_no_polygons_is_as_narrow_as_can_be() -> None:
    assert stack([]).shape == (0, 1, 2)
    assert stack([np.zeros((3, 2))]).shape == (1, 3, 2)


def test_rows_of_a_batch_are_clipped_one_by_one() -> None:
    square = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
    triangle = square[:3]
    batch = stack([square, triangle, square + 5.0])
    cut, rows = clip_all(batch, directions(2), np.array([[0.5, 0.0], [2.0, 0.0], [5.25, -5.125]]))
    assert rows.tolist() == [0, 1, 2]
    assert [round(area(p), 6) for p in unpadded(cut)] == [0.5, 0.5, 0.125]
    _, rows = clip_all(batch, directions(2), np.array([[-0.5, 0.0], [2.0, 0.0], [4.0, 0.0]]))
    assert rows.tolist() == [1]


@given(clouds, clouds)
@settings(max_examples=80, deadline=None)
def test_minkowski_sum_is_the_hull_of_all_sums(a: np.ndarray, b: np.ndarray) -> None:
    p, q = convex_hull(a), convex_hull(b)
    total = minkowski(p[None], q[None])[0]
    expected = shapely.MultiPoint((p[:, None] + q[None]).reshape(-1, 2)).convex_hull
    got = shapely.MultiPoint(total).convex_hull
    assert got.hausdorff_distance(expected) < 1e-6


def test_polygon_from_support_touches_a_circle() -> None:
    normals = directions(16)
    polygon = unpadded(polygons_from_support(normals, np.full((1, 16), 2.0)))[0]
    assert len(polygon) == 16
    assert np.allclose(np.hypot(*polygon.T), 2 / np.cos(np.pi / 16))
    with pytest.raises(ValueError, match="no point"):
        polygons_from_support(normals, np.full((1, 16), -1.0))


@given(clouds)
@settings(max_examples=60, deadline=None)
def test_support_of_a_set_gives_the_same_polygon_without_clipping(points: np.ndarray) -> None:
    normals = directions(8, 0.3)
    support = (points @ normals.T).max(axis=0)[None]
    around = polygons_around(normals, support)[0]
    clipped = unpadded(polygons_from_support(normals, support + 1e-12))[0]
    shape = shapely.MultiPoint(around).convex_hull
    assert shape.hausdorff_distance(shapely.MultiPoint(clipped).convex_hull) < 1e-6
    assert area(around) == pytest.approx(shape.area, abs=1e-9)


def test_columns_that_only_repeat_are_trimmed() -> None:
    square = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
    batch = stack([square, square[:3]])
    padded = np.concatenate([batch, np.repeat(batch[:, -1:], 5, axis=1)], axis=1)
    assert np.array_equal(trimmed(padded), batch)
    assert np.array_equal(trimmed(np.ones((2, 4, 2))), np.ones((2, 1, 2)))
