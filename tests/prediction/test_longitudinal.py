"""Bounds on braking and driving of their own: coverage, tightness, and no change without them."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from prediction.referee import inside_union
from prediction.test_set_based import OPEN, sets_of
from prediction.traffic import CAR, Course, bend, car, drive, fork, lanelet, line, straight_road
from sandra.prediction.lane_cutting import build_map
from sandra.prediction.lane_table import LaneTable
from sandra.prediction.motion import least_way
from sandra.prediction.types import PredictedObstacle
from sandra.scene.types import Lanelet, State

MILD = replace(OPEN, max_braking=5.0, max_driving=3.0)
BOUNDS = {"braking": 5.0, "driving": 3.0}
ROAD = straight_road()
DRIVES = {
    "middle lane of three": (ROAD, Course(0, 10.5), State(-100, 5.25, 0, 20)),
    "changing lane": (ROAD, Course(0, 10.5), State(-30, 2.2, 0.1, 25)),
    "two directions": (
        straight_road(oncoming=True),
        Course(0, 10.5),
        State(-30, 2.2, 0.1, 25),
    ),
    "across a joint": (ROAD, Course(0, 10.5), State(-10, 1.75, 0, 15)),
    "outer lane of a bend": (bend(), Course(-3.5, 3.5, 60, True), State(0, -1.75, 0, 12)),
    "inner lane of a bend": (bend(), Course(-3.5, 3.5, 60, True), State(0, 1.75, 0, 15)),
    "fork, into the bend": (fork(), Course(-1.75, 1.75, 30), State(-20, 0, 0, 9)),
}


def outside(
    lanelets: tuple[Lanelet, ...],
    sets: PredictedObstacle,
    course: Course,
    start: State,
    steps: int = 25,
    count: int = 300,
    **bounds: float,
) -> tuple[int, int]:
    """How many bodies of made-up drives lie outside their sets, and how many were looked at."""
    fine = 4
    poses, valid = drive(course, start, steps, 0.1, count, seed=count, fine=fine, **bounds)
    missing = looked = 0
    for j in range(len(poses)):
        k, rest = divmod(j, fine)
        chosen = [sets.between[k]] if k < steps else []
        if rest == 0:
            chosen += [sets.at[k]] + ([sets.between[k - 1]] if k else [])
        for x, y, heading in poses[j, valid > j]:
            corners = CAR.placed(x, y, heading).vertices
            missing += sum(not inside_union(corners, regions).all() for regions in chosen)
            looked += len(chosen)
    return missing, looked


@pytest.mark.parametrize("name", DRIVES)
def test_who_keeps_the_bounds_stays_inside(name: str) -> None:
    lanelets, course, start = DRIVES[name]
    sets = sets_of(lanelets, car(1, start.x, start.y, start.heading, start.speed), MILD)
    assert {"max_braking", "max_driving"} <= set(sets.assumptions)
    missing, looked = outside(lanelets, sets, course, start, **BOUNDS)
    assert looked > 3000
    assert missing == 0


@pytest.mark.parametrize("wider", [{"braking": 6.0}, {"driving": 4.0}])
def test_who_breaks_one_of_them_may_leave(wider: dict[str, float]) -> None:
    lanelets, course, start = DRIVES["middle lane of three"]
    sets = sets_of(lanelets, car(1, start.x, start.y, start.heading, start.speed), MILD)
    assert outside(lanelets, sets, course, start, **{**BOUNDS, **wider})[0] > 0


def test_on_a_straight_road_the_sets_end_where_the_bounds_do() -> None:
    """20 m/s, 2.5 s at -5 and +3 m/s^2: 34.4 and 59.4 m; less what going across may cost behind."""
    sets = sets_of(ROAD, car(1, -100, 5.25, 0.0, 20.0), MILD)
    x = np.concatenate([r.vertices for r in sets.at[25]])[:, 0] + 100.0
    assert x.max() == pytest.approx(20 * 2.5 + 3 * 2.5**2 / 2 + 2.25, abs=0.3)
    least = float(least_way(20.0, 5.0, 4.0, np.array([2.5]))[0])
    assert least == pytest.approx(33.0, abs=0.3)
    assert least - 2.25 - 1.0 < x.min() < least - 2.25


def test_least_way_is_the_integral() -> None:
    for speed, braking, across in ((25.0, 6.0, 4.0), (10.0, 5.0, 0.0), (8.0, 0.0, 4.0)):
        t = np.linspace(0.0, 4.0, 40001)
        v = np.maximum(speed - braking * t, 0.0)
        along = np.sqrt(np.maximum(v**2 - across**2, 0.0))
        way = np.concatenate([[0.0], np.cumsum((along[1:] + along[:-1]) / 2 * 1e-4)])
        assert least_way(speed, braking, across, t) == pytest.approx(way, abs=1e-3)
    for speed, braking, across in ((3.0, 6.0, 4.0), (9.0, math.inf, 4.0), (9.0, 6.0, math.inf)):
        assert (least_way(speed, braking, across, t) == 0.0).all()


def test_bounds_that_are_no_tighter_change_nothing() -> None:
    for start in (State(-100, 5.25, 0, 20), State(-30, 2.2, 0.1, 25)):
        obstacle = car(1, start.x, start.y, start.heading, start.speed)
        plain = sets_of(ROAD, obstacle, OPEN)
        assert not {"max_braking", "max_driving"} & {*plain.assumptions, *plain.dropped}
        same = sets_of(ROAD, obstacle, replace(OPEN, max_braking=12.0, max_driving=12.0))
        assert same.assumptions == plain.assumptions
        for one, other in zip(plain.at + plain.between, same.at + same.between, strict=True):
            assert [r.vertices.tolist() for r in one] == [r.vertices.tolist() for r in other]


def test_what_is_observed_to_be_broken_is_dropped() -> None:
    obstacle = car(1, -100, 5.25, 0.0, 20.0)
    for acceleration, dropped in ((-5.1, "max_braking"), (3.1, "max_driving"), (-5.0, None)):
        state = replace(obstacle.state, acceleration=acceleration)
        sets = sets_of(ROAD, replace(obstacle, state=state), MILD)
        names = {"max_braking", "max_driving"}
        assert set(sets.dropped) == ({dropped} if dropped else set())
        assert set(sets.assumptions) & names == names - set(sets.dropped)
        only = replace(MILD, **{dropped: math.inf}) if dropped else MILD
        expected = sets_of(ROAD, obstacle, only)
        for one, other in zip(sets.at, expected.at, strict=True):
            assert [r.vertices.tolist() for r in one] == [r.vertices.tolist() for r in other]


def test_bounds_are_not_counted_on_where_they_say_nothing() -> None:
    """Pedestrians have bounds of their own; braking needs lanes, a direction, and a speed."""
    walker = sets_of(ROAD, car(1, -100, 5.25, 0.0, 1.0, kind="pedestrian"), MILD)
    assert not {"max_braking", "max_driving"} & set(walker.assumptions)
    unknown = sets_of(ROAD, car(1, -100, 5.25, 0.0, 9.0, speed_is_known=False), MILD)
    assert not {"max_braking", "max_driving"} & set(unknown.assumptions)
    for a in (replace(MILD, follow_lanes=False), replace(MILD, no_reversing=False)):
        assert "max_braking" not in sets_of(ROAD, car(1, -100, 5.25, 0.0, 9.0), a).assumptions
    reverses = sets_of(ROAD, car(1, -100, 5.25, 0.0, -2.0), MILD)
    assert "max_braking" not in reverses.assumptions


def test_pace_is_that_of_the_slowest_way_round() -> None:
    """1 on straight lanes; round a bend the outer border is longer than the middle."""
    pace, drift = LaneTable.of(build_map(ROAD, 20.0)).pace()
    assert pace == pytest.approx(np.ones(len(pace)))
    assert drift == pytest.approx(np.zeros(len(drift)), abs=1e-9)
    pace, drift = LaneTable.of(build_map(bend(60.0), 20.0)).pace()
    assert (pace > 0.85).all()
    assert (pace < 61.75 / 63.5 + 1e-3).all()
    assert (drift < 0.1).all()


def test_a_lanelet_that_folds_back_gives_no_pace() -> None:
    right, left = line(0.0, 0.0, 40.0), line(3.5, 0.0, 40.0)
    left[1] = (-10.0, 3.5)
    pace, _ = LaneTable.of(build_map((lanelet(1, right, left),), 20.0)).pace()
    assert pace.tolist() == [0.0]
