"""The truth of a formula on a trace whose atoms may be undecided at some steps.

Within one step the acceleration may change, so that neither `a <= 0.2` nor `a > 0.2` holds all
the time. A formula is therefore brought into negation normal form, and an atom and its negation
become two literals, of which at most one is true. The form is monotone in its literals, so what
is found true holds for every acceleration that occurs within the steps.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from sandra.errors import FormulaError
from sandra.logic import Atom, Formula, Predicate, evaluate, truth
from sandra.logic.formula import (
    And,
    Constant,
    Finally,
    Globally,
    Iff,
    Implies,
    Next,
    Not,
    Or,
    Release,
    Until,
    WeakNext,
    WeakUntil,
)

LARGEST = 20_000
"""Most nodes of a normal form."""


@dataclass(frozen=True, slots=True)
class Decided:
    """At each step, whether an atom is true for sure, and whether its negation is."""

    true: tuple[bool, ...]
    false: tuple[bool, ...]


def holds(formula: Formula, atoms: Mapping[Atom, Decided], steps: int) -> bool:
    """Whether the trace of `steps` letters satisfies the formula for sure.

    Raises:
        FormulaError: if the formula is too large.
        KeyError: if `atoms` lacks one of the formula.
        ValueError: if `steps` is 0.
    """
    return evaluate(*_monotone(formula, atoms, steps))


def first_false(formula: Formula, atoms: Mapping[Atom, Decided], steps: int) -> int | None:
    """For `G p`, the first step at which p does not hold for sure; None for other formulas."""
    if not isinstance(formula, Globally) or (formula.lower, formula.upper) != (0, None):
        return None
    values = truth(*_monotone(formula.operand, atoms, steps))
    return values.index(False) if False in values else None


def _monotone(
    formula: Formula, atoms: Mapping[Atom, Decided], steps: int
) -> tuple[Formula, Sequence[frozenset[Atom]]]:
    """The formula over literals, and the literals that are true at each step."""
    if _size(formula) > LARGEST:
        raise FormulaError("the formula is too large to be checked: use fewer '<->' and '->'")
    names = {atom: i for i, atom in enumerate(atoms)}
    form = _normal(formula, names, False)
    trace = [
        frozenset(
            _literal(i, negated)
            for atom, i in names.items()
            for negated in (False, True)
            if (atoms[atom].false if negated else atoms[atom].true)[k]
        )
        for k in range(steps)
    ]
    return form, trace


def _size(formula: Formula) -> int:
    """Bound of the number of nodes of the normal form."""
    below = sum(_size(p) for p in formula.operands)
    return 1 + (2 * below if isinstance(formula, Implies | Iff) else below)


def _literal(number: int, negated: bool) -> Predicate:
    return Predicate("is_not" if negated else "is", str(number))


def _normal(formula: Formula, names: Mapping[Atom, int], negated: bool) -> Formula:
    """The negation normal form of the formula, or of its negation, over literals."""
    if isinstance(formula, Atom):
        return _literal(names[formula], negated)
    if isinstance(formula, Constant):
        return Constant(formula.value != negated)
    parts = formula.operands
    if isinstance(formula, Not):
        return _normal(parts[0], names, not negated)
    plus = [_normal(p, names, negated) for p in parts]
    # Only these two need an operand both ways: each `<->` doubles what is below it.
    both = isinstance(formula, Implies | Iff)
    minus = [_normal(p, names, not negated) for p in parts] if both else plus
    match formula, negated:
        case (And(), False) | (Or(), True):
            return And(*plus)
        case (Or(), False) | (And(), True):
            return Or(*plus)
        case Implies(), False:
            return Or(minus[0], plus[1])
        case Implies(), True:
            return And(minus[0], plus[1])
        case Iff(), False:
            return Or(And(*plus), And(*minus))
        case Iff(), True:
            return Or(And(plus[0], minus[1]), And(minus[0], plus[1]))
        case (Next(), False) | (WeakNext(), True):
            return Next(*plus)
        case (WeakNext(), False) | (Next(), True):
            return WeakNext(*plus)
        case (Globally(_, low, high), False) | (Finally(_, low, high), True):
            return Globally(plus[0], low, high)
        case (Finally(_, low, high), False) | (Globally(_, low, high), True):
            return Finally(plus[0], low, high)
        case (Until(), False) | (Release(), True):
            return Until(*plus)
        case (Release(), False) | (Until(), True):
            return Release(*plus)
        case WeakUntil(), False:
            return WeakUntil(*plus)
        case WeakUntil(), True:
            # p W q = q R (p | q), so its negation is !q U (!p & !q).
            return Until(plus[1], And(*plus))
    raise TypeError(f"no normal form of {type(formula).__name__}")
