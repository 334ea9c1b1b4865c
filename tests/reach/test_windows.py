"""Forbidden cells line by line, against every corner measured one by one."""

import numpy as np
import pytest

from reach_scenes import Course
from sandra.prediction import PredictedObstacle, Prediction
from sandra.reach.cells import grid
from sandra.reach.lattice import Lattice
from sandra.reach.windows import Lines, _intervals, union, windows
from sandra.scene.convex import distance, hull
from sandra.scene.types import Region


def regions(rng: np.random.Generator, count: int) -> list[Region]:
    """Polygons of all sizes, turning either way, and discs and capsules, around the road."""
    found = []
    for i in range(count):
        corners = rng.normal(size=(int(rng.integers(3, 12)), 2)) * 10.0 ** rng.uniform(-0.5, 1.7)
        if i % 5 == 0:
            corners = corners[: 1 + i % 2]
        outline = hull(corners + rng.uniform([-5.0, -8.0], [35.0, 8.0]))
        radius = float(rng.uniform(0.0, 3.0)) if i % 5 == 0 or i % 3 == 0 else 0.0
        found.append(Region(outline[::-1] if i % 4 == 0 else outline, radius))
    return found


@pytest.mark.parametrize("curvature", [0.0, 1 / 30])
@pytest.mark.parametrize("size", [(60, 40), (37, 21), (3, 1)])
def test_lines_find_the_cells_that_all_corners_give(
    curvature: float, size: tuple[int, int]
) -> None:
    rng = np.random.default_rng(size[0])
    scene = Course(curvature).scene(speed=10.0)
    lattice = Lattice(1.0, -size[1] / 8, 0.5, 0.25, *size)
    corners = grid(scene, *lattice.corners())
    reach = rng.uniform(0.5, 1.0, size[0])
    on_line = np.minimum(np.append(reach, np.inf), np.append(np.inf, reach))
    several = regions(rng, 600)
    steps = (tuple(several[:400]), (), tuple(several[400:]))
    car = Course().car(2, 20.0, 0.0)
    predicted = PredictedObstacle(car, steps, steps[1:], np.full((3, 5), np.nan))
    (found,) = windows(Prediction("made up", 0.1, 2, (predicted,)), corners, reach)
    nothing = np.zeros(size, dtype=bool)
    all_masks = union(nothing, [found], 2)
    for at_step, mask in zip(steps, all_masks, strict=True):
        expected = []
        for region in at_step:
            away = distance(corners, region.vertices)
            away = np.maximum(away[:, :-1], away[:, 1:]) - region.radius - on_line[:, None]
            assert np.abs(away).min() > 1e-9, "no draw"
            expected.append((away[:-1] <= 0.0) & (away[1:] <= 0.0))
        assert (mask == np.any([nothing, *expected], axis=0)).all()
    assert sum(len(mine) for mine in found) > 20


# ------------------------------------------------------------------ exactly on the boundary


def forbids(region: Region, point: tuple[float, float], reach: float) -> bool:
    """Whether a cell is forbidden two of whose corners are this point, the others further in."""
    car = Course().car(2, 20.0, 0.0)
    predicted = PredictedObstacle(car, ((region,),), (), np.full((1, 5), np.nan))
    inwards = region.vertices.mean(axis=0) - point
    if not inwards.any():
        inwards = region.vertices[0] - point
    corners = np.tile(np.array([point, point + inwards / 8]), (2, 1, 1))
    ((several,),) = windows(Prediction("made up", 0.1, 0, (predicted,)), corners, np.array([reach]))
    if not several:
        return False
    ((i0, i1, j0, j1, cells),) = several
    assert (i0, i1, j0, j1) == (0, 1, 0, 1)
    return bool(cells.all())


SQUARE = np.array([[0.0, 0.0], [4.0, 0.0], [4.0, 2.0], [0.0, 2.0]])
SIDES = [((0.0, 1.0), (-1, 0)), ((4.0, 1.0), (1, 0)), ((2.0, 0.0), (0, -1)), ((2.0, 2.0), (0, 1))]


