"""A real Dask cluster on loopback, started as a user starts it; and a ranker that kills."""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import sandra
from sandra.evaluation.rollouts.cases import varied
from sandra.rankers import Ranking
from sandra.settings import Settings

TESTS = Path(__file__).parent
SOURCES = Path(sandra.__file__).parents[1]


@contextlib.contextmanager
def running(name: str, *words: str, cwd: Path, sources: Path = SOURCES) -> Iterator[None]:
    """`dask scheduler` or `dask worker` in a folder of its own; ended with all its children."""
    environment = {**os.environ, "PYTHONPATH": f"{sources}{os.pathsep}{TESTS}"}
    environment["OMP_NUM_THREADS"] = "1"
    with (cwd / f"{name}.log").open("wb") as log:
        process = subprocess.Popen(
            [sys.executable, "-m", "dask", name, *words],
            cwd=cwd,
            env=environment,
            stdout=log,
            stderr=subprocess.STDOUT,
            start_new_session=True,
        )
        try:
            yield
        finally:
            process.terminate()
            with contextlib.suppress(subprocess.TimeoutExpired):
                process.wait(5.0)
            with contextlib.suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGKILL)
            process.wait()


@contextlib.contextmanager
def scheduler(folder: Path, port: int) -> Iterator[str]:
    """The address of a scheduler without workers."""
    words = ("--host", "127.0.0.1", "--port", str(port), "--no-dashboard", "--no-jupyter")
    with running("scheduler", *words, cwd=folder):
        yield f"tcp://127.0.0.1:{port}"


@contextlib.contextmanager
def workers(address: str, folder: Path, count: int = 2, sources: Path = SOURCES) -> Iterator[None]:
    """Worker processes with their nannies."""
    words = (address, "--nworkers", str(count), "--nthreads", "1", "--no-dashboard")
    with running("worker", *words, cwd=folder, sources=sources):
        yield


def wait_until(true: Any, seconds: float = 60.0) -> None:
    end = time.monotonic() + seconds
    while not true():
        assert time.monotonic() < end, "waited in vain"
        time.sleep(0.05)


def slow_square(n: int) -> int:
    time.sleep(0.2)
    return n * n


def scene_of(n: int, files: tuple[Path, ...]) -> tuple[str, float]:
    label, scene, _ = varied(files, n, 0, Settings())
    return label, scene.ego.state.speed


class Deadly:
    """A model that takes its process down with it at some scenes, as native code may do."""

    name = "deadly"

    def rank(self, prompt: Any, deadline: float | None = None) -> Ranking:
        if "merge scenario" in prompt.user:
            os.kill(os.getpid(), signal.SIGKILL)
        return Ranking(pairs=prompt.feasible[: prompt.k], ranker=self.name)
