"""How many requests may be on their way to one server, and when it wants none.

Within this process the number is bounded always: a request that hangs keeps its place, so that a
server which never lets go of a connection cannot gather threads without end. A limit that the user
gives holds across all processes of this user on this machine, by locked files.
"""

from __future__ import annotations

import contextlib
import hashlib
import os
import tempfile
import threading
import time
from collections.abc import Callable
from pathlib import Path

from sandra.errors import RankerError
from sandra.rankers.bounded import Deadline

MOST = 16
"""Requests on their way to one server from this process, unless another limit is given."""
_LOOK = 0.02
"""Pause between two looks for a free place [s]."""

Release = Callable[[], None]


class _Server:
    """What all rankers of this process know of one server."""

    def __init__(self) -> None:
        self.until = 0.0
        """On the clock `time.monotonic`: no request before."""
        self.places: dict[int, threading.BoundedSemaphore] = {}


_servers: dict[str, _Server] = {}
_lock = threading.Lock()


class Gate:
    """The way to a server. Usable from several threads.

    Args:
        address: of the server.
        most: requests at once, over all processes; None: `MOST`, in this process.

    Raises:
        RankerError: if `most` is less than 1, or its files cannot be made.
    """

    def __init__(self, address: str, most: int | None = None) -> None:
        if most is not None and most < 1:
            raise RankerError(f"max_concurrent = {most} must be at least 1")
        count = MOST if most is None else most
        with _lock:
            self._server = _servers.setdefault(address, _Server())
            self._place = self._server.places.setdefault(count, threading.BoundedSemaphore(count))
        self._files = () if most is None else _files(address, most)

    @property
    def pause(self) -> float:
        """For so long the server wants no requests [s]."""
        return max(self._server.until - time.monotonic(), 0.0)

    def close_for(self, seconds: float) -> None:
        """The server wants no requests for so long, from anybody in this process."""
        self._server.until = max(self._server.until, time.monotonic() + seconds)

    def enter(self, deadline: Deadline) -> Release | None:
        """Take a place, given back by calling what is returned; None: none was free in time."""
        if not self._place.acquire(timeout=deadline.left):
            return None
        if not self._files:
            return self._place.release
        while True:
            for file in self._files:
                held = _locked(file)
                if held is not None:

                    def release(held: int = held) -> None:
                        os.close(held)  # which unlocks it
                        self._place.release()

                    return release
            if deadline.passed:
                self._place.release()
                return None
            time.sleep(min(_LOOK, deadline.left + 0.001))


def _files(address: str, most: int) -> tuple[Path, ...]:
    """The files that stand for the places; none where the system has no such locks."""
    if os.name != "posix":
        return ()
    folder = Path(tempfile.gettempdir()) / f"sandra-{os.getuid()}"
    name = hashlib.sha256(address.encode()).hexdigest()[:16]
    try:
        with contextlib.suppress(FileExistsError):
            folder.mkdir(mode=0o700)
        if folder.is_symlink() or folder.stat().st_uid != os.getuid():
            raise RankerError(f"{folder}: belongs to somebody else; set TMPDIR to another folder")
        (folder / name).mkdir(mode=0o700, exist_ok=True)
    except OSError as error:
        raise RankerError(
            f"{folder}: max_concurrent needs files there ({error.strerror}); set TMPDIR to a "
            "folder that can be written"
        ) from None
    return tuple(folder / name / str(place) for place in range(most))


def _locked(file: Path) -> int | None:
    """An open descriptor that holds the lock of a file; None if somebody else does."""
    import fcntl

    try:
        held = os.open(file, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o600)
    except OSError:
        return None  # the folder was cleared away, or there are too many open files
    try:
        fcntl.flock(held, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        os.close(held)
        return None
    return held
