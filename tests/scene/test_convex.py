"""Distances to convex polygons, against shapely."""

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st

from sandra.scene.convex import distance, hull, hulls

coordinate = st.floats(-20.0, 20.0).map(lambda x: round(x, 2))


@given(
    st.lists(st.tuples(coordinate, coordinate), min_size=1, max_size=7),
    st.lists(st.tuples(coordinate, coordinate), min_size=1, max_size=20),
)
def test_distance_agrees_with_shapely(
    corners: list[tuple[float, float]], points: list[tuple[float, float]]
) -> None:
    body = shapely.MultiPoint(corners).convex_hull
    vertices = shapely.get_coordinates(body)
    if len(vertices) > 2:
        vertices = vertices[:-1]
    found = distance(np.array(points), vertices)
    assert found == pytest.approx(shapely.distance(body, shapely.points(points)), abs=1e-9)
    # either direction of turning
    assert distance(np.array(points), vertices[::-1]) == pytest.approx(found, abs=1e-9)


def test_distances_broadcast_and_know_segments_and_points() -> None:
    square = np.array([[0.0, 0.0], [2.0, 0.0], [2.0, 2.0], [0.0, 2.0]])
    segment = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 0.0], [1.0, 0.0]])
    point = np.tile([3.0, 4.0], (4, 1))
    places = np.array([[0.0, 0.0], [1.0, 1.0], [5.0, 0.0]])
    found = distance(places[:, None], np.stack([square, segment, point]))
    assert found == pytest.approx(
        np.array([[0.0, 0.0, 5.0], [0.0, 1.0, np.hypot(2, 3)], [3.0, 4.0, np.hypot(2, 4)]])
    )


def test_many_hulls_are_the_hulls_of_each() -> None:
    rng = np.random.default_rng(4)
    clouds = [rng.normal(size=(int(rng.integers(2, 12)), 2)).round(1) for _ in range(300)]
    clouds += [np.zeros((2, 2)), np.array([[0.0, 0.0], [1.0, 1.0], [2.0, 2.0]])]
    for cloud, found in zip(clouds, hulls(clouds), strict=True):
        expected = hull(cloud)
        start = int(np.argmin(np.abs(expected - found[0]).sum(axis=1)))
        assert np.array_equal(np.roll(expected, -start, axis=0), found)
    assert hulls([]) == []
