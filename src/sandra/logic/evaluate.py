"""The truth of a formula on a finite trace, straight from the definitions.

De Giacomo & Vardi 2013: a trace is not empty; X asks for a next step, N does not. Nothing here is
shared with the automaton but the syntax tree, so that each can be checked against the other.
"""

from __future__ import annotations

from collections.abc import Collection, Container, Iterable, Mapping, Sequence

from sandra.logic.formula import (
    And,
    Atom,
    Comparison,
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
)

Valuation = Mapping[Atom, bool] | Container[Atom]
"""One step: the truth of each atom, or the atoms that are true (all others are false)."""


def evaluate(formula: Formula, trace: Sequence[Valuation]) -> bool:
    """Whether the trace satisfies the formula, that is, at its first step.

    Raises:
        ValueError: if the trace is empty, or a mapping in it lacks an atom of the formula.
    """
    return truth(formula, trace)[0]


def truth(formula: Formula, trace: Sequence[Valuation]) -> tuple[bool, ...]:
    """The truth of the formula at each step of the trace, seen from there to the end.

    Raises:
        ValueError: as `evaluate`.
    """
    n = len(trace)
    if n == 0:
        raise ValueError("a trace has at least one step")
    if isinstance(formula, Constant):
        return (formula.value,) * n
    if isinstance(formula, Atom):
        return tuple(_atom(formula, valuation) for valuation in trace)
    parts = [truth(f, trace) for f in formula.operands]
    return tuple(_at(formula, k, n, *parts) for k in range(n))


def letter(
    atoms: Iterable[Atom], values: Mapping[str, float], predicates: Collection[Predicate]
) -> frozenset[Atom]:
    """The true atoms of one step.

    Args:
        atoms: those of interest.
        values: the state variables that the comparisons name, see `formula.VARIABLES`.
        predicates: the named predicates that are true.

    Raises:
        ValueError: if a value is missing or NaN.
    """
    return frozenset(
        atom
        for atom in atoms
        if (atom in predicates if isinstance(atom, Predicate) else _true(atom, values))
    )


def _true(atom: Atom, values: Mapping[str, float]) -> bool:
    if not isinstance(atom, Comparison) or atom.variable not in values:
        raise ValueError(f"no value to decide '{atom}'")
    return atom.holds(values[atom.variable])


def _atom(atom: Atom, valuation: Valuation) -> bool:
    if not isinstance(valuation, Mapping):
        return atom in valuation
    if atom not in valuation:
        raise ValueError(f"the trace does not say whether '{atom}' is true")
    return valuation[atom]


def _at(formula: Formula, k: int, n: int, p: tuple[bool, ...], q: tuple[bool, ...] = ()) -> bool:
    """The truth at step k of n, given that of the operands p and q at every step."""
    match formula:
        case Not():
            return not p[k]
        case And():
            return p[k] and q[k]
        case Or():
            return p[k] or q[k]
        case Implies():
            return q[k] if p[k] else True
        case Iff():
            return p[k] == q[k]
        case Next():
            return k + 1 < n and p[k + 1]
        case WeakNext():
            return k + 1 == n or p[k + 1]
        case Globally(_, lower, upper):
            return all(p[k + lower : None if upper is None else k + upper + 1])
        case Finally(_, lower, upper):
            return any(p[k + lower : None if upper is None else k + upper + 1])
        case Until():
            return any(q[j] and all(p[k:j]) for j in range(k, n))
        case WeakUntil():
            return all(p[k:]) or any(q[j] and all(p[k:j]) for j in range(k, n))
        case Release():
            return all(q[j] or any(p[k:j]) for j in range(k, n))
    raise TypeError(f"no rule to evaluate {type(formula).__name__}")
