"""Workers of a Dask cluster, each with one item at a time.

Each item is bound to one worker, so that it is known whose item killed it; Dask's own count of
killers is of those that happened to wait at the same worker, too. A worker is one process, however
many threads it has. Results come back to this process, and only it writes.
"""

from __future__ import annotations

import logging
import re
import threading
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Generic, TypeVar

from sandra.errors import SandraError, SettingsError
from sandra.evaluation.workers.away import answered, asked_who, packed, unpacked
from sandra.evaluation.workers.identity import identity
from sandra.evaluation.workers.items import Broken, Died, Refused, told

T = TypeVar("T")

logger = logging.getLogger(__name__)

CONNECT = 5.0
"""A scheduler has to answer within this time [s]."""
_LOOK = 0.5
"""Who is there is looked up this often [s]."""
_LOST = object()


@dataclass(frozen=True, slots=True)
class Cluster:
    """A Dask scheduler that runs already, at `tcp://HOST:PORT` (or `tls://`).

    Args:
        patience: how long the cluster may be without any worker before the run ends [s].

    Raises:
        SettingsError: no such address.
    """

    address: str
    patience: float = 60.0

    def __post_init__(self) -> None:
        if not re.fullmatch(r"(tcp|tls)://[^/\s@]+:\d+", self.address):
            raise SettingsError(
                f"scheduler '{self.address}': write tcp://HOST:PORT, as 'dask scheduler' prints it"
            )


class ClusterTeam(Generic[T]):
    """The workers of a cluster, whoever comes and goes.

    Raises:
        SandraError: Dask is not installed, or the scheduler does not answer.
    """

    def __init__(
        self,
        cluster: Cluster,
        work: Callable[[T], Any],
        files: Callable[[T], Iterable[Path]],
    ) -> None:
        self._cluster, self._work, self._files = cluster, work, files
        self._mine = identity()
        self._client = _connected(cluster)
        self._there: set[str] = set()
        self._at: dict[str, tuple[int, Any]] = {}
        """By worker: the number of its item, and Dask's future of it."""
        self._news = threading.Event()
        self._looked = -_LOOK
        self._last_seen = time.monotonic()
        self._warned = False
        try:
            self._look()
        except BaseException:
            self.stop()
            raise

    def size(self) -> int:
        return max(1, len(self._there))

    def free(self) -> bool:
        return len(self._at) < len(self._there)

    def give(self, number: int, item: T) -> None:
        address = next(a for a in sorted(self._there) if a not in self._at)
        parcel = packed(self._work, item, self._files(item))
        with self._talking():
            future = self._client.submit(answered, parcel, workers=[address], pure=False)
        future.add_done_callback(lambda _: self._news.set())
        self._at[address] = number, future

    def collect(self) -> list[tuple[int, Any]]:
        """Wait for a while, at most until it is time to see who is there."""
        self._news.wait(_LOOK)
        self._news.clear()
        found = []
        for address, (number, future) in list(self._at.items()):
            if future.done():
                answer = self._answer(address, future)
                if answer is not _LOST:
                    del self._at[address]
                    found.append((number, answer))
        if time.monotonic() - self._looked >= _LOOK:
            found += self._look()
        return found

    def stop(self) -> None:
        """Nothing is begun any more; what a worker is at ends there, and is dropped."""
        with suppress(Exception):  # The scheduler may be gone: nothing is left to be cancelled.
            self._client.cancel([future for _, future in self._at.values()], force=True)
        self._at.clear()
        self._client.close(timeout=CONNECT)

    def _answer(self, address: str, future: Any) -> Any:
        """Of a task that is done; `_LOST` if that was on the way, with its worker."""
        from distributed import KilledWorker
        from distributed.scheduler import NoValidWorkerError

        if future.status == "error":
            error = future.exception()
            if isinstance(error, KilledWorker | NoValidWorkerError):
                return Died(f"the worker {address}")
            return Broken(told(error))
        if future.cancelled():
            raise self._gone("the task was cancelled there")
        try:
            with self._talking():
                answer = unpacked(future.result(timeout=CONNECT))
        except TimeoutError:
            return _LOST
        if isinstance(answer, Refused):
            kind = type(answer.error)
            return Refused(kind(f"{answer.error} (said by the worker {address})"))
        return answer

    def _look(self) -> list[tuple[int, Any]]:
        """See who is there: who is new has to be the same as here, who is gone has died."""
        with self._talking():
            there = set(self._client.nthreads())
            new = sorted(there - self._there)
            others = self._client.run(asked_who(), workers=new, on_error="return") if new else {}
        self._looked = time.monotonic()
        for address, other in others.items():
            if isinstance(other, OSError):
                there.discard(address)  # Gone again: the next look will tell.
            else:
                self._compare(address, other)
        self._there = there
        self._wait_for_somebody()
        died = []
        for address in [a for a in self._at if a not in there]:
            number, future = self._at.pop(address)
            with self._talking():
                future.cancel(force=True)
            died.append((number, Died(f"the worker {address}")))
        return died

    def _compare(self, address: str, other: dict[str, str] | Exception) -> None:
        if isinstance(other, Exception):
            raise SandraError(
                f"the worker {address} has no SanDRA, or another one ({told(other)}); install the "
                "same there, with sandra[distributed], and start the workers anew"
            )
        differs = [
            f"{name} {other.get(name, 'unknown')} instead of {mine}"
            for name, mine in self._mine.items()
            if other.get(name) != mine
        ]
        if differs:
            raise SandraError(
                f"the worker {address} has {', '.join(differs)}: its results might be others; "
                "install the same SanDRA there, with the same Python, and start the workers anew"
            )

    def _wait_for_somebody(self) -> None:
        now = time.monotonic()
        if self._there:
            self._last_seen, self._warned = now, False
            return
        name, patience = self._cluster.address, self._cluster.patience
        how = f"start one: dask worker {name} --nworkers auto --nthreads 1"
        if now - self._last_seen > patience:
            raise SandraError(
                f"{name}: has had no worker for {patience:.0f} s; {how} (what is finished is kept)"
            )
        if not self._warned:
            logger.warning("%s has no worker; waiting for %.0f s; %s", name, patience, how)
            self._warned = True

    @contextmanager
    def _talking(self) -> Iterator[None]:
        try:
            yield
        except TimeoutError:
            raise
        except OSError as error:  # Dask's errors of communication are of this kind.
            raise self._gone(told(error)) from None

    def _gone(self, why: str) -> SandraError:
        return SandraError(
            f"{self._cluster.address}: the scheduler is gone ({why}); start it and its workers "
            "again, then the same command: what is finished is kept"
        )


def _connected(cluster: Cluster) -> Any:
    try:
        from distributed import Client
    except ImportError as error:
        raise SandraError(
            f"--scheduler needs Dask ({error}); pip install 'sandra[distributed]' brings it"
        ) from None
    address = cluster.address
    try:
        return Client(address, timeout=CONNECT, set_as_default=False, name="sandra")
    except (OSError, ValueError) as error:
        raise SandraError(
            f"{address}: no Dask scheduler answers there within {CONNECT:.0f} s ({told(error)}); "
            f"start one with 'dask scheduler', and workers with 'dask worker {address} --nworkers "
            "auto --nthreads 1', or leave --scheduler away"
        ) from None
