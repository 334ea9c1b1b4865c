"""Straight roads in closed form, against the general way, and what is no straight road."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import shapely

from prediction.traffic import bend, car, fork, line, scene, straight_road
from prediction.traffic import lanelet as made
from sandra.prediction import Prediction, predict
from sandra.prediction.geometry import directions, polygons_around
from sandra.prediction.lane_cutting import build_map
from sandra.prediction.straight import closed
from sandra.prediction.straight_road import StraightRoad
from sandra.scene.types import Lanelet, Obstacle, Region, State
from sandra.settings import Assumptions, Settings

ROAD = straight_road()
OFFSET = np.array([5.0, 9.0])
# A lane of the other direction, out of everybody's reach: no straight road any more.
ELSEWHERE = made(900, line(-500.0, -200.0, 200.0)[::-1], line(-503.5, -200.0, 200.0)[::-1])


def area(regions: tuple[Region, ...]) -> shapely.Geometry:
    return shapely.union_all([shapely.Polygon(r.vertices).buffer(r.radius) for r in regions])


def traffic(rng: np.random.Generator) -> tuple[Obstacle, ...]:
    return tuple(
        car(
            10 + i,
            float(rng.uniform(-150, 100)),
            float(rng.uniform(0.3, 10.2)),
            float(rng.choice([0.0, rng.uniform(-0.15, 0.15)])),
            float(rng.choice([0.0, rng.uniform(3, 30)])),
        )
        for i in range(8)
    )


def both(
    seed: int, a: Assumptions, ego_lane: tuple[int, ...] = (21, 22)
) -> tuple[Prediction, Prediction]:
    """In closed form, and by cells."""
    now = scene(ROAD, traffic(np.random.default_rng(seed)), State(-60.0, 5.25, 0.0, 15.0), ego_lane)
    other = replace(now, lanelets=(*ROAD, ELSEWHERE))
    assert StraightRoad.of(now.lanelets, 10.0) is not None
    assert StraightRoad.of(other.lanelets, 10.0) is None
    settings = Settings(assumptions=a)
    return predict(now, "set-based", 15, settings), predict(other, "set-based", 15, settings)


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize(
    "a",
    [
        Assumptions(),
        Assumptions(no_rear_end=False, legal_cut_in=False),
        Assumptions(legal_cut_in=False),
        Assumptions(max_braking=5.0, max_driving=2.0),
        Assumptions(max_lateral_speed=1.5, bounded_heading=False),
    ],
)
def test_closed_form_is_the_general_way_without_its_rounding(seed: int, a: Assumptions) -> None:
    """Half-planes differ by the vehicle's heading, cells round by a metre, lanes by 0.1 m."""
    closed_form, by_cells = both(seed, a)
    mine = theirs = 0.0
    for one, other in zip(closed_form.obstacles, by_cells.obstacles, strict=True):
        assert one.dropped == other.dropped
        assert set(one.assumptions) <= set(other.assumptions)
        rows = zip((*one.at, *one.between), (*other.at, *other.between), strict=True)
        for few, many in rows:
            tight, loose = area(few), area(many)
            assert tight.difference(loose.buffer(0.5)).is_empty
            mine, theirs = mine + tight.area, theirs + loose.area
    assert 0.9 < mine / theirs < 1.02


def test_who_keeps_out_of_the_ego_lane_is_beside_it_on_both_sides() -> None:
    now = scene(ROAD, (car(7, -75.0, 8.75, 0.0, 20.0),), State(-60.0, 5.25, 0.0, 20.0), (21, 22))
    (each,) = predict(now, "set-based", 25, Settings()).obstacles
    assert {"legal_cut_in", "no_rear_end"} <= set(each.assumptions)
    late = each.at[25]
    assert len(late) == 2
    for region in late:
        y = region.vertices[:, 1]
        assert y.min() >= 7.0 - 1e-3 or y.max() <= 3.5 + 1e-3
    assert len(each.at[2]) == 1
    # Too far from the ego's lane to come near it: nothing is left out, nothing is relied on.
    wide = straight_road(6)
    far = scene(wide, (car(7, -75.0, 19.25, 0.0, 20.0),), now.ego.state, (21, 22))
    (each,) = predict(far, "set-based", 10, Settings()).obstacles
    assert not {"legal_cut_in", "no_rear_end"} & set(each.assumptions)


