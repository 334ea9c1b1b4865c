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
