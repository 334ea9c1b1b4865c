"""What must not change a verdict, and what can only make it worse.

Another obstacle, another rule, or a smaller range of inputs leaves fewer trajectories: nothing that
was UNSAFE may become REACHABLE or CERTIFIED. Another order, a second time, or another thread
changes nothing at all. Each property is also shown a verifier that is broken on purpose.
"""

from __future__ import annotations

import random
import sys
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import sandra
from random_scenes import Drawn, draw, obstacle
from sandra.actions import ALL_PAIRS, ActionPair
from sandra.certificate import check
from sandra.certify import Basis, Proven, certify
from sandra.logic import Specification, specification
from sandra.prediction import predict
from sandra.reach import (
    Ground,
    ReachableSet,
    Status,
    Verdict,
    compute,
    ground,
    verify_on,
    verify_pair,
)
from sandra.scene import Scene
from sandra.settings import Settings

SEEDS = st.integers(0, 2**32 - 1)
PREDICTIONS = st.sampled_from(["most-likely", "set-based"])
HORIZON = 8
SETTINGS = Settings(horizon=HORIZON)
RULES = ("R_G1", "R_G2", "R_G3")
MORE_RULES = (
    *RULES,
    "G(v <= 9)",
    "G(d <= 0.4)",
    "F(v >= 8 & X(v < 8))",
    "in_lane(current) U in_lane(left)",
    "!in_lane(right)",
)
SMALLER = {
    "a_lon_max": (1.0, 6.0),
    "a_lon_min": (-6.0, -1.0),
    "a_lat_max": (1.0, 4.0),
    "v_max": (10.0, 30.0),
}
"""Bounds on the ego, and the values from which another one is drawn."""


def crowded(seed: int) -> Drawn:
    """A random scene in which others often leave no room."""
    return draw(seed, most=6)


Verifier = Callable[[Ground, tuple[str, ...]], Iterable[Verdict]]


def all_pairs(base: Ground, rules: tuple[str, ...] = ()) -> Iterable[Verdict]:
    return verify_on(base, ALL_PAIRS, rules, reasons=False)


def ground_of(scene: Scene, prediction: str, values: Settings = SETTINGS) -> Ground:
    return ground(scene, predict(scene, prediction, values.horizon, values), values)


def never_better(easier: Iterable[Verdict], harder: Iterable[Verdict]) -> None:
    """What is UNSAFE where more is allowed must be UNSAFE where less is."""
    for before, after in zip(easier, harder, strict=True):
        if before.status is Status.UNSAFE:
            assert after.status is Status.UNSAFE, f"{before} became {after.status.value}"


def unchanged(before: Iterable[Verdict], after: Iterable[Verdict]) -> None:
    """The same verdicts with the same sets, corner for corner, and for the same reasons."""
    for a, b in zip(before, after, strict=True):
        assert (a.pair, a.status, a.reason) == (b.pair, b.status, b.reason)
        assert a.reachable_set.steps == b.reachable_set.steps


# ------------------------------------------------------------------ one more obstacle


def another_obstacle(
    drawn: Drawn, seed: int, prediction: str, rules: tuple[str, ...], verifier: Verifier = all_pairs
) -> None:
    """With R_G1 only one that stands: a fast car may hide a slower one that is farther ahead, and
    less distance is asked to it."""
    rng = np.random.default_rng(seed)
    other = obstacle(drawn.road, 99, rng, [0, 0, 1, -1], leftmost=1)
    if "R_G1" in rules:
        other = replace(other, state=replace(other.state, speed=0.0), is_static=True)
    more = replace(drawn.scene, obstacles=(*drawn.scene.obstacles, other))
    easier = verifier(ground_of(drawn.scene, prediction), rules)
    never_better(easier, verifier(ground_of(more, prediction), rules))


@settings(max_examples=12, deadline=None)
@given(SEEDS, PREDICTIONS, st.sampled_from([(), RULES[1:], RULES]))
def test_another_obstacle_makes_nothing_better(
    seed: int, prediction: str, rules: tuple[str, ...]
) -> None:
    another_obstacle(crowded(seed), seed + 1, prediction, rules)


def looks_at_the_last_obstacle_only(base: Ground, rules: tuple[str, ...]) -> Iterable[Verdict]:
    """Broken: the forbidden cells of each obstacle replace those of the one before."""
    others = range(len(base.prediction.obstacles) - 1)
    blind = base
    for index in others:
        by_obstacle = list(blind.by_obstacle)
        by_obstacle[index] = ((),) * (base.horizon + 1)
        blind = replace(blind, by_obstacle=tuple(by_obstacle))
    return all_pairs(replace(blind, forbidden=blind.forbidden_without(None)), rules)


