"""Work that may hang, under a deadline that holds.

Time-outs of network libraries are per read: a server that sends one byte now and then never trips
them. So the work runs in a thread of its own, and the caller waits no longer than it wants to. A
thread cannot be stopped from outside; one that hangs is left behind (it is a daemon, so it does
not keep the process alive), and what it still finds is not looked at.
"""

from __future__ import annotations

import logging
import math
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Generic, TypeVar

from sandra.rankers.secret import hidden

T = TypeVar("T")

logger = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True)
class Outcome(Generic[T]):
    """`value` if the work was done, `error` (one line) if it broke, else it is late."""

    value: T | None = None
    error: str | None = None

    @property
    def late(self) -> bool:
        """Whether the deadline passed first."""
        return self.value is None and self.error is None


class Deadline:
    """A moment on the clock `time.monotonic`; another thread may bring it forward to now."""

    def __init__(self, seconds: float) -> None:
        self._at = time.monotonic() + seconds

    @property
    def left(self) -> float:
        """Seconds until then, at least 0."""
        return max(self._at - time.monotonic(), 0.0)

    @property
    def passed(self) -> bool:
        """Whether it is over."""
        return time.monotonic() > self._at

    def end(self) -> None:
        """It is over now."""
        self._at = -math.inf


class Running(Generic[T]):
    """Work that has begun in a thread of its own.

    `work` must not return None. Whatever it raises is logged with its traceback and becomes one
    line: rankers may be anybody's code, and a ranker that breaks must not break the decision.
    """

    def __init__(self, work: Callable[[], T], name: str) -> None:
        self._work, self._name = work, name
        self._box: list[Outcome[T]] = []
        self._begin = time.monotonic()
        self._end = math.inf
        self._thread = threading.Thread(target=self._run, name=name, daemon=True)
        self._thread.start()

    def _run(self) -> None:
        try:
            outcome = Outcome(value=self._work())
        except Exception as error:
            logger.exception("%s broke", self._name)
            outcome = Outcome(error=hidden(f"{type(error).__name__}: {error}"))
        self._end = time.monotonic()
        self._box.append(outcome)

    @property
    def done(self) -> bool:
        """Whether it has come to an end."""
        return bool(self._box)

    @property
    def duration(self) -> float:
        """How long it took, or has taken until now [s]."""
        return min(self._end, time.monotonic()) - self._begin

    def wait(self, seconds: float | None) -> Outcome[T]:
        """What it found within `seconds` from now (None: for as long as it takes)."""
        self._thread.join(seconds if seconds is None else max(seconds, 0.0))
        return self._box[0] if self._box else Outcome()


def run_within(seconds: float | None, work: Callable[[], T], name: str) -> Outcome[T]:
    """Run `work` for at most `seconds`; see `Running`."""
    return Running(work, name).wait(seconds)
