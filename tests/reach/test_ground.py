"""Forbidden cells: only where the body collides for sure, by exact geometry."""

from dataclasses import replace

import numpy as np
import pytest
import shapely

from reach_particles import road, shape
from reach_scenes import Course, prediction
from sandra.logic import Predicate
from sandra.reach import Ground, ground
from sandra.reach.regions import answers_of
from sandra.scene.frame import Frame
from sandra.scene.types import Region
from sandra.settings import Settings


def crowded(course: Course, horizon: int = 25) -> Ground:
    """Cars, a pedestrian and a capsule on a bent road, at odd angles."""
    rng = np.random.default_rng(5)
    outlines = [Region.rectangle(4.5, 1.8), Region.disc(0.4), Region.rectangle(12.0, 2.5)]
    outlines.append(Region(np.array([[-1.0, 0.0], [1.0, 0.0]]), 0.5))
    cars = [
        course.car(
            i + 2,
            float(rng.uniform(5.0, 60.0)),
            float(rng.uniform(-6.0, 6.0)),
            angle=float(rng.uniform(-1.0, 1.0)),
            outline=outlines[i % len(outlines)],
        )
        for i in range(12)
    ]
    scene = course.scene(obstacles=cars, speed=15.0)
    return ground(scene, prediction(scene, horizon), Settings(horizon=horizon))


COURSES = [
    Course(),
    Course(angle=0.7, step=10.0),
    Course(1 / 25),
    Course(-1 / 15, step=2.0),
    Course(1 / 25, step=6.0),
    Course(-1 / 20, step=9.0),
]


@pytest.mark.parametrize("course", COURSES)
def test_cells_forbidden_by_obstacles_collide_for_sure(course: Course) -> None:
    """Any point of such a cell is nearer to the body than the inscribed disc's radius."""
    base = crowded(course)
    rng = np.random.default_rng(1)
    radius = base.scene.ego.width / 2
    seen = 0
    for obstacle, steps in zip(base.prediction.obstacles, base.by_obstacle, strict=True):
        body = shapely.MultiPoint(obstacle.at[0][0].vertices).convex_hull
        for i0, _, j0, _, mask in steps[0]:
            cells = np.argwhere(mask) + np.array([i0, j0])
            inside = rng.uniform(0.0, 1.0, (40, len(cells), 2))
            # corners and edges too, and what lies next to the corners of the reference line
            inside[:16] = np.round(inside[:16])
            inside[16:32, :, 1] = np.round(inside[16:32, :, 1])
            at = (cells + inside).reshape(-1, 2) * [base.lattice.ds, base.lattice.dd]
            points = base.scene.frame.to_cartesian(
                at + np.array([base.lattice.s0, base.lattice.d0])
            )
            away = shapely.distance(body, shapely.points(points)) - obstacle.at[0][0].radius
            assert away.max() <= radius + 1e-9
            seen += len(cells)
    assert seen > 200


@pytest.mark.parametrize("step", [5.0, 8.0])
def test_cells_bulge_where_the_reference_line_has_a_corner(step: float) -> None:
    """Long cells over corners of 0.25 rad: their image is not the hull of its four corners."""
    course = Course(-0.25 / step, step)
    rng = np.random.default_rng(8)
    slab = Region.rectangle(14.0, 1.0)
    stones = [
        course.car(i, s, d, angle=angle, outline=slab)
        for i, (s, d, angle) in enumerate(
            rng.uniform([3.0, -5.0, -0.1], [45.0, 5.0, 0.1], (200, 3)), start=2
        )
    ]
    scene = course.scene(obstacles=stones, speed=15.0)
    base = ground(scene, prediction(scene, 25), Settings(horizon=25, cell_s=2.0, cell_d=0.4))
    radius = scene.ego.width / 2
    lattice = base.lattice
    marks = scene.frame.stations
    worst = -np.inf
    for obstacle, steps in zip(base.prediction.obstacles, base.by_obstacle, strict=True):
        region = obstacle.at[0][0]
        for i0, _, j0, _, mask in steps[0]:
            for i, j in np.argwhere(mask) + np.array([i0, j0]):
                low, high, down, up = lattice.bounds((i, i + 1, j, j + 1))
                s = marks[(marks >= low) & (marks <= high)]
                at = np.array([(x, d) for x in [*s, low, high] for d in (down, up)])
                xy = scene.frame.to_cartesian(at)
                away = shapely.distance(shapely.Polygon(region.vertices), shapely.points(xy))
                worst = max(worst, float(away.max()))
    assert worst <= radius + 1e-9


