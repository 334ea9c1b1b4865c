"""One question at a time, and none under way when the process ends.

A model in this process has one memory of what it has read. And native code must not be at work
while Python is taken down: that ends in a crash instead of an exit status.
"""

from __future__ import annotations

import atexit
import threading
import weakref
from collections.abc import Iterator
from contextlib import contextmanager

from sandra.rankers.bounded import Deadline

LONGEST = 60.0
"""How long an exit waits for native code to come back [s]; it is asked to after each batch."""

_all: weakref.WeakSet[Turns] = weakref.WeakSet()


class Turns:
    """Who may ask a model now."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._ending = False
        _all.add(self)

    @contextmanager
    def turn(self, deadline: Deadline) -> Iterator[bool]:
        """Waits for the turn; whether it came before the deadline."""
        mine = self._lock.acquire(timeout=deadline.left)
        try:
            yield mine and not self._ending
        finally:
            if mine:
                self._lock.release()

    def over(self, deadline: Deadline) -> bool:
        """Whether whoever has the turn is to stop: nobody waits for it any more."""
        return self._ending or deadline.passed

    def end(self) -> None:
        """Nobody gets a turn any more."""
        self._ending = True

    def wait(self) -> None:
        """Until whoever has the turn has stopped."""
        if self._lock.acquire(timeout=LONGEST):
            self._lock.release()


@atexit.register
def _before_the_exit() -> None:
    turns = list(_all)
    for each in turns:
        each.end()
    for each in turns:
        each.wait()
