"""`openai:MODEL`, `ollama:MODEL`, `vllm:MODEL`: servers that speak OpenAI's language.

They differ in where they listen by default and in whose key they are shown: that of OpenAI is sent
to nobody but the server of `openai:`.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

from sandra.rankers.chat import ChatRanker
from sandra.rankers.endpoint import Endpoint
from sandra.rankers.responses import ResponsesEndpoint
from sandra.rankers.spec import at_least, number, one_of, split

SERVERS: dict[str, str | None] = {
    "openai": None,
    "ollama": "http://localhost:11434/v1",
    "vllm": "http://localhost:8000/v1",
}
"""Where they listen; None: at OpenAI's. `OLLAMA_BASE_URL` and the like name another place."""
OPTIONS: dict[str, Callable[[str], Any]] = {
    "api": one_of("chat", "responses"),
    "temperature": number,
    "seed": at_least(0),
}
"""What may follow the model's name, as in `openai:MODEL#api=responses&temperature=0`."""


def server_ranker(
    kind: str,
    text: str,
    *,
    base_url: str | None,
    deadline: float,
    cache: str | Path | None = None,
    max_concurrent: int | None = None,
    **sampling: float | int | None,
) -> ChatRanker:
    """A ranker that asks one of `SERVERS`.

    Args:
        kind, text: of the spec `kind:text`.
        base_url: goes before the environment and the default.
        deadline: see `ChatRanker`.
        cache, max_concurrent: see `Endpoint`.
        sampling: `temperature` and `seed`, where the spec names none.

    Raises:
        RankerError: see `split` and `ChatRanker`.
    """
    model, options = split(kind, text, OPTIONS)
    make = ResponsesEndpoint if options.pop("api", "chat") == "responses" else Endpoint
    given = {name: v for name, v in {**sampling, **options}.items() if v is not None}
    variables = kind.upper()
    address = base_url or os.environ.get(f"{variables}_BASE_URL") or SERVERS[kind]
    endpoint = make(model, address, given, variables, cache=cache, max_concurrent=max_concurrent)
    return ChatRanker(model, deadline=deadline, endpoint=endpoint, name=f"{kind}:{text.strip()}")
