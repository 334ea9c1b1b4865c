import math
import random

import pytest
from hypothesis import given

from logic.random_formulas import formulas, random_formula, random_step
from sandra.logic.evaluate import letter, truth
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
    compare,
    conjunction,
    simplify,
    substitute,
)
from sandra.logic.parser import parse

P, Q = Predicate("p"), Predicate("q")


@given(formulas)
def test_text_parses_back_to_the_same_formula(formula):
    assert parse(str(formula)) == formula


@pytest.mark.parametrize(
    ("formula", "text"),
    [
        (And(And(P, Q), P), "p & q & p"),
        (And(P, And(Q, P)), "p & (q & p)"),
        (Implies(P, Implies(Q, P)), "p -> q -> p"),
        (Implies(Implies(P, Q), P), "(p -> q) -> p"),
        (Until(Until(P, Q), P), "(p U q) U p"),
        (Or(And(P, Q), Not(P)), "p & q | !p"),
        (And(Or(P, Q), P), "(p | q) & p"),
        (Not(Comparison("a", "<=", 0.2)), "a > 0.2"),
        (Not(Not(Comparison("a", "<", -2.0))), "!(a >= -2)"),
        (Globally(Finally(P, 2, 5), 1, None), "G[1,inf](F[2,5](p))"),
    ],
)
def test_text_has_the_parentheses_that_it_needs(formula, text):
    assert str(formula) == text


@pytest.mark.parametrize(
    ("op", "expected"), [("<", [1, 0, 0]), ("<=", [1, 1, 0]), (">", [0, 0, 1]), (">=", [0, 1, 1])]
)
def test_compare_means_what_it_says(op, expected):
    formula = compare("v", op, 1.0)
    for value, holds in zip((0.5, 1.0, 1.5), expected, strict=True):
        true = letter(atoms_of(formula), {"v": value}, ())
        assert truth(formula, [true]) == (bool(holds),)


def test_a_comparison_and_its_complement_are_one_atom():
    assert compare("a", ">", 0.2) == Not(compare("a", "<=", 0.2))
    assert compare("a", ">=", 0.2) == Not(compare("a", "<", 0.2))
    assert compare("a", "<=", -0.0) == compare("a", "<=", 0.0)
    assert str(compare("a", "<=", -0.0)) == "a <= 0"
    assert repr(compare("a", "<=", -0.0)) == repr(compare("a", "<=", 0.0))


@pytest.mark.parametrize(
    ("bound", "text"),
    [
        (2.0, "2"),
        (-0.5, "-0.5"),
        (1e16 - 2, "9999999999999998"),
        (1e16, "1e+16"),
        (-1e16, "-1e+16"),
        (1.5e-7, "1.5e-07"),
    ],
)
def test_bounds_are_written_without_needless_digits(bound, text):
    formula = Comparison("v", "<=", bound)
    assert str(formula) == f"v <= {text}"
    assert parse(str(formula)) == formula


@pytest.mark.parametrize(
    ("op", "bound", "expected"),
    [
        ("<=", math.inf, TRUE),
        ("<", math.inf, TRUE),
        (">", math.inf, FALSE),
        (">=", math.inf, FALSE),
        ("<=", -math.inf, FALSE),
        ("<", -math.inf, FALSE),
        (">", -math.inf, TRUE),
        (">=", -math.inf, TRUE),
    ],
)
def test_an_infinite_limit_is_a_constant(op, bound, expected):
    assert compare("v", op, bound) == expected


def test_nan_is_never_compared():
    with pytest.raises(ValueError, match="finite"):
        compare("v", "<=", math.nan)
    with pytest.raises(ValueError, match="NaN"):
        Comparison("v", "<=", 1.0).holds(math.nan)


@pytest.mark.parametrize(
    "build",
    [
        lambda: Comparison("x", "<=", 1.0),
        lambda: Comparison("v", ">", 1.0),
        lambda: Comparison("v", "<", math.inf),
        lambda: compare("v", "==", 1.0),
        lambda: compare("x", "<", math.inf),
        lambda: Predicate("p(q)"),
        lambda: Predicate("p", "q)"),
        lambda: Globally(P, 3, 2),
        lambda: Finally(P, -1, 2),
    ],
)
def test_impossible_nodes_cannot_be_built(build):
    with pytest.raises(ValueError, match=r".+"):
        build()


