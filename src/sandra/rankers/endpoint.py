"""One question to an OpenAI-compatible chat endpoint, with retries, within a deadline."""

from __future__ import annotations

import json
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any, Protocol

from sandra.rankers.bounded import Deadline
from sandra.rankers.cache import Cache, Kept
from sandra.rankers.client import Problem, client_for, problem_of
from sandra.rankers.gate import Gate
from sandra.rankers.secret import Secret
from sandra.rankers.stream import Reply, read
from sandra.rankers.types import Failure
from sandra.rankers.usage import Usage

ATTEMPTS = 3
"""Requests for one answer, if the first ones fail in a way that may pass."""
BACKOFF = 0.2
"""Pause before the second attempt, doubled for the third [s]; `Retry-After` goes first."""

_GRACE = 0.25
"""After the deadline, a request that nobody waits for any more ends itself [s]."""

_LATE = "the server did not answer in time"
_PASSING = (Failure.RATE_LIMITED, Failure.SERVER_ERROR, Failure.UNREACHABLE)
_NAP = 0.05
"""A pause looks so often whether its deadline was brought forward [s]."""


Content = str | list[dict[str, Any]]


@dataclass(frozen=True, slots=True)
class Question:
    """System text, then turns of (role, content), and the schema of the answer to the last one.

    A content is a text, or a list of parts as the chat format has it. Without a schema (None) any
    text will do.
    """

    system: str
    turns: tuple[tuple[str, Content], ...]
    schema: dict[str, Any] | None


@dataclass(slots=True)
class Exchange:
    """What passes between us and a server for one question.

    Filled by the thread that asks; another may read it at any time.
    """

    requests: list[Reply] = field(default_factory=list)
    """One for each request, in their order, as far as its answer has come."""
    recorded: float | None = None
    """How long the server once took, where the answer is from the cache on disk [s]."""
    keep: Callable[[], None] = lambda: None
    """Keep the answer on disk, if a cache is there; for whoever has found it good."""

    @property
    def reply(self) -> Reply | None:
        """The last answer that has begun."""
        return next((reply for reply in reversed(self.requests) if reply.begun), None)

    @property
    def usage(self) -> Usage:
        """What the question has cost until now."""
        if self.recorded is not None:
            return Usage(from_cache=1)
        found = Usage()
        for reply in tuple(self.requests):
            unknown = reply.usage is None and not reply.refused
            found += (reply.usage or Usage()) + Usage(requests=1, unknown=int(unknown))
        return found


class Asks(Protocol):
    """Whatever can be asked a question: a server, or a model in this process."""

    def ask(self, question: Question, deadline: Deadline, exchange: Exchange) -> Problem | Reply:
        """Ask; each reply is also put into `exchange.requests`, and grows there."""
        ...


