"""What the driver remembers: situations that once were, and how they were reasoned about."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from importlib.resources import files
from pathlib import Path

import numpy as np

from sandra.errors import SettingsError
from sandra.rankers.bounded import Deadline
from sandra.rankers.client import Problem
from sandra.rankers.dilu.embedding import Array, Embedding


@dataclass(frozen=True, slots=True)
class Experience:
    """One item of memory; together they make a turn of question and answer."""

    situation: str
    """`View.situation`: what it is found by."""
    choices: str
    """`View.choices`."""
    answer: str
    """A reasoning that ends with `####` and the number of the action."""
    source: str = ""
    """Where it was seen, e.g. "setting 2, seed 100003, step 12"."""

    @property
    def question(self) -> str:
        """The text to which the answer was given."""
        return f"{self.situation}\n\nYou can choose:\n{self.choices}"


class Memory:
    """Experiences, found by likeness. Its vectors are computed when they are first needed."""

    def __init__(self, items: Sequence[Experience], embedding: Embedding) -> None:
        self.items = tuple(items)
        self.embedding = embedding
        self._vectors: Array | None = None

    def nearest(
        self, situation: str, n: int, deadline: Deadline
    ) -> tuple[Experience, ...] | Problem:
        """The n experiences most like a situation (cosine), the likest last.

        The last stands next to the question: what a model reads last it minds most.
        """
        if n == 0 or not self.items:
            return ()
        if self._vectors is None:
            vectors = self.embedding.embed([item.situation for item in self.items], deadline)
            if isinstance(vectors, Problem):
                return vectors
            self._vectors = vectors
        here = self.embedding.embed([situation], deadline)
        if isinstance(here, Problem):
            return here
        likeness = np.round(self._vectors @ here[0], 9)
        order = np.argsort(-likeness, kind="stable")[:n]
        return tuple(self.items[int(i)] for i in order[::-1])


def load(path: str | Path | None = None) -> tuple[Experience, ...]:
    """Experiences of a JSON file; without a path those that are shipped.

    Raises:
        SettingsError: a file that cannot be read.
    """
    try:
        if path is None:
            text = (files(__package__) / "memory.json").read_text(encoding="utf-8")
        else:
            text = Path(path).read_text(encoding="utf-8")
        return tuple(Experience(**item) for item in json.loads(text))
    except (OSError, ValueError, TypeError) as error:
        raise SettingsError(
            f"{path}: no memory can be read ({error}); it is a list of objects with situation, "
            f"choices, answer, as scripts/dilu_memory.py writes it"
        ) from None


def dump(items: Sequence[Experience]) -> str:
    """The text of a file that `load` reads."""
    return json.dumps([asdict(item) for item in items], indent=1, ensure_ascii=False) + "\n"
