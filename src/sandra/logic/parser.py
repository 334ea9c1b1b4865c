"""From text to a formula.

Weakest to strongest binding: `<->`, `->` (groups to the right), `|`, `&`, `U R W` (to the right),
then `! G F X N`. `G[1,5]` counts steps, `G[0s,1.5s]` seconds. Atoms are comparisons of a state
variable (`a > a_lim`, `|a| <= 0.2`, `v <= 50 km/h`) and named predicates (`in_lane(left)`).
"""

from __future__ import annotations

import difflib
import math
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import NoReturn

from sandra.errors import FormulaError
from sandra.logic.formula import (
    VARIABLES,
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
from sandra.logic.tokens import SYNONYMS, Token, excerpt, one_line, quoted, tokens_of

PREDICATES: Mapping[str, tuple[str, ...]] = {
    "in_lane": ("current", "left", "right", "opposite"),
    "in_lanelet": ("ID",),
    "keeps_safe_distance": ("preceding",),
    "keeps_lane_speed_limit": (),
    "braking_justification": (),
}
"""Predicates that geometry or the decision itself decides, with the arguments that each takes.

`in_lane` and `in_lanelet`: the body touches the lane or lanelet (paper Sec. III-C). `ID` stands
for a lanelet's number.
"""

MAX_HEIGHT = 200
"""Deepest nesting, definitions included; all that works on formulas can then recurse."""
MAX_REPLACED = 1000
"""Most defined predicates in one formula, those within definitions included."""

_UNITS = {"km/h": 1 / 3.6, "m/s": 1.0, "m/s^2": 1.0}
_FLIPPED = {"<": ">", "<=": ">=", ">": "<", ">=": "<="}
_RESERVED = frozenset({"true", "false", "inf", "U", "R", "W", *VARIABLES})


def parse(
    text: str,
    parameters: Mapping[str, float] | None = None,
    dt: float | None = None,
    definitions: Mapping[str, str] | None = None,
) -> Formula:
    """Read a formula.

    Args:
        text: the formula, e.g. `"G(a > a_lim) & F G in_lane(left)"`.
        parameters: values of the names that comparisons may use.
        dt: duration of a step [s]; needed where bounds are given in seconds.
        definitions: named predicates without argument, as text over the same names; they are
            replaced by what they stand for.

    Raises:
        FormulaError: if the text is no formula, or a name in it is unknown.
    """
    if dt is not None and not (math.isfinite(dt) and dt > 0):
        raise FormulaError(f"dt = {dt!r} must be a finite number of seconds > 0")
    try:
        formula = _Parser(text, _Names(parameters or {}, dt, definitions or {}, [])).formula()
    except RecursionError:
        formula = None
    if formula is None or _height_exceeds(formula, MAX_HEIGHT):
        raise FormulaError(f"the formula '{excerpt(text)}' is nested too deeply: use fewer parts")
    return formula


def check_definition_name(name: str) -> None:
    """Raises `FormulaError` if a predicate may not be defined under this name."""
    if not re.fullmatch(r"[A-Za-z_]\w*", name) or re.fullmatch(r"[GFXN]+", name):
        raise FormulaError(f"'{name}' is no name of a predicate: use letters, digits and '_'")
    if name in PREDICATES or name in _RESERVED or name in SYNONYMS:
        raise FormulaError(f"'{name}' is built in and cannot be defined: choose another name")


@dataclass(frozen=True, slots=True)
class _Names:
    """What the names in a text may mean, and the definitions that were replaced so far."""

    parameters: Mapping[str, float]
    dt: float | None
    definitions: Mapping[str, str]
    replaced: list[str]


def _height_exceeds(formula: Formula, limit: int) -> bool:
    level = [formula]
    for _ in range(limit):
        level = [operand for node in level for operand in node.operands]
        if not level:
            return False
    return True


class _Parser:
    """Recursive descent over the tokens of one text."""

    def __init__(self, text: str, names: _Names, within: tuple[str, ...] = ()) -> None:
        self._text = one_line(text)
        self._names = names
        self._within = within
        self._tokens = tokens_of(self._text)
        self._next = 0

    def formula(self) -> Formula:
        """The whole text."""
        if self._peek.kind == "end":
            raise FormulaError("a formula is empty: write 'true' for no requirement")
        formula = self._iff()
        if self._peek.kind != "end":
            self._fail(f"unexpected '{self._peek.text}'")
        return formula

    # Tokens

    @property
    def _peek(self) -> Token:
        return self._tokens[self._next]

    def _take(self) -> Token:
        token = self._peek
        if token.kind != "end":
            self._next += 1
        return token

    def _accept(self, *texts: str) -> Token | None:
        return self._take() if self._peek.kind != "end" and self._peek.text in texts else None

    def _expect(self, text: str) -> None:
        if self._accept(text) is None:
            self._fail(f"expected '{text}', found {quoted(self._peek)}")

    def _fail(self, problem: str, token: Token | None = None) -> NoReturn:
        column = (token or self._peek).column
        raise FormulaError(f"{problem} at column {column} of '{excerpt(self._text)}'")

    # Connectives, weakest first

    def _iff(self) -> Formula:
        left = self._implies()
        while self._accept("<->"):
            left = Iff(left, self._implies())
        return left

    def _implies(self) -> Formula:
        left = self._or()
        return Implies(left, self._implies()) if self._accept("->") else left

    def _or(self) -> Formula:
        left = self._and()
        while self._accept("|"):
            left = Or(left, self._and())
        return left

    def _and(self) -> Formula:
        left = self._until()
        while self._accept("&"):
            left = And(left, self._until())
        return left

    def _until(self) -> Formula:
        left = self._unary()
        operator = self._accept("U", "R", "W")
        if operator is None:
            return left
        node = {"U": Until, "R": Release, "W": WeakUntil}[operator.text]
        return node(left, self._until())

    def _unary(self) -> Formula:
        if self._accept("!"):
            return Not(self._unary())
        if self._peek.kind != "modal":
            return self._primary()
        operator = self._take().text
        if operator in ("X", "N"):
            return Next(self._unary()) if operator == "X" else WeakNext(self._unary())
        lower, upper = self._interval() if self._peek.text == "[" else (0, None)
        node = Globally if operator == "G" else Finally
        return node(self._unary(), lower, upper)

    def _interval(self) -> tuple[int, int | None]:
        """`[2,5]` in steps or `[0s,1.5s]` in seconds: the steps within the interval."""
        bracket = self._take()
        lower = self._bound(upwards=True)
        self._expect(",")
        upper = self._bound(upwards=False)
        self._expect("]")
        if lower is None:
            self._fail("an interval cannot begin at inf", bracket)
        if upper is not None and upper < lower:
            self._fail("no step lies within the interval", bracket)
        return lower, upper

    def _bound(self, upwards: bool) -> int | None:
        """One end of an interval in steps, seconds rounded inwards; None for `inf`."""
        if self._accept("inf"):
            return None
        token = self._take()
        if token.kind != "number":
            self._fail(f"expected a number of steps or seconds, found {quoted(token)}", token)
        value = float(token.text)
        if self._peek.kind == "name" and self._peek.text == "s":
            self._take()
            if self._names.dt is None:
                self._fail("bounds in seconds need the duration of a step: use steps", token)
            steps = value / self._names.dt
            if math.isinf(steps):
                self._fail(f"'{token.text}s' is too long: for no limit write 'inf'", token)
            # 1.5 s are 15 steps of 0.1 s, whatever the last digit of the quotient.
            nearest = round(steps)
            if abs(steps - nearest) <= 1e-9 * max(1.0, steps):
                return nearest
            return math.ceil(steps) if upwards else math.floor(steps)
        if not value.is_integer():
            self._fail(
                f"'{token.text}' is no number of steps: for seconds write '{token.text}s'", token
            )
        return int(value)

    # Atoms

    def _primary(self) -> Formula:
        token = self._peek
        if token.text == "(":
            self._take()
            inner = self._iff()
            self._expect(")")
            return inner
        if token.text in ("true", "false"):
            self._take()
            return Constant(token.text == "true")
        if token.text == "|" or token.text in VARIABLES:
            variable, absolute = self._subject()
            operator = self._comparator()
            return self._comparison(token, variable, absolute, operator, self._sum())
        if token.kind == "number" or token.text in ("-", "+", "inf", *self._names.parameters):
            bound = self._sum()
            operator = _FLIPPED[self._comparator()]
            return self._comparison(token, *self._subject(), operator, bound)
        if token.kind == "name":
            return self._predicate()
        self._fail(f"expected a formula, found {quoted(token)}")

    def _subject(self) -> tuple[str, bool]:
        """A state variable, or its absolute value: (name, whether absolute)."""
        absolute = self._accept("|") is not None
        token = self._take()
        if token.kind != "name" or token.text not in VARIABLES:
            known = ", ".join(VARIABLES)
            self._fail(f"{quoted(token)} is no state variable (choose from {known})", token)
        if absolute:
            self._expect("|")
        return token.text, absolute

    def _comparator(self) -> str:
        token = self._accept(*_FLIPPED)
        if token is None:
            self._fail(f"expected one of < <= > >=, found {quoted(self._peek)}")
        return token.text

    def _comparison(
        self, token: Token, variable: str, absolute: bool, operator: str, bound: float
    ) -> Formula:
        if math.isnan(bound):
            self._fail("a comparison with something that is not a number", token)
        if not absolute:
            return compare(variable, operator, bound)
        both = compare(variable, operator, bound), compare(variable, _FLIPPED[operator], -bound)
        return And(*both) if operator in ("<", "<=") else Or(*both)

    def _predicate(self) -> Formula:
        token = self._take()
        arguments = PREDICATES.get(token.text)
        if arguments is None:
            return self._definition(token)
        if not arguments:
            return Predicate(token.text)
        if self._accept("(") is None:
            self._fail(
                f"'{token.text}' needs an argument: {token.text}({'|'.join(arguments)})", token
            )
        argument = self._take()
        number = arguments == ("ID",)
        if not (argument.text.isdigit() if number else argument.text in arguments):
            choices = "a number" if number else " or ".join(arguments)
            self._fail(f"'{token.text}' takes {choices}, not {quoted(argument)}", argument)
        self._expect(")")
        return Predicate(token.text, str(int(argument.text)) if number else argument.text)

    def _definition(self, token: Token) -> Formula:
        name = token.text
        if name not in self._names.definitions:
            known = [*PREDICATES, *self._names.definitions, *self._names.parameters]
            self._fail(f"unknown name '{name}'{_suggestion(name, known)}", token)
        if name in self._within:
            self._fail(f"'{name}' is defined by itself", token)
        self._names.replaced.append(name)
        if len(self._names.replaced) > MAX_REPLACED:
            self._fail(f"more than {MAX_REPLACED} defined predicates to replace", token)
        try:
            text = self._names.definitions[name]
            return _Parser(text, self._names, (*self._within, name)).formula()
        except FormulaError as error:
            raise FormulaError(f"predicate {name}: {error}") from None

    # Numbers

    def _sum(self) -> float:
        value = self._product()
        while operator := self._accept("+", "-"):
            value += self._product() if operator.text == "+" else -self._product()
        return value

    def _product(self) -> float:
        value = self._factor()
        while operator := self._accept("*", "/"):
            token = self._peek
            factor = self._factor()
            if operator.text == "/" and factor == 0:
                self._fail("division by zero", token)
            value = value * factor if operator.text == "*" else value / factor
        return value

    def _factor(self) -> float:
        if sign := self._accept("-", "+"):
            return -self._factor() if sign.text == "-" else self._factor()
        if self._accept("("):
            value = self._sum()
            self._expect(")")
            return value
        token = self._take()
        if token.kind == "number" or token.text == "inf":
            value = float(token.text)
            return value * _UNITS[self._take().text] if self._peek.kind == "unit" else value
        if token.kind != "name":
            self._fail(f"expected a number, found {quoted(token)}", token)
        if token.text in VARIABLES:
            self._fail("a state variable can only be compared with numbers and parameters", token)
        if token.text not in self._names.parameters:
            hint = _suggestion(token.text, self._names.parameters)
            self._fail(f"unknown parameter '{token.text}'{hint}", token)
        return float(self._names.parameters[token.text])


def _suggestion(name: str, known: Iterable[str]) -> str:
    choices = list(known)
    close = difflib.get_close_matches(name, choices, n=1)
    if close:
        return f" (did you mean '{close[0]}'?)"
    return f" (choose from {', '.join(choices)})" if choices else ""
