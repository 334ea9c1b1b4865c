"""Convex polygons: exact against shapely, every rounding outwards."""

import numpy as np
import pytest
import shapely
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from reach_particles import in_polygon
from sandra.reach.polygon import (
    EPS,
    MAX_CORNERS,
    Point,
    Polygon,
    contains,
    cut,
    cut_x,
    cut_y,
    hull,
    limit_corners,
    propagate,
    range_x,
    range_y,
)

coordinate = st.floats(-50.0, 50.0).map(lambda x: round(x, 3))
points = st.lists(st.tuples(coordinate, coordinate), min_size=1, max_size=14)


def shape(polygon: Polygon) -> shapely.Geometry:
    return shapely.MultiPoint(polygon).convex_hull


def turns(polygon: Polygon) -> list[float]:
    a = np.array(polygon)
    e = np.roll(a, -1, axis=0) - a
    f = np.roll(e, -1, axis=0)
    return list(e[:, 0] * f[:, 1] - e[:, 1] * f[:, 0])


@given(points)
def test_hull_is_convex_counter_clockwise_and_holds_all_points(some: list[Point]) -> None:
    found = hull(some)
    assert set(found) <= set(some)
    if len(found) > 2:
        assert min(turns(found)) > 0.0
    assert all(contains(found, x, y, 1e-9) for x, y in some)
    assert shape(found).area == pytest.approx(shapely.MultiPoint(some).convex_hull.area)


def test_hull_of_points_and_segments() -> None:
    assert hull([(1.0, 2.0), (1.0, 2.0)]) == [(1.0, 2.0)]
    assert hull([(0.0, 0.0), (2.0, 2.0), (1.0, 1.0)]) == [(0.0, 0.0), (2.0, 2.0)]


@given(points, st.floats(0.0, 2 * np.pi), st.floats(-60.0, 60.0))
def test_cut_is_the_intersection(some: list[Point], angle: float, c: float) -> None:
    a, b = float(np.cos(angle)), float(np.sin(angle))
    polygon = hull(some)
    found = cut(polygon, a, b, c)
    n, t = np.array([a, b]), np.array([-b, a])
    half = [n * c + 500 * t, n * c - 500 * t, n * (c - 500) - 500 * t, n * (c - 500) + 500 * t]
    exact = shape(polygon).intersection(shapely.Polygon(half))
    if not found:
        assert all(a * x + b * y > c for x, y in polygon)
        return
    # nothing is lost, and nothing is kept beyond the tolerance
    assert all(a * x + b * y <= c + 2 * EPS for x, y in found)
    assert all(contains(polygon, x, y, 1e-9) for x, y in found)
    assert all(contains(found, x, y, 1e-8) for x, y in shapely.get_coordinates(exact))
    if exact.area > 1e-3:
        assert shape(found).area == pytest.approx(exact.area, abs=1e-5)
        assert min(turns(found)) >= -1e-7


@given(points, coordinate, st.floats(0.0, 30.0))
def test_cut_along_an_axis(some: list[Point], low: float, width: float) -> None:
    polygon = hull(some)
    high = low + width
    for found, index in ((cut_x(polygon, low, high), 0), (cut_y(polygon, low, high), 1)):
        kept = [p for p in polygon if low <= p[index] <= high]
        assert set(kept) <= set(found)
        assert all(low - 2 * EPS <= p[index] <= high + 2 * EPS for p in found)
    assert cut_x(polygon, -np.inf, np.inf) == polygon
    assert cut_y([], 0.0, 1.0) == []


def test_cut_keeps_what_lies_on_the_line() -> None:
    square = [(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)]
    assert cut(square, 1.0, 0.0, 1.0) == square
    assert range_y(cut(square, 1.0, 0.0, 0.0)) == (0.0, 1.0)
    assert cut(square, 1.0, 0.0, -1e-6) == []
    assert cut([(1.0, 1.0)], 1.0, 0.0, 1.0) == [(1.0, 1.0)]
    assert cut([(1.0, 1.0)], 1.0, 0.0, 0.5) == []


def test_cut_rounds_outwards() -> None:
    beyond = 1.0 + EPS / 2
    assert cut([(beyond, 0.0)], 1.0, 0.0, 1.0) == [(beyond, 0.0)]
    assert range_x(cut([(0.0, 0.0), (2.0, 0.0)], 1.0, 0.0, 1.0))[1] >= beyond


def test_cut_of_a_segment_is_a_segment() -> None:
    segment = [(0.0, 0.0), (2.0, 2.0)]
    assert cut(segment, 1.0, 0.0, 3.0) == segment
    assert cut(segment, 1.0, 0.0, 1.0) == pytest.approx(np.array([(0.0, 0.0), (1.0, 1.0)]))
    assert cut(segment, -1.0, 0.0, -1.0) == pytest.approx(np.array([(1.0, 1.0), (2.0, 2.0)]))


