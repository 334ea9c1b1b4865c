"""What a fail-safe may try: braking profiles, decelerations, edges and aims, one by one."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from reach_scenes import Course
from sandra.planning import strategies
from sandra.planning.strategies import ABORT, BRAKE, COMPLETE, EVADE, Situation
from sandra.scene.types import Scene
from sandra.settings import Settings

COURSE = Course(step=5.0)
TAU = 0.05


def state(
    d: float = 0.0,
    heading: float = 0.0,
    speed: float = 10.0,
    steering: float = 0.0,
    x: float = 0.0,
) -> np.ndarray:
    return np.array([x, d, heading, speed, steering])


def scene(left: int = 1, right: int = 1) -> Scene:
    return COURSE.scene(COURSE.lanes(left=left, right=right))


def test_decelerations_from_the_mildest_to_the_hardest() -> None:
    found = strategies.decelerations(Settings(a_lon_min=-6.0))
    assert found == pytest.approx(np.linspace(2.0, 5.998, 5))
    assert strategies.decelerations(Settings(a_lon_min=-2.002)).tolist() == [pytest.approx(2.0)]
    assert strategies.decelerations(Settings(a_lon_min=-1.0)).tolist() == [0.998]
    assert len(strategies.decelerations(Settings(a_lon_min=0.0))) == 0
    assert len(strategies.decelerations(Settings(a_lon_min=-strategies.INNER))) == 0


def test_braking_to_exactly_nothing() -> None:
    (found,) = strategies.braking(2.0, TAU, np.array([4.0]), 10)
    assert found == pytest.approx(2.0 - 0.2 * np.arange(11))
    assert found[-1] == 0.0
    # A last step that is shorter than the others.
    (found,) = strategies.braking(2.1, TAU, np.array([4.0]), 11)
    assert len(found) == 12
    assert found[-2] == pytest.approx(0.1)
    assert found[-1] == 0.0


def test_braking_that_takes_longer_than_predicted_is_none() -> None:
    levels = np.array([2.0, 4.0])
    lengths = [len(x) for x in strategies.braking(2.0, TAU, levels, 20)]
    assert lengths == [21, 11]
    assert [len(x) for x in strategies.braking(2.0, TAU, levels, 19)] == [11]
    assert strategies.braking(2.0, TAU, levels, 9) == []


@pytest.mark.parametrize("speed", [0.0, 6.0])
@pytest.mark.parametrize("distance", [9.0, 15.0])
def test_leaving_drives_so_far_and_no_step_further(speed: float, distance: float) -> None:
    levels = np.linspace(2.0, 5.998, 5)
    found = strategies.leaving(speed, distance, TAU, 13.0, levels, 160)
    assert found
    pushes = set()
    for profile in found:
        assert profile[0] == speed
        assert profile[-1] == 0.0
        assert profile.max() <= 13.0
        driven = TAU * (profile[1:] + profile[:-1]).sum() / 2
        assert driven >= distance - 0.15
        assert driven < distance + 2 * TAU * profile.max() + 0.3
        change = np.diff(profile) / TAU
        pushes.add(round(float(change[0]), 6))
        assert round(-float(change.min()), 3) in (5.998, 3.999)
    # It keeps its speed, or speeds up; who stands cannot keep on.
    assert pushes == ({0.0, 1.5, 3.0} if speed else {1.5, 3.0})


def test_leaving_where_braking_alone_is_far_enough_or_time_or_speed_are_short() -> None:
    levels = np.array([4.0])
    # 8 m/s and 4 m/s^2 need 8 m.
    assert strategies.leaving(8.0, 8.0, TAU, 20.0, levels, 200) == []
    assert len(strategies.leaving(8.0, 8.01, TAU, 20.0, levels, 200)) == 3
    # 4 m more at 8 m/s: 0.5 s, then 2 s of braking: 50 steps.
    far = strategies.leaving(8.0, 12.0, TAU, 8.0, levels, 50)
    assert [len(x) for x in far] == [51]
    assert strategies.leaving(8.0, 12.0, TAU, 8.0, levels, 49) == []
    assert strategies.leaving(8.0, 12.0, TAU, 7.9, levels, 50) == []
    assert len(strategies.leaving(8.0, 12.0, TAU, 8.7, levels, 200)) == 2


def test_lengths() -> None:
    assert strategies.lengths(10.0) == pytest.approx((10.0, 16.0, 24.0, 34.0))
    assert strategies.lengths(2.0) == pytest.approx((4.0, 4.8, 6.8))
    assert strategies.lengths(0.0) == (4.0,)


def test_edges_are_the_narrowest_on_the_way() -> None:
    narrow = COURSE.lane(
        "current",
        100,
        lambda s: -1.75 + 0.5 * (np.abs(s - 20.0) < 1.0),
        lambda s: 1.75 - 0.5 * (np.abs(s - 20.0) < 1.0),
    )
    # In its own frame that is at s = 60.
    assert strategies.edges(narrow, 0.0, 50.0) == pytest.approx((-1.75, 1.75))
    assert strategies.edges(narrow, 50.0, 70.0) == pytest.approx((-1.25, 1.25))
    assert strategies.edges(narrow, 60.0, 60.0) == pytest.approx((-1.25, 1.25))
    assert strategies.edges(narrow, 70.0, 90.0) == pytest.approx((-1.75, 1.75))
    assert strategies.edges(narrow, 57.5, 57.5) == pytest.approx((-1.5, 1.5))
    wedge = COURSE.lane("current", 100, -1.75, lambda s: 1.75 + 0.01 * (s + 40.0))
    right, left = strategies.edges(wedge, 50.0, 90.0)
    assert left - right == pytest.approx(3.5 + 0.5 - 0.2 + 0.2, abs=0.05)


def test_room_is_what_the_body_leaves() -> None:
    on = scene()
    assert strategies.room(on.current, state(), 20.0, on.ego) == pytest.approx((-0.75, 0.75))
    # The narrowest place ahead counts, not the one behind.
    narrow = COURSE.lane("current", 100, -1.75, lambda s: 1.75 - 0.5 * (np.abs(s - 10.0) < 1.0))
    right, left = strategies.room(narrow, state(), 20.0, on.ego)
    assert left - right == pytest.approx(1.0, abs=0.01)
    right, left = strategies.room(narrow, state(x=15.0), 20.0, on.ego)
    assert left - right == pytest.approx(1.5, abs=0.01)


def test_aims_in_the_lane() -> None:
    on = scene()
    aims = strategies.stopping_aims(on, state(), Situation(on.current, ()))
    assert [(a.strategy, a.lane is on.current) for a in aims] == [(BRAKE, True)] * 8
    assert np.isnan([a.target for a in aims[::2]]).all()
    assert [a.target for a in aims[1::2]] == [0.0] * 4
    assert [a.length for a in aims[::2]] == [10.0, 16.0, 24.0, 34.0]


def test_aims_of_a_lane_change() -> None:
    on = scene()
    assert on.left is not None
    leaving = strategies.stopping_aims(on, state(), Situation(on.current, (on.left,)))
    assert [(a.strategy, a.lane.relation, a.target) for a in leaving[1:3]] == [
        (ABORT, "current", 0.0),
        (COMPLETE, "left", 0.0),
    ]
    arriving = strategies.stopping_aims(on, state(), Situation(on.left, (on.current,)))
    assert [(a.strategy, a.lane.relation, a.target) for a in arriving[1:3]] == [
        (COMPLETE, "left", 0.0),
        (ABORT, "current", 0.0),
    ]
    assert arriving[0].strategy == BRAKE
    assert len(arriving) == 12


def test_aims_beside_an_obstacle() -> None:
    on = scene()
    aims = strategies.evading_aims(on.ego, state(), Situation(on.current, ()), 20.0)
    assert {a.strategy for a in aims} == {EVADE}
    assert [a.target for a in aims[::4]] == pytest.approx([-0.75, -0.375, 0.75, 0.375])
    assert [a.length for a in aims[:4]] == [10.0, 16.0, 24.0, 34.0]
    # 0.1 m to a side is no evasion; and a body that does not fit has no room to evade.
    for width in (2.19, 1.4):
        tight = COURSE.lane("current", 100, -width / 2, width / 2)
        assert strategies.evading_aims(on.ego, state(), Situation(tight, ()), 20.0) == []


# Which lanes the body is in: its own is 3.5 m wide, the body 1.8 by 4.5 m.


def lanes(at: np.ndarray, on: Scene | None = None) -> tuple[str, list[str]]:
    on = scene() if on is None else on
    found = strategies.situation(on, at)
    return found.home.relation, [lane.relation for lane in found.changing]


@pytest.mark.parametrize("sign", [1, -1])
def test_a_body_over_the_edge_is_changing_lanes(sign: int) -> None:
    side = "left" if sign > 0 else "right"
    touching = 1.75 - 0.9 + strategies.TOUCH
    assert lanes(state(d=sign * (touching - 0.01))) == ("current", [])
    assert lanes(state(d=sign * (touching + 0.01))) == ("current", [side])
    # Beyond the middle between the lanes the other one is its own; seen from there, this one.
    assert lanes(state(d=sign * 1.76)) == (side, ["current"])
    assert lanes(state(d=sign * (3.5 - touching + 0.01))) == (side, [])
    assert lanes(state(d=sign * 3.5)) == (side, [])


@pytest.mark.parametrize("sign", [1, -1])
def test_a_body_that_moves_over_is_changing_lanes(sign: int) -> None:
    """More than 0.3 m/s across, by its course: heading and slip."""
    side = "left" if sign > 0 else "right"
    for across, found in ((0.29, []), (0.31, [side])):
        angle = np.arcsin(across / 10.0)
        assert lanes(state(heading=sign * angle)) == ("current", found)
        steering = np.arctan(2 * np.tan(angle))
        assert lanes(state(steering=sign * steering)) == ("current", found)
        assert lanes(state(heading=sign * angle, steering=-sign * steering)) == (
            "current",
            [],
        )
        assert lanes(state(heading=sign * angle, speed=5.0)) == ("current", [])


def test_a_turned_body_reaches_further() -> None:
    """At 0.3 rad, standing: half of 4.5 sin 0.3 + 1.8 cos 0.3."""
    half = 2.25 * np.sin(0.3) + 0.9 * np.cos(0.3)
    touching = 1.75 - half + strategies.TOUCH
    for turn in (0.3, -0.3):
        assert lanes(state(d=touching - 0.01, heading=turn, speed=0.0)) == (
            "current",
            [],
        )
        assert lanes(state(d=touching + 0.01, heading=turn, speed=0.0)) == (
            "current",
            ["left"],
        )


def test_only_the_next_lane() -> None:
    """From the left lane the right one is two lanes away, wherever the body moves."""
    assert lanes(state(d=3.5, heading=-0.1)) == ("left", ["current"])
    assert lanes(state(d=-3.5, heading=0.1)) == ("right", ["current"])


def test_lanes_that_end_before_or_begin_after_are_not_there() -> None:
    current = COURSE.lanes(left=0, right=0)[0]
    behind = COURSE.lane("left", 101, 1.75, 5.25, end=-5.0)
    ahead = COURSE.lane("left", 101, 1.75, 5.25, start=5.0)
    here = COURSE.lane("left", 101, 1.75, 5.25, start=-5.0, end=5.0)
    for lane, found in ((behind, []), (ahead, []), (here, ["left"])):
        on = COURSE.scene([current, lane])
        assert lanes(state(heading=0.1), on) == ("current", found)
    # Where there is no lane at all it is the current one.
    assert lanes(state(x=-300.0), COURSE.scene([current]))[0] == "current"


# The bounds themselves, on numbers that a computer has exactly.


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_the_edge_and_the_speed_across_at_their_bounds(side: float) -> None:
    """Between borders at -1 and 2 m; the next lane is no further than 4.5 m away."""
    borders = (-1.0, 2.0) if side > 0 else (-2.0, 1.0)
    next_lane = 3.0 * side

    def changes(
        d: float = 0.0, half: float = 0.5, across: float = 0.0, offset: float = next_lane
    ) -> bool:
        return strategies._changes(side * d, half, side * across, borders, offset)

    edge = 2.0 + strategies.TOUCH
    assert not changes(d=edge, half=0.0)
    assert changes(d=float(np.nextafter(edge, 9.0)), half=0.0)
    assert not changes(across=strategies.SIDEWAYS)
    assert changes(across=float(np.nextafter(strategies.SIDEWAYS, 9.0)))
    assert not changes(across=-9.0)
    assert changes(d=9.0, offset=side * 4.5)
    assert not changes(d=9.0, offset=side * float(np.nextafter(4.5, 9.0)))


@pytest.mark.parametrize("x", [-5.0, 5.0])
def test_abeam_of_the_ends_of_a_lane_is_still_there(x: float) -> None:
    here = COURSE.lane("left", 101, 1.75, 5.25, start=-5.0, end=5.0)
    on = COURSE.scene([COURSE.lanes(left=0, right=0)[0], here])
    assert lanes(state(x=x, heading=0.1), on) == ("current", ["left"])


def test_an_evasion_of_just_the_distance_to_the_edge_is_none(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(strategies, "TO_EDGE", 0.5)
    ego = replace(scene().ego, width=2.0)
    # From -2 to 2 m: half a metre to both sides.
    tight = COURSE.lane("current", 100, -2.0, 2.0)
    assert strategies.evading_aims(ego, state(), Situation(tight, ()), 20.0) == []
    # Where one offset is left, that one: 3 m wide, its frame 1 m beside its middle.
    beside = replace(
        COURSE.lane("current", 100, -0.5, 2.5), frame=COURSE.lane("current", 1, -1.0, 1.0).frame
    )
    aims = strategies.evading_aims(ego, state(), Situation(beside, ()), 20.0)
    assert {aim.target for aim in aims} == {1.0}


def test_the_mildest_deceleration_is_not_repeated(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(strategies, "INNER", 0.5)
    assert strategies.decelerations(Settings(a_lon_min=-2.5)).tolist() == [2.0]
