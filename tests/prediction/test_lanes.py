"""Lanelets as cells: where a point is, what lies behind, progress on one scale."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from prediction.traffic import lanelet, line, straight_road
from sandra.prediction.lane_cutting import _end_direction, _scale, build_map
from sandra.prediction.lane_table import LaneTable
from sandra.scene.types import Lanelet


def lane(identifier: int, start: float, end: float, y: float = 0.0, **links: object) -> Lanelet:
    """A straight lanelet 3.5 m wide; its right border is at y."""
    return lanelet(identifier, line(y, start, end), line(y + 3.5, start, end), **links)  # type: ignore[arg-type]


def test_corners_of_a_lanelet_are_on_it() -> None:
    """Even without any tolerance: the borders belong to it."""
    found = build_map((lane(1, 0.0, 40.0, predecessors=(1,)),), 0.0)
    for x, y in ((0.0, 0.0), (0.0, 3.5), (40.0, 0.0), (40.0, 3.5), (20.0, 0.0), (20.0, 3.5)):
        (place,) = found.places(x, y, 0.0, 0.0)
        assert (place.s, place.p) == pytest.approx((x, x))
        assert place.y == pytest.approx(y - 1.75)
    for x, y in ((-1e-6, 1.0), (40.0 + 1e-6, 1.0), (20.0, -1e-6), (20.0, 3.5 + 1e-6)):
        assert found.places(x, y, 0.0, 0.0) == []
        assert len(found.places(x, y, 0.0, 1e-5)) == 1


def test_a_point_just_beside_one_lanelet_may_be_on_another() -> None:
    """The first one runs at 45 degrees; the point is within the box of one of its cells."""
    way = np.array([[0.0, 0.0], [20.0, 20.0]])
    crossing = lanelet(1, way, way + np.array([-2.5, 2.5]))
    found = build_map((crossing, lane(2, 0.0, 40.0, y=8.0)), 0.0)
    assert [place.lanelet for place in found.places(10.2, 10.3, 0.0, 0.0)] == [1, 2]
    point = np.array([10.3, 10.2])
    assert found.near(point, point).sum() >= 2
    assert [place.lanelet for place in found.places(10.3, 10.2, 0.0, 0.0)] == [2]


def test_relative_heading_is_wrapped() -> None:
    found = build_map((lane(1, 0.0, 40.0),), 0.0)
    for heading, relative in ((0.3, 0.3), (2 * np.pi - 0.3, -0.3), (-2 * np.pi + 3.0, 3.0)):
        assert found.places(10.0, 1.0, heading, 0.0)[0].relative_heading == pytest.approx(relative)


def test_a_doubled_point_of_the_map_does_no_harm() -> None:
    """A cell without length, at the beginning of a lanelet."""
    plain = lane(2, 0.0, 40.0, predecessors=(1,))
    doubled = replace(
        plain, right=np.vstack([plain.right[:1], plain.right]),
        left=np.vstack([plain.left[:1], plain.left]),
    )  # fmt: skip
    before = lane(1, -40.0, 0.0, successors=(2,))
    found = build_map((before, doubled), 0.0)
    place = next(p for p in found.places(0.0, 2.0, 0.1, 0.0) if p.lanelet == 2)
    assert (place.s, place.p, place.y) == pytest.approx((0.0, 0.0, 0.25))
    assert [x.hull.shape[1] for x in LaneTable.of(found).slices]


@pytest.mark.parametrize(
    ("ahead", "stretch"), [(0.0, 1.0), (3.5, np.sqrt(2.0)), (-3.5, np.sqrt(2.0)), (35.0, 5.0)]
)
def test_across_a_slanted_lanelet_it_is_further_but_five_times_at_most(
    ahead: float, stretch: float
) -> None:
    """The left border begins and ends further ahead than the right one, 3.5 m beside it."""
    slanted = lanelet(1, line(0.0, 0.0, 40.0), line(3.5, ahead, 40.0 + ahead))
    assert build_map((slanted,), 0.0).strips[1].stretch == pytest.approx(stretch)


def test_the_maps_own_cross_sections_are_known() -> None:
    """With and without a continuation beyond the end of the map."""
    for reach in (0.0, 30.0):
        strip = build_map((lane(1, 0.0, 60.0, predecessors=(1,)),), reach).strips[1]
        given = strip.right[strip.corners]
        ends = [[60.0 + reach, 0.0]] if reach else []
        assert given == pytest.approx(np.array([[0, 0], [20, 0], [40, 0], [60, 0], *ends]))
    strip = build_map((lane(1, 0.0, 60.0),), 0.0).strips[1]
    assert strip.right[0] == pytest.approx([-20.0, 0.0])
    assert strip.s[-1] == pytest.approx(80.0)


def test_end_direction_is_that_of_the_last_half_metre_and_more() -> None:
    """The last point is 0.5 m from the one before it, which is too near to tell."""
    right = np.array([[0.0, 0.0], [10.0, 0.0], [10.0, 0.5]])
    assert _end_direction(right, right) == pytest.approx(np.array([10.0, 0.5]) / np.hypot(10, 0.5))
    further = right + np.array([[0.0, 0.0], [0.0, 0.0], [0.0, 1e-6]])
    assert _end_direction(further, further) == pytest.approx([0.0, 1.0])


def test_lanelets_side_by_side_share_progress_where_one_is_longer() -> None:
    short = lane(2, 0.0, 40.0, 3.5, adjacent_right=(1, True), predecessors=(9,))
    for start, end in ((0.0, 40.0), (-100.0, 40.0), (0.0, 140.0), (-100.0, 140.0)):
        long = lane(1, start, end, adjacent_left=(2, True), predecessors=(9,))
        after = lane(9, 500.0, 520.0)
        for order in ((long, short), (short, long)):
            found = build_map((*order, after), 0.0)
            for x in (0.0, 0.3, 20.0, 39.9, 40.0):
                p = [each.p for each in found.places(x, 3.5, 0.0, 1e-6)]
                assert p[0] == pytest.approx(p[1], abs=0.05)
            assert found.strips[1].shared == {2}
            assert found.strips[2].shared == {1}


def test_progress_is_shared_over_a_single_cell() -> None:
    """Lanelets of one metre face each other, if only at two cross-sections."""
    links = {"predecessors": (9,), "successors": (9,)}
    one = lane(1, 0.05, 0.95, adjacent_left=(2, True), **links)
    two = lane(2, 0.0, 1.0, 3.5, adjacent_right=(1, True), **links)
    found = build_map((one, two, lane(9, 500.0, 520.0)), 0.0)
    assert [len(found.strips[i].s) for i in (1, 2)] == [2, 2]
    assert found.strips[1].shared == {2}
    first, second = (p.p for p in found.places(0.5, 3.5, 0.0, 1e-6))
    assert first == pytest.approx(second)


def test_lanelets_that_do_not_face_each_other_share_nothing() -> None:
    one = lane(1, 0.0, 40.0, adjacent_left=(2, True))
    two = lane(2, 100.0, 140.0, 3.5, adjacent_right=(1, True), predecessors=(1,))
    found = build_map((one, two), 0.0)
    assert not found.strips[1].shared
    assert found.strips[2].progress[0, 0] == pytest.approx(0.0)


def test_only_lanes_of_the_same_direction_and_known_ones_are_linked() -> None:
    one = lane(1, 0.0, 40.0, adjacent_left=(2, False), adjacent_right=(7, True), successors=(8,))
    strip = build_map((one, lane(2, 0.0, 40.0, 3.5)), 0.0).strips[1]
    assert (strip.left_id, strip.right_id, strip.successors) == (None, None, ())


def test_what_a_long_body_may_still_be_on() -> None:
    """Lanelet 22 is before 12's neighbour; each is 200 m long, and one is behind at once."""
    found = build_map(straight_road(2, 400.0), 0.0)
    assert sorted(found.behind([12], 0.0)) == [12, 22]
    assert sorted(found.behind([12], 1e-6)) == [11, 12, 21, 22]
    chain = build_map(
        (
            lane(1, 0.0, 50.0, successors=(2,)),
            lane(2, 50.0, 100.0, successors=(3,), predecessors=(1,)),
            lane(3, 100.0, 150.0, predecessors=(2,)),
        ),
        0.0,
    )
    way = 1e-6 + float(chain.strips[2].s[-1])
    assert way == pytest.approx(50.0, abs=1e-5)
    assert sorted(chain.behind([3], way)) == [1, 2, 3]
    assert sorted(chain.behind([3], 49.9)) == [2, 3]


