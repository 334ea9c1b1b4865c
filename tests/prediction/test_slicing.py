"""Slices hold their lanelet, with few corners; borders are projected as by brute force."""

from __future__ import annotations

import numpy as np
import pytest
import shapely

from prediction.traffic import bend, fork, straight_road
from sandra.prediction.lane_cutting import _projected, build_map
from sandra.prediction.slicing import (
    FEW_CORNERS,
    GROWTH,
    _is_straight,
    _straight_parts,
    simplified,
    slices_of,
)
from sandra.scene.convex import hull


@pytest.mark.parametrize("seed", range(8))
def test_fewer_corners_hold_the_same(seed: int) -> None:
    rng = np.random.default_rng(seed)
    angle = np.sort(rng.uniform(0.0, rng.uniform(0.2, 2 * np.pi), 60))
    axes = 10.0 ** rng.uniform(-1.0, 2.0, 2)
    outline = hull(np.column_stack([np.cos(angle), np.sin(angle)]) * axes + rng.uniform(-9, 9, 2))
    few = simplified(outline)
    exact, wide = shapely.Polygon(outline), shapely.Polygon(few)
    assert wide.is_valid
    assert len(hull(few)) == len(few) <= len(outline)
    assert exact.difference(wide).area < 1e-9
    # No further than a border moved outwards, but at corners, which are further than that.
    grown = exact.buffer(GROWTH + 1e-9, join_style="mitre", mitre_limit=1e6)
    assert wide.difference(grown).area < 1e-9


def test_few_corners_are_few() -> None:
    """Half a turn of 60 m radius in steps of a quarter of a degree."""
    angle = np.radians(np.linspace(0.0, 180.0, 721))
    outline = 60.0 * np.column_stack([np.cos(angle), np.sin(angle)])
    assert len(simplified(outline)) < 100
    square = outline[::180]
    assert simplified(square) is square
    assert len(square) <= FEW_CORNERS


@pytest.mark.parametrize("lanelets", [straight_road(2), bend(), fork()])
def test_slices_hold_all_cells(lanelets: tuple) -> None:
    lane_map = build_map(lanelets, 30.0)
    strips = tuple(lane_map.strips.values())
    for strip, several in zip(strips, slices_of(strips), strict=True):
        assert [x.first for x in several[1:]] == [x.last for x in several[:-1]]
        assert (several[0].first, several[-1].last) == (0, len(strip.s) - 1)
        for part in several:
            shape = shapely.Polygon(part.hull).buffer(1e-7)
            cells = strip.cells[part.first : part.last]
            assert shapely.covers(shape, shapely.polygons(cells)).all()
            across = cells @ np.array([-part.along[1], part.along[0]])
            assert (across.min(), across.max()) == pytest.approx(part.sides)
            # Nobody in the slice has more progress, or is further behind, than it says.
            progress = strip.progress[part.first : part.last + 1]
            assert part.ahead == progress.max()
            ends = np.stack([strip.right, strip.left], axis=1)[part.first : part.last + 1]
            assert (progress - ends @ part.along).max() == pytest.approx(part.lag)


@pytest.mark.parametrize("radius", [20.0, 60.0, 400.0, 3000.0])
def test_slices_of_a_bend_are_as_long_as_they_are_straight(radius: float) -> None:
    """Both borders of a lane along a circle, every metre."""
    turn = np.exp(1j * np.arange(300) / radius)
    sides = np.column_stack([(radius + 1.75) * turn, (radius - 1.75) * turn])
    for low, high in ((0, 299), (7, 150), (100, 102)):
        parts = _straight_parts(sides, low, high)
        assert [first for first, _ in parts] == [low, *(last for _, last in parts[:-1])]
        assert parts[-1][1] == high
        for first, last in parts:
            assert last > first
            assert _is_straight(sides[first : last + 1]) or last == first + 1
            assert last == high or not _is_straight(sides[first : last + 2])


def test_projection_onto_a_border_is_the_nearest_point() -> None:
    rng = np.random.default_rng(3)
    way = np.cumsum(rng.uniform(-0.6, 0.6, 300))
    line = np.cumsum(np.column_stack([np.cos(way), np.sin(way)]), axis=0)
    points = line[rng.integers(0, 300, 500)] + rng.normal(size=(500, 2)) * 4.0
    nearest, share = _projected(points, line)
    foot = line[nearest] + share[:, None] * (line[nearest + 1] - line[nearest])
    away = np.hypot(*(points - foot).T)
    assert away == pytest.approx(shapely.distance(shapely.LineString(line), shapely.points(points)))
