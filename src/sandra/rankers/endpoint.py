"""One question to an OpenAI-compatible chat endpoint, with retries, within a deadline."""

from __future__ import annotations

import json
import os
import time
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any
from urllib.parse import urlsplit

from sandra.errors import RankerError
from sandra.rankers.bounded import Deadline
from sandra.rankers.stream import Reply, read
from sandra.rankers.types import Failure

if TYPE_CHECKING:
    import openai

ATTEMPTS = 3
"""Requests for one answer, if the first ones fail in a way that may pass."""
BACKOFF = 0.2
"""Pause before the second attempt, doubled for the third [s]; `Retry-After` goes first."""

_GRACE = 0.25
"""After the deadline, a request that nobody waits for any more ends itself [s]."""

_LATE = "the server did not answer in time"
_OPENAI_HOST = "api.openai.com"
_PASSING = (Failure.RATE_LIMITED, Failure.SERVER_ERROR, Failure.UNREACHABLE)


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


@dataclass(frozen=True, slots=True)
class Problem:
    """Why a request brought no reply. `pause`: what the server asks to wait [s], if anything."""

    failure: Failure
    detail: str
    status: int | None = None
    pause: float | None = None


class Endpoint:
    """`/chat/completions` of one server for one model. Usable from several threads.

    Args:
        model: name of the model.
        base_url: of the server, up to `/v1`; default: OPENAI_BASE_URL, else OpenAI's.
        options: further fields of each request.

    Raises:
        RankerError: no key for OpenAI's own server, or a bad address.
    """

    def __init__(self, model: str, base_url: str | None, options: dict[str, Any]) -> None:
        self._model = model
        self._options = options
        self._client = client_for(base_url)
        # Imports half of the library: here, so that no ranking pays for it.
        self._completions = self._client.chat.completions.with_streaming_response

    def ask(self, question: Question, deadline: Deadline, replies: list[Reply]) -> Problem | Reply:
        """Ask up to `ATTEMPTS` times; the last reply is also put into `replies` as it grows."""
        with_schema = question.schema is not None
        attempt = 0
        while True:
            result = self._request(question, deadline, with_schema, replies)
            if not isinstance(result, Problem):
                return result
            if with_schema and _rejects_schema(result):
                with_schema = False
                continue
            attempt += 1
            pause = BACKOFF * 2 ** (attempt - 1) if result.pause is None else result.pause
            passing = result.failure in _PASSING and attempt < ATTEMPTS
            if not passing or pause >= deadline.left:
                return result
            time.sleep(pause)

    def _request(
        self, question: Question, deadline: Deadline, with_schema: bool, replies: list[Reply]
    ) -> Problem | Reply:
        import httpx2
        import openai

        body = {**self._body(question, with_schema), **self._options}
        # A little longer than the caller waits: being late is then always noticed there.
        left = deadline.left + _GRACE
        reply = Reply()
        try:
            with self._completions.create(**body, stream=True, timeout=left) as response:
                replies.append(reply)
                content_type = response.headers.get("content-type", "")
                read(response.iter_bytes(), content_type, reply, deadline)
        except (openai.APITimeoutError, httpx2.TimeoutException):
            return self._broken(reply, Problem(Failure.TIMEOUT, _LATE))
        except openai.APIError as error:
            return problem_of(error, self._client)
        except httpx2.HTTPError as error:
            words = f"the connection broke ({type(error).__name__}: {error})"
            return self._broken(reply, Problem(Failure.UNREACHABLE, words))
        return reply

    def _broken(self, reply: Reply, problem: Problem) -> Problem | Reply:
        """The reply so far if it holds text, else the problem."""
        if not reply.text:
            return problem
        reply.ended_early = True
        return reply

    def _body(self, question: Question, with_schema: bool) -> dict[str, Any]:
        system = question.system
        extra: dict[str, Any] = {}
        if with_schema:
            schema = {"name": "ranking", "strict": True, "schema": question.schema}
            extra["response_format"] = {"type": "json_schema", "json_schema": schema}
        elif question.schema is not None:
            words = json.dumps(question.schema, ensure_ascii=False)
            system += f"\nThe answer must fit this JSON schema: {words}"
        messages = [{"role": role, "content": content} for role, content in question.turns]
        return {
            "model": self._model,
            "messages": [{"role": "system", "content": system}, *messages],
            **extra,
        }


def client_for(base_url: str | None) -> openai.OpenAI:
    """A client of a server; None: that of OPENAI_BASE_URL, else OpenAI's.

    Raises:
        RankerError: no key for OpenAI's own server, or a bad address.
    """
    import openai

    base_url = base_url or os.environ.get("OPENAI_BASE_URL") or None
    address = urlsplit(base_url or f"https://{_OPENAI_HOST}/v1")
    if address.scheme not in ("http", "https") or not address.hostname:
        raise RankerError(
            f"openai: base_url '{base_url}' is no address; write for example http://localhost:8000/v1"
        )
    key = os.environ.get("OPENAI_API_KEY")
    if not key and address.hostname == _OPENAI_HOST:
        raise RankerError(
            "openai: no API key; set OPENAI_API_KEY, or give the base_url of a local server"
        )
    # Retries and the deadline are kept here: the library's are per attempt.
    return openai.OpenAI(api_key=key or "not-needed", base_url=base_url, max_retries=0)


def problem_of(error: openai.APIError, client: openai.OpenAI) -> Problem:
    """What went wrong with a request, by name."""
    import openai

    if isinstance(error, openai.APIStatusError):
        return _refused_request(error)
    if isinstance(error, openai.APITimeoutError):
        return Problem(Failure.TIMEOUT, _LATE)
    if isinstance(error, openai.APIConnectionError):
        words = f"{client.base_url} cannot be reached ({error.__cause__ or error})"
        return Problem(Failure.UNREACHABLE, words)
    return Problem(Failure.MALFORMED, f"the server's answer cannot be read ({error.message})")


def _rejects_schema(problem: Problem) -> bool:
    """Whether the server does not know structured outputs."""
    words = problem.detail.lower()
    return problem.status in (400, 422) and any(
        word in words for word in ("response_format", "json_schema", "schema")
    )


def _refused_request(error: openai.APIStatusError) -> Problem:
    status = error.status_code
    detail = f"HTTP {status}: {error.message}"
    pause = _seconds(error.response.headers.get("retry-after"))
    if status == 429:
        return Problem(Failure.RATE_LIMITED, detail, status, pause)
    if status >= 500:
        return Problem(Failure.SERVER_ERROR, detail, status, pause)
    return Problem(Failure.TIMEOUT if status == 408 else Failure.REJECTED, detail, status)


def _seconds(text: str | None) -> float | None:
    try:
        value = float(text or "")
    except ValueError:
        return None
    return value if 0.0 <= value < float("inf") else None