@pytest.mark.parametrize(("point", "outwards"), SIDES)
@pytest.mark.parametrize("radius", [0.0, 0.25])
@pytest.mark.parametrize("turned", [False, True])
def test_a_cell_as_far_away_as_allowed_is_forbidden(
    point: tuple[float, float], outwards: tuple[int, int], radius: float, turned: bool
) -> None:
    region = Region(SQUARE[::-1].copy() if turned else SQUARE, radius)
    for away, there in ((0.5, True), (0.5 + 2.0**-40, False)):
        at = np.array(point) + np.array(outwards) * (away + radius)
        assert forbids(region, (at[0], at[1]), 0.5) == there
    # on the border and inside; with no reach at all, only there
    for away in (0.0, -0.5):
        at = np.array(point) + np.array(outwards) * away
        assert forbids(region, (at[0], at[1]), 0.5)
        assert forbids(region, (at[0], at[1]), 0.0)
        assert not forbids(region, (at[0], at[1]), -radius - 1.0)


@pytest.mark.parametrize(("point", "outwards"), SIDES)
def test_short_sides_reach_as_far_as_long_ones(
    point: tuple[float, float], outwards: tuple[int, int]
) -> None:
    """A quarter and an eighth of a metre: between the arcs about its corners a side moves out."""
    for away, there in ((0.5, True), (0.5 + 2.0**-40, False)):
        at = np.array(point) / 16 + np.array(outwards) * away
        assert forbids(Region(SQUARE / 16), (at[0], at[1]), 0.5) == there


def test_a_column_beside_a_region_just_within_reach_is_forbidden() -> None:
    """Its lines are parallel to a side, and meet the border of what is within reach all along."""
    car = Course().car(2, 20.0, 0.0)
    predicted = PredictedObstacle(car, ((Region(SQUARE),),), (), np.full((1, 5), np.nan))
    for away, expected in ((0.5, [[0, 4]]), (0.5 + 2.0**-40, [])):
        corners = np.tile(np.column_stack([np.arange(5.0), np.full(5, -away)]), (2, 1, 1))
        ((found,),) = windows(Prediction("made up", 0.1, 0, (predicted,)), corners, np.array([0.5]))
        assert [[j0, j1] for *_, j0, j1, cells in found if cells.all()] == expected


@pytest.mark.parametrize("outwards", [(-1, 0), (1, 0), (0, -1), (0, 1)])
def test_discs_and_capsules_reach_as_far_in_every_direction(outwards: tuple[int, int]) -> None:
    disc = Region(np.array([[1.0, 2.0]]), 0.25)
    capsule = Region(np.array([[1.0, 2.0], [3.0, 2.0]]), 0.25)
    for away, there in ((0.75, True), (0.75 + 2.0**-40, False)):
        x, y = np.array([1.0, 2.0]) + np.array(outwards) * away
        assert forbids(disc, (x, y), 0.5) == there
        start = 3.0 if outwards[0] > 0 else 1.0
        x, y = np.array([start, 2.0]) + np.array(outwards) * away
        assert forbids(capsule, (x, y), 0.5) == there


def test_a_needle_counts_as_its_longest_side() -> None:
    """A polygon without area, and one with corners twice in the same place."""
    needle = Region(np.array([[0.0, 0.0], [2.0, 0.0], [4.0, 0.0]]))
    twice = Region(np.array([[0.0, 0.0], [4.0, 0.0], [4.0, 0.0], [4.0, 2.0], [0.0, 2.0]]))
    for region in (needle, twice):
        assert forbids(region, (3.0, -0.5), 0.5)
        assert forbids(region, (4.5, 0.0), 0.5)
        assert not forbids(region, (3.0, -0.75), 0.5)
        assert not forbids(region, (4.75, 0.0), 0.5)
    # along it, with no reach at all
    for line in (needle, Region(needle.vertices[::2].copy())):
        assert forbids(line, (0.0, 0.0), 0.0)
        assert not forbids(line, (0.0, 0.0), -0.25)
    assert forbids(needle, (3.0, 0.5), 0.5)
    assert not forbids(needle, (3.0, 0.75), 0.5)


def test_a_small_body_has_an_inside_as_well() -> None:
    """The outline of somebody on foot: its middle is not as far from it as its sides are."""
    for size in (0.5, 1e-3):
        body = Region(np.array([[0.0, 0.0], [size, 0.0], [size, size], [0.0, size]]))
        assert forbids(body, (size / 2, size / 2), 0.0)
        assert not forbids(body, (size / 2, -size / 4), 0.0)


