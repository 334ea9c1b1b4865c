"""A file of results that grows with a run and from which the run goes on.

JOURNAL.jsonl: the first line says what is run, every further line holds one key and its value. A
line that was cut short by a kill is dropped; a run of something else never goes on in it.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from sandra.errors import SandraError


class Journal:
    """Values by key; each is in the file as soon as it is added.

    Args:
        path: None keeps everything in memory. about: what is run, as JSON.

    Raises:
        SandraError: if the file cannot be read or written, or holds another run.
    """

    def __init__(self, path: Path | None, about: dict[str, Any]) -> None:
        self.values: dict[str, Any] = {}
        self._path = path
        if path is None:
            return
        head = json.dumps({"about": about}, sort_keys=True)
        try:
            lines = path.read_bytes().split(b"\n") if path.exists() else []
            whole = lines[:-1]  # What follows the last line break was cut short.
            if whole:
                self._go_on(path, head, whole)
            else:
                path.parent.mkdir(parents=True, exist_ok=True)
            kept = b"".join(line + b"\n" for line in whole or [head.encode()])
            path.write_bytes(kept)
        except OSError as error:
            raise SandraError(
                f"{path}: cannot be written ({error.strerror}); choose another --out"
            ) from None

    def _go_on(self, path: Path, head: str, lines: list[bytes]) -> None:
        try:
            told = [json.loads(line) for line in lines]
            known = told[0]["about"]
            self.values = {entry["key"]: entry["value"] for entry in told[1:]}
        except (ValueError, KeyError, TypeError):
            raise SandraError(f"{path}: is no journal of ours; choose another --out") from None
        wanted = json.loads(head)["about"]
        differs = [k for k in {**known, **wanted} if known.get(k) != wanted.get(k)]
        if differs:
            raise SandraError(
                f"{path}: holds a run that differs in {', '.join(sorted(differs))}; "
                "choose another --out"
            )

    def add(self, key: str, value: Any) -> None:
        """Keep a value, as it is after JSON.

        Raises:
            SandraError: if the file cannot be written.
        """
        line = json.dumps({"key": key, "value": value}, allow_nan=False)
        self.values[key] = json.loads(line)["value"]
        if self._path is None:
            return
        try:
            with self._path.open("a", encoding="utf-8") as file:
                file.write(line + "\n")
        except OSError as error:
            raise SandraError(f"{self._path}: cannot be written ({error.strerror})") from None
