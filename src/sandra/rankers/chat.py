"""Rankings by a language model behind an OpenAI-compatible chat endpoint.

OpenAI itself, vLLM, Ollama, llama.cpp, LM Studio: whatever serves `/chat/completions`. The answer
is asked for with a strict JSON schema and checked again here. One deadline holds for everything:
connecting, retries, waiting, and reading.
"""

from __future__ import annotations

from dataclasses import replace

from sandra.actions import ActionPair
from sandra.describe import only
from sandra.describe.outside import one_line
from sandra.describe.types import Prompt
from sandra.errors import RankerError
from sandra.rankers.answer import pairs_so_far, parse_answer, parse_reasoning
from sandra.rankers.bounded import Deadline, Running
from sandra.rankers.client import Problem
from sandra.rankers.endpoint import Asks, Content, Endpoint, Exchange, Question
from sandra.rankers.stream import Reply
from sandra.rankers.types import Failure, Ranking
from sandra.rankers.usage import both, total

DEADLINE = 30.0
"""Wall-clock time for one ranking if no other is given [s]."""


class ChatRanker:
    """`openai:MODEL`. Immutable after creation; usable from several threads.

    Args:
        model: name of the model.
        base_url: of the server, up to `/v1`; default: OPENAI_BASE_URL, else OpenAI's.
        deadline: for one ranking, over all attempts [s].
        temperature, seed: sampling parameters; not sent unless given, some models refuse them.
        endpoint: who is asked instead of `/chat/completions` of a server.
        name: default `openai:MODEL`.

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
        endpoint: Asks | None = None,
        name: str | None = None,
    ) -> None:
        if not model.strip():
            raise RankerError("openai: no model named; write for example openai:gpt-4o")
        if not 0.0 < deadline < float("inf"):
            raise RankerError(f"openai: deadline = {deadline} must be a finite number > 0 [s]")
        self.name = name or f"openai:{model}"
        self.deadline = deadline
        options = {"temperature": temperature, "seed": seed}
        given = {name: value for name, value in options.items() if value is not None}
        self._endpoint: Asks = endpoint or Endpoint(model, base_url, given)
        self.takes_pictures = bool(getattr(self._endpoint, "takes_pictures", True))

    def rank(self, prompt: Prompt, deadline: float | None = None) -> Ranking:
        """Ask the model; see `Ranker`. Returns within the deadline (default: `self.deadline`).

        Pairs that had arrived by the deadline are kept, with the failure TIMEOUT.
        """
        return self.asking(prompt, deadline).ranking(prompt)

    def asking(self, prompt: Prompt, deadline: float | None = None) -> Asked:
        """Put the question of `rank`, and look at the answer while it is written."""
        seconds = self.deadline if deadline is None else deadline
        question = Question(prompt.system, (("user", content_of(prompt)),), prompt.schema)
        return Asked(self._endpoint, self.name, question, seconds)

    def begin(self, prompt: Prompt, deadline: float | None = None) -> Reasoning:
        """Let the model read and reason already; see `Reasoning`."""
        return Reasoning(
            self._endpoint, self.name, prompt, self.deadline if deadline is None else deadline
        )


def content_of(prompt: Prompt) -> Content:
    """The user's message: the text, followed by the picture if the prompt has one."""
    if prompt.picture is None:
        return prompt.user
    url = {"url": prompt.picture.data_url}
    return [{"type": "text", "text": prompt.user}, {"type": "image_url", "image_url": url}]


