"""DiLu at the wheel: its decision loop as a driver without a verifier."""

from __future__ import annotations

import logging
from dataclasses import replace

from sandra.describe.outside import one_line
from sandra.errors import RankerError, SettingsError
from sandra.rankers.dilu.embedding import Embedding, HashedWords
from sandra.rankers.dilu.loop import DEADLINE, SHOTS, Choice, Loop
from sandra.rankers.dilu.memory import Experience, Memory, load
from sandra.rankers.endpoint import Endpoint
from sandra.rankers.types import Failure
from sandra.rankers.usage import Usage
from sandra.simulation.dilu.scene import view
from sandra.simulation.highway import ACTIONS, Environment

logger = logging.getLogger(__name__)


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
        shots: int = SHOTS,
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
        self.usage = Usage()
        """What the episode has cost, without embeddings."""
        endpoint = Endpoint(model, base_url, {"temperature": 0.0})
        self._loop = Loop(endpoint, self.name, self.memory, shots)
        self._step = 0

    def start(self, world: Environment) -> None:
        """Forget the episode before; what is in memory stays."""
        self.choices, self._step, self.usage = [], 0, Usage()

    def action(self, world: Environment) -> str | None:
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
        """One decision; after any failure, whose name it tells, it is `default`."""
        choice = self._loop.decide(view(world), self.deadline)
        self.usage += choice.usage
        return choice if choice.failure is None else replace(choice, action=self.default)
