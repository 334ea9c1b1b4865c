"""What remains of a formula after a letter, and which accelerations it admits.

Formula progression (Bacchus & Kabanza 1998): the search of `grid_search` carries along what a
trajectory still has to satisfy. It needs no automaton, and shares none with `sandra.logic`.
"""

from __future__ import annotations

from collections.abc import Mapping
from itertools import pairwise

import numpy as np

from grid_world import holds
from sandra.logic import Atom, Comparison, Formula
from sandra.logic.evaluate import evaluate
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
    atoms_of,
)

TRUE, FALSE = Constant(True), Constant(False)


def conjunction(*parts: Formula) -> Formula:
    return _joined(And, FALSE, TRUE, parts)


def disjunction(*parts: Formula) -> Formula:
    return _joined(Or, TRUE, FALSE, parts)


def _joined(
    kind: type[And] | type[Or], ends: Formula, neutral: Formula, parts: tuple[Formula, ...]
) -> Formula:
    flat: dict[str, Formula] = {}
    waiting = list(parts)
    while waiting:
        part = waiting.pop()
        if part == ends:
            return ends
        if isinstance(part, kind):
            waiting += part.operands
        elif part != neutral:
            flat[str(part)] = part
    found = neutral
    for name in sorted(flat):
        found = flat[name] if found == neutral else kind(found, flat[name])
    return found


def negation(part: Formula) -> Formula:
    return Constant(not part.value) if isinstance(part, Constant) else Not(part)


def progressed(f: Formula, letter: Mapping[Atom, bool]) -> Formula:
    """What must hold from the next step on, which exists, so that `f` holds from this one on."""
    if isinstance(f, Constant):
        return f
    if isinstance(f, Atom):
        return Constant(letter[f])
    if isinstance(f, Next | WeakNext):
        return f.operands[0]
    if isinstance(f, Globally | Finally):
        inner, join = f.operands[0], conjunction if isinstance(f, Globally) else disjunction
        later = None if f.upper is None else f.upper - 1
        if f.lower > 0:
            return type(f)(inner, f.lower - 1, later)
        now = progressed(inner, letter)
        return now if f.upper == 0 else join(now, type(f)(inner, 0, later))
    parts = [progressed(x, letter) for x in f.operands]
    match f:
        case Not():
            return negation(parts[0])
        case And():
            return conjunction(*parts)
        case Or():
            return disjunction(*parts)
        case Implies():
            return disjunction(negation(parts[0]), parts[1])
        case Iff():
            a, b = parts
            return disjunction(conjunction(a, b), conjunction(negation(a), negation(b)))
        case Until() | WeakUntil():
            return disjunction(parts[1], conjunction(parts[0], f))
        case Release():
            return conjunction(parts[1], disjunction(parts[0], f))
    raise TypeError(f"no rule to progress {type(f).__name__}")


def admissible(formula: Formula, low: float, high: float) -> tuple[float, float]:
    """The range of accelerations that no conjunct G(...) about the acceleration alone forbids."""
    asked = [
        part.operands[0]
        for part in conjuncts(formula)
        if isinstance(part, Globally) and (part.lower, part.upper) == (0, None)
        if all(isinstance(a, Comparison) and a.variable == "a" for a in atoms_of(part))
    ]
    marks = sorted({low, high, *(a.bound for part in asked for a in atoms_of(part))})
    tries = sorted(
        {y for x in marks for y in (x - 1e-7, x, x + 1e-7) if low <= y <= high}
        | {(a + b) / 2 for a, b in pairwise(marks)}
    )
    allowed = [
        a
        for a in tries
        if low <= a <= high
        if all(
            evaluate(part, [{x: bool(holds(x, np.array(a))) for x in atoms_of(part)}])
            for part in asked
        )
    ]
    return (min(allowed), max(allowed)) if allowed else (1.0, 0.0)


def conjuncts(formula: Formula) -> list[Formula]:
    if isinstance(formula, And):
        return [part for operand in formula.operands for part in conjuncts(operand)]
    return [formula]
