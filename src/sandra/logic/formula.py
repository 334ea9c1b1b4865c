"""LTL over finite traces: the syntax tree, immutable and structurally comparable.

Syntax and meaning follow De Giacomo & Vardi 2013 (paper Sec. II-B1). A trace is a non-empty
sequence of letters; a letter says which atoms are true. The atoms are named predicates
(`in_lane(left)`) and comparisons of one state variable with a number (`a <= 0.2`).
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from functools import reduce
from typing import ClassVar

VARIABLES: Mapping[str, str] = {
    "a": "longitudinal acceleration [m/s^2]",
    "v": "longitudinal speed [m/s]",
    "s": "position along the current lane [m]",
    "d": "position across the current lane, to the left [m]",
}
"""State variables that a comparison may name.

Letter k holds the state at t_k and the acceleration applied in [t_k, t_k+1]; at the last step h
it holds the acceleration of the last interval.
"""

# How tightly a node binds when written; an operand that binds less tightly gets parentheses.
_IFF, _IMPLIES, _OR, _AND, _UNTIL, _UNARY, _ATOM = range(7)


class Formula:
    """Base of all formulas. Combine with `&`, `|`, `~`; `str` gives text that parses back."""

    __slots__ = ()
    level: ClassVar[int] = _ATOM

    @property
    def operands(self) -> tuple[Formula, ...]:
        """The direct subformulas, left to right."""
        return ()

    def with_operands(self, *operands: Formula) -> Formula:
        """The same connective over other subformulas (as many as in `operands`)."""
        return self

    def __and__(self, other: Formula) -> Formula:
        return And(self, other)

    def __or__(self, other: Formula) -> Formula:
        return Or(self, other)

    def __invert__(self) -> Formula:
        return Not(self)


@dataclass(frozen=True, slots=True)
class Constant(Formula):
    """`true` or `false`, at every step."""

    value: bool

    def __str__(self) -> str:
        return "true" if self.value else "false"


TRUE = Constant(True)
FALSE = Constant(False)


class Atom(Formula):
    """What is true or false of one step alone."""

    __slots__ = ()


@dataclass(frozen=True, slots=True)
class Predicate(Atom):
    """A named predicate with at most one argument, e.g. `in_lane(left)`."""

    name: str
    argument: str | None = None

    def __post_init__(self) -> None:
        # Texts of different predicates differ only if names hold no parentheses.
        if not re.fullmatch(r"[A-Za-z_]\w*", self.name):
            raise ValueError(f"{self.name!r} is no name of a predicate")
        if self.argument is not None and not re.fullmatch(r"\w+", self.argument):
            raise ValueError(f"{self.argument!r} is no argument of a predicate")

    def __str__(self) -> str:
        return self.name if self.argument is None else f"{self.name}({self.argument})"


@dataclass(frozen=True, slots=True)
class Comparison(Atom):
    """`variable op bound` with `op` either `"<="` or `"<"` and a finite bound.

    `>` and `>=` are the negations of these two, so that an atom and its complement are one atom.
    Use `compare` to build any of the four.
    """

    variable: str
    op: str
    bound: float

    def __post_init__(self) -> None:
        if self.variable not in VARIABLES:
            raise ValueError(f"unknown state variable {self.variable!r}")
        if self.op not in ("<=", "<"):
            raise ValueError(f"operator {self.op!r} of an atom must be '<=' or '<'")
        if not math.isfinite(self.bound):
            raise ValueError(f"bound {self.bound!r} of an atom must be finite")
        # One zero only: -0.0 would print differently from 0.0 though both are equal.
        object.__setattr__(self, "bound", float(self.bound) + 0.0)

    def holds(self, value: float) -> bool:
        """Whether the comparison is true of `value`.

        Raises:
            ValueError: if `value` is NaN, of which neither an atom nor its negation is true.
        """
        if math.isnan(value):
            raise ValueError(f"'{self}' has no truth value: {self.variable} is NaN")
        return value <= self.bound if self.op == "<=" else value < self.bound

    def __str__(self) -> str:
        return f"{self.variable} {self.op} {_number(self.bound)}"


def compare(variable: str, op: str, bound: float) -> Formula:
    """`variable op bound` with `op` in `<`, `<=`, `>`, `>=`; an infinite bound folds to a constant.

    Raises:
        ValueError: if the variable or the operator is unknown, or the bound is NaN.
    """
    if op in (">", ">="):
        opposite = compare(variable, "<=" if op == ">" else "<", bound)
        return Constant(not opposite.value) if isinstance(opposite, Constant) else Not(opposite)
    if math.isinf(bound) and variable in VARIABLES and op in ("<", "<="):
        return Constant(bound > 0)
    return Comparison(variable, op, bound)


@dataclass(frozen=True, slots=True)
class _Unary(Formula):
    operand: Formula
    symbol: ClassVar[str]
    level: ClassVar[int] = _UNARY

    @property
    def operands(self) -> tuple[Formula, ...]:
        return (self.operand,)

    def with_operands(self, *operands: Formula) -> Formula:
        return replace(self, operand=operands[0])

    def __str__(self) -> str:
        return f"{self.symbol}({self.operand})"


@dataclass(frozen=True, slots=True)
class Not(_Unary):
    """Negation."""

    symbol: ClassVar[str] = "!"

    def __str__(self) -> str:
        operand = self.operand
        if isinstance(operand, Comparison):
            op = ">" if operand.op == "<=" else ">="
            return f"{operand.variable} {op} {_number(operand.bound)}"
        if isinstance(operand, Predicate | Constant):
            return f"{self.symbol}{operand}"
        return f"{self.symbol}({operand})"


@dataclass(frozen=True, slots=True)
class Next(_Unary):
    """X: there is a next step, and it satisfies the operand."""

    symbol: ClassVar[str] = "X"


@dataclass(frozen=True, slots=True)
class WeakNext(_Unary):
    """N: this is the last step, or the next one satisfies the operand."""

    symbol: ClassVar[str] = "N"


@dataclass(frozen=True, slots=True)
class _Timed(_Unary):
    """An operator over the steps `lower`..`upper` from now; `upper` None: to the end."""

    lower: int = 0
    upper: int | None = None

    def __post_init__(self) -> None:
        if self.lower < 0 or (self.upper is not None and self.upper < self.lower):
            raise ValueError(f"steps [{self.lower}, {self.upper}] are no interval")

    def __str__(self) -> str:
        if self.lower == 0 and self.upper is None:
            return f"{self.symbol}({self.operand})"
        upper = "inf" if self.upper is None else str(self.upper)
        return f"{self.symbol}[{self.lower},{upper}]({self.operand})"


@dataclass(frozen=True, slots=True)
class Globally(_Timed):
    """G: at each step of the interval that the trace still has."""

    symbol: ClassVar[str] = "G"


@dataclass(frozen=True, slots=True)
class Finally(_Timed):
    """F: at some step of the interval that the trace still has."""

    symbol: ClassVar[str] = "F"


@dataclass(frozen=True, slots=True)
class _Binary(Formula):
    left: Formula
    right: Formula
    symbol: ClassVar[str]
    right_associative: ClassVar[bool] = False

    @property
    def operands(self) -> tuple[Formula, ...]:
        return (self.left, self.right)

    def with_operands(self, *operands: Formula) -> Formula:
        return replace(self, left=operands[0], right=operands[1])

    def __str__(self) -> str:
        left, right = str(self.left), str(self.right)
        if _level(self.left) < self.level + self.right_associative:
            left = f"({left})"
        if _level(self.right) < self.level + (not self.right_associative):
            right = f"({right})"
        return f"{left} {self.symbol} {right}"


@dataclass(frozen=True, slots=True)
class And(_Binary):
    """Conjunction."""

    symbol: ClassVar[str] = "&"
    level: ClassVar[int] = _AND


@dataclass(frozen=True, slots=True)
class Or(_Binary):
    """Disjunction."""

    symbol: ClassVar[str] = "|"
    level: ClassVar[int] = _OR


@dataclass(frozen=True, slots=True)
class Implies(_Binary):
    """Implication."""

    symbol: ClassVar[str] = "->"
    level: ClassVar[int] = _IMPLIES
    right_associative: ClassVar[bool] = True


@dataclass(frozen=True, slots=True)
class Iff(_Binary):
    """Equivalence."""

    symbol: ClassVar[str] = "<->"
    level: ClassVar[int] = _IFF


@dataclass(frozen=True, slots=True)
class Until(_Binary):
    """U: `right` holds at some step, and `left` at all steps before it."""

    symbol: ClassVar[str] = "U"
    level: ClassVar[int] = _UNTIL
    right_associative: ClassVar[bool] = True


@dataclass(frozen=True, slots=True)
class Release(_Binary):
    """R: `right` holds up to and including the first step of `left`, or to the end."""

    symbol: ClassVar[str] = "R"
    level: ClassVar[int] = _UNTIL
    right_associative: ClassVar[bool] = True


@dataclass(frozen=True, slots=True)
class WeakUntil(_Binary):
    """W: as U, but `left` may also hold to the end without `right`."""

    symbol: ClassVar[str] = "W"
    level: ClassVar[int] = _UNTIL
    right_associative: ClassVar[bool] = True


def _level(formula: Formula) -> int:
    # A negated comparison is written as one comparison.
    if isinstance(formula, Not) and isinstance(formula.operand, Comparison):
        return _ATOM
    return formula.level


def _number(value: float) -> str:
    return str(int(value)) if value.is_integer() and abs(value) < 1e16 else repr(value)


def conjunction(formulas: Iterable[Formula]) -> Formula:
    """All of `formulas`; `true` if there is none."""
    parts = [f for f in formulas if f != TRUE]
    return reduce(And, parts) if parts else TRUE


def atoms_of(formula: Formula) -> frozenset[Atom]:
    """The atoms that the formula names."""
    found: set[Atom] = set()
    pending = [formula]
    while pending:
        node = pending.pop()
        if isinstance(node, Atom):
            found.add(node)
        pending.extend(node.operands)
    return frozenset(found)


def substitute(formula: Formula, values: Mapping[Atom, Formula]) -> Formula:
    """The formula with each atom in `values` replaced."""
    if isinstance(formula, Atom):
        return values.get(formula, formula)
    return formula.with_operands(*(substitute(f, values) for f in formula.operands))


def simplify(formula: Formula) -> Formula:
    """An equivalent formula without needless constants and double negations.

    Only what holds on every finite trace: `X true` stays, as it is false at the last step.
    """
    node = formula.with_operands(*(simplify(f) for f in formula.operands))
    match node:
        case Not(Constant(value)):
            return Constant(not value)
        case Not(Not(f)):
            return f
        case And(Constant(value), f) | And(f, Constant(value)):
            return f if value else FALSE
        case Or(Constant(value), f) | Or(f, Constant(value)):
            return TRUE if value else f
        case Implies(Constant(value), f):
            return f if value else TRUE
        case Implies(f, Constant(value)):
            return TRUE if value else simplify(Not(f))
        case Iff(Constant(value), f) | Iff(f, Constant(value)):
            return f if value else simplify(Not(f))
        case Next(Constant(False)) | WeakNext(Constant(True)):
            return node.operands[0]
        case Globally(Constant(True)) | Finally(Constant(False)):
            return node.operands[0]
        # Step 0 of the interval always exists, later ones need not.
        case Globally(Constant(False), 0) | Finally(Constant(True), 0):
            return node.operands[0]
        case (
            Until(_, Constant(_) as end)
            | WeakUntil(_, Constant(True) as end)
            | Release(_, Constant(_) as end)
        ):
            return end
        case Until(Constant(False), f) | WeakUntil(Constant(False), f) | Release(Constant(True), f):
            return f
        case WeakUntil(Constant(True), _):
            return TRUE
        case WeakUntil(f, Constant(False)):
            return Globally(f)
        case Until(Constant(True), f):
            return Finally(f)
        case Release(Constant(False), f):
            return Globally(f)
    return node
