"""Reading a chat completion from the wire, piece by piece, with limits.

A stream of server-sent events is asked for, so that what has arrived by the deadline can be used.
A server that answers with one plain JSON body instead is understood as well.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from typing import Any

from sandra.rankers.answer import MAX_ANSWER
from sandra.rankers.bounded import Deadline
from sandra.rankers.types import Failure

MAX_WIRE = 16_000_000
"""Most bytes of a response that are read: events carry much more frame than text."""


@dataclass(slots=True)
class Reply:
    """What has arrived so far. Written by one thread; another may read `text` at any time."""

    pieces: list[str] = field(default_factory=list)
    refusal: list[str] = field(default_factory=list)
    finish: str | None = None
    length: int = 0
    ended_early: bool = False
    failure: Failure | None = None
    detail: str | None = None

    @property
    def text(self) -> str:
        """The answer's text so far."""
        return "".join(self.pieces)


def read(
    blocks: Iterable[bytes],
    content_type: str,
    reply: Reply,
    deadline: Deadline,
    take: Callable[[bytes, Reply], None] | None = None,
) -> None:
    """Fill `reply` from a response body until it ends, or a limit or the deadline is met.

    Args:
        blocks: the body as it arrives.
        content_type: of the response.
        reply: filled as the body arrives.
        deadline: looked at whenever something arrives.
        take: takes one event's data, or the whole body; default: of a chat completion.
    """
    take = take or _take
    limited = _limited(blocks, reply, deadline)
    if "text/event-stream" in content_type:
        for data in _events(limited):
            if data == b"[DONE]" or reply.ended_early or reply.failure is not None:
                return
            take(data, reply)
        return
    take(b"".join(limited), reply)


def _limited(blocks: Iterable[bytes], reply: Reply, deadline: Deadline) -> Iterator[bytes]:
    size = 0
    for block in blocks:
        size += len(block)
        if size > MAX_WIRE:
            reply.ended_early = True
            return
        yield block
        if deadline.passed or reply.ended_early:
            reply.ended_early = True
            return


def _events(blocks: Iterable[bytes]) -> Iterator[bytes]:
    """The data of each server-sent event; events of several data lines are not used here."""
    rest = b""
    for block in blocks:
        *lines, rest = (rest + block).split(b"\n")
        for line in lines:
            if line.startswith(b"data:"):
                yield line[5:].strip()
    if rest.startswith(b"data:"):
        yield rest[5:].strip()


def _take(data: bytes, reply: Reply) -> None:
    """Take one chunk of a stream, or one whole body."""
    try:
        body = json.loads(data)
    except (ValueError, RecursionError):
        if not reply.ended_early:
            reply.failure, reply.detail = Failure.MALFORMED, "the server did not send JSON"
        return
    if isinstance(body, dict) and body.get("error"):
        error = body["error"]
        words = error.get("message") if isinstance(error, dict) else error
        reply.failure, reply.detail = Failure.SERVER_ERROR, str(words)
        return
    choice = _first_choice(body)
    if choice is None:
        # Streams end with a chunk that only counts tokens; a whole body needs a choice.
        if not (isinstance(body, dict) and "choices" in body):
            reply.failure, reply.detail = Failure.MALFORMED, "the server sent no chat completion"
        return
    message = choice.get("delta") or choice.get("message") or {}
    if isinstance(message, dict):
        content, refusal = message.get("content"), message.get("refusal")
        if isinstance(content, str):
            reply.pieces.append(content[: MAX_ANSWER + 1 - reply.length])
            reply.length += len(content)
        if isinstance(refusal, str) and refusal:
            reply.refusal.append(refusal[:2000])
    finish = choice.get("finish_reason")
    if isinstance(finish, str):
        reply.finish = finish
    if reply.length > MAX_ANSWER:
        reply.ended_early = True


def _first_choice(body: Any) -> dict[str, Any] | None:
    choices = body.get("choices") if isinstance(body, dict) else None
    if isinstance(choices, list) and choices and isinstance(choices[0], dict):
        return choices[0]
    return None
