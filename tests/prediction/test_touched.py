"""What acceleration-based sets touch: whatever they meet up to rounding."""

from __future__ import annotations

import numpy as np
import pytest

from prediction.traffic import CAR, car, straight_road
from sandra.prediction.lane_cutting import build_map
from sandra.prediction.lane_table import LaneTable
from sandra.prediction.observed import NOTHING, observe
from sandra.prediction.touched import NEVER, Touched, Vehicle, bodies_of, touch
from sandra.settings import Assumptions

TABLE = LaneTable.of(build_map(straight_road(1, 80.0), 0.0))
NORMALS = np.array([[1.0, 0.0], [0.0, 1.0], [-1.0, 0.0], [0.0, -1.0]])


def vehicle(front: tuple[float, ...], rear: float = -30.0) -> Vehicle:
    """One that may be anywhere on the road between `rear` and `front`, at each of the times."""
    obstacle = car(1, -20.0, 1.75)
    seen = observe(obstacle, obstacle.state, TABLE.map, Assumptions())
    at = np.array([[x, 100.0, -rear, 100.0] for x in front])
    at[np.isinf(at[:, 0])] = -np.inf
    rows = np.concatenate([at, np.maximum(at[:-1], at[1:])])
    rows[len(at) :][np.isinf(at[1:, 0])] = -np.inf
    bodies = np.arange(len(at), dtype=float)[:, None, None] * np.ones((1, 4, 2))
    return Vehicle(seen, NOTHING, CAR, CAR, NORMALS, rows, bodies)


def touched_by(front: tuple[float, ...], radius: float = 0.5) -> Touched:
    return touch(TABLE, [vehicle(front)], np.array([radius]))


def test_cells_are_touched_up_to_rounding() -> None:
    """Lanelet 12 begins at x = 0."""
    for front, met in ((-1e-9, True), (-1.001e-9, False)):
        found = touched_by((front, front))
        assert (12 in found.segments[0]) == met
        if met:
            assert (found.first[:, found.segments[0][12]] == TABLE.cell[1]).all()
        ahead = np.arange(len(TABLE.slices)) >= TABLE.slice[1]
        assert found.slices[0, :, ahead].any() == met


def test_each_row_touches_its_own_cells() -> None:
    """At three times, and during the steps from the lower end to the higher one."""
    found = touched_by((-10.5, -4.5, -8.5))
    own = found.segments[0][11]
    assert TABLE.right[found.first[:, own], 0] == pytest.approx([-31.0] * 5)
    assert TABLE.right[found.last[:, own], 0] == pytest.approx([-11.0, -5.0, -9.0, -5.0, -5.0])


def test_nothing_is_touched_beyond_the_last_step() -> None:
    found = touched_by((-10.5, -4.5, np.inf))
    own = found.segments[0][11]
    assert found.first[:, own].tolist()[2::2] == [NEVER, NEVER]
    assert found.last[:, own].tolist()[2::2] == [-1, -1]
    assert found.slices.any(axis=2)[0].tolist() == [True, True, False, True, False]


def test_around_are_the_cells_within_two_radii_and_a_metre() -> None:
    front = 18.0 - 1e-9
    assert front + 1e-9 == 18.0
    found = touched_by((0.0, front), radius=0.5)
    start = TABLE.cells[found.around[0]][:, :, 0].min(axis=1)
    assert start.max() == 20.0
    assert start.min() == -33.0


def test_bodies_of_rows() -> None:
    """At t_0, t_1, t_2; during a step, that at its end."""
    found = bodies_of([vehicle((0.0, 1.0, 2.0))], np.zeros(5, int), np.arange(5))
    assert found[:, 0, 0].tolist() == [0.0, 1.0, 2.0, 1.0, 2.0]
