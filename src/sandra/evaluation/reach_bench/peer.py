"""The peer as a subprocess: asked on its stdin, answering on its stdout, one line of JSON each."""

from __future__ import annotations

import json
import os
import select
import subprocess
import tempfile
from pathlib import Path
from types import TracebackType
from typing import Any

from sandra.errors import SandraError

PATIENCE = 300.0
"""The peer is given up after so long without an answer [s]."""
SCRIPT = Path(__file__).with_name("peer_script.py")


class PeerError(SandraError):
    """The peer cannot be started, or it does not answer."""


class PeerRefused(PeerError):
    """The peer answered with an error of its own."""


class Peer:
    """A running peer; use it as a context manager. It works in a directory that is then deleted.

    Args:
        python: the interpreter of an environment that holds the peer.

    Raises:
        PeerError: if that interpreter is not there or cannot import the peer.
    """

    def __init__(self, python: Path, patience: float = PATIENCE) -> None:
        if not python.exists():
            raise PeerError(
                f"no peer at {python}: 'make bench' sets it up, --peer names another "
                "interpreter, --no-peer times ours alone"
            )
        self._patience = patience
        self._directory = tempfile.TemporaryDirectory(prefix="sandra-bench-")
        self._errors = (Path(self._directory.name) / "stderr").open("w+", encoding="utf-8")
        environment = {**os.environ, "OMP_NUM_THREADS": "1", "MPLCONFIGDIR": self._directory.name}
        # Interpreters of virtual environments are links: the path must stay as it is.
        self._process = subprocess.Popen(
            [str(python.absolute()), "-I", str(SCRIPT)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=self._errors,
            text=True,
            cwd=self._directory.name,
            env=environment,
        )
        try:
            self.versions: dict[str, str] = self.ask({"do": "hello"})["versions"]
        except PeerError:
            self.close()
            raise

    def ask(self, request: dict[str, Any]) -> dict[str, Any]:
        """Ask one thing, wait for the answer.

        Raises:
            PeerRefused: if the peer answers with an error.
            PeerError: if it has died.
        """
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        try:
            self._process.stdin.write(json.dumps(request) + "\n")
            self._process.stdin.flush()
            ready, _, _ = select.select([self._process.stdout], [], [], self._patience)
            if not ready:
                self._process.kill()
                self._process.wait()
                raise PeerError(
                    f"the peer gave no answer to '{request['do']}' for {self._patience:g} s"
                )
            line = self._process.stdout.readline()
        except BrokenPipeError:
            line = ""
        if not line:
            raise PeerError(f"the peer has stopped: {self._last_words()}")
        answer: dict[str, Any] = json.loads(line)
        if "error" in answer:
            raise PeerRefused(f"the peer says: {answer['error']}")
        return answer

    @property
    def alive(self) -> bool:
        """Whether the process still runs."""
        return self._process.poll() is None

    def _last_words(self) -> str:
        self._process.wait()
        self._errors.seek(0)
        lines = [line.strip() for line in self._errors if line.strip()]
        return lines[-1] if lines else f"exit status {self._process.returncode}"

    def close(self) -> None:
        """End the process and delete its directory."""
        self._process.kill()
        self._process.communicate()
        self._errors.close()
        self._directory.cleanup()

    def __enter__(self) -> Peer:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self.close()