@pytest.mark.parametrize("course", COURSES)
def test_cells_off_the_road_cross_its_border_for_sure(course: Course) -> None:
    base = crowded(course)
    rng = np.random.default_rng(2)
    lattice = base.lattice
    free = road(base)
    cells = np.argwhere(base.off_road)
    assert len(cells) > 50
    inside = np.round(rng.uniform(0.0, 1.0, (6, len(cells), 2)), 1)
    at = (cells + inside).reshape(-1, 2) * [lattice.ds, lattice.dd] + [lattice.s0, lattice.d0]
    points = shapely.points(base.scene.frame.to_cartesian(at))
    outside = ~shapely.covers(free, points)
    to_border = shapely.distance(free.boundary, points)
    # 0.1 m: slits between lanelets up to twice that are closed, corners are rounded by it
    assert (outside | (to_border <= base.scene.ego.width / 2 + 1e-6)).all()


def test_most_of_what_collides_is_forbidden() -> None:
    """Not only sound: on a straight road the forbidden cells fill the occupied ones."""
    course = Course()
    scene = course.scene(obstacles=[course.car(2, 20.0, 0.0)], speed=10.0)
    base = ground(scene, prediction(scene, 20), Settings(horizon=20))
    ((i0, i1, j0, j1, mask),) = base.by_obstacle[0][0]
    assert base.forbidden[0][i0:i1, j0:j1][mask].all()
    body = shape(base.prediction.obstacles[0].at[0][0]).buffer(0.9)
    area = mask.sum() * base.lattice.ds * base.lattice.dd
    assert 0.75 * body.area < area <= body.area


def test_leaving_a_cause_out() -> None:
    base = crowded(Course())
    alone = next(i for i, steps in enumerate(base.by_obstacle) if steps[0])
    without = base.forbidden_without(alone)
    assert (without[0] <= base.forbidden[0]).all()
    assert without[0].sum() < base.forbidden[0].sum()
    assert (base.forbidden_without(None)[0] == base.forbidden[0]).all()
    assert not (base.forbidden_without(None, road=False)[0] == base.forbidden[0]).all()
    index = next(i for i, steps in enumerate(base.by_obstacle) if i > alone and steps[0])
    ((i0, i1, j0, j1, mask),) = base.by_obstacle[index][0]
    cells = np.zeros_like(base.off_road)
    cells[i0:i1, j0:j1] = mask
    assert index in base.obstacles_at(0, cells)
    assert base.obstacles_at(0, np.zeros_like(cells)) == []
    with pytest.raises(ValueError, match="read-only"):
        base.forbidden[0][0, 0] = True


def test_initial_state_and_its_uncertainty() -> None:
    course = Course(1 / 25)
    scene = course.scene(d=1.0, angle=0.1, speed=10.0)
    exact = ground(scene, prediction(scene, 3), Settings(horizon=3))
    ((s, v_s),) = exact.lon
    ((d, v_d),) = exact.lat
    assert d == pytest.approx(1.0, abs=0.02)
    # the speed along the reference line is larger on the inside of the bend
    assert v_s == pytest.approx(10.0 * np.cos(0.1) / (1.0 - 1.0 / 25), rel=1e-3)
    assert v_d == pytest.approx(10.0 * np.sin(0.1), rel=1e-2)
    wide = ground(
        scene, prediction(scene, 3), Settings(horizon=3, s_uncertainty=0.3, v_uncertainty=0.2)
    )
    assert np.ptp(np.array(wide.lon), axis=0) == pytest.approx([0.6, 0.4])
    assert np.mean(np.array(wide.lat), axis=0) == pytest.approx([d, v_d])
    assert s == pytest.approx(np.mean(np.array(wide.lon)[:, 0]))


