"""Rankings by a language model behind an OpenAI-compatible chat endpoint.

OpenAI itself, vLLM, Ollama, llama.cpp, LM Studio: whatever serves `/chat/completions`. The answer
is asked for with a strict JSON schema and checked again here. One deadline holds for everything:
connecting, retries, waiting, and reading.
"""

from __future__ import annotations

import json
import os
import time
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any
from urllib.parse import urlsplit

from sandra.describe.outside import one_line
from sandra.describe.types import Prompt
from sandra.errors import RankerError
from sandra.rankers.answer import parse_answer
from sandra.rankers.bounded import run_within
from sandra.rankers.stream import Reply, read
from sandra.rankers.types import Failure, Ranking

if TYPE_CHECKING:
    import openai

DEADLINE = 30.0
"""Wall-clock time for one ranking if no other is given [s]."""
ATTEMPTS = 3
"""Requests for one ranking, if the first ones fail in a way that may pass."""
BACKOFF = 0.2
"""Pause before the second attempt, doubled for the third [s]; `Retry-After` goes first."""

_GRACE = 0.25
"""After the deadline, a request that nobody waits for any more ends itself [s]."""

_OPENAI_HOST = "api.openai.com"
_PASSING = (Failure.RATE_LIMITED, Failure.SERVER_ERROR, Failure.UNREACHABLE)


@dataclass(frozen=True, slots=True)
class Problem:
    """Why a request brought no reply. `pause`: what the server asks to wait [s], if anything."""

    failure: Failure
    detail: str
    status: int | None = None
    pause: float | None = None


class ChatRanker:
    """`openai:MODEL`. Immutable after creation; usable from several threads.

    Args:
        model: name of the model.
        base_url: of the server, up to `/v1`; default: OPENAI_BASE_URL, else OpenAI's.
        deadline: for one ranking, over all attempts [s].
        temperature, seed: sampling parameters; not sent unless given, some models refuse them.

    Raises:
        RankerError: no model, no key for OpenAI's own server, or a bad address or deadline.
    """

    def __init__(
        self,
        model: str,
        *,
        base_url: str | None = None,
        deadline: float = DEADLINE,
        temperature: float | None = None,
        seed: int | None = None,
    ) -> None:
        if not model.strip():
            raise RankerError("openai: no model named; write for example openai:gpt-4o")
        if not 0.0 < deadline < float("inf"):
            raise RankerError(f"openai: deadline = {deadline} must be a finite number > 0 [s]")
        self.name = f"openai:{model}"
        self.deadline = deadline
        self._model = model
        options = {"temperature": temperature, "seed": seed}
        self._options = {name: value for name, value in options.items() if value is not None}
        self._client = _client(base_url or os.environ.get("OPENAI_BASE_URL") or None)
        # Imports half of the library: here, so that no ranking pays for it.
        self._completions = self._client.chat.completions.with_streaming_response

    def rank(self, prompt: Prompt, deadline: float | None = None) -> Ranking:
        """Ask the model; see `Ranker`. Returns within the deadline (default: `self.deadline`).

        Pairs that had arrived by the deadline are kept, with the failure TIMEOUT.
        """
        seconds = self.deadline if deadline is None else deadline
        until = time.monotonic() + seconds
        replies: list[Reply] = []
        outcome = run_within(seconds, lambda: self._ask(prompt, until, replies), self.name)
        if outcome.error is not None:
            return Ranking((), self.name, Failure.INTERNAL, one_line(outcome.error, 300))
        problem = outcome.value
        if isinstance(problem, Problem):
            return Ranking((), self.name, problem.failure, one_line(problem.detail, 300))
        late = outcome.late or time.monotonic() > until
        if not replies:
            return self._late(Ranking((), self.name), seconds)
        ranking = self._read(replies[-1], prompt, late)
        return self._late(ranking, seconds) if late and _is_cut(ranking) else ranking

    def _read(self, reply: Reply, prompt: Prompt, late: bool) -> Ranking:
        if reply.refusal or reply.finish == "content_filter":
            words = "".join(reply.refusal) or "stopped by the content filter"
            detail = one_line(words, 300)
            return Ranking((), self.name, Failure.REFUSED, detail, answer=reply.text or None)
        early = reply.ended_early or reply.finish == "length" or late
        ranking = parse_answer(reply.text, prompt, self.name, ended_early=early)
        if reply.failure is not None and not ranking.pairs:
            detail = one_line(reply.detail or "", 300)
            return replace(ranking, failure=reply.failure, detail=detail)
        return ranking

    def _late(self, ranking: Ranking, seconds: float) -> Ranking:
        detail = f"no complete answer within {seconds:g} s"
        if ranking.pairs:
            detail += f"; {len(ranking.pairs)} pairs had arrived"
        return replace(ranking, failure=Failure.TIMEOUT, detail=detail)

    def _ask(self, prompt: Prompt, until: float, replies: list[Reply]) -> Problem | Reply:
        """Ask up to `ATTEMPTS` times; the last reply is also put into `replies` as it grows."""
        with_schema = True
        attempt = 0
        while True:
            result = self._request(prompt, until, with_schema, replies)
            if not isinstance(result, Problem):
                return result
            if with_schema and _rejects_schema(result):
                with_schema = False
                continue
            attempt += 1
            pause = BACKOFF * 2 ** (attempt - 1) if result.pause is None else result.pause
            passing = result.failure in _PASSING and attempt < ATTEMPTS
            if not passing or time.monotonic() + pause >= until:
                return result
            time.sleep(pause)

    def _request(
        self, prompt: Prompt, until: float, with_schema: bool, replies: list[Reply]
    ) -> Problem | Reply:
        import httpx2
        import openai

        body = {**self._body(prompt, with_schema), **self._options}
        # A little longer than the caller waits: being late is then always noticed there.
        left = max(until - time.monotonic(), 0.0) + _GRACE
        reply = Reply()
        try:
            with self._completions.create(**body, stream=True, timeout=left) as response:
                replies.append(reply)
                content_type = response.headers.get("content-type", "")
                read(response.iter_bytes(), content_type, reply, until)
        except openai.APIStatusError as error:
            return _refused_request(error)
        except (openai.APITimeoutError, httpx2.TimeoutException):
            return self._broken(
                reply, Problem(Failure.TIMEOUT, "the server did not answer in time")
            )
        except openai.APIConnectionError as error:
            words = f"{self._client.base_url} cannot be reached ({error.__cause__ or error})"
            return Problem(Failure.UNREACHABLE, words)
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

    def _body(self, prompt: Prompt, with_schema: bool) -> dict[str, Any]:
        system = prompt.system
        extra: dict[str, Any] = {}
        if with_schema:
            schema = {"name": "ranking", "strict": True, "schema": prompt.schema}
            extra["response_format"] = {"type": "json_schema", "json_schema": schema}
        else:
            words = json.dumps(prompt.schema, ensure_ascii=False)
            system += f"\nThe answer must fit this JSON schema: {words}"
        messages = [
            {"role": "system", "content": system},
            {"role": "user", "content": prompt.user},
        ]
        return {"model": self._model, "messages": messages, **extra}


def _client(base_url: str | None) -> openai.OpenAI:
    import openai

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


def _is_cut(ranking: Ranking) -> bool:
    return ranking.failure in (Failure.TRUNCATED, Failure.EMPTY, Failure.MALFORMED)


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
