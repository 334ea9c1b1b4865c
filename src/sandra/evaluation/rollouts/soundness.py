"""Many rollouts of many certificates: how often does an accepted one fail?

Every certificate comes from a scene that depends on the seed and its number alone, and is played
with random numbers that depend on the same, so that any number of workers finds the same.
"""

from __future__ import annotations

import multiprocessing
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ProcessPoolExecutor
from pathlib import Path

from sandra.errors import SettingsError
from sandra.evaluation.rollouts.cases import cases
from sandra.evaluation.rollouts.report import Report, Tried
from sandra.evaluation.rollouts.road import Road
from sandra.evaluation.rollouts.rollout import play
from sandra.scenarios import examples
from sandra.settings import Settings

PER_CERTIFICATE = 100
IN_VAIN = 20
"""Scenes one after another, beside one of each file, that may all have no certificate."""


def soundness(
    files: Sequence[str | Path] = (),
    rollouts: int = 10_000,
    seed: int = 0,
    workers: int = 1,
    per_certificate: int = PER_CERTIFICATE,
    settings: Settings | None = None,
    progress: Callable[[str], None] | None = None,
) -> Report:
    """Play certificates against adversaries until there are `rollouts` admissible ones.

    Args:
        files: CommonRoad files; default: all scenarios that come with SanDRA.
        rollouts: at least so many; the last certificate is played to its end.
        seed: of scenes and adversaries.
        workers: processes; the result does not depend on it.
        per_certificate: rollouts of each certificate.
        settings: of predictions, planner and checker.
        progress: told in words how far it is.

    Raises:
        SettingsError: for counts below 1, or if no certificate is found.
        ScenarioError: if a file cannot be read.
    """
    for name, value in (("rollouts", rollouts), ("workers", workers),
                        ("rollouts per certificate", per_certificate)):  # fmt: skip
        if value < 1:
            raise SettingsError(f"{name} = {value} must be at least 1")
    paths = tuple(Path(f) for f in files) or tuple(examples().values())
    settings = settings or Settings()
    tried: list[Tried] = []
    scenes = done = in_vain = 0
    for found in _units(paths, seed, workers, per_certificate, settings):
        in_vain = 0 if found else in_vain + 1
        if in_vain > IN_VAIN + len(paths):
            raise SettingsError(
                f"no certificate in {in_vain} scenes one after another: choose other scenarios"
            )
        scenes += bool(found)
        for each in found:
            tried.append(each)
            done += int(each.played.admissible.sum())
            if done >= rollouts:
                break
        if progress is not None:
            progress(f"{len(tried)} certificates, {done} of {rollouts} rollouts")
        if done >= rollouts:
            break
    return Report(tuple(tried), scenes, seed)


def _units(
    paths: tuple[Path, ...], seed: int, workers: int, per_certificate: int, settings: Settings
) -> Iterator[tuple[Tried, ...]]:
    """The scenes 0, 1, 2, ... in order, without end."""
    index = 0
    if workers == 1:
        while True:
            yield unit(paths, index, seed, per_certificate, settings)
            index += 1
    pending: deque[Future[tuple[Tried, ...]]] = deque()
    with ProcessPoolExecutor(workers, multiprocessing.get_context("spawn")) as pool:
        try:
            while True:
                while len(pending) < 2 * workers:
                    pending.append(pool.submit(unit, paths, index, seed, per_certificate, settings))
                    index += 1
                yield pending.popleft().result()
        finally:
            for future in pending:
                future.cancel()


def unit(
    paths: tuple[Path, ...], index: int, seed: int, per_certificate: int, settings: Settings
) -> tuple[Tried, ...]:
    """All certificates of one scene, played."""
    found = cases(paths, index, seed, settings)
    road = Road(found.scene)
    return tuple(
        Tried(
            index,
            found.label,
            str(c.pair),
            c.prediction,
            c.rules,
            play(c, found.scene, per_certificate, [seed, index, n], road),
        )
        for n, c in enumerate(found.certificates)
    )
