"""Many rollouts of many certificates: how often does an accepted one fail?

Every certificate comes from a scene that depends on the seed and its number alone, and is played
with random numbers that depend on the same, so that any number of workers finds the same.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import closing
from functools import partial
from itertools import count
from pathlib import Path

from sandra.errors import SettingsError
from sandra.evaluation.rollouts.cases import cases, file_of
from sandra.evaluation.rollouts.report import Report, Tried
from sandra.evaluation.rollouts.road import Road
from sandra.evaluation.rollouts.rollout import play
from sandra.evaluation.workers import Broken, Workers, in_order
from sandra.scenarios import examples
from sandra.settings import Settings

PER_CERTIFICATE = 100
IN_VAIN = 20
"""Scenes one after another, beside one of each file, that may all have no certificate."""


def soundness(
    files: Sequence[str | Path] = (),
    rollouts: int = 10_000,
    seed: int = 0,
    workers: Workers = 1,
    per_certificate: int = PER_CERTIFICATE,
    settings: Settings | None = None,
    progress: Callable[[str], None] | None = None,
) -> Report:
    """Play certificates against adversaries until there are `rollouts` admissible ones.

    Args:
        files: CommonRoad files; default: all scenarios that come with SanDRA.
        rollouts: at least so many; the last certificate is played to its end.
        seed: of scenes and adversaries.
        workers: see `sandra.evaluation.workers`; the result does not depend on it.
        per_certificate: rollouts of each certificate.
        settings: of predictions, planner and checker.
        progress: told in words how far it is.

    Raises:
        SettingsError: for counts below 1, or if no certificate is found.
        ScenarioError: if a file cannot be read.
    """
    for name, value in (("rollouts", rollouts), ("rollouts per certificate", per_certificate)):
        if value < 1:
            raise SettingsError(f"{name} = {value} must be at least 1")
    paths = tuple(Path(f) for f in files) or tuple(examples().values())
    settings = settings or Settings()
    work = partial(unit, files=paths, seed=seed, per_certificate=per_certificate, settings=settings)
    tried: list[Tried] = []
    broken: list[str] = []
    scenes = done = in_vain = 0

    def files_of(index: int) -> tuple[Path]:
        return (file_of(paths, index),)

    with closing(in_order(work, count(), workers, files_of)) as answers:
        for index, found in enumerate(answers):
            if isinstance(found, Broken):
                broken.append(f"scene {index} ({paths[index % len(paths)].stem}): {found.error}")
                found = ()
            in_vain = 0 if found else in_vain + 1
            if in_vain > IN_VAIN + len(paths):
                why = f" ({broken[-1]})" if broken else ""
                raise SettingsError(
                    f"no certificate in {in_vain} scenes one after another{why}: "
                    "choose other scenarios"
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
    return Report(tuple(tried), scenes, seed, tuple(broken))


def unit(
    index: int, files: tuple[Path, ...], seed: int, per_certificate: int, settings: Settings
) -> tuple[Tried, ...]:
    """All certificates of one scene, played."""
    found = cases(files, index, seed, settings)
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
