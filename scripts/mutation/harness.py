"""Runs tests against one changed source file, each time in a process forked for it.

The parent has imported what the tests need from other projects, but neither the package nor any
test. A child puts the changed text in place of the file, and runs the chosen tests in order until
one fails. Time is processor time, so that a busy machine does not make a mutant look slow.
"""

from __future__ import annotations

import gc
import importlib
import importlib.abc
import importlib.machinery
import importlib.util
import json
import os
import resource
import signal
import sys
import traceback
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import CodeType, ModuleType
from typing import Any

import pytest

SETUP_S = 60.0
"""Processor time for importing and collecting, far above what it takes."""
MEMORY = 8 << 30
"""Address space of a child in bytes; a mutant that asks for more dies of it."""


def time_limit(normal: float) -> float:
    """Processor time in s after which a test that normally takes `normal` s is cut off."""
    return 2.0 + 10.0 * normal


@dataclass(frozen=True)
class Outcome:
    """How the tests ended: "killed", "survived", "timeout" or "broken" (the harness itself)."""

    status: str
    by: str = ""
    seconds: float = 0.0


@dataclass(frozen=True)
class Job:
    """Tests to run in order, by id, with their normal durations in s, against a changed file."""

    key: str
    module: str
    path: Path
    source: str
    tests: Mapping[str, float]


def run_all(jobs: Iterator[Job], workers: int) -> Iterator[tuple[Job, Outcome]]:
    """Each job in a process of its own, at most `workers` at a time."""
    running: dict[int, tuple[Job, int]] = {}
    gc.collect()
    gc.freeze()
    try:
        for job in jobs:
            pid, pipe = _fork(lambda report, job=job: _child(job, report))
            running[pid] = (job, pipe)
            if len(running) >= workers:
                yield _wait(running)
        while running:
            yield _wait(running)
    finally:
        for pid, (_, pipe) in running.items():
            os.kill(pid, signal.SIGKILL)
            os.waitpid(pid, 0)
            os.close(pipe)


def run_once(work: Callable[[], Any]) -> Any:
    """The result (through JSON) of a function that runs in a forked process."""
    pid, pipe = _fork(lambda report: report(work()))
    chunks = []
    while chunk := os.read(pipe, 1 << 16):
        chunks.append(chunk)
    os.close(pipe)
    _, status = os.waitpid(pid, 0)
    if status != 0:
        raise SystemExit(f"mutation: the unchanged tests did not run (status {status})")
    return json.loads(b"".join(chunks))


