"""Rows as token sequences for a trainer: what is read, what is to be said, and what counts.

The conversation is that of `sandra.rankers.local`: system, user, then the answer as JSON without
reasoning. Every token has a weight: those that choose the first pair count most, the rest of the
answer little (a recording does not tell what would have been second best), the prompt as much as
is asked for.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from sandra.errors import SandraError
from sandra.learn.export import answer
from sandra.learn.rows import Row, read_rows

_FIRST, _REST = 1.0, 0.05
"""Weights of the tokens of the first pair, and of the answer's others."""


@dataclass(frozen=True, slots=True)
class Example:
    """A conversation as tokens; `answer` is where the answer begins, `chosen` where its first
    pair is over. `pair` and `feasible` are for measuring."""

    tokens: tuple[int, ...]
    answer: int
    chosen: int
    pair: str
    feasible: tuple[str, ...]

    def weights(self, prompt: float) -> list[float]:
        """One for each token, as something to be said."""
        return [
            prompt if i < self.answer else _FIRST if i < self.chosen else _REST
            for i in range(len(self.tokens))
        ]


def messages(row: Row) -> list[dict[str, str]]:
    """System and user."""
    return [
        {"role": "system", "content": row.system or ""},
        {"role": "user", "content": row.user or ""},
    ]


def example(row: Row, tokenizer: Any) -> Example:
    """The tokens of a labelled row. `tokenizer` has a chat template, as a folder's has."""
    before = tokenizer.apply_chat_template(
        messages(row), tokenize=False, add_generation_prompt=True, enable_thinking=False
    )
    said = answer(row)
    first = said.index("}") + 1

    def tokens(text: str) -> list[int]:
        found: list[int] = tokenizer(text, add_special_tokens=False)["input_ids"]
        return found

    read, whole = tokens(before), tokens(said + tokenizer.eos_token)
    chosen = len(tokens(said[:first]))
    return Example(
        tokens=(*read, *whole),
        answer=len(read),
        chosen=len(read) + chosen,
        pair=row.label or "",
        feasible=row.feasible,
    )


def conversation(row: Row) -> str:
    """A row with its answer, as text; as the chat template of our own tokenizer writes it."""
    said = {"role": "assistant", "content": answer(row)}
    turns = [*messages(row), said]
    return "".join(f"<|im_start|>{t['role']}\n{t['content']}<|im_end|>\n" for t in turns)


def labelled(files: Sequence[Path], split: str) -> list[Row]:
    """The rows of a split that have a label.

    Raises:
        SandraError: a file that cannot be read, or no such row.
    """
    rows = [row for file in files for row in read_rows(file) if row.is_labelled]
    found = [row for row in rows if row.split == split]
    if not found:
        names = ", ".join(map(str, files))
        raise SandraError(f"{names}: no labelled row in split '{split}'")
    return found


def digest(files: Iterable[Path]) -> dict[str, str]:
    """SHA-256 of each file, by its name."""
    return {file.name: hashlib.sha256(file.read_bytes()).hexdigest() for file in files}