def test_a_verifier_that_forgets_obstacles_is_noticed() -> None:
    with pytest.raises(AssertionError, match="became REACHABLE"):
        another_obstacle(crowded(15), 15, "most-likely", (), looks_at_the_last_obstacle_only)


def test_a_fast_car_in_between_may_make_r_g1_easier() -> None:
    """Why the property leaves moving obstacles out under R_G1: it speaks of the nearest only."""
    road = draw(0).road
    slow, fast = road.obstacle(2, 20.0, 0.0, 0.0), road.obstacle(3, 10.0, 0.0, 30.0)
    scene = road.scene(slow, speed=12.0, dt=0.1)
    pair = [ActionPair.parse("decelerate,follow-lane")]
    values = Settings(horizon=1)
    alone, hidden = (
        verify_on(ground_of(x, "most-likely", values), pair, ["R_G1"])[0]
        for x in (scene, replace(scene, obstacles=(slow, fast)))
    )
    assert alone.status is Status.UNSAFE
    assert hidden.status is Status.REACHABLE


# ------------------------------------------------------------------ one more rule


def another_rule(
    base: Ground, rules: tuple[str, ...], rule: str, verifier: Verifier = all_pairs
) -> None:
    never_better(verifier(base, rules), verifier(base, (*rules, rule)))


@settings(max_examples=12, deadline=None)
@given(
    SEEDS,
    PREDICTIONS,
    st.lists(st.sampled_from(MORE_RULES), max_size=2, unique=True),
    st.sampled_from(MORE_RULES),
)
def test_another_rule_makes_nothing_better(
    seed: int, prediction: str, rules: list[str], rule: str
) -> None:
    another_rule(ground_of(crowded(seed).scene, prediction), tuple(rules), rule)


def rule_replaces_action(base: Ground, rules: tuple[str, ...]) -> Iterable[Verdict]:
    """Broken: a rule on the acceleration takes the place of the longitudinal action's range."""
    for pair in ALL_PAIRS:
        spec = specification(pair, rules, base.settings, dt=base.scene.dt)
        if "R_G2" in rules:
            spec = spec.without(pair.longitudinal.value)
        yield verdict_of(spec, compute(base, spec))


def verdict_of(spec: Specification, found: ReachableSet) -> Verdict:
    status = Status.REACHABLE if found.first_empty_step is None else Status.UNSAFE
    return Verdict(spec.pair, status, spec, found, None, 0.0)


def test_a_rule_that_replaces_an_action_is_noticed() -> None:
    base = ground_of(draw(0).scene, "most-likely")
    with pytest.raises(AssertionError, match="became REACHABLE"):
        another_rule(base, (), "R_G2", rule_replaces_action)


# ------------------------------------------------------------------ a smaller range of inputs


def smaller_range(
    scene: Scene, prediction: str, name: str, share: float, verifier: Verifier = all_pairs
) -> None:
    low, high = SMALLER[name]
    values = SETTINGS.replace(**{name: low + share * (high - low)})
    easier = verifier(ground_of(scene, prediction), ())
    never_better(easier, verifier(ground_of(scene, prediction, values), ()))


@settings(max_examples=12, deadline=None)
@given(SEEDS, PREDICTIONS, st.sampled_from(sorted(SMALLER)), st.floats(0.0, 1.0))
def test_a_smaller_range_of_inputs_makes_nothing_better(
    seed: int, prediction: str, name: str, share: float
) -> None:
    smaller_range(crowded(seed).scene, prediction, name, share)


def reads_another_bound_in_feet(base: Ground, rules: tuple[str, ...]) -> Iterable[Verdict]:
    """Broken: a lateral bound that is not the usual one is taken for one in another unit."""
    bound = base.settings.a_lat_max
    wrong = base.settings.replace(a_lat_max=bound if bound == SETTINGS.a_lat_max else 3.28 * bound)
    return all_pairs(replace(base, settings=wrong), rules)


def test_a_range_in_another_unit_is_noticed() -> None:
    scene = crowded(15).scene
    with pytest.raises(AssertionError, match="became REACHABLE"):
        smaller_range(scene, "most-likely", "a_lat_max", 0.9, reads_another_bound_in_feet)


# ------------------------------------------------------------------ nothing changes


OneByOne = Callable[[Ground, ActionPair, tuple[str, ...]], Verdict]


