"""Who broke what, on recordings that are made by hand; decisions and predictions are real."""

from dataclasses import replace

import numpy as np
import pytest

import conformance_recordings
import sandra
from monitor_roads import car, rows
from reach_scenes import Course
from sandra.decider import Operation
from sandra.evaluation.closed_loop.blame import (
    before_collision,
    from_behind,
    lapses,
    partner_of,
)
from sandra.evaluation.closed_loop.breaches import breaches
from sandra.settings import Assumptions, Settings
from sandra.simulation.episode import Episode, Step
from sandra.simulation.recording import Recording

ROAD = Course()
TICK, STRIDE = 1 / 15, 3
N = 31
T = TICK * np.arange(N)
LEADER = 7
SETTINGS = Settings()


def driven(start, speed, acceleration=0.0, since=0.0, d=0.0):
    """A car that begins to change its speed at a time; it does not drive backwards."""
    late = np.maximum(T - since, 0.0)
    v = np.maximum(speed + acceleration * late, 0.0)
    gone = np.concatenate([[0.0], np.cumsum((v[1:] + v[:-1]) / 2 * TICK)])
    return rows(ROAD, start + gone, d, v)


def scene_at(tick, ego, others, dt=STRIDE * TICK):
    """What is seen at a tick."""
    scene = ROAD.scene(ROAD.lanes(1, 1, end=600.0), (), dt=dt)

    def state(row):
        return sandra.scene.State(*row[:4])

    seen = tuple(replace(o, state=state(o.states[tick]), states=None) for o in others)
    return replace(scene, ego=replace(scene.ego, state=state(ego[tick])), obstacles=seen)


def recorded(ego, others):
    return replace(conformance_recordings.recorded(*others, ego=ego), dt=TICK)


def told(number, ego, others, operation=Operation.CERTIFIED, covered=True):
    """A step with the real decision of its scene."""
    scene = scene_at(number * STRIDE, ego, others)
    decision = sandra.decide(
        scene, "rules", accept="certified", prediction="most-likely", horizon=10
    )
    assert decision.basis is not None
    return Step(number, decision, operation, 0.0, covered, 0.0, 0.0)


def episode(ego, others, steps, crashed=()):
    return Episode(Recording(recorded(ego, others), dict(crashed)), tuple(steps), STRIDE, 30, None)


EGO = driven(0.0, 15.0)


@pytest.mark.parametrize(
    ("since", "until", "relied", "found"),
    [
        (0, 30, {LEADER: ("max_acceleration",)}, True),
        (0, 14, {LEADER: ("max_acceleration",)}, False),  # it has not braked yet
        (0, 30, {LEADER: ("max_speed", "follow_lanes")}, False),  # that was not relied on
        (0, 30, {8: ("max_acceleration",)}, False),  # nobody asks for it
        (0, 0, {LEADER: ("max_acceleration",)}, False),
    ],
)
def test_braking_beyond_the_bound(since, until, relied, found):
    leader = car(ROAD, LEADER, driven(40.0, 15.0, -14.0, since=14 * TICK))
    got = breaches(recorded(EGO, [leader]), STRIDE, since, until, relied, SETTINGS)
    assert bool(got) is found
    if found:
        (one,) = got
        assert (one.assumption, one.vehicle, one.allowed) == ("max_acceleration", LEADER, 12.0)
        assert one.value == pytest.approx(14.0)
        assert one.time == pytest.approx(15 * TICK)
        assert one.crashed is None


def test_braking_within_the_bound_is_none():
    leader = car(ROAD, LEADER, driven(40.0, 15.0, -11.9, since=0.5))
    names = {LEADER: tuple(f for f in Assumptions.__slots__)}
    assert breaches(recorded(EGO, [leader]), STRIDE, 0, 30, names, SETTINGS) == ()


def test_a_tighter_bound_is_another_assumption():
    tight = Settings(assumptions=Assumptions(max_braking=6.0))
    leader = car(ROAD, LEADER, driven(40.0, 15.0, -8.0, since=0.5))
    relied = {LEADER: ("max_acceleration", "max_braking")}
    (one,) = breaches(recorded(EGO, [leader]), STRIDE, 0, 30, relied, tight, {LEADER: 9, 8: 1})
    assert (one.assumption, one.allowed) == ("max_braking", 6.0)
    assert one.crashed == pytest.approx(0.6)


def test_what_was_observed_is_no_breach():
    """Lateral speed: who was seen to be fast is predicted so; who becomes so breaks it."""
    turn = np.where(T >= 0.6, np.arcsin(5.0 / 20.0), 0.0)
    d = -3.0 + 5.0 * np.maximum(T - 0.6, 0.0)
    s = 30.0 + np.cumsum(20.0 * np.cos(turn)) * TICK
    changing = car(ROAD, LEADER, rows(ROAD, s, d, 20.0, turn))
    relied = {LEADER: ("max_lateral_speed", "follow_lanes")}
    scene = recorded(EGO, [changing])
    (one,) = breaches(scene, STRIDE, 0, 18, relied, SETTINGS)
    assert (one.assumption, one.allowed) == ("max_lateral_speed", 4.0)
    assert one.value == pytest.approx(5.0, abs=1e-6)
    assert breaches(scene, STRIDE, 12, 18, relied, SETTINGS) == ()
    # What was dropped, and is not named, was not relied on, though lanes were.
    assert breaches(scene, STRIDE, 0, 18, {LEADER: ("follow_lanes",)}, SETTINGS) == ()