def test_formulas_are_values():
    assert Globally(P) == Globally(P)
    assert Globally(P) != Finally(P)
    assert len({Globally(P), Globally(P), Finally(P), Globally(P, 0, 3)}) == 3
    assert Or(And(P, Q), Not(P)) == (P & Q | ~P)


def test_atoms_of():
    formula = parse("G(in_lane(left) -> |a| <= 1) U v < 3")
    assert {str(a) for a in atoms_of(formula)} == {"in_lane(left)", "a <= 1", "a < -1", "v < 3"}


def test_conjunction_of_none_is_true():
    assert conjunction([]) == TRUE
    assert conjunction([TRUE, P, TRUE, Q]) == And(P, Q)


def test_substitute_replaces_every_occurrence():
    formula = Until(P, Globally(Implies(Q, P)))
    assert substitute(formula, {P: FALSE}) == Until(FALSE, Globally(Implies(Q, FALSE)))


def test_simplify_folds_constants():
    assert simplify(Globally(Implies(P, FALSE))) == Globally(Not(P))
    assert simplify(Globally(And(P, TRUE))) == Globally(P)
    assert simplify(Globally(Implies(P, TRUE))) == TRUE


@pytest.mark.parametrize(
    ("formula", "simple"),
    [
        # There is no next step with `false`, and none without `true`.
        (Next(FALSE), FALSE),
        (WeakNext(TRUE), TRUE),
        (Globally(TRUE, 1, 2), TRUE),
        (Finally(FALSE, 1, 2), FALSE),
        (Globally(FALSE, 0, 2), FALSE),
        (Finally(TRUE, 0, 2), TRUE),
    ],
)
def test_simplify_folds_constants_in_time(formula, simple):
    assert simplify(formula) == simple


@pytest.mark.parametrize(
    ("node", "with_true", "with_false"),
    [
        # What becomes of it if a constant is on the left, ...
        (lambda c: Not(c), FALSE, TRUE),
        (lambda c: And(c, P), P, FALSE),
        (lambda c: Or(c, P), TRUE, P),
        (lambda c: Implies(c, P), P, TRUE),
        (lambda c: Iff(c, P), P, Not(P)),
        (lambda c: Until(c, P), Finally(P), P),
        (lambda c: Release(c, P), P, Globally(P)),
        (lambda c: WeakUntil(c, P), TRUE, P),
        # ... and on the right.
        (lambda c: And(P, c), P, FALSE),
        (lambda c: Or(P, c), TRUE, P),
        (lambda c: Implies(P, c), TRUE, Not(P)),
        (lambda c: Implies(Not(P), c), TRUE, P),
        (lambda c: Iff(P, c), P, Not(P)),
        (lambda c: Iff(Not(P), c), Not(P), P),
        (lambda c: Until(P, c), TRUE, FALSE),
        (lambda c: Release(P, c), TRUE, FALSE),
        (lambda c: WeakUntil(P, c), TRUE, Globally(P)),
        (lambda c: Globally(c), TRUE, FALSE),
        (lambda c: Finally(c), TRUE, FALSE),
        (lambda c: Globally(Not(c), 1, 3), Globally(FALSE, 1, 3), TRUE),
        (lambda c: Finally(Not(c), 1, 3), FALSE, Finally(TRUE, 1, 3)),
        (lambda c: Not(Not(Next(c))), Next(TRUE), FALSE),
        (lambda c: Not(WeakNext(c)), FALSE, Not(WeakNext(FALSE))),
    ],
)
def test_simplify_leaves_no_constant_that_is_not_needed(node, with_true, with_false):
    assert simplify(node(TRUE)) == with_true
    assert simplify(node(FALSE)) == with_false


@pytest.mark.parametrize("formula", [Next(TRUE), WeakNext(FALSE), Finally(TRUE, 1, 2)])
def test_simplify_keeps_what_speaks_of_the_end_of_the_trace(formula):
    assert simplify(formula) == formula


def test_simplify_keeps_the_meaning():
    rng = random.Random(5)
    changed = 0
    for _ in range(1500):
        formula = random_formula(rng, rng.randrange(1, 9))
        # Constants in many places, as a settled predicate leaves them.
        settled = {Predicate("in_lane", "left"): rng.choice((TRUE, FALSE))}
        formula = substitute(formula, settled)
        simple = simplify(formula)
        changed += simple != formula
        trace = [letter(atoms_of(formula), *random_step(rng)) for _ in range(rng.randrange(1, 6))]
        assert truth(simple, trace) == truth(formula, trace), (str(formula), str(simple))
    assert changed > 300