def test_forbidden_are_exactly_the_cells_with_all_corners_within_reach() -> None:
    """On a straight road cells do not bulge; the disc's radius is half the ego's width."""
    course = Course()
    scene = course.scene(obstacles=[course.car(2, 20.0, 0.7, angle=0.4)], speed=10.0)
    base = ground(scene, prediction(scene, 20), Settings(horizon=20))
    corners = base.scene.frame.to_cartesian(
        np.stack(np.meshgrid(*base.lattice.corners(), indexing="ij"), axis=-1).reshape(-1, 2)
    )
    body = shapely.Polygon(base.prediction.obstacles[0].at[0][0].vertices)
    away = shapely.distance(body, shapely.points(corners))
    away = away.reshape(base.lattice.columns + 1, base.lattice.rows + 1)
    farthest = np.maximum(
        np.maximum(away[1:, 1:], away[1:, :-1]), np.maximum(away[:-1, 1:], away[:-1, :-1])
    )
    got = np.zeros_like(base.off_road)
    ((i0, i1, j0, j1, mask),) = base.by_obstacle[0][0]
    got[i0:i1, j0:j1] = mask
    assert (got == (farthest <= 0.9 - 1e-6)).all()


def test_obstacles_are_told_by_the_number_of_cells() -> None:
    course = Course()
    outlines = Region.disc(0.5), Region.rectangle(12.0, 2.5), Region.rectangle(4.5, 1.8)
    cars = [
        course.car(i, 20.0, 0.0, outline=outline) for i, outline in enumerate(outlines, start=2)
    ]
    scene = course.scene(obstacles=[*cars, course.car(9, 30.0, 3.5)], speed=10.0)
    base = ground(scene, prediction(scene, 25), Settings(horizon=25))
    everything = np.ones_like(base.off_road)
    assert base.obstacles_at(3, everything) in ([1, 2, 3, 0], [1, 3, 2, 0])
    # only cells that are asked for count
    ((i0, i1, j0, j1, mask),) = base.by_obstacle[0][3]
    few = np.zeros_like(everything)
    few[i0:i1, j0:j1] = mask
    assert base.obstacles_at(3, few)[0] in (0, 1, 2)
    assert sorted(base.obstacles_at(3, few)) == [0, 1, 2]


def test_curvature_of_a_column_is_that_within_it() -> None:
    """A road that bends more and more: lowest and highest at the ends of each column."""
    s = np.linspace(0.0, 120.0, 121)
    heading = 0.0002 * s**2
    line = np.cumsum(np.column_stack([np.cos(heading), np.sin(heading)]), axis=0)
    course = Course()
    lanes = tuple(
        replace(lane, frame=Frame(line - line[40])) if lane.relation == "current" else lane
        for lane in course.lanes()
    )
    base = ground(course.scene(lanes), prediction(course.scene(lanes), 5), Settings(horizon=5))
    frame, lines = base.scene.frame, base.lattice.corners()[0]
    ends = frame.curvature(lines)
    low, high = base.curvature
    assert low == pytest.approx(np.minimum(ends[:-1], ends[1:]), abs=2e-4)
    assert high == pytest.approx(np.maximum(ends[:-1], ends[1:]), abs=2e-4)
    assert (low <= np.minimum(ends[:-1], ends[1:])).all()
    assert (high >= np.maximum(ends[:-1], ends[1:])).all()
    assert np.ptp(ends) > 3e-3


def test_a_lane_that_begins_ahead_is_felt_half_a_diagonal_before() -> None:
    """The body reaches 2.42 m from its centre; lanes are read by columns of 0.5 m."""
    course = Course()
    lanes = [course.lane("current", 100, -1.75, 1.75), course.lane("left", 101, 1.75, 5.25, 8.0)]
    base = ground(course.scene(lanes), prediction(course.scene(lanes), 20), Settings(horizon=20))
    (_, (own, *others)), (_, left) = base.bands
    assert others == []
    assert own.s_low == base.lattice.s0
    reach = float(np.hypot(4.5, 1.8)) / 2
    assert 48.0 - reach - 1.05 <= left[0].s_low <= 48.0 - reach
    # the same of single lanelets
    (answer,) = answers_of(base, (Predicate("in_lanelet", "101"),))
    for s, there in ((48.0 - reach, True), (48.0 - reach - 1.05, False)):
        pieces = answer(True, 3, [(s, 10.0)], [(3.5, 0.0)])
        assert bool(pieces[0]) == there
