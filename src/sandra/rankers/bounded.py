"""Work that may hang, under a deadline that holds.

Time-outs of network libraries are per read: a server that sends one byte now and then never trips
them. So the work runs in a thread of its own, and the caller waits no longer than it wants to. A
thread cannot be stopped from outside; one that hangs is left behind (it is a daemon, so it does
not keep the process alive), and what it still finds is not looked at.
"""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable
from dataclasses import dataclass
from typing import Generic, TypeVar

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


def run_within(seconds: float | None, work: Callable[[], T], name: str) -> Outcome[T]:
    """Run `work` for at most `seconds` (None: for as long as it takes).

    `work` must not return None. Whatever it raises is logged with its traceback and returned as
    one line: rankers may be anybody's code, and a ranker that breaks must not break the decision.
    """
    box: list[Outcome[T]] = []

    def run() -> None:
        try:
            box.append(Outcome(value=work()))
        except Exception as error:
            logger.exception("%s broke", name)
            box.append(Outcome(error=f"{type(error).__name__}: {error}"))

    thread = threading.Thread(target=run, name=name, daemon=True)
    thread.start()
    thread.join(seconds if seconds is None else max(seconds, 0.0))
    return box[0] if box else Outcome()
