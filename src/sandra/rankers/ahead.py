"""Rankers that begin to think before it is known which pairs hold (mode verify-first), and those
whose ranking can be read while it is written."""

from __future__ import annotations

import time
from typing import Protocol

from sandra.actions import ActionPair
from sandra.describe.types import Prompt
from sandra.rankers.types import Ranker, Ranking


class Ahead(Protocol):
    """A question that has been put, and whose ranking is not wanted yet."""

    @property
    def ready(self) -> bool:
        """Whether the ranker has nothing left to do until it is told the pairs."""
        ...

    @property
    def duration(self) -> float:
        """How long the ranker has been at work, without waiting for the pairs [s]."""
        ...

    def finish(self, prompt: Prompt) -> Ranking:
        """Rank, now that the prompt is narrowed to the pairs that hold."""
        ...

    def stop(self) -> None:
        """No ranking is wanted any more; returns at once."""
        ...


class Later:
    """For rankers that cannot think ahead: asked once the pairs are known, and only about them."""

    ready = True

    def __init__(self, ranker: Ranker, deadline: float | None) -> None:
        self._ranker, self._deadline = ranker, deadline
        self.duration = 0.0

    def finish(self, prompt: Prompt) -> Ranking:
        """See `Ahead`."""
        begin = time.perf_counter()
        ranking = self._ranker.rank(prompt, self._deadline)
        self.duration = time.perf_counter() - begin
        return ranking

    def stop(self) -> None:
        """See `Ahead`."""


class Asking(Protocol):
    """A question that has been put, and whose answer can be looked at while it is written."""

    def so_far(self, prompt: Prompt) -> tuple[ActionPair, ...]:
        """The pairs that have arrived; the ranking may still come to others."""
        ...

    def ranking(self, prompt: Prompt) -> Ranking:
        """The ranking, waited for until the deadline."""
        ...


def asking(ranker: Ranker, prompt: Prompt, deadline: float) -> Asking | None:
    """Put a question to a ranker that has a method `asking`; None: it has none."""
    own = getattr(ranker, "asking", None)
    asked: Asking | None = own(prompt, deadline) if callable(own) else None
    return asked


def begin(ranker: Ranker, prompt: Prompt, deadline: float | None = None) -> Ahead:
    """Put a question before it is known which of its pairs hold.

    A ranker with a method `begin(prompt, deadline)` starts to read and to think now; any other is
    asked in `finish`. The deadline [s] counts the time in which the ranker is at work.
    """
    own = getattr(ranker, "begin", None)
    ahead: Ahead = own(prompt, deadline) if callable(own) else Later(ranker, deadline)
    return ahead
