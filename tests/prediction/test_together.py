"""All participants are predicted in one batch: none depends on who else is in it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import shapely

from prediction.traffic import bend, car, fork, scene, straight_road
from sandra.prediction import PredictedObstacle, predict
from sandra.prediction.carriageway import Carriageway
from sandra.prediction.lane_cutting import build_map
from sandra.prediction.lane_table import LaneTable
from sandra.scene.types import Obstacle, Region, Scene, State

TRUCK = Region.rectangle(12.0, 2.5)


def recorded_from(obstacle: Obstacle, first: int) -> Obstacle:
    """The same obstacle, first seen at some step."""
    s = obstacle.state
    rows = np.tile([s.x, s.y, s.heading, s.speed, 0.0], (first + 2, 1))
    rows[:first] = np.nan
    return replace(obstacle, states=rows)


def crowd() -> tuple[Scene, ...]:
    """Vehicles of all kinds on several roads; all as fast, so that the map is the same for each."""
    walker = Obstacle(8, "pedestrian", Region.disc(0.3), State(5, -3, 1.0, 1.0))
    free = car(9, 20, 1.75, speed=20.0, kind="bicycle")
    on_straight = (
        car(1, -30, 1.75, speed=20.0),
        car(2, 15, 5.3, 0.02, 20.0),
        car(3, -20, 5.25, speed=20.0),
        replace(car(4, 5, 8.6, speed=20.0), outline=TRUCK),
        recorded_from(car(5, -60, 5.2, speed=20.0), 4),
        recorded_from(car(6, -60, 5.2, speed=20.0), 40),
        car(7, 40, 12.0, np.pi, 20.0),
        recorded_from(car(10, 20, 1.75, speed=20.0, kind="bicycle"), 7),
        recorded_from(car(11, 20, 1.75, speed=20.0, kind="bicycle"), 40),
    )
    ego = State(0, 5.25, 0.0, 20.0)
    return (
        scene(straight_road(oncoming=True), (*on_straight, walker, free), ego, (21, 22)),
        scene(bend(), tuple(car(i, 2.0 * i, -1.75 + i, 0.0, 20.0) for i in range(1, 4))),
        scene(fork(), tuple(car(i, -30.0 * i, 0, 0.0, 20.0) for i in range(1, 4))),
    )


def area(regions: tuple[Region, ...]) -> shapely.Geometry:
    return shapely.union_all(
        [shapely.MultiPoint(r.vertices).convex_hull.buffer(r.radius) for r in regions]
    )


def same(one: PredictedObstacle, other: PredictedObstacle) -> None:
    assert one.assumptions == other.assumptions
    for rows, others in ((one.at, other.at), (one.between, other.between)):
        for mine, theirs in zip(rows, others, strict=True):
            assert area(mine).symmetric_difference(area(theirs)).area < 1e-6


@pytest.mark.parametrize("now", crowd())
def test_alone_is_as_in_company(now: Scene) -> None:
    together = predict(now, "set-based", 15).obstacles
    for obstacle, found in zip(now.obstacles, together, strict=True):
        if obstacle.state.speed == 20.0:
            alone = predict(replace(now, obstacles=(obstacle,)), "set-based", 15)
            same(alone.obstacles[0], found)


@pytest.mark.parametrize("now", crowd())
def test_without_instants_only_the_regions_at_the_steps_are_wider(now: Scene) -> None:
    exact = predict(now, "set-based", 15)
    quick = predict(now, "set-based", 15, instants=False)
    assert quick.notes == exact.notes
    for found, other in zip(exact.obstacles, quick.obstacles, strict=True):
        assert (other.assumptions, other.dropped) == (found.assumptions, found.dropped)
        for mine, theirs in zip(found.between, other.between, strict=True):
            assert len(mine) == len(theirs)
            for a, b in zip(mine, theirs, strict=True):
                assert np.array_equal(a.vertices, b.vertices)
        wider = 0
        for mine, theirs in zip(found.at, other.at, strict=True):
            assert area(mine).difference(area(theirs).buffer(1e-6)).area < 1e-9
            assert bool(mine) == bool(theirs)
            wider += area(theirs).area > area(mine).area + 0.1
        assert wider or found.obstacle.id != 1


def test_carriageway_is_what_lies_beside_each_slice() -> None:
    table = LaneTable.of(build_map((*bend(), *fork()[2:]), 20.0))
    rng = np.random.default_rng(2)
    slices = np.flatnonzero(rng.random(len(table.slices)) < 0.7)
    found = Carriageway.of(table, slices, 5.0)
    for margin in (5.0, 2.0, 0.5):
        road = rng.random(len(table.cells)) < 0.3
        low, high = found.edges(road, margin)
        for i, number in enumerate(slices.tolist()):
            axes = np.stack([table.along[number], table.across[number]])
            own, cells = axes @ table.slices[number].hull.T, table.cells[road] @ axes.T
            start, end = cells.min(axis=1), cells.max(axis=1)
            near = (end >= own.min(axis=1) - margin) & (start <= own.max(axis=1) + margin)
            beside = near.all(axis=1)
            if beside.any():
                assert low[i] == pytest.approx(start[beside, 1].min())
                assert high[i] == pytest.approx(end[beside, 1].max())
            else:
                assert (low[i], high[i]) == (-np.inf, np.inf)
