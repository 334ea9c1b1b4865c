"""Processes of this machine, each with one item at a time."""

from __future__ import annotations

import logging
import multiprocessing
import os
import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from multiprocessing import resource_tracker
from multiprocessing.connection import Connection, wait
from typing import Any, Generic, TypeVar

from sandra.errors import SandraError, SettingsError
from sandra.evaluation.workers.items import Broken, Died, attempt

T = TypeVar("T")

logger = logging.getLogger(__name__)

ALL_CORES = 0
"""As a number of workers: one for each core."""
_READY = "ready"


def processes(workers: int) -> int:
    """Number of processes: `workers`, or one for each core that this process may use.

    Raises:
        SettingsError: if it is negative.
    """
    if workers < 0:
        raise SettingsError(f"workers = {workers}: at least one process, or 0 for all cores")
    if workers != ALL_CORES:
        return workers
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


class _Worker(Generic[T]):
    """A process, and the number of the item that it has."""

    def __init__(self, work: Callable[[T], Any]) -> None:
        context = multiprocessing.get_context("spawn")
        self.connection, theirs = context.Pipe()
        # A daemon: it ends with this process, whatever happens.
        self.process = context.Process(target=_serve, args=(theirs, work), daemon=True)
        with _no_interrupts():
            self.process.start()
        theirs.close()
        self.ready = False
        self.number: int | None = None

    def give(self, number: int, item: T) -> None:
        """Hand an item over; raises `OSError` if the process is gone."""
        self.connection.send(item)
        self.number = number

    def answer(self) -> Any:
        """The next message; `Died` if the process has died with the item in its hands."""
        try:
            message = self.connection.recv()
        except (EOFError, OSError):
            self.process.join()
            killed = (self.process.exitcode or 0) < 0
            if not self.ready and not killed:
                raise SandraError(
                    "a worker process ended before it began; in a script of your own, call this "
                    "from under \"if __name__ == '__main__':\", or use one worker"
                ) from None
            return Died(_ending(self.process.exitcode))
        return message

    def dismiss(self) -> None:
        """No more items; who is at work is not waited for."""
        self.connection.close()
        if self.number is not None:
            self.process.terminate()

    def join(self) -> None:
        """Wait for the end of the process."""
        self.process.join(5.0)
        if self.process.is_alive():
            self.process.kill()
            self.process.join()


class LocalTeam(Generic[T]):
    """At most `count` workers; started when there is something for them to do."""

    def __init__(self, work: Callable[[T], Any], count: int) -> None:
        self._work, self._count = work, count
        self._idle: list[_Worker[T]] = []
        self._busy: list[_Worker[T]] = []

    def size(self) -> int:
        return self._count

    def free(self) -> bool:
        return len(self._busy) < self._count

    def give(self, number: int, item: T) -> None:
        while self._idle:
            worker = self._idle.pop()
            try:
                worker.give(number, item)
            except OSError:  # It died of something that was not ours.
                worker.dismiss()
                worker.join()
                continue
            self._busy.append(worker)
            return
        worker = _Worker(self._work)
        self._busy.append(worker)
        worker.give(number, item)

    def collect(self) -> list[tuple[int, Any]]:
        """Wait until somebody has something to say."""
        found = []
        speaking = wait([worker.connection for worker in self._busy])
        for worker in [w for w in self._busy if w.connection in speaking]:
            answer = worker.answer()
            if not worker.ready:
                worker.ready = answer == _READY
                continue
            number, worker.number = worker.number, None
            assert number is not None, "only who has an item is busy"
            found.append((number, answer))
            self._busy.remove(worker)
            if worker.process.exitcode is None:
                self._idle.append(worker)
        return found

    def stop(self) -> None:
        """End all processes."""
        everybody = (*self._busy, *self._idle)
        for worker in everybody:
            worker.dismiss()
        for worker in everybody:
            worker.join()


def _serve(connection: Connection, work: Callable[[T], Any]) -> None:
    """What a worker does until nobody talks to it any more."""
    connection.send(_READY)
    while True:
        try:
            item = connection.recv()
        except (EOFError, OSError):
            return
        answer = attempt(work, item)
        try:
            connection.send(answer)
        except OSError:
            return
        except Exception as error:  # It cannot be pickled, or is too large.
            logger.exception("the answer to %r cannot be sent", item)
            connection.send(Broken(f"{type(error).__name__}: the answer cannot be sent"))


@contextmanager
def _no_interrupts() -> Iterator[None]:
    """Processes started here are never interrupted from the keyboard: their parent ends them."""
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    # Started with the first process, and leaves interrupts unblocked behind it.
    resource_tracker.ensure_running()
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _ending(code: int | None) -> str:
    if code is not None and code < 0:
        return f"signal {signal.Signals(-code).name}"
    return f"exit status {code}"