def test_others_on_the_same_road_go_the_general_way() -> None:
    """A vehicle that reverses, one whose speed is not known, one that does not follow lanes."""
    plain = car(1, 0.0, 5.25, 0.0, 10.0)
    odd = (
        car(2, 0.0, 1.75, 0.0, -3.0),
        car(3, 30.0, 1.75, 0.0, 0.0, speed_is_known=False),
        car(4, -30.0, 1.75, 1.4, 2.0),
        car(5, -60.0, 1.75, 0.0, 5.0, kind="bicycle"),
    )
    together = predict(scene(ROAD, (plain, *odd)), "set-based", 8)
    alone = predict(scene((*ROAD, ELSEWHERE), odd), "set-based", 8)
    for one, other in zip(together.obstacles[1:], alone.obstacles, strict=True):
        assert one.assumptions == other.assumptions
        for few, many in zip(one.at, other.at, strict=True):
            assert area(few).equals_exact(area(many), 1e-6)


def test_places_are_those_of_the_cells() -> None:
    road, cells = StraightRoad.of(ROAD, 20.0), build_map(ROAD, 20.0)
    assert road is not None
    rng = np.random.default_rng(0)
    points = rng.uniform((-230, -1), (230, 11.5), (300, 2)).tolist()
    for x, y in [*points, (0.0, 3.5), (-220.0, 1.0), (-220.5, 1.0)]:
        mine = road.places(x, y, 3.3, 0.02)
        theirs = cells.places(x, y, 3.3, 0.02)
        assert {p.lanelet for p in mine} <= {p.lanelet for p in theirs}
        assert {p.lanelet // 10 for p in mine} == {p.lanelet // 10 for p in theirs}
        by_id = {p.lanelet: p for p in theirs}
        for p in mine:
            assert p.y == pytest.approx(by_id[p.lanelet].y, abs=1e-6)
            assert p.relative_heading == pytest.approx(by_id[p.lanelet].relative_heading)


def test_places_go_as_far_as_the_bounds_themselves() -> None:
    """A lane of 4 m between s = 0 and 80 m, in two lanelets, with numbers that are exact."""
    road = StraightRoad(np.zeros(2), 0.0, ((1, 2),), ((0.0, 40.0, 80.0),), (0.0, 4.0), 16.0)

    def at(x: float, y: float) -> list[int]:
        return [p.lanelet for p in road.places(x, y, 0.0, 0.25)]

    for x, y, lanelet in ((8.0, -0.25, 1), (8.0, 4.25, 1), (-20.25, 2.0, 1), (96.25, 2.0, 2)):
        assert at(x, y) == [lanelet]
        assert at(x + np.sign(x - 8.0) * 2.0**-20, y + np.sign(y - 2.0) * 2.0**-20) == []
    # where the second begins it is the second
    assert (at(40.0, 2.0), at(40.0 - 2.0**-20, 2.0)) == ([2], [1])


def moved(lanelets: tuple[Lanelet, ...], number: int, **changes: object) -> tuple[Lanelet, ...]:
    return tuple(
        replace(x, **changes) if x.id == number else x  # type: ignore[arg-type]
        for x in lanelets
    )


def shifted(each: Lanelet, x: float, y: float) -> dict[str, np.ndarray]:
    shift = np.array([x, y])
    return {"left": each.left + shift, "right": each.right + shift}


BY_ID = {x.id: x for x in ROAD}
CROOKED = BY_ID[12].right.copy()
CROOKED[1, 1] += 0.01
BACK = BY_ID[12].right.copy()
BACK[[1, 2]] = BACK[[2, 1]]


@pytest.mark.parametrize(
    "lanelets",
    [
        (),
        bend(),
        fork(),
        straight_road(oncoming=True),
        moved(ROAD, 12, right=CROOKED),
        moved(ROAD, 12, right=BACK),
        moved(ROAD, 32, **shifted(BY_ID[32], 0.0, 0.5)),
        moved(ROAD, 32, **shifted(BY_ID[32], 5.0, 0.0)),
        moved(ROAD, 12, right=BY_ID[12].right + np.array([1.0, 0.0])),
        moved(ROAD, 11, successors=()),
        moved(ROAD, 11, successors=(12, 22)),
        moved(ROAD, 12, predecessors=()),
        moved(ROAD, 32, successors=(11,)),
        moved(ROAD, 21, adjacent_left=None),
        moved(ROAD, 31, adjacent_left=(11, True)),
        moved(ROAD, 21, adjacent_right=(31, True)),
        ROAD[:5],
    ],
)
def test_what_is_no_straight_road(lanelets: tuple[Lanelet, ...]) -> None:
    assert StraightRoad.of(ROAD, 10.0) is not None
    assert StraightRoad.of(lanelets, 10.0) is None


def test_a_turned_road_has_its_own_frame() -> None:
    angle = 0.7
    turn = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
    turned = tuple(
        replace(x, left=x.left @ turn + OFFSET, right=x.right @ turn + OFFSET) for x in ROAD
    )
    road = StraightRoad.of(turned, 10.0)
    assert road is not None
    assert road.course == pytest.approx(angle)
    assert np.diff(road.borders) == pytest.approx([3.5, 3.5, 3.5])
    points = np.random.default_rng(0).uniform(-9, 9, (5, 2))
    assert road.to_world(road.to_frame(points)) == pytest.approx(points)
    state = np.array([-20.0, 5.0]) @ turn + OFFSET
    one = predict(scene(ROAD, (car(1, -20.0, 5.0, 0.05, 14.0),)), "set-based", 10)
    other = predict(scene(turned, (car(1, *state, 0.05 + angle, 14.0),)), "set-based", 10)
    for a, b in zip(one.obstacles[0].at, other.obstacles[0].at, strict=True):
        assert b[0].vertices == pytest.approx(a[0].vertices @ turn + OFFSET, abs=1e-6)


@pytest.mark.parametrize("count", [8, 16])
def test_closed_offsets_are_supports(count: int) -> None:
    """Against the polygon that shapely cuts out, half-plane by half-plane."""
    rng = np.random.default_rng(count)
    normals = directions(count)
    offsets = rng.uniform(-0.5, 4.0, (300, count))
    support, alive = closed(offsets)
    found = iter(polygons_around(normals, support))
    empty = 0
    for row, is_alive in zip(offsets, alive, strict=True):
        exact: shapely.Geometry = shapely.box(-50, -50, 50, 50)
        for (a, b), bound in zip(normals, row, strict=True):
            middle, along = bound * np.array([a, b]), 200 * np.array([-b, a])
            corners = [middle + along, middle + along - 400 * np.array([a, b])]
            corners += [middle - along - 400 * np.array([a, b]), middle - along]
            exact = exact.intersection(shapely.Polygon(corners))
        if exact.area < 1e-6:
            empty += 1
            continue
        assert is_alive
        assert exact.symmetric_difference(shapely.Polygon(next(found))).area < 1e-6
    assert alive.sum() == len(offsets) - empty
    assert 20 < empty < 280


def test_most_likely_trajectories_follow_a_straight_road_as_any_other() -> None:
    obstacles = (
        *traffic(np.random.default_rng(3)),
        car(30, 190.0, 5.0, 0.1, 20.0),
        car(31, 0.0, 5.0, 2.0, 20.0),
        car(32, 0.0, 30.0, 0.2, 20.0),
        car(33, 260.0, 5.0, 0.2, 20.0),
    )
    one = predict(scene(ROAD, obstacles), "constant-velocity", 12)
    other = predict(scene((*ROAD, ELSEWHERE), obstacles), "constant-velocity", 12)
    for a, b in zip(one.obstacles, other.obstacles, strict=True):
        assert a.states == pytest.approx(b.states, abs=1e-6)
