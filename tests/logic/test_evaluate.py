import random

import pytest

from logic.random_formulas import random_formula, random_step
from sandra.logic.evaluate import evaluate, letter, truth
from sandra.logic.formula import (
    FALSE,
    TRUE,
    And,
    Comparison,
    Finally,
    Globally,
    Iff,
    Implies,
    Next,
    Not,
    Or,
    Predicate,
    Release,
    Until,
    WeakNext,
    WeakUntil,
    atoms_of,
)
from sandra.logic.translation import translate

P, Q = Predicate("p"), Predicate("q")
LETTERS = [frozenset(), frozenset({P}), frozenset({Q}), frozenset({P, Q})]


def all_traces(longest):
    """Every trace over p and q of up to `longest` steps."""
    traces = [[x] for x in LETTERS]
    yield from traces
    for _ in range(longest - 1):
        traces = [[*t, x] for t in traces for x in LETTERS]
        yield from traces


TRACES = list(all_traces(4))


def test_all_traces_are_there():
    assert len(TRACES) == 4 + 16 + 64 + 256


IDENTITIES = {
    "FG is the last step": (Finally(Globally(P)), Finally(And(P, WeakNext(FALSE)))),
    "GF is FG": (Globally(Finally(P)), Finally(Globally(P))),
    "not X is N not": (Not(Next(P)), WeakNext(Not(P))),
    "not N is X not": (Not(WeakNext(P)), Next(Not(P))),
    "not G is F not": (Not(Globally(P)), Finally(Not(P))),
    "not U is R": (Not(Until(P, Q)), Release(Not(P), Not(Q))),
    "not R is U": (Not(Release(P, Q)), Until(Not(P), Not(Q))),
    "W is U or G": (WeakUntil(P, Q), Or(Until(P, Q), Globally(P))),
    "W is R": (WeakUntil(P, Q), Release(Q, Or(P, Q))),
    "F is true U": (Finally(P), Until(TRUE, P)),
    "G is false R": (Globally(P), Release(FALSE, P)),
    "U unfolds": (Until(P, Q), Or(Q, And(P, Next(Until(P, Q))))),
    "R unfolds": (Release(P, Q), And(Q, Or(P, WeakNext(Release(P, Q))))),
    "G unfolds": (Globally(P), And(P, WeakNext(Globally(P)))),
    "F unfolds": (Finally(P), Or(P, Next(Finally(P)))),
    "bounded G": (Globally(P, 1, 2), And(WeakNext(P), WeakNext(WeakNext(P)))),
    "bounded F": (Finally(P, 1, 2), Or(Next(P), Next(Next(P)))),
    "bounded G from now": (Globally(P, 0, 1), And(P, WeakNext(P))),
    "bounded F from now": (Finally(P, 0, 1), Or(P, Next(P))),
    "bounded to the end": (Globally(P, 2, None), WeakNext(WeakNext(Globally(P)))),
    "bounded F to the end": (Finally(P, 2, None), Next(Next(Finally(P)))),
    "bounded dual": (Not(Globally(P, 1, 3)), Finally(Not(P), 1, 3)),
    "one step": (Finally(P, 0, 0), P),
    "iff": (Iff(P, Q), And(Implies(P, Q), Implies(Q, P))),
}


@pytest.mark.parametrize("name", IDENTITIES)
def test_identity_by_evaluation_and_by_automaton(name):
    left, right = IDENTITIES[name]
    assert all(truth(left, t) == truth(right, t) for t in TRACES)
    assert translate(left) == translate(right)
    a, b = translate(left), translate(right)
    assert all(a.accepts(t) == b.accepts(t) == evaluate(left, t) for t in TRACES)


@pytest.mark.parametrize(
    ("left", "right"),
    [
        (Next(P), WeakNext(P)),
        (Until(P, Q), WeakUntil(P, Q)),
        (Globally(P), Finally(P)),
        (Until(P, Q), Until(Q, P)),
        (Finally(P, 1, 2), Finally(P, 0, 2)),
        (Globally(P, 1, 2), Globally(P, 1, 3)),
        (Next(TRUE), TRUE),
    ],
)
def test_what_is_different_is_told_apart(left, right):
    assert any(evaluate(left, t) != evaluate(right, t) for t in TRACES)
    assert translate(left) != translate(right)


@pytest.mark.parametrize("formula", [Finally(Globally(P)), Globally(Finally(P))])
def test_fg_and_gf_are_the_last_step(formula):
    assert all(evaluate(formula, t) == (P in t[-1]) for t in TRACES)


def test_at_the_last_step_next_is_false_and_weak_next_is_true():
    assert truth(Next(TRUE), [LETTERS[0]] * 3) == (True, True, False)
    assert truth(WeakNext(FALSE), [LETTERS[0]] * 3) == (False, False, True)


def test_until_needs_its_end_and_release_does_not():
    only_p = [frozenset({P})] * 3
    assert not evaluate(Until(P, Q), only_p)
    assert evaluate(WeakUntil(P, Q), only_p)
    assert evaluate(Release(Q, P), only_p)
    # R asks for its right side also at the step that releases it.
    assert not evaluate(Release(Q, P), [frozenset({P}), frozenset({Q})])
    assert evaluate(Release(Q, P), [frozenset({P, Q}), frozenset()])


def test_an_empty_trace_has_no_truth():
    with pytest.raises(ValueError, match="at least one step"):
        evaluate(TRUE, [])


def test_mappings_say_true_and_false_and_must_be_complete():
    assert evaluate(Globally(P), [{P: True}, {P: True}])
    assert not evaluate(Globally(P), [{P: True}, {P: False}])
    with pytest.raises(ValueError, match="does not say whether 'q'"):
        evaluate(Q, [{P: True}])


def test_letter_from_values():
    slow, brakes = Comparison("v", "<=", 0.1), Comparison("a", "<", -2.0)
    found = letter([slow, brakes, P, Q], {"v": 0.1, "a": -2.0}, {Q})
    assert found == {slow, Q}
    with pytest.raises(ValueError, match="no value"):
        letter([slow], {"a": 0.0}, ())
    with pytest.raises(ValueError, match="NaN"):
        letter([slow], {"v": float("nan")}, ())


def test_automaton_and_evaluation_agree_on_10000_random_pairs():
    rng = random.Random(2026)
    accepted = pairs = 0
    while pairs < 10_000:
        formula = random_formula(rng, rng.randrange(1, 10))
        dfa = translate(formula)
        atoms = atoms_of(formula)
        for _ in range(5):
            trace = [letter(atoms, *random_step(rng)) for _ in range(rng.randrange(1, 8))]
            expected = evaluate(formula, trace)
            assert dfa.accepts(trace) == expected, (str(formula), trace)
            accepted += expected
            pairs += 1
    # Neither answer is rare, so that agreement means something.
    assert 0.3 < accepted / pairs < 0.7
