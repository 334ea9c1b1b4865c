"""Random formulas and traces for the tests of this room, in two independent ways."""

import random

from hypothesis import strategies as st

from sandra.logic.formula import (
    And,
    Constant,
    Finally,
    Formula,
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
    compare,
)

PREDICATES = (
    Predicate("in_lane", "left"),
    Predicate("in_lane", "current"),
    Predicate("keeps_lane_speed_limit"),
)
BOUNDS = (-2.0, -0.2, 0.2)
# Values between the bounds, and the bounds themselves.
VALUES = (-3.0, -2.0, -1.0, -0.2, 0.0, 0.2, 1.0)
BINARY = (And, Or, Implies, Iff, Until, Release, WeakUntil)
UNARY = (Not, Next, WeakNext, Globally, Finally)


def random_formula(rng: random.Random, size: int) -> Formula:
    """A formula of about `size` nodes over three predicates and comparisons of a and v."""
    if size <= 1:
        if rng.random() < 0.05:
            return Constant(rng.random() < 0.5)
        if rng.random() < 0.5:
            return rng.choice(PREDICATES)
        return compare(rng.choice("av"), rng.choice(("<", "<=", ">", ">=")), rng.choice(BOUNDS))
    if rng.random() < 0.45:
        kind = rng.choice(UNARY)
        operand = random_formula(rng, size - 1)
        if kind in (Globally, Finally) and rng.random() < 0.4:
            lower = rng.randrange(4)
            return kind(operand, lower, rng.choice((None, lower + rng.randrange(4))))
        return kind(operand)
    left = rng.randrange(1, size) if size > 2 else 1
    return rng.choice(BINARY)(random_formula(rng, left), random_formula(rng, size - left))


def random_step(rng: random.Random) -> tuple[dict[str, float], frozenset[Predicate]]:
    """Values of the variables and the true predicates of one step."""
    return (
        {"a": rng.choice(VALUES), "v": rng.choice(VALUES)},
        frozenset(p for p in PREDICATES if rng.random() < 0.5),
    )


atoms = st.one_of(
    st.sampled_from(PREDICATES),
    st.builds(Predicate, st.just("in_lanelet"), st.integers(0, 10**6).map(str)),
    st.builds(
        compare,
        st.sampled_from("avsd"),
        st.sampled_from(("<", "<=", ">", ">=")),
        st.floats(allow_nan=False, allow_infinity=False),
    ),
    st.builds(Constant, st.booleans()),
)


def _extend(formulas: st.SearchStrategy[Formula]) -> st.SearchStrategy[Formula]:
    timed = st.tuples(st.integers(0, 9), st.none() | st.integers(0, 9)).map(
        lambda b: (b[0], None if b[1] is None else b[0] + b[1])
    )
    return st.one_of(
        st.sampled_from((Not, Next, WeakNext)).flatmap(lambda kind: st.builds(kind, formulas)),
        st.builds(lambda f, b: Globally(f, *b), formulas, timed),
        st.builds(lambda f, b: Finally(f, *b), formulas, timed),
        st.sampled_from(BINARY).flatmap(lambda kind: st.builds(kind, formulas, formulas)),
    )


formulas = st.recursive(atoms, _extend, max_leaves=12)
