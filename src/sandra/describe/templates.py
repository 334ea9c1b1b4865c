"""The sentences of the prompt: those in `templates.toml`, and a user's own laid over them."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from pathlib import Path
from string import Formatter
from types import MappingProxyType

from sandra.errors import SettingsError

Tables = Mapping[str, Mapping[str, str]]

ESSENTIAL: Mapping[tuple[str, str], frozenset[str]] = MappingProxyType(
    {
        ("system", "command"): frozenset({"command"}),
        ("system", "action"): frozenset({"name"}),
        ("system", "past"): frozenset({"pairs"}),
        ("rules", "line"): frozenset({"text"}),
        ("narrowed", "holds"): frozenset({"pairs"}),
        ("narrowed", "rank"): frozenset({"k"}),
        ("answered", "line"): frozenset({"pair"}),
        ("answered", "rank"): frozenset({"k", "pairs"}),
    }
)
"""Placeholders that a sentence of the user's must keep: what the model is asked depends on them."""
OPEN = ("weather", "country")
"""Tables to which words may be added; the others have the names that the code asks for."""

_INTEGERS = frozenset({"k", "id"})
_BAD_FORMAT = re.compile(r"\d{4,}|[{}]")
_HEADER = re.compile(r"\s*\[\s*([\w.\"'-]+)\s*\]")


@dataclass(frozen=True, slots=True)
class Templates:
    """Our sentences with some changed: `changes` holds (table, name, sentence)."""

    changes: tuple[tuple[str, str, str], ...] = ()

    @staticmethod
    def load(path: str | Path) -> Templates:
        """Read a TOML file with tables and names of `templates.toml`; it may leave out any.

        Raises:
            SettingsError: the file is missing or no TOML, a table or a name is unknown, or a
                sentence has an unknown placeholder, lacks an essential one, or cannot be filled
                in. The message names file and line.
        """
        try:
            text = Path(path).read_text(encoding="utf-8")
            data = tomllib.loads(text)
        except OSError as error:
            raise SettingsError(
                f"{path}: cannot be read ({error.strerror}); check the path"
            ) from None
        except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
            raise SettingsError(f"{path}: not a TOML file ({error})") from None
        changes = []
        for table, entries in data.items():
            if table not in sentences() or not isinstance(entries, dict):
                known = ", ".join(sentences())
                where = _place(path, text, table, None)
                raise SettingsError(f"{where}: unknown table '{table}'; choose from {known}")
            for name, sentence in entries.items():
                wrong = _wrong(table, name, sentence)
                if wrong:
                    where = _place(path, text, table, name)
                    raise SettingsError(f"{where}: {table}.{name}: {wrong}")
                changes.append((table, name, sentence))
        return Templates(tuple(changes))

    @property
    def tables(self) -> Tables:
        """All sentences by table and name."""
        return _laid_over(self.changes)

    def say(self, table: str, name: str, /, **values: object) -> str:
        """One sentence, filled in. Values are never read as templates themselves.

        A number that rounds to zero is told as 0.0, never as -0.0.
        """
        filled = {k: _Number(v) if isinstance(v, float) else v for k, v in values.items()}
        return self.tables[table][name].format(**filled)


def our_text() -> str:
    """`templates.toml` as it is."""
    return files("sandra.describe").joinpath("templates.toml").read_text(encoding="utf-8")


@cache
def sentences() -> Tables:
    """All tables of `templates.toml`, read once, immutable."""
    tables = tomllib.loads(our_text())
    return MappingProxyType({name: MappingProxyType(table) for name, table in tables.items()})


def say(table: str, name: str, /, **values: object) -> str:
    """One of our own sentences; see `Templates.say`."""
    return Templates().say(table, name, **values)


@cache
def _laid_over(changes: tuple[tuple[str, str, str], ...]) -> Tables:
    tables = {name: dict(table) for name, table in sentences().items()}
    for table, name, sentence in changes:
        tables[table][name] = sentence
    return MappingProxyType({name: MappingProxyType(table) for name, table in tables.items()})


def _wrong(table: str, name: str, sentence: object) -> str | None:
    """What is wrong with a sentence of the user's, in words."""
    if not isinstance(sentence, str):
        return "must be a text in quotes"
    ours = sentences()[table].get(name)
    if ours is None and table not in OPEN:
        return f"no such sentence; choose from {', '.join(sentences()[table])}"
    fields = _placeholders(ours or "")
    try:
        used = _placeholders(sentence)
    except ValueError as error:
        return f"{error}; write {{{{ and }}}} for braces that are meant as such"
    unknown = sorted(set(used) - set(fields))
    if unknown:
        known = ", ".join(f"{{{x}}}" for x in fields) or "none"
        return f"unknown placeholder {{{unknown[0]}}}; this sentence has {known}"
    if any(_BAD_FORMAT.search(spec) for spec in used.values()):
        return "a format of more than three digits, or with a placeholder in it"
    missing = sorted(ESSENTIAL.get((table, name), frozenset()) - set(used))
    if missing:
        return f"the placeholder {{{missing[0]}}} is missing"
    try:
        sentence.format(**{x: _sample(x, spec) for x, spec in fields.items()})
    except (ValueError, LookupError, AttributeError, TypeError) as error:
        return f"a placeholder cannot be filled in ({error})"
    return None


def _placeholders(sentence: str) -> dict[str, str]:
    """Format specifications by placeholder."""
    parts = Formatter().parse(sentence)
    return {field: spec or "" for _, field, spec, _ in parts if field is not None}


def _sample(name: str, spec: str) -> object:
    """A value of the kind that our own sentence is filled in with."""
    if name in _INTEGERS:
        return 1
    return _Number(1.0) if spec else "text"


def _place(path: str | Path, text: str, table: str, name: str | None) -> str:
    """`path:line` of a name in a table, or of the table; `path` where it is not found."""
    inside = ""
    for number, line in enumerate(text.splitlines(), start=1):
        header = _HEADER.match(line)
        if header:
            inside = header[1].strip("\"'")
        found = header if name is None else re.match(rf"\s*[\"']?{re.escape(name)}[\"']?\s*=", line)
        if found and inside == table:
            return f"{path}:{number}"
    return str(path)


class _Number(float):
    """A float without a negative zero after rounding."""

    def __format__(self, spec: str) -> str:
        text = float(self).__format__(spec)
        return text[1:] if text.startswith("-") and not text.strip("-0.") else text
