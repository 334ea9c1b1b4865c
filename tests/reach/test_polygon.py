"""Convex polygons: exact against shapely, every rounding outwards."""

import numpy as np
import pytest
import shapely
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from reach_particles import in_polygon
from sandra.reach import polygon as module
from sandra.reach.polygon import (
    EPS,
    MAX_CORNERS,
    Point,
    Polygon,
    _extension,
    area,
    contains,
    cut,
    cut_x,
    cut_y,
    half_planes,
    hull,
    intersection,
    joined,
    limit_corners,
    propagate,
    range_x,
    range_y,
    swept,
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
    assert in_polygon(propagate(polygon, low, low + span, dt, tight=True), end).all()
    speeds = sorted(rng.choice(end[:, 1], 2))
    kept = end[(end[:, 1] >= speeds[0]) & (end[:, 1] <= speeds[1])]
    found = propagate(polygon, low, low + span, dt, tuple(speeds), tight=seed % 2 == 0)
    assert in_polygon(found, kept).all()
    assert speeds[0] - 2e-9 <= range_y(found)[0] <= range_y(found)[1] <= speeds[1] + 2e-9


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
    # The hexagon: 9/8 of the lens.
    tight = propagate([(1.0, 2.0)], low, low + span, dt, tight=True)
    assert range_x(tight) == pytest.approx(x, abs=1e-12)
    assert range_y(tight) == pytest.approx(v, abs=1e-12)
    assert len(tight) == 6
    assert shape(tight).area == pytest.approx(span**2 * dt**3 * 3 / 16, rel=1e-6)


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


# ------------------------------------------------------------------ exactly on the boundary


SQUARE = [(0.0, 0.0), (2.0, 0.0), (2.0, 2.0), (0.0, 2.0)]


def test_a_cut_through_corners_keeps_them_once() -> None:
    """Coordinates such that a x + b y - c is exactly 0 there: c plus the tolerance is its x."""
    edge = 1.0 + EPS
    diamond = [(0.0, 0.0), (edge, -1.0), (3.0, 0.0), (edge, 1.0)]
    assert cut(diamond, 1.0, 0.0, 1.0) == [(0.0, 0.0), (edge, -1.0), (edge, 1.0)]
    triangle = [(edge, 0.0), (2.0, 0.0), (2.0, 1.0)]
    assert cut(triangle, 1.0, 0.0, 1.0) == [(edge, 0.0)]
    assert cut(triangle[::-1], 1.0, 0.0, 1.0) == [(edge, 0.0)]
    inside = [(0.0, 0.0), (edge, 0.0), (0.0, 1.0)]
    assert cut(inside, 1.0, 0.0, 1.0) == inside
    assert cut([(edge, 0.0), (2.0, 0.0)], 1.0, 0.0, 1.0) == [(edge, 0.0)]
    assert cut([(0.0, 0.0), (edge, 0.0)], 1.0, 0.0, 1.0) == [(0.0, 0.0), (edge, 0.0)]


def test_cuts_at_infinity_keep_everything() -> None:
    for low, high in ((-np.inf, np.inf), (-np.inf, 5.0), (-5.0, np.inf)):
        assert cut_x(SQUARE, low, high) == SQUARE
        assert cut_y(SQUARE, low, high) == SQUARE
    assert range_x(cut_x(SQUARE, -np.inf, 1.0)) == pytest.approx((0.0, 1.0))
    assert range_x(cut_x(SQUARE, 1.0, np.inf)) == pytest.approx((1.0, 2.0))
    assert range_y(cut_y(SQUARE, -np.inf, 1.0)) == pytest.approx((0.0, 1.0))
    assert range_y(cut_y(SQUARE, 1.0, np.inf)) == pytest.approx((1.0, 2.0))


def test_a_triangle_is_turned_counter_clockwise() -> None:
    assert hull([(0.0, 0.0), (1.0, 2.0), (2.0, 0.0)]) == [(0.0, 0.0), (2.0, 0.0), (1.0, 2.0)]


def regular(n: int, radius: float = 1.0) -> Polygon:
    angles = 2 * np.pi * np.arange(n) / n
    return [(float(radius * np.cos(a)), float(radius * np.sin(a))) for a in angles]


def test_as_many_corners_as_allowed_are_kept() -> None:
    assert limit_corners(regular(MAX_CORNERS)) == regular(MAX_CORNERS)
    assert len(limit_corners(regular(MAX_CORNERS + 1))) == MAX_CORNERS


@pytest.mark.parametrize("turn", range(MAX_CORNERS + 1))
def test_the_shortest_edge_goes_wherever_it_is(turn: int) -> None:
    """A corner that is cut off a little comes back; the order of corners goes on."""
    polygon = regular(MAX_CORNERS)
    (px, py), (x, y), (qx, qy) = polygon[4:7]
    near = [(x + 0.1 * (u - x), y + 0.1 * (w - y)) for u, w in ((px, py), (qx, qy))]
    clipped = [*polygon[:5], *near, *polygon[6:]]
    clipped = clipped[turn:] + clipped[:turn]
    found = limit_corners(clipped)
    start = min(range(len(found)), key=lambda i: np.hypot(found[i][0] - 1.0, found[i][1]))
    assert np.allclose(found[start:] + found[:start], polygon)


def test_edges_that_cannot_be_extended_are_kept() -> None:
    """Their neighbours are parallel, or nearly so: rounding decides where they meet."""
    assert limit_corners(regular(20, 1e-7)) == regular(20, 1e-7)
    p, q, r = (0.0, 0.0), (1.0, 0.0), (1.0, 1.0)
    assert _extension(p, q, r, (0.0, 1.0)) == (np.inf, q)
    # turning by so little that the cross product of both is exactly the least that counts
    tiny = _extension((0.0, 0.0), (1e-12, 0.0), (1e-12, 1.0), (0.0, 2.0))
    assert tiny == (np.inf, (1e-12, 0.0))
    tiny = _extension((0.0, 0.0), (1e-12, 0.0), (1e-12, 1.0), (1e-12, 2.0))
    assert tiny == (np.inf, (1e-12, 0.0))
    # turning on
    assert _extension(p, q, (2.0, 1.0), (2.0, 2.0)) == (0.5, (2.0, 0.0))
    # turning back: beyond q they do not meet
    assert _extension(p, q, (0.5, 1.0), (-2.0, 0.5))[0] == np.inf
    assert _extension(p, q, (0.0, -1.0), (0.0, 0.0))[0] == np.inf


def test_an_edge_in_line_with_its_neighbour_costs_nothing() -> None:
    area, corner = _extension((0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (1.0, 2.0))
    assert (area, corner) == (0.0, (1.0, 0.0))
    area, corner = _extension((0.0, 0.0), (1.0, 0.0), (2.0, 0.0), (2.0, 1.0))
    assert (area, corner) == (0.0, (2.0, 0.0))


def test_half_planes_are_those_of_the_edges() -> None:
    found = half_planes([(0.0, 0.0), (2.0, 0.0), (0.0, 2.0)])
    half = np.sqrt(0.5)
    expected = [(-1.0, 0.0, 0.0), (0.0, -1.0, 0.0), (half, half, np.sqrt(2.0))]
    assert len(found) == 3
    assert np.allclose(found, expected)
    # of points the box, of segments the line on both sides as well
    box = [(1.0, 0.0, 3.0), (-1.0, 0.0, -3.0), (0.0, 1.0, 4.0), (0.0, -1.0, -4.0)]
    assert half_planes([(3.0, 4.0)]) == box
    segment = half_planes([(0.0, 0.0), (3.0, 4.0)])
    assert segment[:4] == [(1.0, 0.0, 3.0), (-1.0, 0.0, 0.0), (0.0, 1.0, 4.0), (0.0, -1.0, 0.0)]
    assert np.allclose(sorted(segment[4:]), sorted(2 * [(0.8, -0.6, 0), (-0.8, 0.6, 0)]))
    # what is as short as rounding errors has no direction
    assert len(half_planes([(0.0, 0.0), (1e-12, 0.0)])) == 4
    assert len(half_planes([(0.0, 0.0), (2e-12, 0.0)])) == 8
    assert len(half_planes([(0.0, 0.0), (1e-13, 0.0), (2.0, 0.0), (1.0, 1.0)])) == 3


@given(points, points)
def test_intersection_is_that_of_shapely(some: list[Point], others: list[Point]) -> None:
    a, b = hull(some), hull(others)
    found = intersection(a, b)
    exact = shape(a).intersection(shape(b))
    for x, y in shapely.get_coordinates(exact):
        assert found
        assert contains(found, x, y, 1e-6)
    # cuts keep a nanometre more, of slivers somewhat more
    for x, y in found:
        assert contains(a, x, y, 1e-9)
        assert all(u * x + w * y <= c + 2 * EPS for u, w, c in half_planes(b))
    assert intersection([], b) == []


@given(points)
def test_area_is_that_of_shapely(some: list[Point]) -> None:
    polygon = hull(some)
    assert area(polygon) == pytest.approx(shape(polygon).area, abs=1e-9)
    assert area(polygon[::-1]) == pytest.approx(-shape(polygon).area, abs=1e-9)


def test_contains_up_to_the_tolerance_and_no_further() -> None:
    """Numbers that are exact in binary, so that the boundary itself can be asked for."""
    beyond = 0.5 + 2.0**-40
    for polygon in ([(1.0, 3.0)], [(0.0, 3.0), (1.0, 3.0)], [(1.0, 1.0), (1.0, 3.0)]):
        x, y = polygon[-1]
        assert contains(polygon, x + 0.5, y, 0.5)
        assert contains(polygon, x, y + 0.5, 0.5)
        assert not contains(polygon, x + beyond, y, 0.5)
        assert not contains(polygon, x, y + beyond, 0.5)
        x, y = polygon[0]
        assert contains(polygon, x - 0.5, y, 0.5)
        assert contains(polygon, x, y - 0.5, 0.5)
        assert not contains(polygon, x - beyond, y, 0.5)
        assert not contains(polygon, x, y - beyond, 0.5)
    for x, y in ((-0.5, 1.0), (2.5, 1.0), (1.0, -0.5), (1.0, 2.5)):
        assert contains(SQUARE, x, y, 0.5)
        assert not contains(SQUARE, x + (x - 1.0) * 2.0**-40, y + (y - 1.0) * 2.0**-40, 0.5)
    # of a sloping edge it is measured along both axes together
    slope = [(0.0, 0.0), (4.0, 0.0), (0.0, 4.0)]
    assert contains(slope, 2.5, 2.5, 0.5)
    assert not contains(slope, 2.5, 2.5 + 2.0**-40, 0.5)
    assert contains([(0.0, 0.0)], 1e-6, -1e-6)
    assert not contains([(0.0, 0.0)], 2e-6, 0.0)


@given(st.lists(points, min_size=1, max_size=4))
def test_joined_is_the_hull_of_all_corners(several: list[list[Point]]) -> None:
    polygons = [hull(some) for some in several]
    assert joined(polygons) == hull([p for polygon in polygons for p in polygon])


def test_corners_as_far_apart_as_rounding_lie_on_one_line(monkeypatch: pytest.MonkeyPatch) -> None:
    """A quarter of a metre here, so that the bound itself is exact in binary."""
    monkeypatch.setattr(module, "PARALLEL", 0.25)
    # by just so much the third corner of the right side is farther out than those beside it
    bulging = [(0.0, 0.0), (1.0, 0.0), (1.25, 0.5), (1.0, 1.0), (0.0, 1.0)]
    assert swept(bulging, 0.0, 1.0) == [(0.0, 0.0), (1.0, 0.0), (1.0, 2.0), (0.0, 2.0)]
    for turn in range(5):
        found = swept(bulging[turn:] + bulging[:turn], 0.0, 1.0)
        assert sorted(found) == [(0.0, 0.0), (0.0, 2.0), (1.0, 0.0), (1.0, 2.0)]
    farther = [(0.0, 0.0), (1.0, 0.0), (1.5, 0.5), (1.0, 1.0), (0.0, 1.0)]
    assert len(swept(farther, 0.0, 1.0)) == 6
    # of what is no wider than that on both sides all corners count
    narrow = [(0.0, 0.0), (0.25, -0.1), (0.5, 0.0), (0.25, 1.0)]
    sides = [(0.5, 0.0), (0.5, 1.0), (0.25, 2.0), (0.0, 1.0)]
    assert swept(narrow, 0.0, 1.0) == [*narrow[:2], *sides]


def test_a_triangle_is_swept_in_the_order_in_which_the_native_kernel_does_it() -> None:
    """The chain that stays, then the one that moves; the hull would begin on the far left below."""
    found = swept([(0.0, 0.0), (2.0, 0.0), (0.0, 2.0)], 1.0, 1.0)
    assert found == [(0.0, 2.0), (0.0, 0.0), (2.0, 0.0), (3.0, 1.0), (1.0, 3.0)]


def test_of_edges_that_add_the_same_area_the_first_goes(monkeypatch: pytest.MonkeyPatch) -> None:
    cut_off = [(1.0, 0.0), (2.0, 0.0), (3.0, 1.0), (3.0, 2.0)]
    cut_off += [(2.0, 3.0), (1.0, 3.0), (0.0, 2.0), (0.0, 1.0)]
    monkeypatch.setattr(module, "MAX_CORNERS", 7)
    assert limit_corners(cut_off) == [(1.0, 0.0), (3.0, 0.0), *cut_off[3:]]
    # from the last corner to the first
    rest = [(3.0, 3.0), (0.0, 3.0), (0.0, 0.0)]
    monkeypatch.setattr(module, "MAX_CORNERS", 4)
    assert limit_corners([(3.0, 1.0), *rest, (2.0, 0.0)]) == [(3.0, 0.0), *rest]


def test_a_new_corner_is_within_the_range_of_its_edge() -> None:
    """At its very ends, where the edge beside it is upright; and not beyond."""
    upright = [(0.0, 0.0), (2.0, 0.0), (3.0, 1.0), (3.0, 2.0)]
    assert _extension(*upright) == (0.5, (3.0, 0.0))
    assert _extension(*((3.0 - x, y) for x, y in upright[::-1])) == (0.5, (0.0, 0.0))
    leaning = [(0.0, 0.0), (2.0, 0.0), (3.0, 1.0), (2.5, 2.0)]
    assert _extension(*leaning)[0] == np.inf
    # the same along y
    for edge, found in ((upright, (0.5, (0.0, 3.0))), (leaning, None)):
        area, corner = _extension(*((y, x) for x, y in edge[::-1]))
        assert area == np.inf if found is None else (area, corner) == found


@pytest.mark.parametrize("tight", [False, True])
def test_positions_at_the_highest_speed_grow_as_they_can(tight: bool) -> None:
    """By v dt and, if the speed swings within the step, a dt^2 / 4; twice that if not `tight`."""
    polygon, dt = [(0.0, 19.0)], 0.1
    for k in range(1, 81):
        before = range_x(polygon)[1]
        polygon = propagate(polygon, -6.0, 6.0, dt, (0.0, 20.0), tight=tight)
        assert len(polygon) <= MAX_CORNERS
        if k > 3:
            swing = 6.0 * dt**2 / (4 if tight else 2)
            assert range_x(polygon)[1] - before == pytest.approx(20.0 * dt + swing, abs=1e-6)


@pytest.mark.parametrize("tight", [False, True])
def test_positions_and_speeds_of_a_free_set_are_exact_for_ever(tight: bool) -> None:
    """However many edges are dropped: both grow as constant acceleration makes them."""
    polygon, dt = [(0.0, 10.0)], 0.1
    for k in range(1, 81):
        polygon = propagate(polygon, -6.0, 4.0, dt, tight=tight)
        t = k * dt
        assert len(polygon) <= MAX_CORNERS
        assert range_y(polygon) == pytest.approx((10.0 - 6.0 * t, 10.0 + 4.0 * t), abs=1e-9)
        expected = (10.0 * t - 3.0 * t * t, 10.0 * t + 2.0 * t * t)
        assert range_x(polygon) == pytest.approx(expected, abs=1e-9)