def test_cells_need_all_their_corners_within_reach() -> None:
    """A row of cells of 1 m along x, more than a block of them, above a wall from 2 to 12 m."""
    car = Course().car(2, 20.0, 0.0)
    wall = Region(np.array([[2.0, -1.0], [12.0, -1.0], [12.0, 0.0], [2.0, 0.0]]))
    predicted = PredictedObstacle(car, ((wall,),), (), np.full((1, 5), np.nan))
    x, y = np.arange(18.0), np.array([0.25, 0.5, 0.75])
    corners = np.stack(np.meshgrid(x, y, indexing="ij"), axis=-1)
    reach = np.full(17, 0.5)
    reach[5] = 0.25  # on both its lines: no upper corners of the columns beside are reached either
    reach[8:11] = 0.75  # all corners on the two lines in between
    ((several,),) = windows(Prediction("made up", 0.1, 0, (predicted,)), corners, reach)
    whole = np.zeros((17, 2), dtype=bool)
    for i0, i1, j0, j1, cells in several:
        whole[i0:i1, j0:j1] = cells
    expected = np.zeros((17, 2), dtype=bool)
    expected[2:12, 0] = True
    expected[4:7, 0] = False
    expected[9, 1] = True
    assert (whole == expected).all()


def across(reach: np.ndarray) -> Lines:
    """A line along y every metre, with three corners each, from y = 0 to 2 m."""
    x, y = np.arange(len(reach) + 1.0), np.arange(3.0)
    return Lines.of(np.stack(np.meshgrid(x, y, indexing="ij"), axis=-1), reach)


@pytest.mark.parametrize(
    ("place", "outwards", "blocks"),
    [
        ((-1.0, 1.0), (-1, 0), [0]),
        ((2.0, -1.0), (0, -1), [0]),
        ((16.5, 3.0), (0, 1), [2]),
        ((18.0, 1.0), (1, 0), [2]),
        ((8.0, 1.0), (1, 0), [0, 1]),
    ],
)
def test_blocks_of_lines_are_near_up_to_the_reach(
    place: tuple[float, float], outwards: tuple[int, int], blocks: list[int]
) -> None:
    """18 lines are two blocks and a quarter; a disc of half a metre, and half a metre of reach."""
    lines = across(np.full(17, 0.5))
    disc, line = lines.near(np.array([place]), np.array([0.5]))
    assert not disc.any()
    assert line.tolist() == [i for i in range(18) if i // 8 in blocks]
    beyond = np.array([place]) + np.array(outwards) * 2.0**-40
    _, line = lines.near(beyond, np.array([0.5]))
    assert line.tolist() == [i for i in range(18) if i // 8 in blocks[1:]]


def test_regions_that_turn_both_ways_are_measured_together() -> None:
    """Above and below a row of cells; each turns the other way."""
    lower = np.array([[-1.0, -2.0], [5.0, -2.0], [5.0, 0.25], [-1.0, 0.25]])
    upper = lower * (1.0, -1.0) + (0.0, 8.0)
    car = Course().car(2, 20.0, 0.0)
    corners = np.stack(np.meshgrid(np.arange(4.0), np.arange(9.0), indexing="ij"), axis=-1)
    for first, second in ((lower, upper), (lower[::-1], upper), (lower, upper[::-1])):
        several = [Region(outline.copy()) for outline in (first, second, first)]
        predicted = PredictedObstacle(car, (tuple(several),), (), np.full((1, 5), np.nan))
        (found,) = windows(Prediction("made up", 0.1, 0, (predicted,)), corners, np.full(3, 1.0))
        (mask,) = union(np.zeros((3, 8), dtype=bool), [found], 0)
        # as far as 1.25 m, and from 6.75 m on
        assert (mask == [True, False, False, False, False, False, False, True]).all()


def test_an_edge_counts_to_its_very_end() -> None:
    """There it meets the arc about its corner, which rounding makes a little smaller here."""
    reach, length = 0.894287109375, 7.0
    lowest = length * (reach / length)
    assert reach**2 - lowest**2 < 0.0
    edge = np.array([[0.0, lowest], [length, lowest + 1e-8], [3.0, 9.0]])
    lines = Lines(np.zeros((1, 2)), np.array([[1.0, 0.0]]), np.ones(1), np.zeros(1), 4)
    for corners in (edge, edge * (-1.0, 1.0), edge[::-1], edge[::-1] * (-1.0, 1.0)):
        ((low,), (high,)) = _intervals(
            corners.T[:, :, None], np.array([reach]), lines, np.zeros(1, dtype=int)
        )
        assert low == high
        assert abs(low) < 1e-6
