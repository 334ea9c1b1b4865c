"""`gguf:PATH`: a GGUF file in this process, through llama.cpp.

The answer is constrained to the schema by a grammar, in which moreover no pair may be written
twice. The prompt is read in small batches, and after each batch and each token it is looked whether
the deadline has passed: a question that nobody waits for any more leaves the model free for the
next one within a batch's time.
"""

from __future__ import annotations

import json
import os
import secrets
import threading
from functools import lru_cache
from pathlib import Path
from typing import Any

from sandra.errors import RankerError
from sandra.rankers.bounded import Deadline
from sandra.rankers.client import Problem
from sandra.rankers.endpoint import Exchange, Question
from sandra.rankers.local.grammar import grammar_of
from sandra.rankers.local.packages import package
from sandra.rankers.local.question import BUSY, MOST_TOKENS, messages_of, schema_of
from sandra.rankers.local.turns import Turns
from sandra.rankers.stream import Reply, read
from sandra.rankers.types import Failure

BATCH = 64
"""Tokens of a prompt that are read at once; between two batches a question can be given up."""
CONTEXT = 8192
"""Tokens of a prompt and its answer."""


class LlamaCpp:
    """A model that is loaded (`Asks`). Usable from several threads; questions wait in line.

    Args:
        path: the GGUF file.
        threads: default OMP_NUM_THREADS, else one per core.
        context: see `CONTEXT`.

    Raises:
        RankerError: no package, no such file, or one that llama.cpp cannot load.
    """

    def __init__(self, path: Path, threads: int | None = None, context: int = CONTEXT) -> None:
        llama = package("xllamacpp")
        parameters = llama.CommonParams()
        parameters.model.path = str(path)
        parameters.n_ctx = context
        parameters.n_batch = parameters.n_ubatch = BATCH
        parameters.n_parallel = 1
        parameters.verbosity = -1
        parameters.warmup = False
        # It always opens a port on loopback too; nobody knows the key.
        parameters.api_keys = [secrets.token_hex(32)]
        number = threads or _usual_threads()
        if number is not None:
            parameters.cpuparams.n_threads = number
            parameters.cpuparams_batch.n_threads = number
        try:
            self._server = llama.Server(parameters)
        except RuntimeError as error:
            raise RankerError(f"gguf: llama.cpp cannot load {path} ({error})") from None
        self._turns = Turns()

    def asking(self, sampling: dict[str, Any]) -> Asking:
        """With these sampling parameters."""
        return Asking(self, sampling)

    def ask(
        self, question: Question, deadline: Deadline, exchange: Exchange, sampling: dict[str, Any]
    ) -> Problem | Reply:
        """See `Asks`."""
        reply = Reply(begun=True)
        problems: list[Problem] = []

        def take(chunk: dict[str, Any]) -> bool:
            """Takes what has come; whether to stop."""
            if chunk.get("error"):
                problems.append(_problem(chunk["error"]))
            else:
                data = json.dumps(chunk, ensure_ascii=False).encode("utf-8", "replace")
                read([data], "application/json", reply, deadline)
            reply.ended_early = reply.ended_early or self._turns.over(deadline)
            return reply.ended_early

        with self._turns.turn(deadline) as mine:
            if not mine:
                return BUSY
            exchange.requests.append(reply)
            self._server.handle_chat_completions(_body(question, sampling), take)
        return problems[0] if problems else reply


class Asking:
    """A loaded model, with the sampling parameters of one ranker (`Asks`)."""

    takes_pictures = False

    def __init__(self, model: LlamaCpp, sampling: dict[str, Any]) -> None:
        self._model, self._sampling = model, sampling

    def ask(self, question: Question, deadline: Deadline, exchange: Exchange) -> Problem | Reply:
        """See `Asks`."""
        return self._model.ask(question, deadline, exchange, self._sampling)


@lru_cache(maxsize=2)
def _loaded(path: Path, changed: int, threads: int | None, context: int) -> LlamaCpp:
    return LlamaCpp(path, threads, context)


_loading = threading.Lock()


def llama(path: str, *, threads: int | None = None, context: int = CONTEXT) -> LlamaCpp:
    """The model in a file; the last two that were used stay loaded.

    Raises:
        RankerError: see `LlamaCpp`.
    """
    file = Path(path).expanduser().resolve()
    try:
        changed = file.stat().st_mtime_ns
        with file.open("rb") as stream:
            is_gguf = stream.read(4) == b"GGUF"
    except OSError as error:
        raise RankerError(f"gguf: {path} cannot be read ({error.strerror})") from None
    if not is_gguf:
        raise RankerError(f"gguf: {path} is no GGUF file")
    with _loading:
        return _loaded(file, changed, threads, context)


def _usual_threads() -> int | None:
    """As PyTorch and others take it from the environment."""
    text = os.environ.get("OMP_NUM_THREADS", "").strip()
    return int(text) if text.isdecimal() and int(text) > 0 else None


def _body(question: Question, sampling: dict[str, Any]) -> dict[str, Any]:
    body = {
        "messages": messages_of(question),
        "stream": True,
        "stream_options": {"include_usage": True},
        "return_progress": True,  # a chunk after each batch that was read
        "max_tokens": MOST_TOKENS,
        "chat_template_kwargs": {"enable_thinking": False},
        "temperature": 0.0,
        **sampling,
    }
    schema = schema_of(question)
    rules = None if schema is None else grammar_of(schema)
    if rules is not None:
        body["grammar"] = f"%llguidance {{}}\n{rules}"
    elif schema is not None:
        schema = {"name": "ranking", "strict": True, "schema": schema}
        body["response_format"] = {"type": "json_schema", "json_schema": schema}
    return body


def _problem(error: Any) -> Problem:
    """What llama.cpp says, by name; a prompt that is too long is REJECTED."""
    code = error.get("code") if isinstance(error, dict) else None
    words = error.get("message") if isinstance(error, dict) else error
    rejected = isinstance(code, int) and 400 <= code < 500
    return Problem(Failure.REJECTED if rejected else Failure.SERVER_ERROR, str(words))