def again_and_elsewhere(base: Ground, rules: tuple[str, ...], seed: int, one: OneByOne) -> None:
    """Another order, a second time, and in several threads at once."""
    expected = [one(base, pair, rules) for pair in ALL_PAIRS]
    order = list(range(len(ALL_PAIRS)))
    random.Random(seed).shuffle(order)
    shuffled = {i: one(base, ALL_PAIRS[i], rules) for i in order}
    unchanged(expected, [shuffled[i] for i in range(len(ALL_PAIRS))])
    unchanged(expected, [one(base, pair, rules) for pair in ALL_PAIRS])
    interval = sys.getswitchinterval()
    sys.setswitchinterval(1e-5)
    try:
        with ThreadPoolExecutor(4) as pool:
            parallel = list(pool.map(lambda pair: one(base, pair, rules), ALL_PAIRS))
    finally:
        sys.setswitchinterval(interval)
    unchanged(expected, parallel)


@settings(max_examples=4, deadline=None)
@given(SEEDS, PREDICTIONS, st.sampled_from([(), RULES]))
def test_order_repetition_and_threads_change_nothing(
    seed: int, prediction: str, rules: tuple[str, ...]
) -> None:
    again_and_elsewhere(ground_of(crowded(seed).scene, prediction), rules, seed, verify_pair)


def test_a_range_left_over_from_the_pair_before_is_noticed() -> None:
    left_over = [SETTINGS.a_lon_max]

    def stateful(base: Ground, pair: ActionPair, rules: tuple[str, ...]) -> Verdict:
        found = verify_pair(
            replace(base, settings=base.settings.replace(a_lon_max=left_over[0])), pair, rules
        )
        left_over[0] = 0.2 if pair.longitudinal.value == "keep" else SETTINGS.a_lon_max
        return found

    with pytest.raises(AssertionError):
        again_and_elsewhere(ground_of(draw(3).scene, "most-likely"), (), 3, stateful)


# ------------------------------------------------------------------ the shipped scenarios


@cache
def shipped(name: str) -> Scene:
    return sandra.load(sandra.example(name))


@pytest.mark.parametrize("name", sorted(sandra.examples()))
def test_shipped_scenarios(name: str) -> None:
    """Rules one after another, then each of three obstacles taken away, then less of each input."""
    scene = shipped(name)
    values = Settings(horizon=10)
    base = ground_of(scene, "set-based", values)
    free = list(all_pairs(base))
    ruled = free
    for count in (1, 2, 3):
        more = list(all_pairs(base, RULES[:count]))
        never_better(ruled, more)
        ruled = more
    for index in range(min(3, len(scene.obstacles))):
        forbidden = base.forbidden_without(index)
        fewer = [
            verdict_of(v.specification, compute(base, v.specification, forbidden)) for v in free
        ]
        never_better(fewer, free)
    for name_, value in (("a_lon_max", 3.0), ("a_lon_min", -3.0), ("a_lat_max", 2.0)):
        smaller = replace(base, settings=values.replace(**{name_: value}))
        never_better(free, all_pairs(smaller))
    unchanged(free, all_pairs(ground_of(scene, "set-based", values)))


# ------------------------------------------------------------------ certificates


def certified(base: Ground, rules: tuple[str, ...] = ()) -> list[Verdict]:
    basis = Basis.of(base)
    return [certify(basis, verdict, rules) for verdict in all_pairs(base, rules)]


@settings(max_examples=2, deadline=None)
@given(SEEDS)
def test_certificates_survive_fewer_obstacles_and_more_freedom(seed: int) -> None:
    """No CERTIFIED pair was UNSAFE where more is allowed, and its proof holds there as well."""
    drawn = draw(seed, dt=0.2)
    scene = drawn.scene
    other = obstacle(drawn.road, 99, np.random.default_rng(seed), [0, 0, 1, -1], leftmost=1)
    harder = SETTINGS.replace(a_lon_max=4.0)
    more = replace(scene, obstacles=(*scene.obstacles, other))
    easier = list(all_pairs(ground_of(scene, "most-likely")))
    found = certified(ground_of(more, "most-likely", harder))
    never_better(easier, found)
    unchanged(found, certified(ground_of(more, "most-likely", harder)))
    for verdict in found:
        if isinstance(proof := verdict.proof, Proven):
            loosened = replace(
                proof.certificate,
                obstacles=proof.certificate.obstacles[:-1],
                settings=SETTINGS,
            )
            assert check(loosened).accepted
