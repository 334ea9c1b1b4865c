"""The lattice's cells in the plane, where every number is known."""

from dataclasses import replace

import numpy as np
import pytest
import shapely
import shapely.affinity

from reach_scenes import Course
from sandra.reach.cells import _inside, _slack, bulge, grid, off_road
from sandra.reach.lattice import Lattice, Mask
from sandra.scene.frame import Frame
from sandra.scene.types import Scene

LATTICE = Lattice(38.0, -5.0, 0.5, 0.25, 8, 40)


def test_points_of_a_grid() -> None:
    scene = Course(angle=np.pi / 2).scene()
    points = grid(scene, np.array([40.0, 42.0, 43.0]), np.array([-1.0, 2.0]))
    # along y, with the ego at s = 40 m
    expected = [[(1, 0), (-2, 0)], [(1, 2), (-2, 2)], [(1, 3), (-2, 3)]]
    assert points == pytest.approx(np.array(expected, dtype=float))


def bent(*corners: tuple[float, float]) -> Scene:
    """A scene whose reference line has these corners."""
    line = np.array(corners)
    (pattern,) = Course().lanes(left=0, right=0)
    lane = replace(pattern, center=line, frame=Frame(line))
    return Course().scene([lane])


def test_cells_bulge_by_a_quarter_of_length_times_turn() -> None:
    """A corner of 0.2 rad at s = 40 m between segments of 40 and 20 m."""
    scene = Course().scene()
    assert bulge(scene, LATTICE) == pytest.approx(1e-6)
    turn = 0.2
    end = (40.0 + 20.0 * np.cos(turn), 20.0 * np.sin(turn))
    kinked = bent((0.0, 0.0), (40.0, 0.0), end)
    found = bulge(kinked, Lattice(38.25, -4.0, 0.5, 0.25, 8, 24))
    # from 39.75 to 40.25 m; 4 m away lines are longer by the curvature there, 0.2 / 20
    expected = np.full(8, 1e-6)
    expected[3] += 0.5 * (1 + 4.0 * turn / 20.0) * turn / 4
    # lines are longer beside the corner as well, but do not turn there
    assert found == pytest.approx(expected)
    # on a line of the lattice it belongs to both cells
    on_line = bulge(kinked, Lattice(38.0, -2.0, 0.5, 0.25, 8, 24))
    expected = np.full(8, 1e-6)
    expected[3:5] += 0.5 * (1 + 4.0 * turn / 20.0) * turn / 4
    assert on_line == pytest.approx(expected)


def test_corners_in_one_cell_add_up_whichever_way_they_turn() -> None:
    """To the left by 0.2 rad, then by 0.3 rad to the right, half a metre on."""
    a = np.array([40.0, 0.0])
    b = a + 0.5 * np.array([np.cos(0.2), np.sin(0.2)])
    c = b + 30.0 * np.array([np.cos(-0.1), np.sin(-0.1)])
    scene = bent((0.0, 0.0), tuple(a), tuple(b), tuple(c))
    found = bulge(scene, Lattice(38.0, -0.5, 4.0, 0.25, 1, 4))
    # the second turns most within the shorter of its segments
    assert found == pytest.approx([4.0 * (1 + 0.5 * 0.3 / 0.5) * 0.5 / 4 + 1e-6])


def off(scene: Scene, lattice: Lattice) -> Mask:
    return off_road(scene, lattice, bulge(scene, lattice))


def test_off_the_road_are_cells_whose_disc_crosses_the_border_for_sure() -> None:
    """On a straight road: the centre of the cell is further out than border, disc and half a
    diagonal of the cell allow. At 1.75 m - 0.9 m + 0.28 m."""
    scene = Course().scene(Course().lanes(left=0, right=0))
    found = off(scene, LATTICE)
    limit = 1.75 - 0.9 + np.hypot(0.5, 0.25) / 2
    assert limit == pytest.approx(1.1295, abs=1e-4)
    expected = np.abs(LATTICE.centers()[1]) > limit
    assert (found == expected[None, :]).all()
    assert expected.sum() == 30
    # as wide as the ego is, not the lane
    both = off(Course().scene(), LATTICE)
    assert (both == (np.abs(LATTICE.centers()[1]) > limit + 3.5)[None, :]).all()