@pytest.mark.parametrize(("braking", "at_fault"), [(-20.0, False), (-11.0, True)])
def test_collision_with_one_that_brakes(braking, at_fault):
    leader = driven(12.0, 15.0, braking, since=0.2)
    tick = int(np.argmax(leader[:, 0] - EGO[:, 0] < 4.6))
    assert tick > 6
    others = [car(ROAD, LEADER, leader), car(ROAD, 8, driven(100.0, 15.0, -30.0))]
    crashed = {LEADER: tick, 8: 3, 1: tick}
    one = episode(EGO, others, [told(0, EGO, others), told(1, EGO, others, Operation.CARRIED)])
    one = replace(one, recording=Recording(one.recording.scene, crashed))
    assert partner_of(one, tick) == LEADER
    since, found = before_collision(one, tick, LEADER, SETTINGS)
    assert since == 0
    assert (not found) is at_fault
    assert all(b.vehicle == LEADER and b.time < tick * TICK for b in found)
    # What was broken before the proof is no excuse.
    later = replace(one, steps=(*one.steps, told(2, EGO, others)))
    slow = before_collision(later, 7, LEADER, SETTINGS)
    assert slow == (2, ())
    assert before_collision(one, tick, None, SETTINGS) == (0, ())


def test_hit_from_behind():
    ego = driven(20.0, 8.0)
    behind = car(ROAD, 9, driven(8.0, 20.0))
    beside = car(ROAD, 10, driven(20.0, 8.0, d=2.1))
    others = [behind, beside]
    tick = int(np.argmax(ego[:, 0] - behind.states[:, 0] < 4.6))
    one = episode(ego, others, [told(0, ego, others)], {9: tick, 10: tick})
    assert partner_of(one, tick) == 9
    _, found = before_collision(one, tick, 9, SETTINGS)
    assert [(b.assumption, b.vehicle) for b in found] == [("no_rear_end", 9)]
    assert found[0].value == pytest.approx(12.0)
    assert from_behind(one.recording.scene, 10, tick) is None


@pytest.mark.parametrize(
    ("braking", "operation", "expected"),
    [
        (-8.0, Operation.RENEWED, ["spares_standing"]),
        (-3.0, Operation.RENEWED, []),  # the ego moves still
        (-8.0, Operation.EMERGENCY, []),  # nothing was proven that ends in a standstill
    ],
)
def test_who_stands_is_driven_into(braking, operation, expected):
    ego = driven(20.0, 10.0, braking)
    # From beside, within all bounds: it comes across the lanes at 1 m/s.
    aside = car(ROAD, 9, rows(ROAD, ego[-1, 0] + 0 * T, 4.4 - 1.0 * T, 1.0, -np.pi / 2 + 0 * T))
    tick = int(np.argmax(aside.states[:, 1] < 2.7))
    one = episode(ego, [aside], [told(0, ego, [aside], operation)], {9: tick})
    _, found = before_collision(one, tick, 9, SETTINGS)
    assert [b.assumption for b in found if b.assumption == "spares_standing"] == expected
    if expected:
        assert found[-1].value == pytest.approx(1.0)


def test_nobody_touches():
    far = car(ROAD, LEADER, driven(40.0, 15.0))
    assert partner_of(episode(EGO, [far], [], {LEADER: 5}), 5) is None


@pytest.mark.parametrize(("jump", "explained"), [(True, True), (False, False)])
def test_lost_fail_safe(jump, explained):
    """The leader stops at once; or it keeps its bounds, and the step is called uncovered all the
    same: then nobody is found, and it is said so."""
    leader = driven(20.0, 15.0, -200.0 if jump else -5.0, since=2 * TICK)
    others = [car(ROAD, LEADER, leader), car(ROAD, 8, driven(150.0, 15.0, -200.0))]
    first = told(0, EGO, others)
    assert first.decision.executed is not None
    assert first.decision.executed.proof is not None
    lost = [told(k, EGO, others, Operation.EMERGENCY, covered=False) for k in (2, 3)]
    steps = [first, replace(first, index=1, operation=Operation.CARRIED), *lost]
    found = lapses(episode(EGO, others, steps), SETTINGS)
    assert [(x.step, x.at, x.since) for x in found] == [(2, 2, 0), (3, 2, 0)]
    assert all(x.explained is explained for x in found)
    if explained:
        assert found[0].vehicles == (LEADER,)
        assert {b.vehicle for b in found[0].breaches} == {LEADER}
        assert "max_acceleration" in str(found[0])
    else:
        assert found[0].breaches == ()
        assert "unexplained" in str(found[0])
