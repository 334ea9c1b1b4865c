"""`hf:PATH`: the model writes its answer token by token, and can only write what the schema admits.

Constrained decoding as in the paper: at each token a grammar says which ones may follow
(llguidance); where only one text may follow, it is read and not asked for. Beyond the schema, no
pair may be written twice.
"""

from __future__ import annotations

import json
import random
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sandra.rankers.bounded import Deadline
from sandra.rankers.client import Problem
from sandra.rankers.endpoint import Exchange, Question
from sandra.rankers.local.folder import Folder, Memory
from sandra.rankers.local.grammar import grammar_of
from sandra.rankers.local.packages import package
from sandra.rankers.local.question import BUSY, MOST_TOKENS, messages_of, schema_of
from sandra.rankers.stream import Reply
from sandra.rankers.usage import Usage

_FORM = {"whitespace_flexible": False, "item_separator": ", ", "key_separator": ": "}
"""As `json.dumps` writes it; see `grammar_of`."""


class Generating:
    """Asks a model in this process (`Asks`). Usable from several threads; questions wait in line.

    Args:
        temperature: 0 takes the likeliest token, always the same.
        seed: of the draw where the temperature is greater than 0.
    """

    takes_pictures = False

    def __init__(self, folder: Folder, temperature: float = 0.0, seed: int = 0) -> None:
        self._folder, self._temperature, self._seed = folder, temperature, seed
        self._guide = package("llguidance").LLMatcher
        self._guided = package("llguidance.hf").from_tokenizer(folder.tokenizer)
        named = folder.model.generation_config.eos_token_id
        several = named if isinstance(named, list) else [named]
        self._ends = {n for n in (*several, folder.tokenizer.eos_token_id) if n is not None}

    def ask(self, question: Question, deadline: Deadline, exchange: Exchange) -> Problem | Reply:
        """See `Asks`."""
        tokens = self._folder.tokens_of(self._folder.text_of(messages_of(question)))
        matcher = self._matcher(question)
        reply = Reply(begun=True)
        with self._folder.turns.turn(deadline) as mine:
            if not mine:
                return BUSY
            exchange.requests.append(reply)
            memory = self._folder.read(tokens, deadline)
            if memory is None:
                reply.ended_early = True
            else:
                self._write(memory, matcher, reply, deadline)
        return reply

    def _matcher(self, question: Question) -> Any:
        """What says which tokens may follow; without a schema None."""
        schema = schema_of(question)
        if schema is None:
            return None
        rules = grammar_of(schema)
        if rules is None:
            text = json.dumps(schema)
            return self._guide(
                self._guided, self._guide.grammar_from_json_schema(text, overrides=_FORM)
            )
        return self._guide(self._guided, self._guide.grammar_from_lark(rules))

    def _write(self, memory: Memory, matcher: Any, reply: Reply, deadline: Deadline) -> None:
        draw = random.Random(self._seed)
        written: list[int] = []
        read = len(memory.tokens)
        while len(written) < MOST_TOKENS:
            if self._folder.turns.over(deadline):
                reply.ended_early = True
                return
            step = list(matcher.compute_ff_tokens()) if matcher else []
            if not step:
                logits = memory.logits.cpu().numpy()
                step = [self._choose(logits, _allowed(matcher, len(logits)), draw)]
            if matcher is not None:
                matcher.consume_tokens(step)
            over = step[-1] in self._ends or (matcher is not None and matcher.is_stopped())
            written += step
            self._tell(written, reply)
            reply.usage = Usage(input=read, cached_input=memory.kept, output=len(written))
            if over:
                reply.finish = "stop"
                return
            memory.feed(step)
        reply.finish = "length"

    def _choose(
        self, logits: NDArray[np.float32], allowed: NDArray[np.bool_], draw: random.Random
    ) -> int:
        logits = np.where(allowed, logits, -np.inf)
        if self._temperature == 0.0:
            return int(np.argmax(logits))
        weights = np.exp((logits - logits.max()) / self._temperature)
        total = np.cumsum(weights)
        return int(np.searchsorted(total, draw.random() * total[-1], side="right"))

    def _tell(self, written: list[int], reply: Reply) -> None:
        text = self._folder.tokenizer.decode(written, skip_special_tokens=True)
        if not text.endswith("\ufffd"):  # else half of a character
            new = text[reply.length :]
            reply.pieces.append(new)
            reply.length += len(new)


def _allowed(matcher: Any, size: int) -> NDArray[np.bool_]:
    """Which tokens the grammar admits next, as a row of `size`."""
    if matcher is None:
        return np.ones(size, dtype=bool)
    bits = np.unpackbits(np.frombuffer(matcher.compute_bitmask(), np.uint8), bitorder="little")
    row = np.zeros(size, dtype=bool)
    row[: len(bits)] = bits[:size]
    return row
