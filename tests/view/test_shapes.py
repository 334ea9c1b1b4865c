"""The geometry of the pictures: true lengths, true sets."""

import math

import numpy as np
import pytest
import shapely

from sandra.reach import verify
from sandra.scene.types import Region
from sandra.view.shapes import View, bounds, grown, path_of, polygons, touches, with_aspect
from straight_road import Road


def test_the_ego_is_at_the_origin_and_its_lane_points_right() -> None:
    road = Road(angle=2.3, x=40.0, y=-7.0)
    view = View.of(road.scene(heading=0.2))
    points = np.array([road.at(0.0, 0.0), road.at(10.0, 0.0), road.at(10.0, 3.0)])
    assert view.points(points) == pytest.approx(np.array([[0, 0], [10, 0], [10, 3]]), abs=1e-9)


def test_lane_points_and_plane_points_agree() -> None:
    scene = Road(angle=-1.0).scene()
    view = View.of(scene)
    s = scene.ego_curvilinear[0]
    assert view.lane_points(np.array([[s + 5.0, 2.0]]))[0] == pytest.approx([5.0, 2.0])


def test_positions_have_the_area_of_the_set() -> None:
    scene = Road(angle=0.7).scene(speed=8.0)
    verdict = verify(scene, "accelerate,follow-lane", horizon=8)[0]
    shapes = View.of(scene).positions(verdict.reachable_set)
    assert len(shapes) == 9
    # Thin sets are thickened, others grow by 1 mm at each side.
    assert shapes[8].area == pytest.approx(verdict.reachable_set.area(8), rel=0.02)
    assert shapes[0].area > 0.0


def test_a_region_becomes_its_polygon() -> None:
    view = View.of(Road().scene())
    assert view.region(Region.rectangle(4.0, 2.0)).area == pytest.approx(8.0)
    assert view.region(Region.disc(1.0)).area == pytest.approx(math.pi, rel=0.02)
    assert view.body(Region.disc(1.0), (math.nan, 0.0, 0.0)).is_empty


def test_holes_stay_open() -> None:
    ring = shapely.Point(0, 0).buffer(3.0).difference(shapely.Point(0, 0).buffer(1.0))
    path = path_of(ring)
    assert path.contains_point((2.0, 0.0))
    assert len(polygons(ring)) == 1
    # Opposite directions: the non-zero rule of every backend leaves the inner ring empty.
    rings = path.to_polygons()
    areas = [shapely.LinearRing(r).is_ccw for r in rings]
    assert sorted(areas) == [False, True]


def test_windows() -> None:
    window = with_aspect((0.0, 10.0, 0.0, 1.0), 2.0)
    assert window == (0.0, 10.0, -2.0, 3.0)
    assert grown(window, 1.0, 2.0) == (-1.0, 11.0, -4.0, 5.0)
    assert touches(window, np.array([[10.0, 3.0], [20.0, 9.0]]))
    assert not touches(window, np.array([[11.0, 3.0], [20.0, 9.0]]))
    assert not touches(window, np.array([[math.nan, 3.0]]))
    assert bounds([shapely.Polygon()]) is None
