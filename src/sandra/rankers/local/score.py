"""`hf:PATH#mode=score`: how likely would the model write each feasible pair?

Nothing is written. The prompt is read once, then all pairs are looked at in one forward pass that
shares what was read: complete, distinct, always the same, and several times faster than writing.

A sum of log-likelihoods favours short words, and models like some words, and some places of a list,
better than others whatever they are told. Hence two corrections (`calibrate`):

* `length`: at each token only those alternatives count that lead to a feasible pair. The rest of a
  word that has only one ending costs nothing, however long it is. What comes out are probabilities
  of the feasible pairs: those with which constrained decoding would write them.
* `neutral`: from the logarithms of these are taken those under a prompt that lists the same
  actions in the same order and tells nothing of the situation (Zhao et al., "Calibrate Before
  Use", ICML 2021; Holtzman et al., "Surface Form Competition", EMNLP 2021). Not for a model that
  was trained for this task: what it prefers in general it has learned.
"""

from __future__ import annotations

import json
from collections.abc import Sequence, Set
from dataclasses import replace
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from sandra.actions import ActionPair
from sandra.describe.outside import one_line
from sandra.describe.types import Prompt
from sandra.rankers.answer import parse_answer
from sandra.rankers.bounded import Deadline, Running
from sandra.rankers.endpoint import Question
from sandra.rankers.local.turns import Turns
from sandra.rankers.types import Failure, Ranking

CALIBRATIONS = ("neutral", "length", "none")
OPENING = '{"reasoning": "", "ranking": ['
"""How an answer without reasoning begins; a pair is what follows."""
NEUTRAL = "There is no information about the environment."

Scores = dict[ActionPair, float]
"""Log-likelihood of each feasible pair, calibrated."""
Way = tuple[int, ...]
"""The tokens of a pair, or the first of them."""
Logits = dict[Way, NDArray[np.float64]]
"""After each of these beginnings."""


class Reader(Protocol):
    """A model as scoring needs it: `sandra.rankers.local.folder`, `sandra.rankers.inside`."""

    turns: Turns

    def tokens_of(self, text: str) -> list[int]:
        """The tokens of a text; nothing is put before or after it."""
        ...

    def tokens_of_question(self, question: Question) -> list[int]:
        """Those of a conversation, up to where the answer begins."""
        ...

    def read(self, tokens: Sequence[int], deadline: Deadline) -> Any:
        """What is known after these tokens; None if the deadline passed first. Needs the turn."""
        ...

    def next_logits(self, memory: Any) -> NDArray[np.float64]:
        """(vocabulary,) of the token that follows what was read."""
        ...

    def branches(self, memory: Any, rows: Sequence[Sequence[int]]) -> NDArray[np.float64]:
        """(rows, longest, vocabulary): logits after each token of each continuation. What was read
        stays as it was; what lies beyond the end of a shorter row means nothing."""
        ...


class ScoreRanker:
    """Ranks by likelihood. Deterministic; usable from several threads.

    Args:
        name: for results.
        deadline: for one ranking [s].
        calibrate: one of `CALIBRATIONS`.
        answers: whether the best pairs are also written down as the answer that the schema asks
            for, and read from there.
    """

    def __init__(
        self, name: str, model: Reader, deadline: float, calibrate: str, *, answers: bool = False
    ) -> None:
        self.name, self.deadline, self.calibrate = name, deadline, calibrate
        self.answers = answers
        self._model = model
        self._of_neutral: dict[tuple[ActionPair, ...], NDArray[np.float64]] = {}

    def rank(self, prompt: Prompt, deadline: float | None = None) -> Ranking:
        """See `Ranker`. Returns within the deadline (default: `self.deadline`)."""
        return self.begin(prompt, deadline).finish(prompt)

    def begin(self, prompt: Prompt, deadline: float | None = None) -> Scoring:
        """Score all feasible pairs already; see `Scoring`."""
        return Scoring(self, prompt, self.deadline if deadline is None else deadline)

    def count_tokens(self, text: str) -> int:
        """The tokens of a text, by the model's own tokenizer."""
        return len(self._model.tokens_of(text))

    def scores(self, prompt: Prompt, deadline: Deadline) -> Scores | None:
        """Of every feasible pair; None if the deadline passed first."""
        with self._model.turns.turn(deadline) as mine:
            if not mine:
                return None
            question = Question(prompt.system, (("user", prompt.user),), None)
            found = self._log_likelihoods(question, prompt.feasible, deadline)
            if found is not None and self.calibrate == "neutral":
                known = self._of_neutral.get(prompt.feasible)
                if known is None:
                    known = self._log_likelihoods(_neutral(prompt), prompt.feasible, deadline)
                if known is None:
                    return None
                self._of_neutral[prompt.feasible] = known
                found = found - known
        if found is None:
            return None
        return dict(zip(prompt.feasible, found.tolist(), strict=True))

    def _log_likelihoods(
        self, question: Question, pairs: Sequence[ActionPair], deadline: Deadline
    ) -> NDArray[np.float64] | None:
        """(n,) of the pairs as they would be written after the question; None: too late."""
        before = self._model.tokens_of_question(question)
        written = [self._model.tokens_of(OPENING + _text(pair)) for pair in pairs]
        # Tokens may reach over the end of the opening: what all have in common is read at once.
        shared = min(_same(written[0], other) for other in written)
        memory = self._model.read([*before, *written[0][:shared]], deadline)
        if memory is None or self._model.turns.over(deadline):
            return None
        ways = [tuple(tokens[shared:]) for tokens in written]
        if self.calibrate == "none":
            return _sums(ways, self._after(memory, {w[:i] for w in ways for i in range(len(w))}))
        return _among_alternatives(ways, self._after(memory, set(_forks(ways))))

    def _after(self, memory: Any, places: Set[Way]) -> Logits:
        """The logits after each of these beginnings, from one forward pass for all of them."""
        found: Logits = {(): self._model.next_logits(memory)}
        longer = {place[:end] for place in places for end in range(len(place))}
        ways = sorted(places - longer - {()})
        if not ways:
            return found
        longest = max(len(way) for way in ways)
        logits = self._model.branches(memory, [[*way, *[0] * (longest - len(way))] for way in ways])
        for way, row in zip(ways, logits, strict=True):
            for end in range(1, len(way) + 1):
                found.setdefault(way[:end], row[end - 1])
        return found


