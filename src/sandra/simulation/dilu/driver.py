"""DiLu's decision loop: describe, recall, ask, read the answer, have it repaired if need be.

After "DiLu: A Knowledge-Driven Approach to Autonomous Driving with Large Language Models" (Wen et
al., ICLR 2024), Sec. "Reasoning" and "Memory", written anew from the paper. Its reflection, and
with it the growth of the memory, is off, as in the comparison of the SanDRA paper.
"""

from __future__ import annotations

import logging
import re
from dataclasses import dataclass

from sandra.describe.outside import one_line
from sandra.errors import RankerError, SettingsError
from sandra.rankers.bounded import Deadline, run_within
from sandra.rankers.client import Problem
from sandra.rankers.endpoint import Endpoint, Exchange, Question
from sandra.rankers.types import Failure
from sandra.simulation.dilu.embedding import Embedding, HashedWords
from sandra.simulation.dilu.memory import Experience, Memory, load
from sandra.simulation.dilu.scene import view
from sandra.simulation.highway import ACTIONS, Environment

logger = logging.getLogger(__name__)

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
_NUMBER = re.compile(r"\s*([0-9]+)\s*")


@dataclass(frozen=True, slots=True)
class Choice:
    """One decision, and what came of the question."""

    action: str
    answer: str | None = None
    """What the model said, as far as it was read."""
    repaired: bool = False
    """The number was read from the answer to a second question."""
    failure: Failure | None = None
    """Why there was no number; `action` then is the default."""
    detail: str | None = None
    recalled: tuple[Experience, ...] = ()


class DiLu:
    """A `Policy` that asks a language model; see `sandra.simulation.policies.play`. No verifier.

    Args:
        model: name of the model.
        base_url: of an OpenAI-compatible server, up to `/v1`; default: OPENAI_BASE_URL, else
            OpenAI's.
        shots: so many experiences are put before the question.
        hold: a decision every so many decision steps; in between the ego goes on (IDLE). The
            original decides at 1 Hz (`hold` 5 here), the SanDRA paper's table at 5 Hz (1).
        deadline: wall-clock time for one decision [s].
        embedding: finds the experiences; default `HashedWords`.
        items: the memory; default: the experiences that are shipped.
        default: the action where there is no usable answer.

    Raises:
        RankerError: no model, no key for OpenAI's own server, a bad address or deadline.
        SettingsError: an option that makes no sense.
    """

    def __init__(
        self,
        model: str,
        *,
        base_url: str | None = None,
        shots: int = 3,
        hold: int = 1,
        deadline: float = DEADLINE,
        embedding: Embedding | None = None,
        items: tuple[Experience, ...] | None = None,
        default: str = "SLOWER",
    ) -> None:
        if not model.strip():
            raise RankerError("dilu: no model named; write for example dilu:gpt-4o")
        if not 0.0 < deadline < float("inf"):
            raise RankerError(f"dilu: deadline = {deadline} must be a finite number > 0 [s]")
        if shots < 0 or hold < 1:
            raise SettingsError(f"dilu: shots = {shots} must be at least 0, hold = {hold} 1")
        if default not in ACTIONS:
            raise SettingsError(f"dilu: default = {default} is none of {', '.join(ACTIONS)}")
        self.name = f"dilu:{model}"
        self.shots, self.hold, self.deadline, self.default = shots, hold, deadline, default
        self.memory = Memory(load() if items is None else items, embedding or HashedWords())
        self.choices: list[Choice] = []
        """Of the episode, one for each time that the model was asked."""
        self._endpoint = Endpoint(model, base_url, {"temperature": 0.0})
        self._step = 0

    def start(self, world: Environment) -> None:
        """Forget the episode before; what is in memory stays."""
        self.choices, self._step = [], 0

    def action(self, world: Environment) -> str:
        """The meta-action of the next decision step.

        Raises:
            RankerError: the server cannot be reached, or refuses the first question of an episode:
                then something is set up wrongly, and a row of a table would tell nothing.
        """
        self._step += 1
        if (self._step - 1) % self.hold:
            return "IDLE"
        choice = self.decide(world)
        if choice.failure is not None:
            if not self.choices and choice.failure in (Failure.UNREACHABLE, Failure.REJECTED):
                raise RankerError(f"{self.name}: {choice.failure.value}: {choice.detail}")
            why = f"{choice.failure.value} ({choice.detail}), so {choice.action}"
            logger.warning(
                "%s, seed %s, step %d: %s",
                self.name,
                world.seed,
                self._step - 1,
                one_line(why, 300),
            )
        self.choices.append(choice)
        return choice.action

    def decide(self, world: Environment) -> Choice:
        """One decision; whatever goes wrong is a named failure. Returns by the deadline."""
        deadline = Deadline(self.deadline)
        seen = view(world)
        recalled = self.memory.nearest(seen.situation(), self.shots, deadline)
        if isinstance(recalled, Problem):
            return Choice(self.default, failure=recalled.failure, detail=recalled.detail)
        turns = [turn for e in recalled for turn in (("user", e.question), ("assistant", e.answer))]
        answer = self._ask(Question(SYSTEM, (*turns, ("user", seen.text())), None), deadline)
        if isinstance(answer, Problem):
            return self._failed(answer, recalled)
        number = number_in(answer)
        if number is not None:
            return Choice(ACTIONS[number], answer, recalled=recalled)
        again = self._ask(_repair(answer), deadline)
        if isinstance(again, Problem):
            return self._failed(again, recalled, answer)
        number = number_in(again)
        if number is None:
            problem = Problem(Failure.MALFORMED, "no number of an action, and none after repair")
            return self._failed(problem, recalled, answer)
        return Choice(ACTIONS[number], answer, repaired=True, recalled=recalled)

    def _failed(
        self, problem: Problem, recalled: tuple[Experience, ...], answer: str | None = None
    ) -> Choice:
        return Choice(self.default, answer, False, problem.failure, problem.detail, recalled)

    def _ask(self, question: Question, deadline: Deadline) -> str | Problem:
        """The text of the model's answer."""
        exchange = Exchange()
        outcome = run_within(
            deadline.left, lambda: self._endpoint.ask(question, deadline, exchange), self.name
        )
        if outcome.error is not None:
            return Problem(Failure.INTERNAL, outcome.error)
        reply = outcome.value
        if reply is None or deadline.passed:
            return Problem(Failure.TIMEOUT, f"no decision within {self.deadline:g} s")
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
    match = _NUMBER.fullmatch(answer.rsplit("####", 1)[-1])
    if match is None or len(match[1]) > 2 or int(match[1]) >= len(ACTIONS):
        return None
    return int(match[1])


def _repair(answer: str) -> Question:
    actions = ", ".join(f"{number} {action}" for number, action in enumerate(ACTIONS))
    return Question(REPAIR.format(actions=actions), (("user", answer[-TAIL:]),), None)