def test_slits_between_lanelets_are_no_border() -> None:
    course = Course()
    lanes = course.lanes(left=0, right=0)
    for slit, closed in ((0.15, True), (0.25, False)):
        beside = course.lane("none", 110, 1.75 + slit, 5.25)
        found = off(course.scene(lanes, more_lanelets=[beside]), LATTICE)
        assert found[:, np.abs(LATTICE.centers()[1] - 1.8) < 0.2].any() != closed


@pytest.mark.parametrize("offset", [0.0, 0.5, 1.0, 1.5])
def test_long_cells_on_the_outside_of_a_bend_at_the_end_of_the_road(offset: float) -> None:
    """11 m to the outside of a bend of 20 m a cell is half as long again as on the line."""
    course = Course(1 / 20, step=0.25)
    scene = course.scene([course.lane("current", 100, -12.0, 1.75, start=-20.0, end=15.0)])
    lattice = Lattice(20.0 + offset, -12.0, 2.0, 0.25, 12, 48)
    found = off(scene, lattice)
    corners = shapely.points(grid(scene, *lattice.corners()))
    free = scene.lanelets[0].area()
    inside = np.where(shapely.covers(free, corners), shapely.distance(free.boundary, corners), 0.0)
    farthest = np.maximum(inside[1:], inside[:-1])
    farthest = np.maximum(farthest[:, 1:], farthest[:, :-1])
    # 0.1 m is what the closing of slits may take off a corner of the road
    assert farthest[found].max() <= 0.9 + 0.1
    assert 100 < found.sum() < found.size - 100


def test_only_a_lanelet_within_reach_of_no_row_of_cells_is_left_out() -> None:
    """Cells of 0.5 m by 6 m: the lanelets beside the road are 10 m away from all but one row."""
    course = Course()
    beside = [course.lane("none", 110, 11.0, 12.0), course.lane("none", 111, -12.0, -11.0)]
    lattice = Lattice(38.0, -15.0, 0.5, 6.0, 2, 5)
    found = off(course.scene(course.lanes(left=0, right=0), more_lanelets=beside), lattice)
    assert lattice.centers()[1].tolist() == [-12.0, -6.0, 0.0, 6.0, 12.0]
    # 3.01 m from the centre to a corner: rows at 6 m are 4.25 m from the one, 5 m from the other
    assert found.tolist() == [[False, True, False, True, False]] * 2


def test_cells_up_to_twice_as_large_are_told_like_the_largest() -> None:
    """0.75 m by 1 m: 0.625 m from the centre to a corner, and as much again by bulging."""
    scene = Course().scene(Course().lanes(left=0, right=0))
    lattice = Lattice(38.25, -4.0, 0.75, 1.0, 3, 8)
    corners = grid(scene, *lattice.corners())
    away = corners[:-1, :-1] - grid(scene, *lattice.centers())
    assert (np.hypot(away[..., 0], away[..., 1]) == 0.625).all()
    # alone, and beside cells that are much larger
    for larger in (0.0, 8.0):
        for bulging, alike in ((0.625, True), (0.625 + 2.0**-40, False)):
            found = off_road(scene, lattice, np.array([0.0, bulging, larger]))
            assert (found[0] == found[1]).all() == alike


@pytest.mark.parametrize("alike", [True, False])
def test_how_large_cells_are_is_asked_at_the_ends_and_in_the_middle(alike: bool) -> None:
    """Where the line bends one way and back within 4 m, cells are smallest about the line."""
    heading = np.array([0.0, *np.linspace(0.0, 0.5, 9)[1:], *np.linspace(0.5, 0.0, 9)[1:], 0.0])
    steps = np.array([40.0, *np.full(16, 0.25), 40.0])[:, None]
    line = np.cumsum(steps * np.column_stack([np.cos(heading), np.sin(heading)]), axis=0)
    course = Course()
    # The road, right of y = 0.5 m, does not follow the line.
    lane = course.lane("current", 100, -10.0, 0.5)
    scene = course.scene([replace(lane, center=line, frame=Frame(line - line[0]))])
    lattice = Lattice(0.0, -1.5, 4.0, 0.125, 2, 48)
    lines = [scene.frame.across(s) for s in (lattice.centers()[0], lattice.corners()[0])]
    slack = _slack(lattice, *lines, np.arange(lattice.rows))
    smallest = slack[0, [0, 24, 47]].min()
    assert slack[0, 8:16].max() < 0.95 * smallest
    # The cells of the other column are twice as large as that, or more by rounding.
    bulges = np.array([0.0, 2 * smallest - slack[1].max()])
    largest = (slack + bulges[:, None]).max()
    assert largest == 2 * smallest
    if not alike:
        bulges[1] += 2.0**-40
    found = off_road(scene, lattice, bulges)
    y = grid(scene, *lattice.centers())[..., 1]
    assert (found[0] == (y[0] > 0.5 + largest - 0.9)).all() == alike


