"""Rankers that do not do their job: the same pair always, no ranking, or no answer in time.

For tests and tables of what happens to a driver whose ranker is like that.
"""

from __future__ import annotations

import random
import threading
from dataclasses import dataclass

from sandra.actions import ActionPair
from sandra.describe.types import Prompt
from sandra.rankers.answer import parse_answer, select
from sandra.rankers.bounded import run_within
from sandra.rankers.types import Failure, Ranking

ANSWERS = (
    "",
    "Sure! I would simply go with the flow of the traffic and take care.",
    "####",
    "accelerate, left-lane",
    "[1, 2, 3]",
    "{'ranking': [keep, follow-lane]}",
    '{"ranking": "keep, follow-lane"}',
    '{"reasoning": "the road is free", "ranking": []}',
    '{"ranking": [{"longitudinal": "take-off", "lateral": "upwards"}, null, 7]}',
    '{"reasoning": "First I look at the',
    '{"ranking": [{"longitudinal": "kee',
    "<html><body>502 Bad Gateway</body></html>",
    "\x00\x1b[2J\ufffd " + "{" * 500,
)
"""What `GarbageRanker` says; no pair can be read from any of them."""


@dataclass(frozen=True, slots=True)
class AlwaysRanker:
    """The same pair always, whatever the situation; INFEASIBLE where it is not feasible."""

    pair: ActionPair

    @property
    def name(self) -> str:
        """`always:PAIR`."""
        return f"always:{self.pair}"

    def rank(self, prompt: Prompt, deadline: float | None = None) -> Ranking:
        """See `Ranker`."""
        pairs, warnings = select([self.pair], prompt)
        if not pairs:
            return Ranking((), self.name, Failure.INFEASIBLE, "; ".join(warnings), warnings)
        return Ranking(pairs, self.name, reasoning="Always the same.")


@dataclass(frozen=True, slots=True)
class GarbageRanker:
    """Answers that are no ranking, one of `ANSWERS` for each prompt, read as a model's is read.

    Always without a pair, and a named failure: EMPTY, MALFORMED, TRUNCATED or INFEASIBLE.
    """

    name: str = "garbage"

    def rank(self, prompt: Prompt, deadline: float | None = None) -> Ranking:
        """See `Ranker`."""
        draw = random.Random(f"{prompt.system}\n{prompt.user}")
        return parse_answer(draw.choice(ANSWERS), prompt, self.name)


@dataclass(frozen=True, slots=True)
class LateRanker:
    """Never answers in time: TIMEOUT after `seconds`, or after the deadline if that is sooner."""

    seconds: float

    @property
    def name(self) -> str:
        """`late:SECONDS`."""
        return f"late:{self.seconds:g}"

    def rank(self, prompt: Prompt, deadline: float | None = None) -> Ranking:
        """See `Ranker`."""
        seconds = self.seconds if deadline is None else min(deadline, self.seconds)
        given_up = threading.Event()
        outcome = run_within(seconds, given_up.wait, self.name)
        given_up.set()  # so that its thread ends
        assert outcome.late
        return Ranking((), self.name, Failure.TIMEOUT, f"no answer within {seconds:g} s")
