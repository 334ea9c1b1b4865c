"""From stretches of lanelets to regions: bounds of pieces, the road beside them, what is named."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from prediction.referee import inside_union
from prediction.traffic import bend, car, fork, lanelet, line, scene, straight_road
from sandra.prediction import predict
from sandra.prediction.lane_cutting import build_map
from sandra.prediction.lane_table import LaneTable
from sandra.prediction.pieces import FAR, _bounds
from sandra.scene.types import Lanelet, Region, State
from sandra.settings import Assumptions, Settings


def taper() -> tuple[Lanelet, ...]:
    """A lanelet that is 3 m wide at its beginning and 6 m at its end, with slanted ends."""
    right = np.array([[0.0, 0.0], [20.0, 1.0], [40.0, 0.0]])
    left = np.array([[1.0, 3.0], [21.0, 5.0], [38.0, 6.0]])
    return (lanelet(1, right, left),)


@pytest.mark.parametrize("lanelets", [bend(), fork(), taper()])
def test_bounds_of_pieces_are_those_of_all_their_cross_sections(
    lanelets: tuple[Lanelet, ...],
) -> None:
    table = LaneTable.of(build_map(lanelets, 20.0))
    owner = np.repeat(np.arange(len(table.strips)), np.diff(table.slice))
    part = np.tile(np.arange(len(table.slices)), 6)
    rng = np.random.default_rng(5)
    ends = np.sort(rng.uniform(-3.0, 3.0, (len(part), 2)))
    ends[: len(table.slices)] = -np.inf, np.inf
    m = rng.uniform(-20.0, 150.0, len(part))
    m[::7] = -np.inf
    found = _bounds(table, part, m, ends[:, 0], ends[:, 1])
    for number, p, (low, high), (rear, right, left) in zip(
        part.tolist(), m.tolist(), ends.tolist(), found.tolist(), strict=True
    ):
        strip, own = table.strips[owner[number]], table.slices[number]
        across = np.array([-own.along[1], own.along[0]])
        rights, lefts = [], []
        for i in range(own.first, own.last + 1):
            half = strip.half[i]
            at = [strip.centre[i] + np.clip(y, -half, half) * strip.across[i] for y in (low, high)]
            rights.append(at[0] @ across)
            lefts.append(at[1] @ across)
        assert rear == pytest.approx(max(p - own.lag, -FAR))
        assert (right, left) == pytest.approx((min(rights), max(lefts)))


def spread_y(regions: tuple[Region, ...]) -> tuple[float, float]:
    points = np.vstack([r.vertices for r in regions])
    return float(points[:, 1].min()), float(points[:, 1].max())


def test_overhang_that_is_seen_is_kept_wherever_it_is() -> None:
    """0.7 m beyond the road's edge, far from the origin and from the line x = y."""
    for x in (-100.0, 100.0):
        now = scene(straight_road(), (car(1, x, 0.2),))
        low, _ = spread_y(predict(now, "set-based", 10).obstacles[0].at[10])
        assert -0.75 <= low <= -0.7


def test_where_the_road_widens_the_body_may_be_on_all_of_it() -> None:
    """From x = 0 on there are 7 m to the left of the right border instead of 3.5 m."""
    lanelets = (
        lanelet(1, line(0.0, -60.0, 0.0), line(3.5, -60.0, 0.0), successors=(2,)),
        lanelet(2, line(0.0, 0.0, 60.0), line(7.0, 0.0, 60.0), predecessors=(1,)),
    )
    now = scene(lanelets, (car(1, -3.0, 1.75, speed=5.0),))
    each = predict(now, "set-based", 12).obstacles[0]
    body = Region.rectangle(4.5, 1.8).placed(3.0, 5.0, 0.0).vertices
    assert inside_union(body, each.at[12]).all()
    assert spread_y(each.at[12])[1] <= 7.3 + 1e-6


def test_only_what_left_something_out_is_named() -> None:
    """Two lanes away, the vehicle may not come to the ego's lane in time, at 0.5 m/s across."""
    obstacle = car(1, 0.0, 8.75)
    now = scene(straight_road(), (obstacle,), State(0.0, 1.75, 0.0, 10.0), current=(11, 12))
    slow = Settings(assumptions=replace(Assumptions(), max_lateral_speed=0.5))
    found = predict(now, "set-based", 10, slow)
    assert not {"legal_cut_in", "no_rear_end"} & set(found.obstacles[0].assumptions)
    assert found.notes == ("most likely trajectories: no recording of obstacles 1; assumed to keep "
                           "the velocity along the lane",)  # fmt: skip
    found = predict(now, "set-based", 25)
    assert {"legal_cut_in", "no_rear_end"} <= set(found.obstacles[0].assumptions)


def test_a_body_that_is_partly_in_the_oncoming_lane_may_stay_there() -> None:
    """It sticks out of its own carriageway by 0.7 m, road or not."""
    now = scene(straight_road(1, oncoming=True), (car(1, 0.0, 3.3),))
    _, high = spread_y(predict(now, "set-based", 10).obstacles[0].at[10])
    assert 4.2 <= high <= 4.25