@pytest.mark.parametrize("seed", range(20))
def test_inside_is_what_shapely_contains(seed: int) -> None:
    """Areas in several parts and with holes, on lines that need not be parallel."""
    rng = np.random.default_rng(seed)
    discs = shapely.points(rng.uniform(-10.0, 10.0, (12, 2))).tolist()
    holes = shapely.points(rng.uniform(-10.0, 10.0, (6, 2))).tolist()
    area = shapely.union_all([p.buffer(rng.uniform(1.0, 4.0)) for p in discs])
    area = area.difference(shapely.union_all([p.buffer(rng.uniform(0.2, 2.0)) for p in holes]))
    offset = rng.uniform(-1.0, 1.0, 2) * 1e5
    area = shapely.affinity.translate(area, *offset)
    m = 60
    foot = offset + np.column_stack([np.linspace(-14.0, 14.0, m), rng.uniform(-1.0, 1.0, m)])
    normal = np.column_stack([rng.uniform(-0.4, 0.4, m), rng.uniform(0.5, 1.5, m)])
    d = np.linspace(-12.0, 12.0, 75)
    points = foot[:, None] + d[:, None] * normal[:, None]
    found = _inside(area, foot, normal, d)
    assert (found == shapely.contains_xy(area, *points.transpose(2, 0, 1))).all()
    assert 0.1 < found.mean() < 0.9
    assert not _inside(shapely.Polygon(), foot, normal, d).any()


def test_in_a_lattice_where_cells_differ_much_each_is_told_by_its_own_size() -> None:
    """Inside a bend of 20 m, cells 15 m to the left of the line are a quarter as long as on it."""
    course = Course(1 / 20, step=0.25)
    scene = course.scene([course.lane("current", 100, -1.75, 16.0, start=-20.0, end=15.0)])
    lattice = Lattice(20.0, -2.0, 2.0, 0.25, 12, 72)
    found = off(scene, lattice)
    lines = [scene.frame.across(s) for s in (lattice.centers()[0], lattice.corners()[0])]
    slack = _slack(lattice, *lines, np.arange(lattice.rows))
    assert slack.max() > 2 * slack.min()
    ends = _slack(lattice, *lines, np.array([0, lattice.rows - 1]))
    assert slack.max() == pytest.approx(ends.max(), rel=1e-12)
    centers = shapely.points(grid(scene, *lattice.centers()))
    free = scene.lanelets[0].area()
    inside = np.where(shapely.covers(free, centers), shapely.distance(free.boundary, centers), -1.0)
    # 0.1 m is what the closing of slits may take off a corner of the road
    assert (inside[found] <= 0.9 - slack[found] + 0.1).all()
    # told like the largest of those up to twice as large
    assert found[inside < 0.9 - 2 * slack - 0.1].all()


def test_what_lies_on_the_border_is_inside_on_the_left_and_at_the_beginning() -> None:
    """A square of 1 m, and lines upwards along its sides and past them."""
    foot = np.column_stack([[-0.5, 0.0, 0.5, 1.0, 1.5], np.zeros(5)])
    upwards = np.tile([0.0, 1.0], (5, 1))
    d = np.array([-0.5, 0.0, 0.5, 1.0, 1.5])
    rows, columns = [0, 1, 1, 0, 0], [0, 0, 1, 1, 0]
    found = _inside(shapely.box(0.0, 0.0, 1.0, 1.0), foot, upwards, d)
    assert (found == np.outer(columns, rows)).all()
