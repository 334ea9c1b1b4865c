"""Data cards: what is in a data set, how much of it, and what made it."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from sandra.errors import SandraError
from sandra.evaluation.provenance import commit, versions

Table = Mapping[str, Mapping[str, int]]


@dataclass(frozen=True, slots=True)
class Card:
    """`facts` by name; `tables` of counts, by value and by column (split)."""

    title: str
    about: str
    facts: Mapping[str, Any]
    tables: Mapping[str, Table]
    errors: tuple[str, ...] = ()
    command_line: tuple[str, ...] = ()
    settings: Mapping[str, Any] = field(default_factory=dict)
    """For machines only."""
    versions: Mapping[str, str] = field(default_factory=versions)
    commit: str | None = field(default_factory=commit)

    def to_dict(self) -> dict[str, Any]:
        return {
            "title": self.title,
            "about": self.about,
            **self.facts,
            "tables": {name: {k: dict(v) for k, v in t.items()} for name, t in self.tables.items()},
            "errors": list(self.errors),
            "command_line": list(self.command_line),
            "settings": dict(self.settings),
            "versions": dict(self.versions),
            "commit": self.commit,
        }

    def __str__(self) -> str:
        """As Markdown."""
        lines = [f"# {self.title}", "", self.about, ""]
        lines += ["| | |", "|---|---|"]
        lines += [f"| {name} | {_words(value)} |" for name, value in self.facts.items()]
        for name, table in self.tables.items():
            lines += ["", *_markdown(name, table)]
        if self.errors:
            lines += ["", "## What is missing", "", *(f"* {words}" for words in self.errors)]
        made = ", ".join(f"{name} {version}" for name, version in self.versions.items())
        lines += ["", "## Made by", "", f"`{' '.join(self.command_line)}`", ""]
        lines += [f"commit {self.commit or 'unknown'}; {made}"]
        return "\n".join(lines) + "\n"


def write_card(card: Card, machine: Path, person: Path) -> None:
    """Write it as JSON and as Markdown. Raises `SandraError` where that is not possible."""
    try:
        machine.write_text(json.dumps(card.to_dict(), indent=1) + "\n", encoding="utf-8")
        person.write_text(str(card), encoding="utf-8")
    except OSError as error:
        raise SandraError(
            f"{machine.parent}: cannot be written ({error.strerror}); choose another place"
        ) from None


def _markdown(name: str, table: Table) -> list[str]:
    columns = list(dict.fromkeys(column for row in table.values() for column in row))
    lines = [f"| {name} | {' | '.join((*columns, 'all', '%'))} |"]
    lines += ["|---|" + "---:|" * (len(columns) + 2)]
    total = sum(sum(row.values()) for row in table.values())
    for value, row in table.items():
        every = sum(row.values())
        counts = [*(row.get(column, 0) for column in columns), every]
        lines += [
            f"| {value} | {' | '.join(map(str, counts))} | {100 * every / max(total, 1):.2f} |"
        ]
    return lines


def _words(value: Any) -> str:
    if isinstance(value, Mapping):
        return "; ".join(f"{name}: {_words(each)}" for name, each in value.items())
    if isinstance(value, list | tuple):
        return ", ".join(map(str, value))
    return str(value)
