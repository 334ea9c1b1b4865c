"""A folder of a small Qwen3 model, as scoring reads it (`sandra.rankers.local.score.Reader`)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sandra.errors import RankerError
from sandra.rankers.bounded import Deadline
from sandra.rankers.endpoint import Question
from sandra.rankers.inside.model import Memory, Qwen3
from sandra.rankers.local.question import messages_of
from sandra.rankers.local.turns import Turns

BATCH = 128
"""Tokens that are read at once; between two batches a question can be given up."""


@dataclass(frozen=True, slots=True, eq=False)
class Read:
    """What is known after a text: the memory, and the logits of the token that follows."""

    memory: Memory
    logits: NDArray[np.float64]


class InsideReader:
    """Model and tokenizer of a folder. What was read before changes nothing.

    Args:
        folder: as `sandra finetune scratch` writes it: the chat template is the one of
            `sandra.learn.tuning.tokenizer`.

    Raises:
        RankerError: a folder that cannot be read.
    """

    def __init__(self, folder: Path) -> None:
        from threadpoolctl import ThreadpoolController
        from tokenizers import Tokenizer

        self.model = Qwen3.load(folder)
        try:
            self._tokenizer = Tokenizer.from_file(str(folder / "tokenizer.json"))
        except Exception as error:  # noqa: BLE001  (that is all the library raises)
            words = str(error).splitlines()[0][:300]
            raise RankerError(f"{folder}: the tokenizer cannot be read ({words})") from None
        # What a driver or a scenario says is text, even if it looks like the end of a turn.
        self._tokenizer.encode_special_tokens = True
        self._start, self._end = (self._number(f"<|im_{word}|>") for word in ("start", "end"))
        self.turns = Turns()
        # Products this small are slower on several cores, and rounded in another order.
        self._blas = ThreadpoolController()

    def tokens_of(self, text: str) -> list[int]:
        """See `Reader`."""
        tokens: list[int] = self._tokenizer.encode(text, add_special_tokens=False).ids
        return tokens

    def tokens_of_question(self, question: Question) -> list[int]:
        """See `Reader`: the conversation in the form of ChatML."""
        found: list[int] = []
        for turn in messages_of(question):
            words = self.tokens_of(f"{turn['role']}\n{turn['content']}")
            found += [self._start, *words, self._end, *self.tokens_of("\n")]
        return [*found, self._start, *self.tokens_of("assistant\n")]

    def read(self, tokens: Sequence[int], deadline: Deadline) -> Read | None:
        """See `Reader`."""
        memory, last = Memory(), None
        for at in range(0, len(tokens), BATCH):
            if self.turns.over(deadline):
                return None
            with self._blas.limit(limits=1):
                x, memory = self.model.read(np.array([tokens[at : at + BATCH]]), memory)
            last = x[0, -1]
        return None if last is None else Read(memory, self.model.logits(last))

    def next_logits(self, memory: Read) -> NDArray[np.float64]:
        """See `Reader`."""
        return memory.logits

    def branches(self, memory: Read, rows: Sequence[Sequence[int]]) -> NDArray[np.float64]:
        """See `Reader`."""
        with self._blas.limit(limits=1):
            x, _ = self.model.read(np.array(rows), memory.memory)
            return self.model.logits(x)

    def _number(self, token: str) -> int:
        number: Any = self._tokenizer.token_to_id(token)
        if number is None:
            raise RankerError(f"the tokenizer has no {token}")
        return int(number)
