"""Actions, rules and predicates as text that a user can read and change."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, fields
from functools import lru_cache
from importlib import resources
from pathlib import Path
from types import MappingProxyType
from typing import Any

from sandra.actions import Lateral, Longitudinal
from sandra.errors import FormulaError
from sandra.logic.formula import Formula
from sandra.logic.parser import check_definition_name, parse
from sandra.settings import Settings

ACTION_NAMES: tuple[str, ...] = tuple(a.value for a in (*Longitudinal, *Lateral))
"""The seven actions of the paper's Tab. II, by the names of the JSON contract."""

_SECTIONS = ("actions", "rules", "predicates", "descriptions")


@dataclass(frozen=True, slots=True)
class Vocabulary:
    """Texts by name: `actions` (all seven), `rules`, `predicates` and `descriptions`.

    `Vocabulary.default()` is the packaged `specification.toml`; `Vocabulary.load(path)` lays a
    file of the user over it.
    """

    actions: Mapping[str, str]
    rules: Mapping[str, str]
    predicates: Mapping[str, str]
    descriptions: Mapping[str, str]

    @staticmethod
    def default() -> Vocabulary:
        """The vocabulary of the paper (Tab. II, eq. 6, Sec. IV-A)."""
        return _default()

    @staticmethod
    def load(path: str | Path) -> Vocabulary:
        """The default vocabulary with the entries of a TOML file laid over it.

        Raises:
            FormulaError: if the file cannot be read, is not TOML, has an unknown section or
                action, or holds a formula that cannot be parsed.
        """
        try:
            text = Path(path).read_text(encoding="utf-8")
        except OSError as error:
            raise FormulaError(
                f"{path}: cannot be read ({error.strerror}); check the path"
            ) from None
        except UnicodeDecodeError:
            raise FormulaError(f"{path}: not a TOML file (it is not UTF-8 text)") from None
        return _from_toml(text, str(path), Vocabulary.default())

    def parse(
        self,
        text: str,
        settings: Settings = Settings(),  # noqa: B008  frozen
        dt: float | None = None,
    ) -> Formula:
        """A formula over this vocabulary's predicates and the parameters of `settings`.

        Raises:
            FormulaError: if the text is no formula, or a name in it is unknown.
        """
        return parse(text, parameters(settings), dt, self.predicates)

    def rule_name(self, text: str) -> str | None:
        """The rule that the text names, whatever its case; None if it names none."""
        wanted = text.strip().lower()
        return next((name for name in self.rules if name.lower() == wanted), None)

    def describe(self, name: str) -> str:
        """One sentence for an action or a rule; its formula where there is no sentence."""
        formula = self.actions.get(name) or self.rules.get(name)
        if formula is None:
            raise FormulaError(f"unknown action or rule '{name}': choose from {self._names()}")
        return self.descriptions.get(name, f"Satisfy {formula}.")

    def _names(self) -> str:
        return ", ".join((*self.actions, *self.rules))


def parameters(settings: Settings) -> dict[str, float]:
    """The numbers in `settings` that formulas may name."""
    values = {f.name: getattr(settings, f.name) for f in fields(settings)}
    return {
        name: float(value)
        for name, value in values.items()
        if isinstance(value, int | float) and not isinstance(value, bool)
    }


@lru_cache(maxsize=1)
def _default() -> Vocabulary:
    file = resources.files("sandra.logic").joinpath("specification.toml")
    nothing = Vocabulary({}, {}, {}, {})
    return _from_toml(file.read_text(encoding="utf-8"), "specification.toml", nothing)


def _from_toml(text: str, source: str, base: Vocabulary) -> Vocabulary:
    try:
        data = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise FormulaError(f"{source}: not a TOML file ({error})") from None
    for section, entries in data.items():
        _check_section(section, entries, source)
    new = {section: data.get(section, {}) for section in _SECTIONS}
    given = [name.lower() for name in new["rules"]]
    for name in new["rules"]:
        if given.count(name.lower()) > 1:
            raise FormulaError(f"{source}: [rules] '{name}' is there twice: case does not matter")
    changed = {_known(name, base.rules) for name in new["rules"]} | set(new["actions"])
    # A sentence about a formula that was replaced would no longer be true.
    old = {name: text for name, text in base.descriptions.items() if name not in changed}
    vocabulary = Vocabulary(
        actions=MappingProxyType({**base.actions, **new["actions"]}),
        rules=MappingProxyType(
            {
                **base.rules,
                **{_known(name, base.rules): text for name, text in new["rules"].items()},
            }
        ),
        predicates=MappingProxyType({**base.predicates, **new["predicates"]}),
        descriptions=MappingProxyType({**old, **new["descriptions"]}),
    )
    for problem in _problems(vocabulary):
        raise FormulaError(f"{source}: {problem}")
    return vocabulary


def _known(name: str, rules: Mapping[str, str]) -> str:
    """A rule's name as the base writes it, since names do not depend on case."""
    return next((known for known in rules if known.lower() == name.lower()), name)


def _check_section(section: str, entries: Any, source: str) -> None:
    if section not in _SECTIONS:
        known = ", ".join(f"[{name}]" for name in _SECTIONS)
        raise FormulaError(f"{source}: unknown section [{section}]: choose from {known}")
    if not isinstance(entries, dict):
        raise FormulaError(f"{source}: '{section}' must be a section: write [{section}]")
    for name, entry in entries.items():
        if not isinstance(entry, str):
            raise FormulaError(f"{source}: [{section}] {name} must be text in quotes")


def _problems(vocabulary: Vocabulary) -> Iterator[str]:
    """What is wrong with a vocabulary, one line each."""
    for name in vocabulary.actions:
        if name not in ACTION_NAMES:
            yield f"[actions] unknown action '{name}': choose from {', '.join(ACTION_NAMES)}"
    for name in vocabulary.rules:
        if not re.fullmatch(r"[A-Za-z][\w-]*", name) or name.lower() in (*ACTION_NAMES, "none"):
            yield f"[rules] '{name}' is no name of a rule: use letters, digits, '_', and no action"
    for name in vocabulary.descriptions:
        if name not in vocabulary.actions and name not in vocabulary.rules:
            yield f"[descriptions] '{name}' is neither an action nor a rule"
    # So short a step that every interval in seconds holds one.
    dt = 1e-9
    for section in ("predicates", "actions", "rules"):
        for name, text in getattr(vocabulary, section).items():
            try:
                if section == "predicates":
                    check_definition_name(name)
                vocabulary.parse(text, dt=dt)
            except FormulaError as error:
                yield f"[{section}] {name}: {error}"
