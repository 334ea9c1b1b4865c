"""Conflict areas: where an incoming lane covers the ego's own lanes."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
import shapely

import sandra
from reach_scenes import WIDTH, Course
from sandra.planning.conflict import SLIVER, conflict_areas
from sandra.scene.frame import Frame
from sandra.scene.types import Lane, Scene

COURSE = Course()


def crossing(x: float, width: float, number: int = 300, shift: float = 0.0) -> Lane:
    """A lane along -y that crosses the ego's road at x."""
    y = np.linspace(40.0 + shift, -40.0 + shift, 81)
    lines = [np.column_stack([np.full_like(y, x + d), y]) for d in (width / 2, -width / 2, 0.0)]
    return Lane("incoming-left", (number,), *lines, (None,), Frame(lines[2]))


def with_incoming(*incoming: Lane) -> Scene:
    return COURSE.scene([*COURSE.lanes(left=1, right=0), *incoming])


def test_a_crossing_lane_makes_the_overlap_with_all_own_lanes() -> None:
    (area,) = conflict_areas(with_incoming(crossing(30.0, 4.0)))
    wanted = shapely.box(28.0, -WIDTH / 2, 32.0, 1.5 * WIDTH)
    assert shapely.Polygon(area).symmetric_difference(wanted).area < 1e-6


def test_two_crossing_lanes_apart_make_two_areas() -> None:
    areas = conflict_areas(with_incoming(crossing(30.0, 4.0), crossing(50.0, 4.0, 301)))
    assert sorted(round(float(a[:, 0].min())) for a in areas) == [28, 48]


def test_without_incoming_lanes_there_is_none() -> None:
    assert conflict_areas(with_incoming()) == []


def test_a_lanelet_that_is_the_egos_own_is_no_conflict() -> None:
    """After a merge the incoming lane goes on along the ego's lanelet."""
    current = COURSE.lanes(left=0, right=0)[0]
    merged = dataclasses.replace(current, relation="incoming-right")
    assert conflict_areas(COURSE.scene([current, merged])) == []


@pytest.mark.parametrize(("overlap", "expected"), [(0.5 * SLIVER, 0), (2.0 * SLIVER, 1)])
def test_slivers_of_the_map_are_no_conflict(overlap: float, expected: int) -> None:
    beside = COURSE.lane(
        "incoming-right", 300, -1.5 * WIDTH, -0.5 * WIDTH + overlap, start=0.0, end=50.0
    )
    current = COURSE.lanes(left=0, right=0)[0]
    assert len(conflict_areas(COURSE.scene([current, beside]))) == expected


def test_in_the_example_of_an_intersection_they_lie_on_the_own_lanes_ahead() -> None:
    scene = sandra.load(sandra.example("intersection"))
    areas = conflict_areas(scene)
    own = shapely.union_all(
        [
            shapely.Polygon(lane.polygon).buffer(0)
            for lane in (scene.current, scene.left, scene.right)
            if lane is not None
        ]
    )
    assert areas
    for area in areas:
        assert own.buffer(0.05).covers(shapely.Polygon(area))
        s = scene.frame.to_curvilinear(area)[:, 0]
        assert s.min() > scene.ego_curvilinear[0] + scene.ego.length / 2


def own_box(x: float, y: float, half: float, number: int) -> Lane:
    """An incoming lane of one square piece, whose sides are parallel to the road."""
    return COURSE.lane("incoming-right", number, y - half, y + half, start=x - half, end=x + half)


@pytest.mark.parametrize(
    ("x", "y"), [(-40.0, 0.0), (160.0, 0.0), (60.0, -WIDTH / 2), (60.0, 1.5 * WIDTH)]
)
@pytest.mark.parametrize(("half", "count"), [(2.0, 1), (0.5 * SLIVER - 0.01, 0)])
def test_areas_at_every_side_of_the_own_lanes(x: float, y: float, half: float, count: int) -> None:
    """Half of a piece at an end or a side of the lanes lies on them."""
    found = conflict_areas(with_incoming(own_box(x, y, half, 300)))
    assert len(found) == count
    if count:
        own = shapely.box(-40.0, -WIDTH / 2, 160.0, 1.5 * WIDTH)
        wanted = own.intersection(shapely.box(x - half, y - half, x + half, y + half))
        assert shapely.Polygon(found[0]).symmetric_difference(wanted).area < 1e-6


def test_lanelets_of_incoming_lanes_away_from_the_own_ones_are_none() -> None:
    """Beside, before, behind; and one that only touches."""
    for x, y in ((60.0, -8.0), (60.0, 12.0), (-60.0, 0.0), (170.0, 0.0), (60.0, -3.75)):
        assert conflict_areas(with_incoming(own_box(x, y, 2.0, 300))) == []


def test_only_lanes_that_the_ego_may_use_are_its_own() -> None:
    """On an opposite lane there is none, however much it is crossed."""
    opposite = COURSE.lane("opposite", 90, -1.5 * WIDTH, -0.5 * WIDTH)
    lanes = [COURSE.lanes(left=0, right=0)[0], opposite, crossing(30.0, 4.0)]
    (area,) = conflict_areas(COURSE.scene(lanes))
    assert area[:, 1].min() == pytest.approx(-WIDTH / 2)
    right = dataclasses.replace(opposite, relation="right")
    (area,) = conflict_areas(COURSE.scene([lanes[0], right, lanes[2]]))
    assert area[:, 1].min() == pytest.approx(-1.5 * WIDTH)


def test_pieces_that_touch_are_one_area() -> None:
    (area,) = conflict_areas(with_incoming(crossing(30.0, 4.0), crossing(33.0, 2.5, 301)))
    assert (area[:, 0].min(), area[:, 0].max()) == pytest.approx((28.0, 34.25))


def test_two_lanes_that_are_slivers_only_together_are_an_area() -> None:
    """Cut pieces of one overlap are joined before slivers are dropped."""
    narrow = 0.125
    assert narrow < SLIVER < 2 * narrow
    (area,) = conflict_areas(
        with_incoming(crossing(30.0, narrow), crossing(30.0 + narrow, narrow, 301))
    )
    assert np.ptp(area[:, 0]) == pytest.approx(2 * narrow, abs=1e-6)


def test_the_ring_of_an_area_is_open() -> None:
    (area,) = conflict_areas(with_incoming(crossing(30.0, 4.0)))
    assert len({tuple(np.round(p, 6)) for p in area}) == len(area)
