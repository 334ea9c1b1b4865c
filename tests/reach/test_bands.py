"""Lanes in the frame of the current lane, on straight roads where every number is exact."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from reach_scenes import Course, prediction
from sandra.reach.bands import (
    BORDER_MARGIN,
    BORDER_MERGE,
    Band,
    Leader,
    Stretch,
    _alike,
    _dense,
    _per_column,
    band,
    leaders,
    limits,
)
from sandra.reach.lattice import Lattice
from sandra.scene.frame import Frame
from sandra.scene.types import Region, Scene
from sandra.settings import Settings

FRAME = Frame(np.array([[0.0, 0.0], [100.0, 0.0]]))
LATTICE = Lattice(10.0, -5.0, 0.5, 0.25, 8, 40)
"""s from 10 m to 14 m."""
RADIUS = 0.75


def straight(start: float, end: float, right: float = -1.75, left: float = 1.75) -> Band:
    lines = (np.array([[start, d], [end, d]]) for d in (left, right))
    return band(FRAME, LATTICE, *lines, RADIUS)


def test_a_straight_lane_is_one_stretch_from_the_first_column_to_the_last() -> None:
    assert straight(0.0, 50.0) == (
        Stretch(
            10.0,
            14.0,
            -1.75 - BORDER_MARGIN,
            -1.75 + BORDER_MARGIN,
            1.75 - BORDER_MARGIN,
            1.75 + BORDER_MARGIN,
        ),
    )


def test_a_lane_that_passes_beside_the_lattice_has_no_stretch() -> None:
    assert straight(20.0, 50.0) == ()
    assert straight(0.0, 8.0) == ()


@pytest.mark.parametrize("beside", [0.25, 0.5, 0.7])
def test_a_lane_that_ends_before_the_lattice_is_touched_from_within(beside: float) -> None:
    """A body in the first columns reaches back to it, one in the last ones ahead to it."""
    for found, low, high in (
        (straight(0.0, 10.0 - beside), 10.0, 10.0 + RADIUS - beside),
        (straight(14.0 + beside, 50.0), 14.0 - RADIUS + beside, 14.0),
    ):
        (touched,) = found
        assert touched.s_low <= low
        assert touched.s_high >= high
        assert touched.s_high - touched.s_low <= RADIUS - beside + 1.0
        assert touched.right_low == -1.75 - BORDER_MARGIN
        assert touched.left_high == 1.75 + BORDER_MARGIN
        assert touched.right_high == np.inf


def test_a_lane_that_begins_and_ends_on_lines_of_the_lattice() -> None:
    """Both columns at its ends are all in it; the body reaches it from further columns."""
    before, within, after = straight(11.0, 13.0)
    # 0.75 m are two columns, beside those of the lane's ends and those that touch them
    assert (within.s_low, within.s_high) == (11.0, 13.0)
    assert within.right_high == -1.75 + BORDER_MARGIN
    assert within.left_low == 1.75 - BORDER_MARGIN
    assert before.s_high == 11.0
    assert before.s_low <= 10.25
    assert after.s_low == 13.0
    assert after.s_high >= 13.75
    for beside in (before, after):
        assert beside.right_low == -1.75 - BORDER_MARGIN
        assert beside.left_high == 1.75 + BORDER_MARGIN
        assert beside.right_high == np.inf
        assert beside.left_low == -np.inf


def test_a_lane_that_ends_within_a_column_does_not_fill_it() -> None:
    found = straight(11.25, 12.75)
    (within,) = (x for x in found if np.isfinite(x.right_high))
    assert (within.s_low, within.s_high) == (11.5, 12.5)


def test_an_opposite_lane_has_its_left_border_at_the_lower_d() -> None:
    (found,) = straight(50.0, 0.0, right=5.0, left=2.0)
    assert (found.right_low, found.right_high) == (2.0 - BORDER_MARGIN, 2.0 + BORDER_MARGIN)
    assert (found.left_low, found.left_high) == (5.0 - BORDER_MARGIN, 5.0 + BORDER_MARGIN)


def test_a_widening_lane_holds_its_borders_in_every_column() -> None:
    """Outer bounds hold whatever of the lane the body reaches, inner ones what all have."""
    left = np.array([[0.0, 2.0], [100.0, 22.0]])
    right = np.array([[0.0, -2.0], [100.0, -12.0]])
    lattice = Lattice(10.0, -20.0, 0.5, 0.25, 60, 200)
    found = band(FRAME, lattice, left, right, RADIUS)
    assert found[0].s_low == 10.0
    assert found[-1].s_high == 40.0
    for x, y in pairwise(found):
        assert x.s_high == y.s_low
    for x in found:
        low, high = x.s_low, x.s_high
        assert x.left_low <= 2.0 + 0.2 * low
        assert x.left_high >= 2.0 + 0.2 * min(high + RADIUS, 40.0)
        assert x.right_high >= -2.0 - 0.1 * low
        assert x.right_low <= -2.0 - 0.1 * min(high + RADIUS, 40.0)
        # and not by much more than what a column, its neighbours and the merging make
        slack = 0.2 * (RADIUS + 1.5) + BORDER_MERGE + 2 * BORDER_MARGIN
        assert x.left_high - x.left_low <= slack + 0.2 * (high - low)
        assert x.right_high - x.right_low <= slack + 0.1 * (high - low)
        assert x.left_high <= 2.0 + 0.2 * (high + RADIUS + 0.5) + BORDER_MERGE


def test_stretches_are_merged_up_to_half_the_tolerance_from_the_first() -> None:
    rows = np.zeros((3, 4))
    for column in range(4):
        rows[:, column] = [0.0, BORDER_MERGE / 2, -BORDER_MERGE / 2]
        assert _alike(rows).all()
    rows[2, 1] = -BORDER_MERGE / 2 - 1e-9
    assert not _alike(rows).all()
    rows[:, 1] = [0.0, 0.0, np.inf]
    assert not _alike(rows).all()
    rows[:, 1] = np.inf
    assert _alike(rows).all()
    rows[:, 1] = -np.inf
    assert _alike(rows).all()


# ------------------------------------------------------------------ vehicles in lanes


def scene_with(*cars: tuple[str, float, float, float]) -> Scene:
    course = Course()
    some = [course.car(i, s, d, v, kind=kind) for i, (kind, s, d, v) in enumerate(cars, start=2)]
    return course.scene(course.lanes(right=0), some)


def moving(scene: Scene, d: dict[int, list[float]], dt: float = 0.1) -> dict[int, np.ndarray]:
    """Paths of cars at 1 m/s per step that are at given d."""
    found = {}
    for car in scene.obstacles:
        if car.id in d:
            n = len(d[car.id])
            path = np.zeros((n, 5))
            path[:, 0] = car.state.x + np.arange(n)
            path[:, 1] = d[car.id]
            path[:, 3] = car.state.speed
            found[car.id] = path
    return found


def led(scene: Scene, paths: dict[int, np.ndarray], h: int, **changes: object):
    settings = Settings().replace(**changes)
    return leaders(scene, prediction(scene, h, paths), settings, scene.lanes)


def test_leaders_are_told_from_near_to_far_with_rear_end_and_speed() -> None:
    scene = scene_with(("car", 30.0, 0.0, 7.0), ("truck", 10.0, 0.5, 3.0), ("car", 20.0, 3.5, 5.0))
    current, left = led(scene, {}, 2)
    # s = 40 m at x = 0; cars are 4.5 m long
    assert current == (((Leader(47.75, 3.0), Leader(67.75, 7.0))),) * 3
    assert left == ((Leader(57.75, 5.0),),) * 3


@pytest.mark.parametrize("speeds", [(7.0, 3.0), (3.0, 7.0)])
def test_of_two_side_by_side_the_slower_one_precedes(speeds: tuple[float, float]) -> None:
    scene = scene_with(("car", 30.0, 1.0, speeds[0]), ("car", 30.0, -1.0, speeds[1]))
    (step,) = led(scene, {}, 0)[0]
    assert [leader.speed for leader in step] == [3.0, 7.0]


@pytest.mark.parametrize("kind", ["pedestrian", "trafficIsland", "building", "pillar"])
def test_what_is_no_vehicle_precedes_nobody(kind: str) -> None:
    scene = scene_with((kind, 30.0, 0.0, 1.0), ("bicycle", 20.0, 0.0, 1.0))
    current, _ = led(scene, {}, 0)
    assert current == ((Leader(57.75, 1.0),),)


def test_a_leader_that_drives_away_and_one_that_comes() -> None:
    """Speeds are those along the lane, and never negative."""
    course = Course()
    cars = [
        course.car(2, 10.0, 0.0, 8.0, angle=np.pi / 3),
        course.car(3, 30.0, 0.0, 8.0, angle=np.pi),
    ]
    scene = course.scene(course.lanes(left=0, right=0), cars)
    ((first, second),) = led(scene, {}, 0)[0]
    assert first.speed == pytest.approx(4.0)
    assert second.speed == 0.0
    assert second.rear == pytest.approx(67.75)
    # the rear end of a body across the lane is its nearest corner
    assert first.rear == pytest.approx(50.0 - 2.25 * 0.5 - 0.9 * np.sin(np.pi / 3))


def test_one_that_is_not_predicted_at_a_step_is_not_there() -> None:
    scene = scene_with(("car", 10.0, 0.0, 5.0))
    path = moving(scene, {2: [0.0, 0.0, 0.0]})[2]
    path[1] = np.nan
    assert [len(step) for step in led(scene, {2: path}, 2)[0]] == [1, 0, 1]
    path[:] = np.nan
    assert [len(step) for step in led(scene, {2: path}, 2)[0]] == [0, 0, 0]


def test_the_exception_for_those_that_cut_in_ends_after_t_c() -> None:
    """In the lane from step 2 on: not asked at steps 2, 3 and 4, asked from step 5 on."""
    scene = scene_with(("car", 10.0, 3.5, 5.0))
    paths = moving(scene, {2: [3.5, 3.5, *[0.0] * 6]})
    exempt = led(scene, paths, 7, cut_in_exception=True, t_c=0.3)[0]
    assert exempt[:2] == ((), ())
    assert [step[0].speed for step in exempt[2:]] == [np.inf, np.inf, np.inf, 5.0, 5.0, 5.0]
    always = led(scene, paths, 7, cut_in_exception=False, t_c=0.3)[0]
    assert [step[0].speed for step in always[2:]] == [5.0] * 6


def test_one_that_was_in_the_lane_from_the_start_has_not_cut_in() -> None:
    """Not even where it leaves the lane later, or has left and comes back."""
    scene = scene_with(("car", 10.0, 0.0, 5.0))
    paths = moving(scene, {2: [0.0, 0.0, 3.5, 0.0, 0.0, 0.0, 0.0, 3.5]})
    found = led(scene, paths, 7, cut_in_exception=True, t_c=0.3)[0]
    assert [[x.speed for x in step] for step in found] == [
        [5.0],
        [5.0],
        [],
        [np.inf],
        [np.inf],
        [np.inf],
        [5.0],
        [],
    ]


def test_a_widened_outline_reaches_the_lane_and_counts_to_its_rear() -> None:
    course = Course()
    disc = Region.disc(0.5)
    for d, there in ((2.25, True), (2.2501, False), (-2.25, True), (-2.2501, False)):
        cars = [course.car(2, 10.0, d, 4.0, outline=disc)]
        scene = course.scene(course.lanes(left=0, right=0), cars)
        assert led(scene, {}, 0)[0] == (((Leader(49.5, 4.0),),) if there else ((),))


# ------------------------------------------------------------------ limits


def limited(*parts: tuple[float, float, float | None], number: int = 1):
    """A lane of lanelets of its own, one after the other, with their limits."""
    course = Course()
    found = [
        course.lane("current", 10 * number + i, -1.75, 1.75, start, end, limit)
        for i, (start, end, limit) in enumerate(parts)
    ]
    lane = replace(
        found[0],
        lanelets=tuple(x.lanelets[0] for x in found),
        speed_limits=tuple(limit for *_, limit in parts),
    )
    return lane, found


def limits_of(*lanes: list[tuple[float, float, float | None]]):
    course = Course()
    made = [limited(*parts, number=i) for i, parts in enumerate(lanes, start=1)]
    reference = course.lane("current", 100, -1.75, 1.75, start=0.0, end=100.0)
    more = [x for _, found in made for x in found]
    scene = course.scene([reference], more_lanelets=more)
    return limits(scene, tuple(lane for lane, _ in made))


def test_limits_change_where_lanelets_do() -> None:
    assert limits_of([(0.0, 50.0, 10.0), (50.0, 80.0, 20.0), (80.0, 100.0, 20.0)]) == (
        (-np.inf, 0.0, None, None),
        (0.0, 50.0, 10.0, 10.0),
        (50.0, 100.0, 20.0, 20.0),
        (100.0, np.inf, None, None),
    )


def test_limits_of_several_lanes_are_a_range_and_unknown_where_one_is() -> None:
    found = limits_of(
        [(0.0, 100.0, 10.0)], [(0.0, 50.0, 20.0), (50.0, 100.0, None)], [(0.0, 100.0, 15.0)]
    )
    assert found == (
        (-np.inf, 0.0, None, None),
        (0.0, 50.0, 10.0, 20.0),
        (50.0, np.inf, None, None),
    )
    assert limits_of() == ((-np.inf, np.inf, None, None),)


def test_lanelets_that_end_within_a_micrometre_end_together() -> None:
    """Between their ends both count; a slit below a nanometre is no part of its own."""
    micro, nano = 1e-6, 1e-9
    found = limits_of([(0.0, 100.0, 10.0)], [(micro, 100.0, 20.0)])
    assert found[1] == (0.0, 100.0, 10.0, 20.0)
    late = 2e-6
    found = limits_of([(0.0, 100.0, 10.0)], [(late, 100.0, 20.0)])
    assert found[1:3] == ((0.0, late, 10.0, 10.0), (late, 100.0, 10.0, 20.0))
    early = 50.0 - micro
    found = limits_of([(0.0, 50.0, 10.0)], [(0.0, early, 20.0)])
    assert found[1] == (0.0, 50.0, 10.0, 20.0)
    found = limits_of([(0.0, 50.0, 10.0)], [(0.0, 50.0 - 2e-6, 20.0)])
    assert found[1][1] == 50.0 - 2e-6
    found = limits_of([(0.0, 100.0, 10.0)], [(nano, 100.0, 20.0)])
    assert found[1] == (nano, 100.0, 10.0, 20.0)


@pytest.mark.parametrize(("d", "stretched"), [(0.0, 1.0), (10.0, 1 / 0.6), (-10.0, 1 / 0.6)])
def test_on_the_inside_of_a_bend_the_body_reaches_further_along_the_lane(
    d: float, stretched: float
) -> None:
    """2 m of body are 3.3 m of the reference line, 10 m to the inside of a bend of 25 m."""
    course = Course(0.04 if d >= 0.0 else -0.04, step=0.25)
    frame = course.lane("current", 1, -1.75, 1.75, start=0.0, end=80.0).frame
    lane = course.lane("left", 2, d, d, start=40.0, end=50.0)
    found = band(frame, Lattice(20.0, -20.0, 0.5, 0.25, 100, 160), lane.left, lane.right, 2.0)
    assert 40.0 - 2.0 * stretched - 1.05 <= found[0].s_low <= 40.0 - 2.0 * stretched + 0.05
    assert 50.0 + 2.0 * stretched - 0.05 <= found[-1].s_high <= 50.0 + 2.0 * stretched + 1.05


def test_near_the_centre_of_a_bend_the_body_reaches_five_times_as_far() -> None:
    course = Course(0.04, step=0.25)
    frame = course.lane("current", 1, -1.75, 1.75, start=0.0, end=80.0).frame
    lane = course.lane("left", 2, 22.0, 22.0, start=40.0, end=50.0)
    found = band(frame, Lattice(20.0, -20.0, 0.5, 0.25, 100, 160), lane.left, lane.right, 2.0)
    assert 40.0 - 10.0 - 1.05 <= found[0].s_low <= 40.0 - 10.0 + 0.05


def test_the_body_reaches_from_the_first_column_to_the_last() -> None:
    lattice = Lattice(10.0, -5.0, 0.5, 0.25, 3, 40)
    for start, end in ((10.1, 10.2), (11.3, 11.4)):
        lines = (np.array([[start, d], [end, d]]) for d in (1.75, -1.75))
        found = band(FRAME, lattice, *lines, 2.0)
        assert (found[0].s_low, found[-1].s_high) == (10.0, 11.5)


def test_edges_that_just_may_come_near_are_read() -> None:
    """From 3 m to 5 m away: no further than its length from 1 m."""
    edge = np.array([[3.0, 0.0], [5.0, 0.0]])
    for way in (edge, edge[::-1], edge[:, ::-1]):
        points, joined, line = _dense([way], np.zeros(2), 1.0)
        assert points.shape == (9, 2)
        assert joined.all()
        assert not line.any()
        assert len(_dense([way], np.zeros(2), 1.0 - 2.0**-40)[0]) == 0


@pytest.mark.parametrize("turn", [0.0, 1.2])
def test_of_a_border_of_many_kilometres_only_what_is_near_is_read(turn: float) -> None:
    """The same pieces as of borders that are cut at each metre, and few of them."""
    c, s = np.cos(turn), np.sin(turn)
    ends = np.array([[-3000.0, 2.0], [4000.0, 2.0]]) @ np.array([[c, s], [-s, c]])
    fine = np.column_stack([np.linspace(*ends[:, i], 7001) for i in (0, 1)])
    middle = np.array([5.0, 1.0])
    for way in (ends, ends[::-1]):
        points, joined, line = _dense([way, fine[3000:3010]], middle, 30.0)
        assert len(points) < 300
        assert joined.sum() == len(points) - 2
        pieces = np.diff(points, axis=0)[joined & (line[:-1] == 0)]
        step = (way[1] - way[0]) / 28000
        assert pieces == pytest.approx(np.tile(step, (len(pieces), 1)), abs=1e-4)
        near, _, _ = _dense([fine if way is ends else fine[::-1]], middle, 30.0)
        held = np.hypot(*(near - middle).T) <= 30.0
        gaps = np.abs(near[held][:, None] - points[None]).sum(axis=2).min(axis=1)
        assert gaps.max() < 0.15
    # where it ends, no more than its last piece; up to 100 m it is read whole
    for length, count in ((200.0, 2), (100.25, 2), (100.0, 401)):
        end = np.array([length, 0.0])
        points, _, _ = _dense([np.array([np.zeros(2), end])], end, 0.1)
        assert points[-2:].tolist() == [[length - 0.25, 0.0], [length, 0.0]]
        assert len(points) == count


def test_borders_are_read_as_far_as_a_body_anywhere_in_the_lattice_reaches() -> None:
    """From its outermost lines on either side, however coarse it is and however long the body."""
    s = np.arange(5.0, 20.0)
    for rows, height, radius, lane in ((1, 40.0, 0.75, 18.0), (40, 0.25, 20.0, 22.0)):
        lattice = Lattice(10.0, -rows * height / 2, 0.5, height, 8, rows)
        for sign in (-1.0, 1.0):
            d = sorted((sign * lane, sign * (lane + 1.0)))
            left, right = (np.column_stack([s, np.full_like(s, x)]) for x in d[::-1])
            (found,) = band(FRAME, lattice, left, right, radius)
            assert (found.s_low, found.s_high) == (10.0, 14.0)
            assert (found.right_low, found.left_high) == (
                d[0] - BORDER_MARGIN,
                d[1] + BORDER_MARGIN,
            )


def test_pieces_of_a_border_count_in_each_column_they_pass() -> None:
    """Columns of 1 m from 0 m to 3 m; what begins on a line is not in the column before it."""
    lines = np.arange(4.0)
    for (a, b), columns in (
        ((0.25, 0.75), [0]),
        ((2.25, 2.75), [2]),
        ((1.0, 2.0), [1]),
        ((-0.5, 0.5), [0]),
        ((2.5, 3.5), [2]),
        ((0.5, 2.5), [0, 1, 2]),
        ((-0.75, -0.25), []),
        ((3.25, 3.75), []),
    ):
        for start, end in (((a, 5.0), (b, 6.0)), ((b, 6.0), (a, 5.0))):
            low, high = _per_column(np.array([start]), np.array([end]), lines)
            assert np.flatnonzero(np.isfinite(low)).tolist() == columns
            assert np.flatnonzero(np.isfinite(high)).tolist() == columns
            assert set(low[columns]) <= {5.0}
            assert set(high[columns]) <= {6.0}
