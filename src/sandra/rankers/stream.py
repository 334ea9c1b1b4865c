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
from sandra.rankers.secret import Secret
from sandra.rankers.types import Failure
from sandra.rankers.usage import Usage, told_by_server

MAX_WIRE = 16_000_000
"""Most bytes of a response that are read: events carry much more frame than text."""
MAX_EVENT = 1_000_000
"""Longest piece that is parsed, an event or a whole body [bytes]: nothing else runs meanwhile."""
MAX_REFUSAL = 2000
"""So much of the words of a refusal is kept [characters]."""


@dataclass(slots=True)
class Reply:
    """What has arrived so far. Written by one thread; another may read `text` at any time."""

    pieces: list[str] = field(default_factory=list, repr=False)
    refusal: list[str] = field(default_factory=list, repr=False)
    finish: str | None = None
    length: int = 0
    begun: bool = False
    """The head of a response that is no error has come."""
    refused: bool = False
    """It was an error, or nobody was there: nothing was worked on."""
    ended_early: bool = False
    failure: Failure | None = None
    detail: str | None = None
    usage: Usage | None = None
    """What the server counted; None if it did not tell, or not yet."""
    hide: Secret = field(default_factory=Secret)
    """Takes our key out of what the server says."""

    @property
    def text(self) -> str:
        """The answer's text so far."""
        text = "".join(self.pieces)
        # Events may part a pair of surrogates; one that stays alone is no character.
        text = text.encode("utf-16-le", "surrogatepass").decode("utf-16-le", "replace")
        return self.hide(text)

    @property
    def refusal_text(self) -> str:
        """The words of a refusal so far."""
        return self.hide("".join(self.refusal))

    def add(self, text: Any) -> None:
        """More of the answer, if it is text; too much ends the reply."""
        if isinstance(text, str):
            self.pieces.append(text[: MAX_ANSWER + 1 - self.length])
            self.length += len(text)
            self.ended_early = self.ended_early or self.length > MAX_ANSWER

    def refuse(self, text: Any) -> None:
        """More of a refusal, if it is text."""
        if isinstance(text, str) and text:
            self.refusal.append(text[: MAX_REFUSAL - sum(map(len, self.refusal))])

    def fail(self, error: Any) -> None:
        """The server says that it went wrong, in a text or an object with a message."""
        words = error.get("message") if isinstance(error, dict) else error
        detail = words if isinstance(words, str) else "an error without words"
        self.failure, self.detail = Failure.SERVER_ERROR, self.hide(detail)

    @property
    def whole(self) -> bool:
        """Whether the model came to its end by itself."""
        cut = self.ended_early or self.failure is not None or bool(self.refusal)
        return not cut and self.finish in (None, "stop")


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
        for data in _events(limited, reply):
            if data == b"[DONE]" or reply.ended_early or reply.failure is not None:
                return
            take(data, reply)
        return
    take(b"".join(_pieces_of_one(limited, reply)), reply)


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


def _pieces_of_one(blocks: Iterable[bytes], reply: Reply) -> Iterator[bytes]:
    """The blocks of a body that is one piece, unless it becomes too long."""
    size = 0
    for block in blocks:
        size += len(block)
        if size > MAX_EVENT:
            reply.ended_early = True
            return
        yield block


def _events(blocks: Iterable[bytes], reply: Reply) -> Iterator[bytes]:
    """The data of each server-sent event; events of several data lines are not used here."""
    begun: list[bytes] = []
    size = 0
    for block in blocks:
        *ends, rest = block.split(b"\n")
        for end in ends:
            line = b"".join((*begun, end))
            begun, size = [], 0
            if line.startswith(b"data:"):
                yield line[5:].strip()
        begun.append(rest)
        size += len(rest)
        if size > MAX_EVENT:
            reply.ended_early = True
            return
    line = b"".join(begun)
    if line.startswith(b"data:"):
        yield line[5:].strip()


def decoded(take: Callable[[Any, Reply], None]) -> Callable[[bytes, Reply], None]:
    """Takes JSON: what is none is a failure, unless it was cut off."""

    def take_bytes(data: bytes, reply: Reply) -> None:
        try:
            body = json.loads(data)
        except (ValueError, RecursionError):
            if not reply.ended_early:
                reply.failure, reply.detail = Failure.MALFORMED, "the server did not send JSON"
            return
        take(body, reply)

    return take_bytes


@decoded
def _take(body: Any, reply: Reply) -> None:
    """Take one chunk of a stream, or one whole body."""
    if isinstance(body, dict) and body.get("error"):
        reply.fail(body["error"])
        return
    if isinstance(body, dict):
        reply.usage = told_by_server(body.get("usage")) or reply.usage
    choice = _first_choice(body)
    if choice is None:
        # Streams end with a chunk that only counts tokens; a whole body needs a choice.
        if not (isinstance(body, dict) and "choices" in body):
            reply.failure, reply.detail = Failure.MALFORMED, "the server sent no chat completion"
        return
    message = choice.get("delta") or choice.get("message") or {}
    if isinstance(message, dict):
        reply.add(message.get("content"))
        reply.refuse(message.get("refusal"))
    finish = choice.get("finish_reason")
    if isinstance(finish, str):
        reply.finish = finish


def _first_choice(body: Any) -> dict[str, Any] | None:
    choices = body.get("choices") if isinstance(body, dict) else None
    if isinstance(choices, list) and choices and isinstance(choices[0], dict):
        return choices[0]
    return None