def test_a_long_body_may_be_on_a_lanelet_behind_a_short_one() -> None:
    """What counts is the length of the lanelet between, not of the one that is come to."""
    chain = build_map(
        (
            lane(1, -300.0, -2.0, successors=(2,)),
            lane(2, -2.0, 0.0, successors=(3,), predecessors=(1,)),
            lane(3, 0.0, 150.0, predecessors=(2,)),
        ),
        0.0,
    )
    assert sorted(chain.behind([3], 5.0)) == [1, 2, 3]
    assert sorted(chain.behind([3], 1.9)) == [2, 3]


def test_reachable_lanelets() -> None:
    found = build_map(straight_road(3, oncoming=True), 0.0)
    assert sorted(found.reachable([12], False)) == [12, 22, 32]
    assert sorted(found.reachable([11], False)) == [11, 12, 21, 22, 31, 32]
    assert sorted(found.reachable([12], True)) == [11, 12, 21, 22, 31, 32]
    assert found.reachable([92], False) == [92, 91] or found.reachable([92], False) == [92]


def test_a_lanelet_between_two_cross_sections_shares_nothing() -> None:
    """None of the border's points faces it."""
    links = {"predecessors": (9,), "successors": (9,)}
    one = lane(1, 0.0, 1.0, adjacent_left=(2, True), **links)
    two = lane(2, 0.2, 0.8, 3.5, adjacent_right=(1, True), **links)
    found = build_map((one, two, lane(9, 500.0, 520.0)), 0.0)
    assert not found.strips[1].shared
    assert not found.strips[2].shared


