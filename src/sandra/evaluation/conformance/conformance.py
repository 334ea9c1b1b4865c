"""Many recordings, one after another or in several processes."""

from __future__ import annotations

import hashlib
import math
import os
from collections.abc import Callable, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass
from functools import partial, reduce
from pathlib import Path

import numpy as np

from sandra.errors import ScenarioError, SettingsError
from sandra.evaluation.conformance.coverage import Coverage, coverage
from sandra.evaluation.conformance.measure import Finding, amounts, findings
from sandra.evaluation.conformance.motion import position_error
from sandra.evaluation.conformance.recording import (
    CRASHED,
    Recording,
    files_of,
    marked_crashes,
    recording,
)
from sandra.evaluation.conformance.report import Conformance, Source
from sandra.evaluation.workers import Broken, Workers, in_order
from sandra.scene import load
from sandra.scene.sent import content_of
from sandra.scene.types import Scene
from sandra.settings import Settings

TOWARDS = ("all", "ego")


@dataclass(frozen=True, slots=True)
class _Item:
    """A recording, its name, and who has crashed in it from which step on."""

    given: str | Path | Scene
    name: str
    crashed: dict[int, int]

    def __repr__(self) -> str:
        return self.name


@dataclass(frozen=True, slots=True)
class _Options:
    settings: Settings
    towards: str
    touching: bool
    horizon: int
    every: int
    noise: float
    step: float


def conformance(
    recordings: Sequence[str | Path | Scene],
    settings: Settings | None = None,
    *,
    towards: str = "all",
    crashed: Mapping[str, Mapping[int, int]] | None = None,
    touching: bool = False,
    horizon: int = 0,
    every: int = 10,
    noise: float = 0.02,
    step: float = 0.0,
    workers: Workers = 1,
    progress: Callable[[str], None] = lambda words: None,
) -> Conformance:
    """Measure recordings against `settings.assumptions`.

    Args:
        recordings: CommonRoad files, or scenes whose obstacles have `states`.
        towards: who is taken for the ego by `no_rear_end` and `legal_cut_in`: "all" vehicles in
            turn, or the recorded "ego" alone.
        crashed: by name of a recording (of the scene, or of the file, below the folder that all
            files have in common), the step from which on a vehicle has crashed and is no
            evidence; added to what the file RECORDING.crashed.json says.
        touching: bodies that touch have crashed, too.
        horizon: steps for which sets are predicted and compared (coverage); 0: none.
        every: predict from every so many steps of a recording.
        noise: recorded positions may be off by so much in a step [m].
        step: look at every so many seconds of a recording, e.g. at the steps that are verified, as
            near as it allows; 0: at all its steps.
        workers: see `sandra.evaluation.workers`.

    Raises:
        SettingsError: an unknown `towards`, a bad number.
        ScenarioError: a file that cannot be read, or nothing that moves in any of them.
    """
    if towards not in TOWARDS:
        raise SettingsError(f"towards = {towards!r}: choose from {', '.join(TOWARDS)}")
    if horizon < 0 or every < 1:
        raise SettingsError(f"horizon = {horizon} must be >= 0, every = {every} at least 1")
    for name, value in (("noise", noise), ("step", step)):
        if not 0.0 <= value < math.inf:
            raise SettingsError(f"{name} = {value} must be a finite number >= 0")
    settings = Settings() if settings is None else settings
    options = _Options(settings, towards, touching, horizon, every, noise, step)
    marked = crashed or {}
    names = _names(recordings)
    items = [
        _Item(x, name, dict(marked.get(name, {})))
        for x, name in zip(recordings, names, strict=True)
    ]
    known = {x.name for x in items}
    for name in marked:
        if name not in known:
            raise ScenarioError(f"crashed vehicles of {name}: no recording of that name is given")
    sources: list[Source] = []
    every_finding: list[list[Finding]] = []
    covered: list[Coverage] = []
    failed = []
    with closing(in_order(partial(_judged, options), items, workers, _files_of)) as answers:
        for number, (item, answer) in enumerate(zip(items, answers, strict=True), start=1):
            if isinstance(answer, Broken):
                failed.append((item.name, answer.error))
                continue
            source, found, cover = answer
            progress(f"{number} of {len(items)} recordings")
            sources.append(source)
            every_finding.append(found)
            if cover is not None:
                covered.append(cover)
    if not failed and not any(source.vehicles for source in sources):
        raise ScenarioError(
            "no recorded vehicle moves in any of the files; give recordings, whose dynamic "
            "obstacles have trajectories"
        )
    together = [reduce(Finding.and_, rows) for rows in zip(*every_finding, strict=True)]
    return Conformance(
        tuple(sources),
        tuple(together),
        settings.assumptions,
        towards,
        tuple(failed),
        reduce(Coverage.and_, covered) if covered else None,
    )


def recordings_in(paths: Sequence[Path]) -> list[Path]:
    """Files as they are, folders as the .xml files in and below them.

    Raises:
        ScenarioError: a path that does not exist, or a folder without any.
    """
    found: list[Path] = []
    for path in paths:
        inside = sorted(path.rglob("*.xml")) if path.is_dir() else [path]
        if not inside or not inside[0].exists():
            what = "holds no .xml file" if path.is_dir() else "does not exist"
            raise ScenarioError(f"{path}: {what}; give CommonRoad files, or folders of them")
        found += inside
    return list(dict.fromkeys(found))


def _names(recordings: Sequence[str | Path | Scene]) -> list[str]:
    """Scenes by their names, files by their paths below the folder that they have in common."""
    files = [Path(x).absolute() for x in recordings if not isinstance(x, Scene)]
    folder = os.path.commonpath([file.parent for file in files]) if files else ""
    return [
        x.name if isinstance(x, Scene) else Path(x).absolute().relative_to(folder).as_posix()
        for x in recordings
    ]


def _files_of(item: _Item) -> tuple[Path, ...]:
    return () if isinstance(item.given, Scene) else files_of(Path(item.given))


def _judged(options: _Options, item: _Item) -> tuple[Source, list[Finding], Coverage | None]:
    given, crashed = item.given, item.crashed
    if isinstance(given, Scene):
        scene, digest = given, ""
    else:
        path = Path(given)
        scene = load(path, settings=options.settings)
        digest = hashlib.sha256(content_of(path)).hexdigest()
        # A run folder marks whoever the simulation had, seen here or not.
        ids = {scene.ego.id, *(o.id for o in scene.obstacles)}
        marked = marked_crashes(path)
        if not path.with_suffix(CRASHED).exists():
            marked = {i: at for i, at in marked.items() if i in ids}
        crashed = {**marked, **crashed}
    made = recording(scene, crashed, touching=options.touching, step=options.step)
    values, off = amounts(made, options.settings, options.towards, options.noise)
    found = findings(made, item.name, values, options.settings.assumptions)
    cover = None
    if options.horizon:
        cover = coverage(made, values, options.settings, options.horizon, options.every)
    return _source(made, item.name, digest, off), found, cover


def _source(made: Recording, name: str, digest: str, off: int) -> Source:
    counted = made.others | made.walking
    there = made.there[counted]
    return Source(
        name,
        digest,
        made.dt,
        int(there.any(axis=1).sum()),
        int(np.sum(there)),
        made.crashed_steps,
        off,
        position_error(made),
    )
