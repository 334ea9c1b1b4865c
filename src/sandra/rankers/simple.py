"""Rankers without a model: random, exhaustive, and any callable of the user."""

from __future__ import annotations

import random
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from itertools import islice

from sandra.actions import ActionPair, Lateral, Longitudinal
from sandra.describe.outside import one_line
from sandra.describe.types import Prompt
from sandra.errors import RankerError
from sandra.rankers.answer import select
from sandra.rankers.bounded import run_within
from sandra.rankers.progress import HORIZON, progress
from sandra.rankers.types import Failure, Ranker, Ranking

_PROGRESS = (
    Longitudinal.ACCELERATE,
    Longitudinal.KEEP,
    Longitudinal.DECELERATE,
    Longitudinal.STOP,
)
_LATERAL = (Lateral.FOLLOW_LANE, Lateral.LEFT_LANE, Lateral.RIGHT_LANE)


@dataclass(frozen=True, slots=True)
class RandomRanker:
    """k distinct feasible pairs by chance.

    The draw depends on the seed and on the prompt's text alone: the same prompt is answered the
    same way, whatever was asked before.
    """

    seed: int = 0

    @property
    def name(self) -> str:
        """`random:SEED`."""
        return f"random:{self.seed}"

    def rank(self, prompt: Prompt, deadline: float | None = None) -> Ranking:
        """See `Ranker`."""
        draw = random.Random(f"{self.seed}\n{prompt.system}\n{prompt.user}")
        pairs = tuple(draw.sample(prompt.feasible, prompt.k))
        return Ranking(pairs, self.name, reasoning="Drawn by chance.")


@dataclass(frozen=True, slots=True)
class ExhaustiveRanker:
    """No language model: every feasible pair is offered, in the order of a stated preference.

    The farther a pair is estimated to bring the ego (`progress`), the earlier; of equals, progress
    first (accelerate, keep, decelerate, stop), then staying in the lane before changing it, left
    before right. The only ranker that returns more than k pairs. The driver's command is not read.
    """

    name: str = "exhaustive"

    def rank(self, prompt: Prompt, deadline: float | None = None) -> Ranking:
        """See `Ranker`."""
        order = (ActionPair(lon, lat) for lon in _PROGRESS for lat in _LATERAL)
        pairs = [pair for pair in order if pair in prompt.feasible]
        way = {pair: progress(prompt.situation, pair) for pair in pairs}
        pairs.sort(key=lambda pair: -round(way[pair], 1))
        told = ", ".join(f"{pair} {way[pair]:.0f} m" for pair in pairs[:3])
        reasoning = f"Every feasible pair by its estimated progress within {HORIZON:g} s: {told}."
        return Ranking(tuple(pairs), self.name, reasoning=reasoning)


_MOST_PAIRS = 100
"""Pairs that are taken from what a function yields."""

Answer = Ranking | Iterable[ActionPair]


@dataclass(frozen=True, slots=True)
class PlugIn:
    """Somebody else's ranker, held to the protocol.

    `function` takes a prompt (and a deadline, if `takes_deadline`) and returns a `Ranking` or
    pairs. If it raises, is late, or returns anything else, that is a named failure; pairs that
    are infeasible, repeated, or beyond the prompt's k are removed with a warning. `deadline` [s]
    holds where `rank` is given none. `takes_pictures`: whether it looks at `Prompt.picture`.
    """

    name: str
    function: Callable[..., Answer]
    takes_deadline: bool = False
    deadline: float | None = None
    takes_pictures: bool = False

    def rank(self, prompt: Prompt, deadline: float | None = None) -> Ranking:
        """See `Ranker`."""

        seconds = self.deadline if deadline is None else deadline

        def work() -> Ranking:
            arguments = (prompt, seconds) if self.takes_deadline else (prompt,)
            return self._checked(self.function(*arguments), prompt)

        outcome = run_within(seconds, work, self.name)
        if outcome.value is not None:
            return outcome.value
        if outcome.late:
            return Ranking((), self.name, Failure.TIMEOUT, f"no answer within {seconds} s")
        return Ranking((), self.name, Failure.INTERNAL, one_line(outcome.error or "", 300))

    def _checked(self, answer: Answer, prompt: Prompt) -> Ranking:
        if isinstance(answer, Ranking):
            ranking = answer
        else:
            ranking = Ranking(tuple(islice(answer, _MOST_PAIRS)), self.name)
        if not all(isinstance(pair, ActionPair) for pair in ranking.pairs):
            raise TypeError("a ranker must return a Ranking or ActionPairs")
        pairs, warnings = select(ranking.pairs, prompt)
        failure, detail = ranking.failure, ranking.detail
        if not pairs and failure is None:
            failure = Failure.INFEASIBLE if ranking.pairs else Failure.EMPTY
            detail = "; ".join(warnings[:3]) or "no pair returned"
        return replace(
            ranking,
            pairs=pairs,
            failure=failure,
            detail=detail,
            warnings=(*ranking.warnings, *warnings),
        )


def plug_in(
    thing: Ranker | Callable[..., Answer],
    name: str | None = None,
    deadline: float | None = None,
) -> PlugIn:
    """Hold an object with `rank(prompt, deadline)`, or a function of a prompt, to the protocol.

    Raises:
        RankerError: if it is neither.
    """
    function = getattr(thing, "rank", None)
    if callable(function):
        told = name or str(getattr(thing, "name", None) or type(thing).__name__)
        looks = bool(getattr(thing, "takes_pictures", False))
        return PlugIn(told, function, True, deadline, looks)
    if callable(thing):
        told = name or str(getattr(thing, "__name__", None) or type(thing).__name__)
        looks = bool(getattr(thing, "takes_pictures", False))
        return PlugIn(told, thing, False, deadline, looks)
    raise RankerError(
        f"{type(thing).__name__} is no ranker: pass a text such as 'rules', an object with "
        f"rank(prompt, deadline), or a function of a prompt"
    )
