"""Which test runs which line, and how long each test takes: one run of the unchanged tests."""

from __future__ import annotations

import functools
import gc
import hashlib
import json
import os
import time
from collections import defaultdict
from collections.abc import Generator, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest
from coverage import CoverageData

from mutation.harness import foreign_modules, run_once, run_pytest


@dataclass(frozen=True)
class Covering:
    """What the unchanged tests do.

    Attributes:
        seconds: test id -> processor time in s.
        tests: file -> line -> tests that run it; "" stands for the import.
        foreign: modules of other projects that the tests load.
    """

    seconds: dict[str, float]
    tests: dict[str, dict[int, set[str]]]
    foreign: list[str]

    def of(self, file: str, lines: tuple[int, int], budget: float) -> dict[str, float]:
        """Tests that run one of the lines, the quickest first, up to a sum of durations in s.

        What runs on import can show in any test, so then all follow.
        """
        by_line = self.tests.get(file, {})
        found: set[str] = set()
        for line in range(lines[0], lines[1] + 1):
            found |= by_line.get(line, set())
        if not found:
            # Constants in the middle of a long statement are not seen: its beginning is.
            above = max((line for line in by_line if line < lines[0]), default=0)
            found = by_line.get(above, set()) - {""}
        order = sorted(found - {""}, key=self._duration)
        if "" in found:
            order += sorted(set(self.seconds) - found, key=self._duration)
        chosen: dict[str, float] = {}
        total = 0.0
        for test in order:
            total += self._duration(test)
            if chosen and total > budget:
                break
            chosen[test] = self._duration(test)
        return chosen

    def _duration(self, test: str) -> float:
        return self.seconds.get(test, 0.0)


def measure(room: str, tests: Sequence[str], folder: Path) -> Covering:
    """Run the tests of a room once, unchanged, and see what they do.

    Raises:
        SystemExit: if they do not pass.
    """
    folder.mkdir(parents=True, exist_ok=True)
    data_file = folder / f"{room}.coverage"
    data_file.unlink(missing_ok=True)
    os.environ["COVERAGE_FILE"] = str(data_file)

    def work() -> Any:
        watch = _Watch()
        measured = ["--cov=src/sandra/" + room, "--cov-context=test", "--cov-report="]
        status = run_pytest([*tests, *measured, "-m", "not slow and not soundness"], [watch])
        return {"status": status, "seconds": watch.seconds, "foreign": foreign_modules()}

    result = run_once(work)
    if result["status"] != 0:
        raise SystemExit(f"mutation: the unchanged tests fail: {' '.join(tests)}")
    return Covering(result["seconds"], _by_line(data_file), result["foreign"])


def _by_line(data_file: Path) -> dict[str, dict[int, set[str]]]:
    data = CoverageData(str(data_file))
    data.read()
    root = Path.cwd()
    found: dict[str, dict[int, set[str]]] = {}
    for file in data.measured_files():
        lines: dict[int, set[str]] = defaultdict(set)
        for line, contexts in data.contexts_by_lineno(file).items():
            # "tests/logic/test_x.py::test_y|run"; the import has no context
            lines[line] = {context.rpartition("|")[0] for context in contexts}
        found[str(Path(file).resolve().relative_to(root))] = dict(lines)
    return found


class _Watch:
    """Durations; and empty caches before each test, so that each shows all that it needs."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = {}
        self.caches: list[Any] = []

    def pytest_collection_finish(self) -> None:
        self.caches = [
            thing
            for thing in gc.get_objects()
            if isinstance(thing, functools._lru_cache_wrapper)
            and thing.__module__.startswith("sandra")
        ]

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_protocol(self, item: pytest.Item) -> Generator[None, object, object]:
        for cache in self.caches:
            cache.cache_clear()
        begin = time.process_time()
        try:
            return (yield)
        finally:
            self.seconds[item.nodeid] = time.process_time() - begin


def save(covering: Covering, path: Path) -> None:
    tests = {
        file: {str(line): sorted(names) for line, names in lines.items()}
        for file, lines in covering.tests.items()
    }
    text = {"seconds": covering.seconds, "tests": tests, "foreign": covering.foreign}
    path.write_text(json.dumps(text), encoding="utf-8")


def load(path: Path) -> Covering:
    text = json.loads(path.read_text(encoding="utf-8"))
    tests = {
        file: {int(line): set(names) for line, names in lines.items()}
        for file, lines in text["tests"].items()
    }
    return Covering(text["seconds"], tests, text["foreign"])


def fingerprint(paths: Iterable[Path]) -> str:
    """A hash of the contents of files."""
    digest = hashlib.sha256()
    for path in sorted(paths):
        digest.update(str(path).encode() + b"\0" + path.read_bytes() + b"\0")
    return digest.hexdigest()[:16]
