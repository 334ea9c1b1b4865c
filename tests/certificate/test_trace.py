"""What atoms say about a witness, and the truth of formulas with undecided atoms."""

from __future__ import annotations

import itertools
import random
from collections.abc import Sequence
from dataclasses import replace
from types import MappingProxyType

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from certified import HORIZON, constant, made, turning_scene
from logic.random_formulas import random_formula
from reach_scenes import Course
from sandra.certificate import Certificate, check
from sandra.certificate.atoms import Trace, decide, safe_distance_slack, signed_limits
from sandra.certificate.literals import LARGEST, Decided, first_false, holds
from sandra.certificate.trace import trace
from sandra.certificate.types import LaneOf
from sandra.errors import FormulaError
from sandra.logic import Atom, Comparison, Predicate, Vocabulary, evaluate, parse, specification
from sandra.logic.formula import Finally, Formula, Iff, atoms_of
from sandra.scene.types import Region

BASE = made()


def seen(c: Certificate, text: str) -> Decided:
    """The truth of the single atom of a formula."""
    (atom,) = atoms_of(parse(text))
    found = Trace.of(c)
    return decide(found, atom, safe_distance_slack(found))


def claims(c: Certificate, *rules: str) -> Certificate:
    """The same certificate under other rules."""
    spec = specification(c.pair, rules, c.settings, dt=c.dt)
    parts = tuple((p.name, p.text) for p in spec.parts)
    return replace(c, rules=rules, formula=str(spec.formula), parts=parts)


@settings(deadline=None, max_examples=200)
@given(st.integers(0, 2**32))
def test_what_holds_for_sure_holds_under_every_reading(seed: int) -> None:
    """And without undecided atoms it is the plain truth."""
    chance = random.Random(seed)
    formula = random_formula(chance, chance.randint(1, 8))
    atoms = sorted(atoms_of(formula), key=str)
    steps = chance.randint(1, 4)
    for letters in ("tf?", "tf"):
        values = [[chance.choice(letters) for _ in range(steps)] for _ in atoms]
        _compare(formula, atoms, values, steps)


def _compare(formula: Formula, atoms: Sequence[Atom], values: list[list[str]], steps: int) -> None:
    decided = {
        atom: Decided(tuple(v == "t" for v in row), tuple(v == "f" for v in row))
        for atom, row in zip(atoms, values, strict=True)
    }
    found = holds(formula, decided, steps)
    open_places = [(i, k) for i, row in enumerate(values) for k, v in enumerate(row) if v == "?"]
    truths = []
    for choice in itertools.product((True, False), repeat=len(open_places[:6])):
        picked = dict(zip(open_places[:6], choice, strict=True))
        letters = [
            frozenset(
                atom for i, atom in enumerate(atoms) if picked.get((i, k), values[i][k] == "t")
            )
            for k in range(steps)
        ]
        truths.append(evaluate(formula, letters))
    if found:
        assert all(truths)
    if not open_places:
        assert found == truths[0]


def test_a_formula_may_be_too_large() -> None:
    formula: Formula = parse("a > 0")
    for _ in range(9):
        formula = Iff(formula, formula)
    with pytest.raises(FormulaError, match="too large"):
        holds(formula, {}, 1)
    assert LARGEST > 1000

    class Strange(Formula):
        """A connective that nobody knows."""

    with pytest.raises(TypeError, match="Strange"):
        holds(Strange(), {}, 1)


def test_the_first_step_at_which_a_demand_fails() -> None:
    atom = Predicate("in_lane", "left")
    decided = {atom: Decided((True, False, False), (False, True, True))}
    assert first_false(parse("G in_lane(left)"), decided, 3) == 1
    assert first_false(parse("G true"), {}, 3) is None
    assert first_false(Finally(atom), decided, 3) is None
    assert first_false(parse("G[0,1] in_lane(left)"), decided, 3) is None


def test_the_acceleration_of_an_interval_must_be_so_throughout() -> None:
    inputs = np.vstack([constant(0.0, 4), constant(0.5, 1), constant(0.0, 25)])
    c = made(inputs=inputs, pair="keep,follow-lane")
    found = seen(c, "a <= 0.2")
    assert found.true == tuple(k != 2 for k in range(HORIZON + 1))
    assert not any(found.false)
    last = made(inputs=np.vstack([constant(0.0, 28), constant(0.5, 2)]))
    assert seen(last, "a <= 0.2").false[-2:] == (True, True)
    assert seen(last, "a < 0.5").false[-2:] == (True, True)
    assert seen(last, "a <= 0.5").true[-2:] == (True, True)


