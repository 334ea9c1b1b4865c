"""Rollouts: sound certificates survive, corrupted ones are found out, bounds are kept."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from certified import made, turning_scene
from prediction.referee import Road as OtherRoad
from prediction.referee import first_breach
from prediction.traffic import CAR, car
from rollout_scenes import (
    LEFT,
    RIGHT,
    leader,
    narrow,
    sound,
    stopping,
    two_lanes,
    with_assumptions,
    without,
)
from sandra.actions import ActionPair
from sandra.certificate import check
from sandra.certify import Basis, Proven, certify
from sandra.evaluation.rollouts.actors import actors_of
from sandra.evaluation.rollouts.adversary import KINDS, plans
from sandra.evaluation.rollouts.ego import execute
from sandra.evaluation.rollouts.outcome import Played
from sandra.evaluation.rollouts.referee import judge
from sandra.evaluation.rollouts.road import Road
from sandra.evaluation.rollouts.rollout import play
from sandra.evaluation.rollouts.routes import routes_of
from sandra.evaluation.rollouts.traffic import Ego, simulate
from sandra.prediction import predict
from sandra.reach import ground, verify_pair
from sandra.scene.types import Obstacle, Region, State
from sandra.settings import Assumptions, Settings

TRAFFIC = (
    leader(),
    car(8, -100.0 + 8.0, LEFT, speed=12.0),
    car(9, -100.0 - 15.0, RIGHT, speed=12.0),
    car(10, -100.0 - 30.0, LEFT, speed=20.0),
)
WALKER = Obstacle(11, "pedestrian", Region.disc(0.3), State(-70.0, -1.5, 0.0, 1.0))


def collisions(found: Played) -> int:
    return sum(e.what == "collision" for e in found.events)


def test_a_sound_certificate_survives_what_comes_near() -> None:
    now = two_lanes(*TRAFFIC, WALKER)
    found = play(sound(stopping(now)), now, 180, 1)
    assert found.events == ()
    assert found.rules == ()
    assert found.others == 5
    assert found.admissible.mean() > 0.95
    assert found.deviation < 1e-6
    for kind in range(len(KINDS)):
        assert found.distance[found.kind == kind].min() < 3.0, KINDS[kind]
    assert found.distance.min() > 0.0
    assert found.cut_ins > 0


def test_braking_too_late_is_found() -> None:
    """A fail-safe that goes on for 1 s before it brakes: no checker would accept it."""
    now = two_lanes(leader())
    found = play(stopping(now, wait=1.0), now, 60, 1)
    assert collisions(found) > 10
    assert {"brake", "search"} <= {e.kind for e in found.events}
    event = found.events[0]
    assert event.obstacle == 7
    assert 0.5 < event.time < 3.1


def test_others_that_brake_harder_than_assumed_are_found() -> None:
    now = two_lanes(leader())
    c = sound(stopping(now))
    assert collisions(play(c, now, 60, 1)) == 0
    assert collisions(play(with_assumptions(c, max_acceleration=36.0), now, 60, 1)) > 5


def test_a_prediction_with_loosened_bounds_is_found() -> None:
    """Accepted with others that brake with 2 m/s^2; they do with 12."""
    now = two_lanes(leader())
    c = sound(stopping(now, braking=2.5, settings=narrow(max_acceleration=2.0)))
    assert collisions(play(c, now, 60, 1)) == 0
    assert collisions(play(with_assumptions(c, max_acceleration=12.0), now, 60, 1)) > 5


@pytest.mark.parametrize(
    ("other", "names"),
    [
        (car(9, -100.0 - 15.0, RIGHT, speed=12.0), ("no_rear_end",)),
        (car(8, -100.0 - 8.0, LEFT, speed=12.0), ("legal_cut_in", "no_rear_end")),
    ],
)
def test_nothing_is_excused_by_an_assumption_that_is_not_listed(
    other: Obstacle, names: tuple[str, ...]
) -> None:
    now = two_lanes(other)
    c = sound(stopping(now))
    assert set(names) <= set(c.obstacles[0].assumptions)
    assert play(c, now, 60, 1).events == ()
    found = play(without(c, *names), now, 60, 1)
    assert collisions(found) > 0


def test_who_comes_in_behind_must_not_drive_into_the_ego_and_the_certificate_says_so() -> None:
    """Beside the ego now, behind it in its lane later: both assumptions are relied on."""
    now = two_lanes(car(8, -100.0 - 8.0, LEFT, speed=12.0))
    c = sound(stopping(now))
    assert {"legal_cut_in", "no_rear_end"} <= set(c.obstacles[0].assumptions)
    assert collisions(play(without(c, "no_rear_end"), now, 90, 1)) + sum(
        e.what == "after a cut-in" for e in play(without(c, "no_rear_end"), now, 90, 1).events
    )


def test_a_mild_fail_safe_is_caught_by_a_legal_cut_in_and_the_checker_knows() -> None:
    """d_safe counts on a_min: 2 m/s^2 is not what the law grants a follower."""
    now = two_lanes(car(8, -100.0 + 14.0, LEFT, speed=20.0), speed=18.0)
    mild = stopping(now, braking=2.0)
    refused = check(mild).violation
    assert refused is not None
    assert refused.condition == "cut-in"
    caught = [e for e in play(mild, now, 120, 3).events if e.what == "after a cut-in"]
    assert caught
    assert all(e.avoided for e in caught)
    assert play(sound(stopping(now, braking=6.0)), now, 120, 3).events == ()


@pytest.mark.parametrize("speed", [12.0, 25.0])
def test_the_planner_brakes_hard_enough_for_legal_cut_ins(speed: float) -> None:
    """Nobody else is near: without this, the mildest fail-safe would be kept."""
    now = two_lanes(car(8, -100.0 + 14.0, LEFT, speed=speed), speed=speed)
    settings = Settings(horizon=10)
    base = ground(now, predict(now, "most-likely", 10, settings), settings)
    pair = ActionPair.parse("keep,follow-lane")
    verdict = certify(Basis.of(base), verify_pair(base, pair, (), reasons=False))
    assert isinstance(verdict.proof, Proven)
    found = play(verdict.proof.certificate, now, 120, 1)
    assert found.events == ()
    assert found.cut_ins > 20
    assert found.distance.min() < 3.0


def test_the_same_seed_gives_the_same_rollouts() -> None:
    now = two_lanes(*TRAFFIC)
    c = stopping(now)
    first, again, other = (play(c, now, 30, seed) for seed in (5, 5, 6))
    assert np.array_equal(first.distance, again.distance)
    assert not np.array_equal(first.distance, other.distance)


def test_two_referees_agree_on_adversaries() -> None:
    """Each motion keeps the assumptions by the referee that judges predictions, too."""
    now = two_lanes(car(8, -80.0, LEFT, speed=15.0))
    c = stopping(now)
    rng = np.random.default_rng(0)
    road, drive = Road(now), execute(c)
    actors = actors_of(c, now, drive, road)
    routes = routes_of(actors, road, drive, rng)
    kinds = np.repeat(np.arange(len(KINDS)), 10)
    wanted = plans(kinds, [routes.of(0)] * len(kinds), 2.0, rng)
    motion = simulate(
        [actors[0]] * len(kinds), wanted, routes, drive, Ego.of(drive, road, 4.5), c.settings
    )
    judged = judge(actors[0], motion, np.arange(len(kinds)), drive, road, c.settings)
    assert (judged.name == "").mean() > 0.95
    other = OtherRoad(now.lanelets)
    # The other referee knows no slip: it reads the heading as the course.
    a = Assumptions(max_acceleration=12.0 + 1e-6)
    agreed = 0
    for b in np.flatnonzero((judged.name == "") & (wanted.slip == 0.0)):
        v = motion.velocity[:, b]
        speed = np.hypot(*v.T)
        states = np.column_stack(
            [motion.position[:, b], motion.heading[:, b], speed, np.zeros_like(speed)]
        )
        assert first_breach(states, CAR, drive.step, other, a, noise=1e-6) == (len(states), None)
        agreed += 1
    assert agreed > 10


def test_who_breaks_an_assumption_is_caught() -> None:
    """The referee, against motions that were driven with larger bounds."""
    now = two_lanes(car(8, -98.0, LEFT, speed=12.0))
    c = stopping(now)
    rng = np.random.default_rng(0)
    road, drive = Road(now), execute(c)
    actor = actors_of(c, now, drive, road)[0]
    routes = routes_of((actor,), road, drive, rng)
    kinds = np.repeat([1, 3], 20)
    wanted = plans(kinds, [routes.of(0)] * len(kinds), 2.0, rng)
    ego = Ego.of(drive, road, 4.5)

    def breaches(**wider: float) -> set[str]:
        free = replace(actor, **wider)  # type: ignore[arg-type]
        motion = simulate([free] * len(kinds), wanted, routes, drive, ego, c.settings)
        judged = judge(actor, motion, np.arange(len(kinds)), drive, road, c.settings)
        return set(judged.name) - {""}

    assert "max_acceleration" in breaches(a_max=13.0)
    assert "max_lateral_speed" in breaches(lateral=6.0)
    listed = actor
    actor = replace(listed, braking=5.0, driving=3.0)
    assert not {"max_braking", "max_driving"} & breaches()
    assert "max_braking" in breaches(braking=5.5)
    assert "max_driving" in breaches(driving=3.5)
    actor = listed
    assert "legal_cut_in" in breaches(listed=actor.listed - {"legal_cut_in"})
    slow = replace(actor, v_max=15.0)
    motion = simulate([actor] * len(kinds), wanted, routes, drive, ego, c.settings)
    assert "max_speed" in judge(slow, motion, np.arange(40), drive, road, c.settings).name


def test_the_ego_is_driven_by_its_inputs_not_by_what_is_claimed() -> None:
    c = made(turning_scene(0.02, others=False))
    drive = execute(c)
    assert drive.step <= 0.02
    assert drive.deviation < 1e-5
    shifted = c.witness.states.copy()
    shifted[1:, 0] += 0.5
    claimed = replace(c, witness=replace(c.witness, states=shifted))
    assert execute(claimed).deviation == pytest.approx(0.5, abs=1e-5)
    assert np.array_equal(execute(claimed).states, drive.states)


def test_broken_rules_of_the_ego_are_named() -> None:
    from sandra.evaluation.rollouts.rules import broken

    now = two_lanes(leader())
    c = stopping(now)
    road, drive = Road(now), execute(c)
    assert broken(replace(c, rules=("R_G1", "R_G2", "R_G3")), drive, road) == []
    hard = drive.acceleration.copy()
    hard[0] = -3.0
    assert broken(replace(c, rules=("R_G2",)), replace(drive, acceleration=hard), road) == ["R_G2"]
    slow = tuple(replace(x, speed_limit=5.0) for x in c.lanelets)
    assert broken(replace(c, rules=("R_G3",), lanelets=slow), drive, road) == ["R_G3"]
    near = two_lanes(leader(x=-100.0 + 10.0))
    c = stopping(near)
    assert broken(replace(c, rules=("R_G1",)), execute(c), Road(near)) == ["R_G1"]


def test_a_distance_that_another_takes_away_is_counted_apart(tmp_path: Path) -> None:
    now = two_lanes(leader(x=-100.0 + 12.75))
    c = replace(stopping(now), rules=("R_G1",))
    found = play(c, now, 60, 1)
    assert found.rules == ()
    assert 0 < found.shortfalls < 60
