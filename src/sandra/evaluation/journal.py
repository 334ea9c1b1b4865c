"""A file of results that grows with a run and from which the run goes on.

JOURNAL.jsonl: the first line says what is run, every further line holds one key and its value. A
line that was cut short by a kill is dropped; a run of something else never goes on in it.
"""

from __future__ import annotations

import io
import json
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, BinaryIO

from sandra.errors import SandraError


class Journal:
    """Values by key; each is in the file as soon as it is added, and read there when asked for.

    Args:
        path: None keeps everything in memory. about: what is run, as JSON.

    Raises:
        SandraError: if the file cannot be read or written, or holds another run.
    """

    def __init__(self, path: Path | None, about: dict[str, Any]) -> None:
        self._path = path
        self._memory = io.BytesIO()
        self._places: dict[str, int] = {}
        head = json.dumps({"about": about}, sort_keys=True).encode() + b"\n"
        if path is not None:
            with _written(path):
                path.parent.mkdir(parents=True, exist_ok=True)
                path.touch()
        with self._opened() as file:
            first = file.readline()
            if first.endswith(b"\n"):
                self._go_on(json.loads(head)["about"], first, file)
            else:  # Empty, or cut short.
                file.truncate(0)
                file.seek(0)
                file.write(head)

    def _go_on(self, wanted: dict[str, Any], first: bytes, file: BinaryIO) -> None:
        place = len(first)
        try:
            known = json.loads(first)["about"]
            for line in file:
                if not line.endswith(b"\n"):
                    break  # Cut short.
                self._places[json.loads(line)["key"]] = place
                place += len(line)
            differs = [k for k in {**known, **wanted} if known.get(k) != wanted.get(k)]
        except (ValueError, KeyError, TypeError):
            raise SandraError(
                f"{self._path}: is no journal of ours; choose another --out"
            ) from None
        if differs:
            raise SandraError(
                f"{self._path}: holds a run that differs in {', '.join(sorted(differs))}; "
                "choose another --out, or remove it"
            )
        file.truncate(place)

    def __contains__(self, key: str) -> bool:
        return key in self._places

    def __getitem__(self, key: str) -> Any:
        """A value, as it is after JSON. Raises `KeyError` if there is none."""
        place = self._places[key]
        with self._opened() as file:
            file.seek(place)
            return json.loads(file.readline())["value"]

    def add(self, key: str, value: Any) -> None:
        """Keep a value.

        Raises:
            SandraError: if the file cannot be written.
        """
        line = json.dumps({"key": key, "value": value}, allow_nan=False).encode() + b"\n"
        with self._opened() as file:
            self._places[key] = file.seek(0, io.SEEK_END)
            file.write(line)

    def remove(self) -> None:
        """Nothing is to go on any more."""
        if self._path is not None:
            self._path.unlink(missing_ok=True)

    @contextmanager
    def _opened(self) -> Iterator[BinaryIO]:
        if self._path is None:
            self._memory.seek(0)
            yield self._memory
            return
        with _written(self._path), self._path.open("r+b") as file:
            yield file


@contextmanager
def _written(path: Path) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        raise SandraError(
            f"{path}: cannot be written ({error.strerror}); choose another --out"
        ) from None