def test_progress_that_does_not_rise_tells_nothing() -> None:
    """The scale goes through points that are more than a micrometre ahead of the one before."""
    links = {"predecessors": (9,), "successors": (9,)}
    one = lane(1, 0.0, 4.0, adjacent_left=(2, True), **links)
    two = lane(2, 0.0, 4.0, 3.5, adjacent_right=(1, True), **links)
    strips = build_map((one, two, lane(9, 500.0, 520.0)), 0.0).strips
    for second, expected in ((1e-6, 1e-6), (1.001e-6, 1.0)):
        theirs = np.array([0.0, second, 2.0, 3.0, 4.0])
        other = replace(strips[2], progress=np.column_stack([theirs, theirs]))
        scale = _scale(strips[1], other, 1)
        assert scale is not None
        assert scale(np.array([second])) == pytest.approx(expected, abs=1e-9)


def test_a_cross_section_without_width_is_upright() -> None:
    """Up to a micrometre; a wider one has its own direction, here along the road."""
    for width, across in ((1e-6, [0.0, 1.0]), (1.001e-6, [1.0, 0.0])):
        right = np.array([[0.0, 0.0], [1.0, 0.0], [2.0, 0.0]])
        left = np.array([[width, 0.0], [1.0, 3.5], [2.0, 3.5]])
        one = lanelet(1, right, right + (left - right) * [[1], [0], [0]], predecessors=(1,))
        strip = build_map((one,), 0.0).strips[1]
        assert strip.across[0] == pytest.approx(across)
