"""The stages of a cycle: how long each took, and a ranking that is waited for meanwhile."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import Future, wait
from contextlib import contextmanager
from typing import Generic, TypeVar

T = TypeVar("T")

STAGES = ("describe", "rank", "predict", "verify", "plan")


class Clock:
    """Durations of stages [s]; `progress` is told the name of each as it begins."""

    def __init__(self, progress: Callable[[str], None]) -> None:
        self._progress = progress
        self._begin = time.perf_counter()
        self.durations = dict.fromkeys((*STAGES, "total"), 0.0)

    def tell(self, stage: str) -> None:
        """A stage begins that is timed elsewhere."""
        self._progress(stage)

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        """What is done in this block belongs to the stage; a stage may have several blocks."""
        self._progress(name)
        begin = time.perf_counter()
        yield
        self.durations[name] += time.perf_counter() - begin

    def stop(self) -> dict[str, float]:
        """All durations."""
        self.durations["total"] = time.perf_counter() - self._begin
        return self.durations


class Meanwhile(Generic[T]):
    """Work that runs in a thread of its own until its result is asked for.

    The thread is a daemon: if the caller fails meanwhile, nobody waits for the work.
    """

    def __init__(self, work: Callable[[], T], name: str) -> None:
        self._future: Future[T] = Future()
        self._work = work
        self.duration = 0.0
        """Of the work itself, once it is done [s]."""
        threading.Thread(target=self._run, name=name, daemon=True).start()

    def _run(self) -> None:
        begin = time.perf_counter()
        try:
            found = self._work()
        except BaseException as error:  # noqa: BLE001  raised again in `result`
            self._future.set_exception(error)
        else:
            self.duration = time.perf_counter() - begin
            self._future.set_result(found)

    @property
    def done(self) -> bool:
        """Whether the result is there."""
        return self._future.done()

    def wait(self, seconds: float) -> None:
        """Wait for the result, but no longer than this."""
        wait((self._future,), seconds)

    def result(self) -> T:
        """Wait for the result; whatever the work raised is raised here."""
        return self._future.result()
