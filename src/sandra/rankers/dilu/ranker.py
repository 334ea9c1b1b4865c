"""`dilu:MODEL`: DiLu's decision loop as a ranker, so that it is verified like any other.

It chooses one of highway-env's actions, so a ranking of it is one pair. It is told what DiLu is
told, not the text of the prompt: no command, no light, nobody but who is in its lane or beside.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

from sandra.describe.outside import one_line, several_lines
from sandra.describe.types import Prompt
from sandra.errors import RankerError, SettingsError
from sandra.rankers.dilu.embedding import embedding_of
from sandra.rankers.dilu.loop import SHOTS, Choice, Loop, reasons_in
from sandra.rankers.dilu.memory import Memory, load
from sandra.rankers.dilu.situation import PAIRS, view_of
from sandra.rankers.endpoint import Asks, Endpoint
from sandra.rankers.spec import at_least, number, split
from sandra.rankers.types import Failure, Ranking

OPTIONS: dict[str, Callable[[str], Any]] = {
    "shots": at_least(0),
    "embedding": str,
    "memory": str,
    "temperature": lambda text: None if text == "none" else number(text),
    "seed": at_least(0),
}
"""What may follow the model's name, as in `dilu:MODEL#shots=5&temperature=none` (not sent)."""


class DiLuRanker:
    """See the module. Immutable after creation; usable from several threads.

    Args:
        endpoint: who is asked.
        name: how it is called in results.
        deadline: for one ranking, both questions and a server's embeddings included [s].
        memory, shots: see `Loop`.

    Raises:
        RankerError: a bad deadline.
    """

    takes_pictures = False

    def __init__(
        self, endpoint: Asks, name: str, deadline: float, memory: Memory, shots: int = SHOTS
    ) -> None:
        if not 0.0 < deadline < float("inf"):
            raise RankerError(f"dilu: deadline = {deadline} must be a finite number > 0 [s]")
        self.name, self.deadline = name, deadline
        self._loop = Loop(endpoint, name, memory, shots)

    def rank(self, prompt: Prompt, deadline: float | None = None) -> Ranking:
        """See `Ranker`: one pair, or a named failure. Returns within the deadline.

        An action that had arrived by the deadline is kept, with the failure TIMEOUT. Where no
        action means a feasible pair, nobody is asked, and the failure is INFEASIBLE.
        """
        seen = view_of(prompt.situation)
        if not seen.allowed:
            words = "none of DiLu's actions means one of the pairs that may be ranked"
            return Ranking((), self.name, Failure.INFEASIBLE, words)
        choice = self._loop.decide(seen, self.deadline if deadline is None else deadline)
        ranking = self._ranking(choice, prompt)
        if ranking.failure is None:
            choice.keep()
        return ranking

    def _ranking(self, choice: Choice, prompt: Prompt) -> Ranking:
        pair = None if choice.action is None else PAIRS[choice.action]
        failure, detail, answer = choice.failure, choice.detail, choice.answer
        if pair is not None and failure is not None:
            detail = f"{detail}; {choice.action} had arrived"
        if pair is not None and pair not in prompt.feasible:
            failure, detail = Failure.INFEASIBLE, f"{choice.action}: {pair} is not feasible here"
            pair = None
        return Ranking(
            () if pair is None else (pair,),
            self.name,
            failure,
            None if failure is None else one_line(detail or "", 300),
            ("the number was read from the answer to a second question",) * choice.repaired,
            None if answer is None else several_lines(reasons_in(answer)) or None,
            answer,
            choice.usage,
            choice.recorded_s,
        )


def dilu_ranker(
    text: str,
    *,
    base_url: str | None,
    deadline: float,
    cache: str | Path | None = None,
    max_concurrent: int | None = None,
    **sampling: float | int | None,
) -> DiLuRanker:
    """The ranker of `dilu:MODEL#OPTION=VALUE&...`.

    Args:
        text: of the spec, without `dilu:`; see `OPTIONS`.
        base_url: of an OpenAI-compatible server; default: OPENAI_BASE_URL, else OpenAI's.
        deadline: see `DiLuRanker`.
        cache, max_concurrent: see `Endpoint`.
        sampling: `temperature` (0 unless told otherwise) and `seed`, where the spec names none.

    Raises:
        RankerError: no model, an unknown option, no key, a bad address, deadline or folder, or a
            memory that cannot be read.
    """
    model, options = split("dilu", text, OPTIONS)
    try:
        items = load(options.pop("memory", None))
        embedding = embedding_of(options.pop("embedding", "words"), base_url)
    except SettingsError as error:
        raise RankerError(str(error)) from None
    shots = options.pop("shots", SHOTS)
    told = {name: value for name, value in sampling.items() if value is not None}
    sent = {"temperature": 0.0, **told, **options}
    endpoint = Endpoint(
        model,
        base_url,
        {name: value for name, value in sent.items() if value is not None},
        cache=cache,
        max_concurrent=max_concurrent,
    )
    name = f"dilu:{text.strip()}"
    return DiLuRanker(endpoint, name, deadline, Memory(items, embedding), shots)