class Scoring:
    """The pairs are scored while it is found out which hold; then the best of these (`Ahead`)."""

    def __init__(self, ranker: ScoreRanker, prompt: Prompt, seconds: float) -> None:
        self._name, self._seconds, self._answers = ranker.name, seconds, ranker.answers
        self._deadline = Deadline(seconds)
        self._running: Running[Scores | bool] = Running(
            lambda: ranker.scores(prompt, self._deadline) or False, ranker.name
        )

    @property
    def ready(self) -> bool:
        """See `Ahead`."""
        return self._running.done

    @property
    def duration(self) -> float:
        """See `Ahead`."""
        return self._running.duration

    def finish(self, prompt: Prompt) -> Ranking:
        """See `Ahead`."""
        outcome = self._running.wait(self._deadline.left)
        ranking = Ranking((), self._name)
        if outcome.error is not None:
            detail = one_line(outcome.error, 300)
            return replace(ranking, failure=Failure.INTERNAL, detail=detail)
        if not isinstance(outcome.value, dict) or self.duration > self._seconds:
            detail = f"not read within {self._seconds:g} s"
            return replace(ranking, failure=Failure.TIMEOUT, detail=detail)
        scores = {pair: outcome.value[pair] for pair in prompt.feasible}
        best = sorted(scores, key=lambda pair: -scores[pair])[: prompt.k]
        shares = _told(scores, best)
        if self._answers:
            written = OPENING + ", ".join(map(_text, best)) + "]}"
            told = f"Likelihood of each pair as the answer: {shares}."
            return replace(parse_answer(written, prompt, self._name), reasoning=told)
        told = f"Likelihood of each pair as an answer, nothing is written: {shares}."
        return replace(ranking, pairs=tuple(best), reasoning=told)

    def stop(self) -> None:
        """See `Ahead`."""
        self._deadline.end()


def _text(pair: ActionPair) -> str:
    """A pair as it stands in an answer."""
    return json.dumps({"longitudinal": pair.longitudinal.value, "lateral": pair.lateral.value})


def _neutral(prompt: Prompt) -> Question:
    """The same choice, in the same order, without a situation, a wish or a past."""
    system = (
        "You are driving a car and need to make a high-level driving decision.\n"
        f"Feasible longitudinal actions: {', '.join(a.value for a in prompt.longitudinal)}\n"
        f"Feasible lateral actions: {', '.join(a.value for a in prompt.lateral)}\n"
        'Answer with one JSON object: first "reasoning" (text), then "ranking" (a list of '
        'objects, each with "longitudinal" and "lateral").'
    )
    return Question(system, (("user", NEUTRAL),), None)


def _same(a: Sequence[int], b: Sequence[int]) -> int:
    """How many tokens at the beginning are the same, short of the last one."""
    length = 0
    while length < min(len(a), len(b)) - 1 and a[length] == b[length]:
        length += 1
    return length


def _forks(ways: Sequence[Way]) -> dict[Way, list[int]]:
    """Where several tokens may follow, and which ones."""
    after: dict[Way, set[int]] = {}
    for way in ways:
        for i, token in enumerate(way):
            after.setdefault(way[:i], set()).add(token)
    return {place: sorted(tokens) for place, tokens in after.items() if len(tokens) > 1}


def _sums(ways: Sequence[Way], logits: Logits) -> NDArray[np.float64]:
    """Of the log-likelihoods of all tokens: short ways are favoured."""
    return np.array(
        [
            sum(logits[way[:i]][token] - _log_sum(logits[way[:i]]) for i, token in enumerate(way))
            for way in ways
        ]
    )


def _among_alternatives(ways: Sequence[Way], logits: Logits) -> NDArray[np.float64]:
    """Of the log-likelihoods of tokens among those that may follow; the exponentials sum to 1."""
    forks = _forks(ways)
    found = np.zeros(len(ways))
    for row, way in enumerate(ways):
        for i, token in enumerate(way):
            others = forks.get(way[:i])
            if others is not None:
                here = logits[way[:i]]
                found[row] += here[token] - _log_sum(here[others])
    return found


def _log_sum(values: NDArray[np.float64]) -> float:
    most = float(values.max())
    return most + float(np.log(np.exp(values - most).sum()))


def _told(scores: Scores, best: Sequence[ActionPair]) -> str:
    """In words, as shares among the pairs that may be ranked."""
    values = np.array(list(scores.values()))
    shares = np.exp(values - _log_sum(values))
    of = dict(zip(scores, shares, strict=True))
    return ", ".join(f"{pair} {of[pair]:.0%}" for pair in best)
