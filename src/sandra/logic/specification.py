"""What one action pair must satisfy, together with the rules: formula and automaton.

phi = phi_longitudinal & phi_lateral & the rules (paper Sec. III-C).

Which acceleration a letter carries: letter k holds the state at t_k and the acceleration applied
in [t_k, t_k+1]; at the last step h it holds the acceleration of the last interval. So a trace
over a horizon of h steps has h + 1 letters.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import lru_cache

from sandra.actions import ActionPair
from sandra.errors import FormulaError
from sandra.logic.automaton import Dfa
from sandra.logic.formula import Constant, Formula, Predicate, conjunction, simplify, substitute
from sandra.logic.parser import PREDICATES
from sandra.logic.translation import translate
from sandra.logic.vocabulary import Vocabulary
from sandra.settings import Settings

_JUSTIFICATION = Predicate("braking_justification")


@dataclass(frozen=True, slots=True)
class Part:
    """One conjunct: an action, a rule, or a formula of the user's own (named by its text)."""

    name: str
    text: str
    """As the user wrote it, with names for parameters and predicates."""
    formula: Formula
    """With their values."""
    description: str = ""
    """One sentence."""


@dataclass(frozen=True, slots=True)
class Specification:
    """The conjunction of `parts`. Letters of its automaton: see the module's docstring."""

    pair: ActionPair
    parts: tuple[Part, ...]
    formula: Formula = field(init=False)
    dfa: Dfa = field(init=False, repr=False)

    def __post_init__(self) -> None:
        formula = conjunction(part.formula for part in self.parts)
        object.__setattr__(self, "formula", formula)
        object.__setattr__(self, "dfa", translate(formula))

    def without(self, name: str) -> Specification:
        """The same without one part: if a verdict then changes, that part was its cause.

        Raises:
            FormulaError: if no part has that name.
        """
        parts = tuple(part for part in self.parts if part.name != name)
        if len(parts) == len(self.parts):
            names = ", ".join(part.name for part in self.parts)
            raise FormulaError(f"no part '{name}' in the specification: choose from {names}")
        return Specification(self.pair, parts)

    def __str__(self) -> str:
        return "\n".join(f"{part.name}: {part.text}" for part in self.parts)


def specification(
    pair: ActionPair,
    rules: Sequence[str] = (),
    settings: Settings = Settings(),  # noqa: B008  frozen
    vocabulary: Vocabulary | None = None,
    dt: float | None = None,
    justified: bool = False,
) -> Specification:
    """The specification of one action pair under rules.

    Args:
        pair: the longitudinal and the lateral action.
        rules: names of rules (`"R_G1"`, in any case) or formulas of the user's own.
        settings: values of the parameters that the formulas name.
        vocabulary: texts of actions, rules and predicates; None: the packaged ones.
        dt: duration of a step [s]; needed where a formula gives bounds in seconds.
        justified: whether abrupt braking is justified, which only a fail-safe maneuver is.

    Raises:
        FormulaError: if a rule is unknown, or a formula cannot be parsed or is too large.
    """
    if isinstance(rules, str):
        raise TypeError("rules must be a sequence of texts: use parse_rules")
    if vocabulary is None:
        return _packaged(pair, tuple(rules), settings, dt, justified)
    return _specification(pair, tuple(rules), settings, vocabulary, dt, justified)


@lru_cache(maxsize=1024)
def _packaged(
    pair: ActionPair,
    rules: tuple[str, ...],
    settings: Settings,
    dt: float | None,
    justified: bool,
) -> Specification:
    """`_specification` in the packaged vocabulary, which never changes."""
    return _specification(pair, rules, settings, Vocabulary.default(), dt, justified)


def _specification(
    pair: ActionPair,
    rules: tuple[str, ...],
    settings: Settings,
    words: Vocabulary,
    dt: float | None,
    justified: bool,
) -> Specification:
    actions = [pair.longitudinal.value, pair.lateral.value]
    named = [(name, words.actions[name]) for name in actions] + [_rule(r, words) for r in rules]
    parts = []
    for name, text in dict(named).items():
        try:
            formula = words.parse(text, settings, dt)
        except FormulaError as error:
            raise FormulaError(f"{name}: {error}" if name != text else str(error)) from None
        formula = simplify(substitute(formula, {_JUSTIFICATION: Constant(justified)}))
        description = words.describe(name) if name != text else f"Satisfy {text}."
        parts.append(Part(name, text, formula, description))
    return Specification(pair, tuple(parts))


def _rule(text: str, vocabulary: Vocabulary) -> tuple[str, str]:
    """(name, formula text) of a rule that is given by its name or by a formula."""
    name = vocabulary.rule_name(text)
    if name is not None:
        return name, vocabulary.rules[name]
    line = " ".join(text.split())
    words = {*PREDICATES, *vocabulary.predicates, "true", "false"}
    if not line or (re.fullmatch(r"[A-Za-z][\w-]*", line) and line not in words):
        raise FormulaError(
            f"unknown rule '{line}': choose from {', '.join(vocabulary.rules)}, or write a formula "
            "such as 'G(v <= 13.9)'"
        )
    return line, line


def parse_rules(text: str) -> tuple[str, ...]:
    """`"R_G1,R_G2"` as a tuple; `""` and `"none"` are no rules.

    Commas within brackets belong to a formula: `"R_G1, F[0,3] in_lane(left)"` are two rules.

    Raises:
        FormulaError: if a rule between two commas is empty.
    """
    if text.strip().lower() in ("", "none"):
        return ()
    pieces, depth, start = [], 0, 0
    for i, character in enumerate(text):
        depth += (character in "([") - (character in ")]")
        if character == "," and depth == 0:
            pieces.append(text[start:i])
            start = i + 1
    rules = tuple(" ".join(piece.split()) for piece in (*pieces, text[start:]))
    if "" in rules:
        raise FormulaError(f"an empty rule in '{text}': write names with commas between them")
    return rules