class Reasoning:
    """The model reasons while the pairs are verified; then it ranks those that hold (`Ahead`).

    Two turns of one conversation. The first asks for the reasoning alone. The second goes on
    where the first ended, word for word, so that a server that keeps what it has read and written
    (a prefix cache) has only the ranking left to write; its schema admits only pairs that hold.
    """

    def __init__(self, endpoint: Asks, name: str, prompt: Prompt, seconds: float) -> None:
        self._endpoint, self._name, self._prompt = endpoint, name, prompt
        schema = only(prompt.schema, "reasoning")
        question = Question(prompt.system, (("user", content_of(prompt)),), schema)
        self._first = Asked(endpoint, name, question, seconds)
        self._second: Asked | None = None

    @property
    def ready(self) -> bool:
        """See `Ahead`."""
        return self._first.running.done

    @property
    def duration(self) -> float:
        """See `Ahead`."""
        second = 0.0 if self._second is None else self._second.running.duration
        return self._first.running.duration + second

    def finish(self, prompt: Prompt) -> Ranking:
        """See `Ahead`. A failure of the first turn is that of the whole."""
        whole = self._first.ranking(prompt)
        text = whole.answer
        if text is None or whole.failure in (Failure.TIMEOUT, Failure.REFUSED, Failure.EMPTY):
            return whole
        if whole.failure is None and not whole.warnings:
            return whole  # A server without structured outputs: it has ranked pairs that hold.
        turns = (
            ("user", content_of(self._prompt)),
            ("assistant", text),
            ("user", prompt.narrowing),
        )
        question = Question(prompt.system, turns, only(prompt.schema, "ranking"))
        left = self._first.seconds - self._first.running.duration
        self._second = Asked(self._endpoint, self._name, question, left, self._first.seconds)
        ranking = self._second.ranking(prompt)
        if ranking.failure is None:
            self._first.exchange.keep()
        answer = "\n".join(part for part in (text, ranking.answer) if part)
        return replace(
            ranking,
            reasoning=parse_reasoning(text),
            answer=answer,
            usage=total((whole.usage, ranking.usage)),
            recorded_s=both(whole.recorded_s, ranking.recorded_s),
        )

    def stop(self) -> None:
        """See `Ahead`. The connection is closed when the next piece arrives."""
        for asked in (self._first, self._second):
            if asked is not None:
                asked.deadline.end()


class Asked:
    """A question under way.

    Args:
        seconds: for the answer. told: what a person is told that they were, if not the same.
    """

    def __init__(
        self,
        endpoint: Asks,
        name: str,
        question: Question,
        seconds: float,
        told: float | None = None,
    ) -> None:
        self.seconds = seconds
        self.deadline = Deadline(seconds)
        self._name = name
        self._told = seconds if told is None else told
        self.exchange = Exchange()
        self.running: Running[Problem | Reply] = Running(
            lambda: endpoint.ask(question, self.deadline, self.exchange), name
        )

    def ranking(self, prompt: Prompt) -> Ranking:
        """The ranking in the answer, waited for until the deadline; kept if it is whole."""
        ranking = self._ranking(prompt)
        if ranking.failure is None:
            self.exchange.keep()
        return replace(ranking, usage=self.exchange.usage, recorded_s=self.exchange.recorded)

    def so_far(self, prompt: Prompt) -> tuple[ActionPair, ...]:
        """The pairs that have arrived; `ranking` may still come to others."""
        reply = self.exchange.reply
        return () if reply is None else pairs_so_far(reply.text, prompt)

    def _ranking(self, prompt: Prompt) -> Ranking:
        outcome = self.running.wait(self.deadline.left)
        if outcome.error is not None:
            return Ranking((), self._name, Failure.INTERNAL, one_line(outcome.error, 300))
        problem = outcome.value
        if isinstance(problem, Problem):
            return Ranking((), self._name, problem.failure, one_line(problem.detail, 300))
        # Not "is the deadline over": an answer in time may be looked at later.
        late = outcome.late or self.running.duration > self.seconds
        reply = self.exchange.reply
        if reply is None:
            return self._late(Ranking((), self._name))
        ranking = self._read(reply, prompt, late)
        return self._late(ranking) if late and _is_cut(ranking) else ranking

    def _read(self, reply: Reply, prompt: Prompt, late: bool) -> Ranking:
        if reply.refusal or reply.finish == "content_filter":
            words = reply.refusal_text or "stopped by the content filter"
            detail = one_line(words, 300)
            return Ranking((), self._name, Failure.REFUSED, detail, answer=reply.text or None)
        early = reply.ended_early or reply.finish == "length" or late
        ranking = parse_answer(reply.text, prompt, self._name, ended_early=early)
        if reply.failure is not None and not ranking.pairs:
            detail = one_line(reply.detail or "", 300)
            return replace(ranking, failure=reply.failure, detail=detail)
        return ranking

    def _late(self, ranking: Ranking) -> Ranking:
        detail = f"no complete answer within {self._told:g} s"
        if ranking.pairs:
            detail += f"; {len(ranking.pairs)} pairs had arrived"
        return replace(ranking, failure=Failure.TIMEOUT, detail=detail)


def _is_cut(ranking: Ranking) -> bool:
    return ranking.failure in (Failure.TRUNCATED, Failure.EMPTY, Failure.MALFORMED)
