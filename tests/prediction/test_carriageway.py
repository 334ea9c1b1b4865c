"""Which cells lie beside a slice: those exactly at the margin belong to it."""

from __future__ import annotations

import numpy as np
import pytest

from prediction.traffic import WIDTH, straight_road
from sandra.prediction.carriageway import Carriageway, cells_of, road_of
from sandra.prediction.lane_cutting import build_map
from sandra.prediction.lane_table import LaneTable

TABLE = LaneTable.of(build_map(straight_road(3, 80.0), 20.0))


def of_lane(lanelets: set[int]) -> np.ndarray:
    return np.flatnonzero(np.repeat([i in lanelets for i in TABLE.number], np.diff(TABLE.slice)))


@pytest.mark.parametrize("margin", [0.0, WIDTH, 2 * WIDTH])
def test_cells_exactly_at_the_margin_count(margin: float) -> None:
    slices = of_lane({11, 12})
    found = Carriageway.of(TABLE, slices, margin)
    assert found.gap.max() == margin
    every = np.ones(len(TABLE.cells), dtype=bool)
    low, high = found.edges(every, margin)
    assert low == pytest.approx(0.0)
    assert high == pytest.approx(min(WIDTH * 2 + margin, WIDTH * 3))
    low, high = Carriageway.of(TABLE, of_lane({31, 32}), margin).edges(every, margin)
    assert low == pytest.approx(max(WIDTH - margin, 0.0))
    assert high == pytest.approx(WIDTH * 3)
    # A little less, and the next lane is not beside it.
    if margin:
        assert found.edges(every, margin - 1e-9)[1] == pytest.approx(WIDTH + margin)


def test_without_road_beside_it_nothing_is_cut() -> None:
    slices = of_lane({11, 12})
    found = Carriageway.of(TABLE, slices, 1.0)
    low, high = found.edges(np.zeros(len(TABLE.cells), dtype=bool), 1.0)
    assert (low == -np.inf).all()
    assert (high == np.inf).all()


def test_road_of_a_body() -> None:
    """The lanelets used, beside, before and after them; and what lies behind the start."""
    assert road_of(TABLE, [], [21], 0.0) == {11, 21, 31, 22}
    assert road_of(TABLE, [], [12], 0.0) == {12, 22, 11}
    assert road_of(TABLE, [12], [], 5.0) == {11, 12, 21, 22, 31, 32}
    found = cells_of(TABLE, {12})
    strip = TABLE.strips[TABLE.number[12]]
    assert np.array_equal(TABLE.cells[found], strip.cells)
