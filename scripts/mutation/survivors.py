"""The list of mutants that survive with a reason: tests/mutation.toml."""

from __future__ import annotations

import tomllib
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from mutation.mutant import Mutant

EQUIVALENT, ACCEPTED = "equivalent", "accepted"


@dataclass(frozen=True)
class Entry:
    """Why a mutant may survive.

    Attributes:
        kind: EQUIVALENT if nothing that the code promises changes; ACCEPTED if something does,
            but no test should fix it.
        reason: why, in one sentence.
    """

    file: str
    function: str
    before: str
    after: str
    kind: str
    reason: str

    def explains(self, mutant: Mutant) -> bool:
        return (self.file, self.function, self.before, self.after) == (
            mutant.file,
            mutant.function,
            mutant.before,
            mutant.after,
        )


def load(path: Path) -> list[Entry]:
    """The entries of the list.

    Raises:
        SystemExit: if an entry lacks something or has an unknown kind.
    """
    if not path.exists():
        return []
    entries = []
    for number, table in enumerate(tomllib.loads(path.read_text("utf-8"))["survivor"], start=1):
        try:
            entry = Entry(**table)
        except TypeError as error:
            raise SystemExit(f"{path}: entry {number}: {error}") from None
        if entry.kind not in (EQUIVALENT, ACCEPTED) or not entry.reason.strip():
            raise SystemExit(f"{path}: entry {number}: kind or reason is missing")
        entries.append(entry)
    return entries


def explanation(mutant: Mutant, entries: Iterable[Entry]) -> Entry | None:
    return next((entry for entry in entries if entry.explains(mutant)), None)


def template(mutant: Mutant) -> str:
    """The entry for a survivor, with the reason still to be written."""
    lines = ["[[survivor]]"]
    for key in ("file", "function", "before", "after"):
        lines.append(f"{key} = {_quoted(getattr(mutant, key))}")
    return "\n".join([*lines, f'kind = "{EQUIVALENT}"', 'reason = ""', ""])


def _quoted(text: str) -> str:
    if "'" not in text:
        return f"'{text}'"
    return '"' + text.replace("\\", "\\\\").replace('"', '\\"') + '"'
