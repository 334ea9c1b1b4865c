"""The initial set and the lattice around all that can be reached from it."""

from dataclasses import replace

import numpy as np
import pytest

from reach_scenes import Course
from sandra.planning.single_track import step
from sandra.reach.initial import LATERAL_REACH, _borders_between, _box, initial_set, lattice_of
from sandra.settings import Settings


@pytest.mark.parametrize(
    ("widened", "expected"),
    [
        ((0.0, 0.0), [(1.0, 5.0)]),
        ((0.5, 0.0), [(0.5, 5.0), (1.5, 5.0)]),
        ((0.0, 2.0), [(1.0, 3.0), (1.0, 7.0)]),
        ((0.5, 2.0), [(0.5, 3.0), (1.5, 3.0), (1.5, 7.0), (0.5, 7.0)]),
    ],
)
def test_a_state_is_widened_to_a_box(
    widened: tuple[float, float], expected: list[tuple[float, float]]
) -> None:
    assert _box(1.0, 5.0, *widened) == expected


def test_the_state_along_and_across_the_lane() -> None:
    scene = Course().scene(d=0.5, angle=0.25, speed=8.0)
    lon, lat = initial_set(scene, Settings(s_uncertainty=0.25, v_uncertainty=0.125))
    v_s, v_d = 8.0 * np.cos(0.25), 8.0 * np.sin(0.25)
    assert lon[0] == pytest.approx((40.0 - 0.25, v_s - 0.125))
    assert lon[2] == pytest.approx((40.0 + 0.25, v_s + 0.125))
    assert lat[0] == pytest.approx((0.5 - 0.25, v_d - 0.125))
    assert lat[2] == pytest.approx((0.5 + 0.25, v_d + 0.125))


def test_a_body_that_steers_moves_along_heading_and_slip() -> None:
    """As the single-track model of the witness has it; a step later it is where the set says."""
    scene = Course().scene(d=0.5, angle=0.1, speed=12.0)
    steering = replace(scene.ego.state, steering_angle=0.08)
    scene = replace(scene, ego=replace(scene.ego, state=steering))
    (_, (_, v_d)) = ((0, 0), initial_set(scene, Settings())[1][0])
    state = np.array([steering.x, steering.y, steering.heading, 12.0, 0.08])
    after = step(state, np.zeros(2), 1e-4, scene.ego.wheelbase)
    d = scene.frame.to_curvilinear(np.array([state[:2], after[:2]]))[:, 1]
    assert v_d == pytest.approx((d[1] - d[0]) / 1e-4, rel=1e-3)
    assert abs(v_d - 12.0 * np.sin(0.1)) > 0.3


def s_range(speed: float, horizon: int, dt: float, **changes: float) -> tuple[float, float]:
    """Ends of the lattice along the lane, relative to the ego, with cells of 1 cm."""
    settings = Settings(cell_s=0.01, cell_d=0.5).replace(**changes)
    scene = Course().scene(speed=speed, dt=dt)
    lattice = lattice_of(scene, horizon, *initial_set(scene, settings), settings)
    low, high, *_ = lattice.bounds((0, lattice.columns, 0, lattice.rows))
    return low - 40.0, high - 40.0


@pytest.mark.parametrize(
    ("speed", "farthest"),
    [
        (10.0, 10.0 * 2.0 + 6.0 * 2.0),  # never at the highest speed for as long as it takes
        (25.0, 30.0 * 2.0),
        (30.0, 30.0 * 2.0),
        (33.0, 33.0 * 2.0),  # beyond the highest speed: it only has to cover the start
        (0.0, 6.0 * 2.0),
    ],
)
def test_the_lattice_holds_all_that_is_within_reach_along_the_lane(
    speed: float, farthest: float
) -> None:
    """A metre more on both ends, and a quarter of a dt^2 for each of the 10 steps."""
    swing = 10 * 6.0 * 0.2**2 / 4
    low, high = s_range(speed, 10, 0.2)
    assert low == pytest.approx(-swing - 1.0, abs=0.011)
    assert high == pytest.approx(farthest + swing + 1.0, abs=0.011)
    low, _ = s_range(speed, 10, 0.2, a_lon_min=-8.0)
    assert low == pytest.approx(-swing * 8 / 6 - 1.0, abs=0.011)


def test_the_lattice_goes_as_far_as_the_road_or_the_car_does() -> None:
    course = Course()

    def rows(horizon: int, d: float = 0.0, angle: float = 0.0, **lanes: int) -> tuple:
        settings = Settings(cell_d=0.01)
        scene = course.scene(course.lanes(**lanes), d=d, angle=angle, speed=8.0)
        lattice = lattice_of(scene, horizon, *initial_set(scene, settings), settings)
        return lattice.bounds((0, lattice.columns, 0, lattice.rows))[2:]

    # within 0.4 s: 4 m/s^2 * 0.4^2 / 2 = 0.32 m
    assert rows(4) == pytest.approx((-0.32, 0.32), abs=0.011)
    # within 3 s: 18 m, more than the road has; the ego may be off the road as well
    assert rows(30) == pytest.approx((-5.25 - LATERAL_REACH, 5.25 + LATERAL_REACH), abs=0.011)
    assert rows(30, left=0) == pytest.approx(
        (-5.25 - LATERAL_REACH, 1.75 + LATERAL_REACH), abs=0.011
    )
    assert rows(30, left=0, d=3.0) == pytest.approx(
        (-5.25 - LATERAL_REACH, 3.0 + LATERAL_REACH), abs=0.011
    )
    assert rows(30, right=0, d=-3.0) == pytest.approx(
        (-3.0 - LATERAL_REACH, 5.25 + LATERAL_REACH), abs=0.011
    )
    # on its way to one side it reaches less far on the other one
    aside = 8.0 * np.sin(0.25) * 0.4
    low, high = rows(4, angle=0.25)
    assert high == pytest.approx(aside + 0.32, abs=0.011)
    assert low <= -0.32 + aside


