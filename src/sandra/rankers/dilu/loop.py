"""DiLu's decision loop: describe, recall, ask, read the answer, have it repaired if need be.

After "DiLu: A Knowledge-Driven Approach to Autonomous Driving with Large Language Models" (Wen et
al., ICLR 2024), Sec. "Reasoning" and "Memory", written anew from the paper. Its reflection, and
with it the growth of the memory, is off, as in the comparison of the SanDRA paper.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field

from sandra.actions import META_ACTIONS
from sandra.rankers.bounded import Deadline, run_within
from sandra.rankers.client import Problem
from sandra.rankers.dilu.memory import Experience, Memory
from sandra.rankers.dilu.view import View
from sandra.rankers.endpoint import Asks, Exchange, Question
from sandra.rankers.types import Failure
from sandra.rankers.usage import Usage, both

SYSTEM = """\
You drive a car on a motorway. Again and again you are told where you are and who is around you,
and you choose what to do next. You want to get ahead, but never at the price of a collision.
Think step by step: is the car ahead coming near, and how soon; would a lane beside you give you
more room, and is there room in it ahead and behind; only then choose.
Give your reasons first. Put the number of the action that you choose, and nothing else, on a last
line that begins with ####, such as
#### 1"""
REPAIR = """\
You are given the end of somebody's thoughts about what to do on the road. Say which of these
actions was meant: {actions}. Answer with its number alone."""
TAIL = 2000
"""So much of an answer's end is shown when it is to be repaired [characters]."""
DEADLINE = 30.0
"""For one decision, the repair included [s]."""
SHOTS = 3
"""Experiences that are put before the question."""
_MARKS = "####"
_NUMBER = re.compile(r"\s*([0-9]+)\s*")


@dataclass(frozen=True, slots=True)
class Choice:
    """One decision, and what came of the question."""

    action: str | None
    """None: none could be read."""
    answer: str | None = None
    """What the model said, as far as it was read."""
    repaired: bool = False
    """The number was read from the answer to a second question."""
    failure: Failure | None = None
    """Why there is no number; TIMEOUT with an action: it had arrived, the end had not."""
    detail: str | None = None
    recalled: tuple[Experience, ...] = ()
    exchanges: tuple[Exchange, ...] = field(default=(), repr=False, compare=False)
    """What passed between us and the server: one, or two with a repair."""

    @property
    def usage(self) -> Usage:
        """What it has cost until now, without embeddings."""
        return sum((exchange.usage for exchange in self.exchanges), Usage())

    @property
    def recorded_s(self) -> float | None:
        """How long the server once took, where all is from the cache on disk [s]."""
        first, *more = [exchange.recorded for exchange in self.exchanges] or [None]
        return both(first, more[0]) if more else first

    def keep(self) -> None:
        """Keep the answers on disk, if a cache is there; for whoever has found them good."""
        for exchange in self.exchanges:
            exchange.keep()


class Loop:
    """Decides from a `View`. Usable from several threads.

    Args:
        endpoint: who is asked.
        name: for threads and logs.
        memory: what is recalled.
        shots: so many experiences are put before the question.
    """

    def __init__(self, endpoint: Asks, name: str, memory: Memory, shots: int = SHOTS) -> None:
        self._endpoint, self._name = endpoint, name
        self._memory, self._shots = memory, shots

    def decide(self, seen: View, seconds: float) -> Choice:
        """One decision; whatever goes wrong is a named failure. Returns within `seconds`."""
        deadline = Deadline(seconds)
        recalled = self._memory.nearest(seen.situation(), self._shots, deadline)
        if isinstance(recalled, Problem):
            return Choice(None, failure=recalled.failure, detail=recalled.detail)
        turns = [turn for e in recalled for turn in (("user", e.question), ("assistant", e.answer))]
        question = Question(SYSTEM, (*turns, ("user", seen.text())), None)
        first = Exchange()
        answer = self._ask(question, first, deadline, seconds)
        if isinstance(answer, Problem):
            return _failed(answer, recalled, first)
        number = number_in(answer)
        if number is not None:
            return Choice(META_ACTIONS[number], answer, recalled=recalled, exchanges=(first,))
        second = Exchange()
        again = self._ask(_repair(answer), second, deadline, seconds)
        if isinstance(again, Problem):
            return _failed(again, recalled, first, second)
        number = number_in(again)
        if number is None:
            problem = Problem(Failure.MALFORMED, "no number of an action, and none after repair")
            return _failed(problem, recalled, first, second)
        return Choice(META_ACTIONS[number], answer, True, None, None, recalled, (first, second))

    def _ask(
        self, question: Question, exchange: Exchange, deadline: Deadline, seconds: float
    ) -> str | Problem:
        """The text of the model's answer."""
        outcome = run_within(
            deadline.left, lambda: self._endpoint.ask(question, deadline, exchange), self._name
        )
        if outcome.error is not None:
            return Problem(Failure.INTERNAL, outcome.error)
        reply = outcome.value
        if reply is None or deadline.passed:
            return Problem(Failure.TIMEOUT, f"no decision within {seconds:g} s")
        if isinstance(reply, Problem):
            return reply
        if reply.refusal or reply.finish == "content_filter":
            return Problem(Failure.REFUSED, reply.refusal_text or "stopped by the filter")
        if reply.failure is not None and not reply.text:
            return Problem(reply.failure, reply.detail or "")
        if not reply.text.strip():
            return Problem(Failure.EMPTY, "the answer holds no text")
        return reply.text


def number_in(answer: str) -> int | None:
    """The number of an action after the last `####` of an answer, or in all of it without one."""
    match = _NUMBER.fullmatch(answer.rsplit(_MARKS, 1)[-1])
    if match is None or len(match[1]) > 2 or int(match[1]) >= len(META_ACTIONS):
        return None
    return int(match[1])


def reasons_in(answer: str) -> str:
    """What stands before the last `####` of an answer."""
    return answer.rpartition(_MARKS)[0].strip()


def _failed(problem: Problem, recalled: tuple[Experience, ...], *exchanges: Exchange) -> Choice:
    """No decision; but a number that had arrived before the deadline is one."""
    said = [exchange.reply.text for exchange in exchanges if exchange.reply is not None]
    number = None
    if problem.failure is Failure.TIMEOUT and said and _MARKS in said[-1]:
        number = number_in(said[-1])
    return Choice(
        None if number is None else META_ACTIONS[number],
        said[0] if said else None,
        len(exchanges) > 1 and number is not None,
        problem.failure,
        problem.detail,
        recalled,
        exchanges,
    )


def _repair(answer: str) -> Question:
    actions = ", ".join(f"{number} {action}" for number, action in enumerate(META_ACTIONS))
    return Question(REPAIR.format(actions=actions), (("user", answer[-TAIL:]),), None)