class Endpoint:
    """`/chat/completions` of one server for one model. Usable from several threads.

    Args:
        model: name of the model.
        base_url: of the server, up to `/v1`; default: OPENAI_BASE_URL, else OpenAI's.
        options: further fields of each request.
        server: whose variables of the environment count: `{server}_BASE_URL`, `{server}_API_KEY`.
        cache: folder of answers that are kept; None keeps none.
        max_concurrent: requests to this server at once, over all processes; see `Gate`.

    Raises:
        RankerError: no key for OpenAI's own server, a bad address, or a bad folder.
    """

    path = "chat/completions"

    def __init__(
        self,
        model: str,
        base_url: str | None,
        options: dict[str, Any],
        server: str = "OPENAI",
        *,
        cache: str | Path | None = None,
        max_concurrent: int | None = None,
    ) -> None:
        self._model = model
        self._options = options
        self._client = client_for(base_url, server)
        self._hide = Secret(self._client.api_key)
        self._address = str(self._client.base_url)
        self._gate = Gate(self._address, max_concurrent)
        self._cache = None if cache is None else Cache(cache)
        self._unknown: frozenset[str] = frozenset()
        """Fields that this server has refused."""
        # Imports half of the library: here, so that no ranking pays for it.
        self._completions = self._service()
        self._take: Callable[[bytes, Reply], None] | None = None

    def _service(self) -> Any:
        return self._client.chat.completions.with_streaming_response

    def ask(self, question: Question, deadline: Deadline, exchange: Exchange) -> Problem | Reply:
        """Ask up to `ATTEMPTS` times; everything is put into `exchange` as it comes."""
        known = None if self._cache is None else self._cache.get(self._identity(question))
        if known is not None:
            exchange.recorded = known.duration
            exchange.requests.append(Reply(pieces=[known.text], finish="stop", begun=True))
            return exchange.requests[-1]
        begin = time.monotonic()
        attempt = 0
        while True:
            result = self._one_by_one(question, deadline, exchange)
            if not isinstance(result, Problem):
                took = time.monotonic() - begin
                exchange.keep = partial(self._keep, question, result, took)
                return result
            refused = self._refused_field(result, question)
            if refused is not None:
                self._unknown |= {refused}
                continue
            attempt += 1
            pause = BACKOFF * 2 ** (attempt - 1) if result.pause is None else result.pause
            passing = result.failure in _PASSING and attempt < ATTEMPTS
            if not passing or pause >= deadline.left:
                return result
            _sleep(pause, deadline)

    def _one_by_one(
        self, question: Question, deadline: Deadline, exchange: Exchange
    ) -> Problem | Reply:
        """One request, once the server wants one and there is a place for it."""
        while True:
            pause = self._gate.pause
            if pause >= deadline.left and pause > 0.0:
                words = f"the server asked for a pause, {pause:.1f} s of it are left"
                return Problem(Failure.RATE_LIMITED, words, pause=pause)
            _sleep(pause, deadline)
            leave = self._gate.enter(deadline)
            if leave is None:
                return Problem(Failure.TIMEOUT, "too many other requests are on their way")
            try:
                if self._gate.pause > 0.0:
                    continue  # asked for meanwhile, by the answer to another request
                result = self._request(question, deadline, exchange)
            finally:
                leave()
            if isinstance(result, Problem) and result.pause is not None:
                self._gate.close_for(result.pause)
            return result

    def _request(
        self, question: Question, deadline: Deadline, exchange: Exchange
    ) -> Problem | Reply:
        import httpx2
        import openai

        body = {**self._body(question), **self._options}
        # A little longer than the caller waits: being late is then always noticed there.
        left = deadline.left + _GRACE
        reply = Reply(hide=self._hide)
        exchange.requests.append(reply)
        try:
            with self._completions.create(**body, stream=True, timeout=left) as response:
                reply.begun = True
                content_type = response.headers.get("content-type", "")
                read(response.iter_bytes(), content_type, reply, deadline, self._take)
        except (openai.APITimeoutError, httpx2.TimeoutException):
            return self._broken(reply, Problem(Failure.TIMEOUT, _LATE))
        except openai.APIError as error:
            reply.refused = isinstance(error, openai.APIStatusError) or isinstance(
                error.__cause__, httpx2.ConnectError
            )
            return problem_of(error, self._client)
        except httpx2.HTTPError as error:
            words = self._hide(f"the connection broke ({type(error).__name__}: {error})")
            return self._broken(reply, Problem(Failure.UNREACHABLE, words))
        return reply

    def _broken(self, reply: Reply, problem: Problem) -> Problem | Reply:
        """The reply so far if it holds text, else the problem."""
        if not reply.text:
            return problem
        reply.ended_early = True
        return reply

    def _body(self, question: Question) -> dict[str, Any]:
        system = question.system
        extra: dict[str, Any] = {}
        if question.schema is not None and "response_format" not in self._unknown:
            schema = {"name": "ranking", "strict": True, "schema": question.schema}
            extra["response_format"] = {"type": "json_schema", "json_schema": schema}
        elif question.schema is not None:
            words = json.dumps(question.schema, ensure_ascii=False)
            system += f"\nThe answer must fit this JSON schema: {words}"
        if "stream_options" not in self._unknown:
            extra["stream_options"] = {"include_usage": True}
        messages = [{"role": role, "content": content} for role, content in question.turns]
        return {
            "model": self._model,
            "messages": [{"role": "system", "content": system}, *messages],
            **extra,
        }

    def _refused_field(self, problem: Problem, question: Question) -> str | None:
        """A field of the last request that the server does not know."""
        if problem.status not in (400, 422):
            return None
        words = problem.detail.lower()
        fields = {
            "stream_options": ("stream_options", "include_usage"),
            "response_format": ("response_format", "text.format", "json_schema", "schema"),
        }
        for name, signs in fields.items():
            sent = name not in self._unknown
            if name == "response_format":
                sent = sent and question.schema is not None
            if sent and any(sign in words for sign in signs):
                return name
        return None

    def _identity(self, question: Question) -> dict[str, Any]:
        """All that an answer depends on; what it is kept under."""
        return {
            "endpoint": f"{self._address.rstrip('/')}/{self.path}",
            "model": self._model,
            "parameters": self._options,
            "system": question.system,
            "turns": [list(turn) for turn in question.turns],
            "schema": question.schema,
        }

    def _keep(self, question: Question, reply: Reply, took: float) -> None:
        if self._cache is not None and reply.whole:
            self._cache.put(self._identity(question), Kept(reply.text, took))


def _sleep(seconds: float, deadline: Deadline) -> None:
    end = time.monotonic() + seconds
    while not deadline.passed and (left := end - time.monotonic()) > 0.0:
        time.sleep(min(left, _NAP))