def test_borders_within_a_range_belong_to_it_with_its_ends() -> None:
    """Lines of lanes have a point each metre, of which those at s = 45 m and 46 m count."""
    scene = Course().scene(Course().lanes(left=0, right=0))
    assert sorted(_borders_between(scene, (45.0, 46.0), 8.0)) == [-1.75, -1.75, 1.75, 1.75]
    assert sorted(_borders_between(scene, (45.25, 45.75), 8.0)) == []
    assert _borders_between(scene, (1000.0, 1001.0), 8.0).size == 0


def test_long_lines_are_read_each_metre() -> None:
    coarse = Course(step=100.0)
    scene = coarse.scene(coarse.lanes(left=0, right=0))
    assert sorted(_borders_between(scene, (45.0, 46.0), 8.0)) == [-1.75, -1.75, 1.75, 1.75]
    # up to their last one, and not only from corner to corner
    short = coarse.lane("none", 110, 5.0, 6.0, start=4.0, end=7.0)
    scene = coarse.scene(coarse.lanes(left=0, right=0), more_lanelets=[short])
    for s in (44.0, 45.0, 46.0, 47.0):
        assert sorted(_borders_between(scene, (s, s), 8.0)) == [-1.75, 1.75, 5.0, 6.0]


def test_of_a_line_of_many_kilometres_the_same_metres_count() -> None:
    fine, coarse = Course(), Course(step=100.0)
    lane = coarse.lane("current", 100, -1.75, 1.75, start=-4000.0, end=6000.0)
    long = coarse.scene((lane,))
    same = fine.scene((fine.lane("current", 100, -1.75, 1.75, start=-100.0, end=200.0),))
    middle = np.array([long.ego.state.x, long.ego.state.y])
    for scene in (long, same):
        assert len(scene.lanelets) == 1
    whole = replace(long.lanelets[0], left=lane.left[[0, -1]], right=lane.right[[0, -1]])
    s = float(long.frame.to_curvilinear(middle[None])[0, 0])
    t = float(same.frame.to_curvilinear(middle[None])[0, 0])
    one = _borders_between(replace(long, lanelets=(whole,)), (s - 9.5, s + 30.5), 8.0)
    other = _borders_between(same, (t - 9.5, t + 30.5), 8.0)
    assert sorted(one) == pytest.approx(sorted(other))
    assert len(one) > 60


def test_borders_far_away_are_left_out_however_long_their_parts_are() -> None:
    course = Course(step=100.0)
    beside = course.lane("none", 110, 5.0, 20.0)
    far = course.lane("none", 111, 300.0, 303.0)
    scene = course.scene(course.lanes(left=0, right=0), more_lanelets=[beside, far])
    assert set(_borders_between(scene, (40.0, 60.0), 25.0)) == {-1.75, 1.75, 5.0, 20.0}
    assert set(_borders_between(scene, (40.0, 42.0), 2.0)) == {-1.75, 1.75, 5.0}


def test_without_any_lanelet_there_is_no_border() -> None:
    scene = replace(Course().scene(), lanelets=())
    assert _borders_between(scene, (40.0, 60.0), 25.0).shape == (0,)


def test_borders_around_an_ego_that_is_not_at_the_origin() -> None:
    """Distances are measured from the ego, wherever the map puts its origin."""
    scene = Course().scene(Course().lanes(left=0, right=0))
    moved = replace(scene, ego=replace(scene.ego, state=replace(scene.ego.state, x=60.0)))
    assert sorted(_borders_between(moved, (100.0, 101.0), 8.0)) == [-1.75, -1.75, 1.75, 1.75]
    assert _borders_between(moved, (45.0, 46.0), 8.0).size == 0


def test_a_road_that_is_far_away_leaves_all_that_is_within_reach() -> None:
    """The road ends 160 m ahead, the ego is 240 m beyond that."""
    scene = Course().scene(speed=8.0)
    scene = replace(scene, ego=replace(scene.ego, state=replace(scene.ego.state, x=400.0)))
    assert _borders_between(scene, (439.0, 445.0), 2.0).size == 0
    settings = Settings(cell_d=0.01)
    lattice = lattice_of(scene, 4, *initial_set(scene, settings), settings)
    low, high = lattice.bounds((0, lattice.columns, 0, lattice.rows))[2:]
    assert (low, high) == pytest.approx((-0.32, 0.32), abs=0.011)