def test_comparisons_of_the_state() -> None:
    c = made(turning_scene(0.02))
    # s = 0 is where the lane begins, 40 m behind the ego.
    assert seen(c, "s <= 41.5").true == tuple(k <= 1 for k in range(HORIZON + 1))
    assert all(seen(c, ["|d", "<= 0.02 ", "d <= 0.02"][-1]).true)
    assert all(seen(c, "v <= 10").true)
    assert all(seen(c, "v < 10").false)


def test_lanes_and_lanelets() -> None:
    for text in ("in_lane(current)", "in_lanelet(100)"):
        assert all(seen(BASE, text).true)
    for text in ("in_lane(left)", "in_lanelet(101)", "in_lane(right)", "in_lane(opposite)"):
        assert all(seen(BASE, text).false)
    assert all(seen(BASE, "braking_justification").false)
    for text in ("in_lanelet(5)",):
        with pytest.raises(FormulaError, match="cannot be decided"):
            seen(BASE, text)
    with pytest.raises(FormulaError, match="cannot be decided"):
        decide(Trace.of(BASE), Predicate("sings"), np.zeros(1))
    comparison = Comparison("v", "<", 1.0)
    object.__setattr__(comparison, "variable", "z")
    with pytest.raises(FormulaError, match="cannot be compared"):
        decide(Trace.of(BASE), comparison, np.zeros(1))


def with_limits(c: Certificate, **limits: float | None) -> Certificate:
    found = tuple(replace(x, speed_limit=limits.get(f"l{x.id}", 30.0)) for x in c.lanelets)
    return replace(c, lanelets=found)


def test_signed_limits() -> None:
    assert set(signed_limits(Trace.of(with_limits(BASE, l100=12.0)))) == {12.0}
    assert set(signed_limits(Trace.of(with_limits(BASE, l100=None)))) == {np.inf}
    # A stricter lanelet elsewhere does not count.
    assert set(signed_limits(Trace.of(with_limits(BASE, l101=5.0)))) == {30.0}
    # The own lanes go before a lanelet of no lane at the same place.
    twice = replace(BASE, lanelets=(*BASE.lanelets, replace(BASE.lanelets[0], id=9, speed_limit=3)))
    assert set(signed_limits(Trace.of(twice))) == {30.0}
    elsewhere = replace(twice, lanes=(LaneOf("opposite", (100,)),))
    assert set(signed_limits(Trace.of(elsewhere))) == {3.0}
    # In a slit of the map, the nearest; off all lanelets, nothing is allowed.
    for shift, expected in ((0.05, 30.0), (0.2, -np.inf)):
        slit = tuple(
            replace(x, left=x.left + np.array([0.0, side]), right=x.right + np.array([0.0, side]))
            for x, side in zip(BASE.lanelets, (1.75 + shift, 1.75 + shift), strict=True)
        )
        assert set(signed_limits(Trace.of(replace(BASE, lanelets=slit)))) == {expected}
    unowned = tuple(
        replace(x, left=x.left + np.array([0.0, 1.8]), right=x.right + np.array([0.0, 1.8]))
        for x in BASE.lanelets
    )
    assert set(signed_limits(Trace.of(replace(BASE, lanelets=unowned, lanes=())))) == {30.0}


def slack(*cars: tuple[float, float, float], **changes: float | bool) -> np.ndarray:
    """Of the ego at 10 m/s towards cars at (s, d) with a speed, in the first and last letter."""
    course = Course(step=5.0)
    others = [course.car(20 + i, s, d, v) for i, (s, d, v) in enumerate(cars)]
    scene = course.scene(course.lanes(left=1, right=0), others, speed=10.0)
    scene = replace(scene, ego=replace(scene.ego, wheelbase=2.6))
    c = made(scene)
    c = replace(c, settings=c.settings.replace(**changes))
    found = safe_distance_slack(Trace.of(c))
    return found[[0, -1]]


def test_the_safe_distance_to_who_precedes() -> None:
    # 40 m less both halves of 4.5 m, less 100/12 - v^2/24 + 4.
    needed = 100 / 12 + 4.0
    assert slack((40.0, 0.0, 10.0)) == pytest.approx([35.5 - needed + 100 / 24] * 2)
    assert slack((40.0, 0.0, 0.0)) == pytest.approx([35.5 - needed, 20.5 - needed])
    # The nearest one precedes; who is beside, behind or in another lane does not.
    assert slack((60.0, 0.0, 0.0), (40.0, 0.0, 0.0), (-30.0, 0.0, 9.0))[0] == pytest.approx(
        35.5 - needed
    )
    assert slack((15.0, 3.5, 0.0)) == pytest.approx([np.inf, np.inf])
    # Who only reaches into the lane does precede.
    assert slack((15.0, 2.6, 0.0))[0] == pytest.approx(10.5 - needed)
    assert slack() == pytest.approx([np.inf, np.inf])
    assert slack((40.0, 0.0, 0.0), t_d=1.4)[0] == pytest.approx(35.5 - needed - 10.0)