def moved(
    start: np.ndarray, low: float, high: float, dt: float, rng: np.random.Generator
) -> np.ndarray:
    """States after dt, with inputs that switch up to four times between random and extreme ones."""
    x, v = start.T
    marks = np.sort(rng.uniform(0.0, dt, (5, len(x))), axis=0)
    marks[-1] = dt
    before = np.zeros(len(x))
    for end in marks:
        t = end - before
        u = np.where(
            rng.random(len(x)) < 0.7,
            rng.choice([low, high], len(x)),
            rng.uniform(low, high, len(x)),
        )
        x, v = x + v * t + u * t**2 / 2, v + u * t
        before = end
    return np.column_stack([x, v])


@settings(max_examples=60)
@given(
    points,
    st.floats(-8.0, 8.0),
    st.floats(0.0, 12.0),
    st.sampled_from([0.04, 0.1, 0.2]),
    st.integers(0, 99),
)
def test_propagate_holds_every_trajectory(
    some: list[Point], low: float, span: float, dt: float, seed: int
) -> None:
    rng = np.random.default_rng(seed)
    polygon = hull(some)
    start = rng.dirichlet(np.full(len(polygon), 0.3), 300) @ np.array(polygon)
    end = moved(start, low, low + span, dt, rng)
    assert in_polygon(propagate(polygon, low, low + span, dt), end).all()


@given(st.floats(-8.0, 8.0), st.floats(0.1, 12.0), st.sampled_from([0.04, 0.1, 0.2]))
def test_propagate_of_a_point_is_tight(low: float, span: float, dt: float) -> None:
    """Exact in position and in speed; in area 3/2 of the lens between the two parabolas.

    The lens holds states between x = u^2 / (2 span) and its mirror image, u the gain in speed:
    span^2 dt^3 / 12 ... of a parallelogram of span^2 dt^3 / 4.
    """
    found = propagate([(1.0, 2.0)], low, low + span, dt)
    x = [1.0 + 2.0 * dt + a * dt**2 / 2 for a in (low, low + span)]
    v = [2.0 + a * dt for a in (low, low + span)]
    assert range_x(found) == pytest.approx(x, abs=1e-12)
    assert range_y(found) == pytest.approx(v, abs=1e-12)
    u = np.linspace(0.0, span * dt, 2001)
    width = u * dt - u**2 / (2 * span) - u**2 / (2 * span)
    lens = float(np.trapezoid(width, u))
    assert lens == pytest.approx(span**2 * dt**3 / 6, rel=1e-4)
    assert shape(found).area == pytest.approx(span**2 * dt**3 / 4, rel=1e-6)


def test_propagate_with_one_admissible_input() -> None:
    assert propagate([(1.0, 2.0)], 3.0, 3.0, 0.1) == [pytest.approx((1.215, 2.3))]


def test_propagate_again_grows_two_edges() -> None:
    polygon = [(0.0, 0.0)]
    sizes = []
    for _ in range(6):
        polygon = propagate(polygon, -6.0, 6.0, 0.1)
        sizes.append(len(polygon))
    # rounding may part a corner into two
    assert all(n <= 2 * i + 6 for i, n in enumerate(sizes, start=1))
    assert len({(round(x, 9), round(y, 9)) for x, y in polygon}) == 14


@given(st.integers(MAX_CORNERS - 2, 60), st.floats(0.2, 20.0), st.integers(0, 99))
def test_limit_corners_only_grows(n: int, flat: float, seed: int) -> None:
    rng = np.random.default_rng(seed)
    angles = rng.uniform(0.0, 2 * np.pi, n)
    polygon = hull([(flat * np.cos(a), np.sin(a)) for a in angles])
    assume(len(polygon) > 2)
    found = limit_corners(polygon)
    assert len(found) <= MAX_CORNERS
    assert min(turns(found)) > -1e-9
    assert all(contains(found, x, y, 1e-9) for x, y in polygon)
    assert shape(found).area <= 1.5 * shape(polygon).area or len(polygon) < 2 * MAX_CORNERS
    if len(polygon) <= MAX_CORNERS:
        assert found == polygon


def test_limit_corners_adds_little_to_a_circle() -> None:
    circle = [(np.cos(a), np.sin(a)) for a in np.linspace(0.0, 2 * np.pi, 40, endpoint=False)]
    assert shape(limit_corners(circle)).area < 1.1 * shape(circle).area


@given(points, coordinate, coordinate)
def test_contains_agrees_with_shapely(some: list[Point], x: float, y: float) -> None:
    polygon = hull(some)
    away = shape(polygon).distance(shapely.Point(x, y))
    assume(away == 0.0 or away > 1e-4)
    # thin slivers: the tolerance of an edge is that of its line
    assert contains(polygon, x, y) or away > 0.0
    if len(polygon) < 3 or min(turns(polygon)) > 1.0:
        assert contains(polygon, x, y) == (away == 0.0)
