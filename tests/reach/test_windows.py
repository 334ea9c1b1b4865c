"""Forbidden cells block by block, against every corner measured one by one."""

import numpy as np
import pytest

from reach_scenes import Course
from sandra.prediction import PredictedObstacle, Prediction
from sandra.reach.cells import grid
from sandra.reach.lattice import Lattice
from sandra.reach.windows import union, windows
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
def test_blocks_find_the_cells_that_all_corners_give(
    curvature: float, size: tuple[int, int]
) -> None:
    rng = np.random.default_rng(size[0])
    scene = Course(curvature).scene(speed=10.0)
    lattice = Lattice(1.0, -size[1] / 8, 0.5, 0.25, *size)
    corners = grid(scene, *lattice.corners())
    reach = rng.uniform(0.5, 1.0, size[0])
    several = regions(rng, 600)
    steps = (tuple(several[:400]), (), tuple(several[400:]))
    car = Course().car(2, 20.0, 0.0)
    predicted = PredictedObstacle(car, steps, steps[1:], np.full((3, 5), np.nan))
    (found,) = windows(Prediction("made up", 0.1, 2, (predicted,)), corners, reach)
    nothing = np.zeros(size, dtype=bool)
    all_masks = union(nothing, [found], 2)
    for at_step, mine, mask in zip(steps, found, all_masks, strict=True):
        expected = []
        for region in at_step:
            away = distance(corners, region.vertices)
            away = np.maximum(away[:-1], away[1:])
            away = np.maximum(away[:, :-1], away[:, 1:]) - region.radius
            assert np.abs(away - reach[:, None]).min() > 1e-9, "no draw"
            expected.append(away <= reach[:, None])
        got = []
        for i0, i1, j0, j1, cells in mine:
            whole = nothing.copy()
            whole[i0:i1, j0:j1] = cells
            got.append(whole)
        wanted = [e for e in expected if e.any()]
        assert len(got) == len(wanted)
        assert all((g == w).all() for g, w in zip(got, wanted, strict=True))
        assert (mask == np.any([nothing, *expected], axis=0)).all()
    assert sum(len(mine) for mine in found) > 20