def test_who_comes_towards_the_ego_has_no_speed_along() -> None:
    course = Course(step=5.0)
    scene = course.scene(
        course.lanes(left=1, right=0), [course.car(7, 60.0, 0.0, 5.0, angle=np.pi)], speed=10.0
    )
    found = safe_distance_slack(Trace.of(made(scene)))
    assert found[0] == pytest.approx(55.5 - 100 / 12 - 4.0)


def cutting_in(**changes: float | bool) -> np.ndarray:
    """A disc-shaped car in the left lane that is in the ego's lane from step 5 on."""
    c = made()
    states = c.obstacles[1].states.copy()
    states[5:, 1] = 0.0
    states[0] = np.nan
    other = replace(c.obstacles[1], states=states, outline=Region(np.array([[0.0, 0.0]]), 1.0))
    c = replace(c, obstacles=(other,), settings=c.settings.replace(**changes))
    return np.isfinite(safe_distance_slack(Trace.of(c)))


def test_the_exception_after_a_cut_in() -> None:
    assert cutting_in().tolist() == [k >= 5 for k in range(HORIZON + 1)]
    assert cutting_in(cut_in_exception=True, t_c=0.6).tolist() == [
        k >= 11 for k in range(HORIZON + 1)
    ]
    assert not cutting_in(cut_in_exception=True, t_c=3.0).any()


def test_who_appears_in_the_lane_has_not_cut_in() -> None:
    c = made()
    states = c.obstacles[0].states.copy()
    states[:4] = np.nan
    c = replace(
        c,
        obstacles=(replace(c.obstacles[0], states=states),),
        settings=c.settings.replace(cut_in_exception=True),
    )
    found = np.isfinite(safe_distance_slack(Trace.of(c)))
    assert found.tolist() == [k >= 4 for k in range(HORIZON + 1)]


@pytest.mark.parametrize(
    "kind", ["pedestrian", "trafficIsland", "building", "pillar", "median_strip"]
)
def test_who_is_not_in_traffic_precedes_nobody(kind: str) -> None:
    c = made()
    walker = replace(c.obstacles[0], kind=kind)
    found = safe_distance_slack(Trace.of(replace(c, obstacles=(walker,))))
    assert np.isinf(found).all()


def test_without_r_g1_there_is_no_margin_but_the_trace_holds() -> None:
    report = check(claims(BASE))
    assert report.accepted
    assert report.checked[-1].margin is None


def test_own_rules_are_checked_and_named() -> None:
    assert check(claims(BASE, "G(v <= 13)", "F[0s,0.5s](s > 42)")).accepted
    report = check(claims(BASE, "F(v <= 5)"))
    assert report.violation is not None
    assert report.violation.step is None
    assert "F(v <= 5)" in report.violation.sentence
    report = check(claims(BASE, "G(s <= 45)"))
    assert report.violation is not None
    assert (report.violation.step, report.violation.time) == (6, pytest.approx(0.6))


def test_a_lanelet_that_is_not_there_cannot_be_decided() -> None:
    report = check(claims(BASE, "G(!in_lanelet(77))"))
    assert report.violation is not None
    assert report.violation.condition == "trace"
    assert "cannot be decided" in report.violation.sentence


def test_own_words_are_kept_and_told() -> None:
    words = Vocabulary.default()
    own = Vocabulary(
        words.actions, {**words.rules, "slow": "G(v <= 11)"}, words.predicates, words.descriptions
    )
    spec = specification(BASE.pair, ("slow",), BASE.settings, own, BASE.dt)
    c = replace(
        BASE,
        rules=("slow",),
        formula=str(spec.formula),
        parts=tuple((p.name, p.text) for p in spec.parts),
        vocabulary=MappingProxyType(
            {"actions": own.actions, "rules": own.rules, "predicates": own.predicates}
        ),
    )
    report = check(c)
    assert report.accepted
    assert "own vocabulary" in str(report)


def test_a_specification_that_cannot_be_made_is_no_trace() -> None:
    answer = trace(replace(BASE, rules=("nonsense",)))
    assert "unknown rule" in answer.sentence
