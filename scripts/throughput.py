"""Files labelled per second with one and two workers, here and on a Dask cluster of this machine.

    python scripts/throughput.py --rounds 3

The four ways take turns, round after round, so that whatever else the machine does meets them
alike; the ratio of two ways is taken within a round. Last, items that take no time: what the
client itself can hand out.
"""

from __future__ import annotations

import argparse
import contextlib
import math
import shutil
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

import sandra
from sandra.evaluation.labelling import Choice, label_all
from sandra.evaluation.workers import Cluster, Workers, as_done

CHOICE = Choice(ego="all", horizon=10, stride=10)


@contextlib.contextmanager
def cluster(folder: Path, port: int, workers: int) -> Iterator[Cluster]:
    """A scheduler and its workers, as a user starts them."""
    address = f"tcp://127.0.0.1:{port}"
    dask = [sys.executable, "-m", "dask"]
    lines = [
        [*dask, "scheduler", "--host", "127.0.0.1", "--port", str(port), "--no-dashboard"],
        [*dask, "worker", address, "--nworkers", str(workers), "--nthreads", "1"],
    ]
    quiet = subprocess.DEVNULL
    started = [subprocess.Popen(x, cwd=folder, stdout=quiet, stderr=quiet) for x in lines]
    try:
        time.sleep(10.0)
        yield Cluster(address)
    finally:
        for process in reversed(started):
            process.terminate()
            process.wait()


def rate(files: list[Path], workers: Workers) -> float:
    """Files per second."""
    begin = time.perf_counter()
    label_all(files, CHOICE, workers=workers)
    return len(files) / (time.perf_counter() - begin)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--files", type=int, default=100)
    parser.add_argument("--dask-only", action="store_true", help="without processes of our own")
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as place, contextlib.ExitStack() as stack:
        folder = Path(place)
        files = [folder / f"{n}.xml" for n in range(arguments.files)]
        for file in files:
            shutil.copy(sandra.example("roadworks"), file)
        ways: dict[str, Workers] = {}
        if not arguments.dask_only:
            ways = {"1 process": 1, "2 processes": 2}
        for n, port in ((1, 18786), (2, 18787)):
            ways[f"Dask, {n}"] = stack.enter_context(cluster(folder, port, n))
        for workers in ways.values():
            rate(files[:2], workers)  # Everybody has imported everything.
        rates: dict[str, list[float]] = {name: [] for name in ways}
        for n in range(arguments.rounds):
            for name, workers in ways.items():
                rates[name].append(rate(files, workers))
            print(n + 1, {name: round(found[-1], 2) for name, found in rates.items()}, flush=True)
        for name, found in rates.items():
            print(f"{name}: median {statistics.median(found):.2f} files/s")
        for one, two in (("1 process", "2 processes"), ("Dask, 1", "Dask, 2")):
            if one not in ways:
                continue
            ratios = [b / a for a, b in zip(rates[one], rates[two], strict=True)]
            print(f"{two} / {one}: {[round(r, 2) for r in ratios]}")
        begin = time.perf_counter()
        done = sum(1 for _ in as_done(math.sqrt, range(300), ways["Dask, 2"]))
        print(f"items without work, Dask, 2: {done / (time.perf_counter() - begin):.0f} per second")


if __name__ == "__main__":
    main()