def preload(names: Sequence[str]) -> None:
    """Import modules of other projects, so that the children need not."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        for name in names:
            # What cannot be imported on its own, the tests import themselves.
            try:
                importlib.import_module(name)
            except Exception:  # noqa: BLE001
                continue


def foreign_modules() -> list[str]:
    """The modules loaded from the standard library and from installed projects."""
    homes = tuple(p for p in sys.path if p.endswith(("site-packages", "lib-dynload")))
    standard = str(Path(os.__file__).parent)
    names = []
    for name, module in list(sys.modules.items()):
        file = getattr(module, "__file__", None) or ""
        if file.startswith((standard, *homes)) and not name.startswith(("sandra", "__")):
            names.append(name)
    return sorted(names)


def _fork(work: Callable[[Callable[[Any], None]], None]) -> tuple[int, int]:
    read, write = os.pipe()
    sys.stdout.flush()
    sys.stderr.flush()
    pid = os.fork()
    if pid:
        os.close(write)
        return pid, read
    os.close(read)
    signal.signal(signal.SIGTERM, signal.SIG_DFL)

    def report(value: Any) -> None:
        text = json.dumps(value).encode()
        while text:
            text = text[os.write(write, text) :]

    code = 1
    try:
        work(report)
        code = 0
    except BaseException:  # noqa: BLE001 - nothing may run on into the parent's code
        if os.environ.get("MUTATION_DEBUG"):
            traceback.print_exc()
    finally:
        os._exit(code)


def _wait(running: dict[int, tuple[Job, int]]) -> tuple[Job, Outcome]:
    pid, status, usage = os.wait4(-1, 0)
    job, pipe = running.pop(pid)
    reported = b""
    while chunk := os.read(pipe, 1 << 16):
        reported += chunk
    os.close(pipe)
    seconds = usage.ru_utime + usage.ru_stime
    if os.WIFSIGNALED(status):
        number = os.WTERMSIG(status)
        slow = number in (signal.SIGPROF, signal.SIGALRM)
        return job, Outcome("timeout" if slow else "killed", signal.Signals(number).name, seconds)
    if not reported:
        return job, Outcome("broken", "", seconds)
    code, by = json.loads(reported)
    # 1: a test failed; 2: a test file could not be imported; 3: pytest gave up.
    status_of = {0: "survived", 1: "killed", 2: "killed", 3: "killed"}
    return job, Outcome(status_of.get(code, "broken"), by, seconds)


def _child(job: Job, report: Callable[[Any], None]) -> None:
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
    signal.setitimer(signal.ITIMER_PROF, SETUP_S)
    # For a mutant that sleeps or waits instead of computing.
    signal.alarm(int(20 * (SETUP_S + sum(map(time_limit, job.tests.values())))))
    sys.meta_path.insert(0, _Changed(job.module, job.path, job.source))
    chosen = _Chosen(job.tests)
    files = sorted({test.partition("::")[0] for test in job.tests})
    report((run_pytest([*files, "--exitfirst"], [chosen]), chosen.failed))


def run_pytest(arguments: Sequence[str], plugins: Sequence[object]) -> int:
    """Exit status of a silent run of pytest in this process."""
    os.environ["CI"] = "1"  # tests/conftest.py: the same random examples in every run
    null = os.open(os.devnull, os.O_WRONLY)
    if not os.environ.get("MUTATION_DEBUG"):
        os.dup2(null, 1)
        os.dup2(null, 2)
    quiet = ["-p", "no:cacheprovider", "-p", "no:faulthandler", "-p", "no:xdist", "--tb=no"]
    # The parent has loaded the plugins already.
    quiet += ["-W", "ignore::pytest.PytestAssertRewriteWarning"]
    return int(pytest.main([*quiet, *arguments], [_Calm(), *plugins]))


class _Calm:
    """No health checks of Hypothesis: they watch the clock, and a busy machine would fail them."""

    @pytest.hookimpl(tryfirst=True)
    def pytest_collection(self) -> None:
        from hypothesis import HealthCheck, settings

        settings.register_profile(
            "mutation",
            settings.get_profile("repeatable"),
            suppress_health_check=list(HealthCheck),
        )
        settings.load_profile("mutation")


class _Chosen:
    """Keeps the chosen tests, in the given order, and gives each its time."""

    def __init__(self, tests: Mapping[str, float]) -> None:
        self.tests = tests
        self.failed = ""

    @pytest.hookimpl(trylast=True)
    def pytest_collection_modifyitems(self, items: list[pytest.Item]) -> None:
        order = {test: i for i, test in enumerate(self.tests)}
        items[:] = sorted(
            (item for item in items if item.nodeid in order), key=lambda i: order[i.nodeid]
        )

    @pytest.hookimpl(tryfirst=True)
    def pytest_runtest_protocol(self, item: pytest.Item) -> None:
        signal.setitimer(signal.ITIMER_PROF, time_limit(self.tests[item.nodeid]))

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        if report.failed:
            self.failed = report.nodeid

    def pytest_collectreport(self, report: pytest.CollectReport) -> None:
        if report.failed:
            self.failed = f"import of {report.nodeid}"


class _Changed(importlib.abc.MetaPathFinder):
    """Finds one module of the package and gives it the changed text."""

    def __init__(self, module: str, path: Path, source: str) -> None:
        self.module, self.path = module, path
        self.loader = _Loader(module, str(path), source)

    def find_spec(
        self, fullname: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> importlib.machinery.ModuleSpec | None:
        if fullname != self.module:
            return None
        return importlib.util.spec_from_file_location(fullname, self.path, loader=self.loader)


class _Loader(importlib.machinery.SourceFileLoader):
    def __init__(self, name: str, path: str, source: str) -> None:
        super().__init__(name, path)
        self.source = source

    def get_code(self, fullname: str) -> CodeType:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # `x is 1` and the like
            return compile(self.source, self.path, "exec", dont_inherit=True)
