"""Every window of the chosen vehicles of every file, labelled; one row each.

A file or a window that cannot be used is a row with its error.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing
from dataclasses import asdict, dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

from sandra.errors import SandraError, ScenarioError, SettingsError
from sandra.evaluation.journal import Journal
from sandra.evaluation.labelling.summary import UNKNOWN, Labels
from sandra.evaluation.workers import Broken, Workers, as_done
from sandra.learn import LABELERS, Label, label
from sandra.learn.trace import Recorded
from sandra.scene import Scene, load
from sandra.scene.tracks import Track, Tracks
from sandra.settings import Settings

EGOS = ("auto", "given", "chosen", "all")
Places = tuple[tuple[int, int], ...]
"""Egos, by id, and steps."""


@dataclass(frozen=True, slots=True)
class Choice:
    """Whose trajectory is labelled, and from which steps on.

    `ego`: "given" is the recording of the planning problem's ego, "chosen" a vehicle of the
    scenario by `seed`, "auto" the given one where it is recorded for `horizon` steps, else the
    chosen one, "all" every vehicle (of the given ego too), a number the vehicle of that id.
    Windows of `horizon` steps begin every `stride` steps; at most `windows` of a vehicle, 0: all.
    """

    ego: str = "auto"
    seed: int = 0
    horizon: int = 25
    stride: int = 25
    windows: int = 0
    labeler: str = "mean"
    settings: Settings = field(default_factory=Settings)

    def __post_init__(self) -> None:
        if self.ego not in EGOS and not self.ego.isdecimal():
            raise SettingsError(
                f"ego = '{self.ego}': choose from {', '.join(EGOS)}, or the id of a vehicle"
            )
        if self.labeler not in LABELERS:
            raise SettingsError(
                f"unknown labeler '{self.labeler}': choose from {', '.join(LABELERS)}"
            )
        if self.horizon < 1 or self.stride < 1 or self.windows < 0:
            raise SettingsError(
                f"horizon = {self.horizon} and stride = {self.stride} must be at least 1, "
                f"windows = {self.windows} at least 0"
            )


@dataclass(frozen=True, slots=True, eq=False)
class Window:
    """A decision problem that was cut out of a recording, or why there is none."""

    ego: int | None
    kind: str | None
    step: int | None
    scene: Scene | None
    error: str | None = None


def windows_of(path: Path, choice: Choice) -> Iterator[Window]:
    """The windows of the chosen vehicles of a file.

    Raises:
        ScenarioError: the file cannot be read, or holds no such vehicle.
    """
    horizon, most = choice.horizon, choice.windows or None
    tracks = Tracks(path, choice.settings)
    if choice.ego in ("auto", "given"):
        given = load(path, settings=choice.settings)
        try:
            Recorded.of(given, horizon)
            yield from _of_given(given, tracks, choice)
            return
        except ScenarioError:
            if choice.ego == "given":
                raise
    for track in _chosen(tracks, choice):
        for step in track.windows(horizon, choice.stride)[:most]:
            yield _window(tracks, track.id, track.kind, step)


def windows_at(path: Path, places: Places, choice: Choice) -> Iterator[Window]:
    """The windows of these vehicles at these steps. Raises `ScenarioError`: see `windows_of`."""
    tracks = Tracks(path, choice.settings)
    kinds = {track.id: track.kind for track in tracks.all()}
    for ego, step in places:
        yield _window(tracks, ego, kinds.get(ego, "car"), step)


def _of_given(given: Scene, tracks: Tracks, choice: Choice) -> Iterator[Window]:
    """Of the planning problem's ego: its first window is the problem as it is."""
    first = tracks.problem_step
    yield Window(given.ego.id, "ego", first, given)
    own = _track_of(given, tracks)
    if own is None:
        return
    later = range(first + choice.stride, own.last - choice.horizon + 1, choice.stride)
    for step in later[: choice.windows - 1 if choice.windows else None]:
        yield _window(tracks, own.id, own.kind, step)


def _track_of(given: Scene, tracks: Tracks) -> Track | None:
    """The obstacle of the file that `load` took for the ego's recording."""
    left = {o.id for o in given.obstacles}
    gone = [t for t in tracks.all() if t.id not in left and t.last >= tracks.problem_step]
    return gone[0] if len(gone) == 1 else None


def _chosen(tracks: Tracks, choice: Choice) -> Sequence[Track]:
    if choice.ego == "all":
        found = tuple(t for t in tracks.all() if t.windows(choice.horizon, 1))
        if not found:
            tracks.choose(choice.seed, choice.horizon)  # Says that there is none.
        return found
    if choice.ego in EGOS:
        return (tracks.choose(choice.seed, choice.horizon),)
    found = tuple(t for t in tracks.all() if t.id == int(choice.ego))
    if not found or not found[0].windows(choice.horizon, 1):
        known = ", ".join(str(t.id) for t in tracks.all() if t.windows(choice.horizon, 1))
        raise ScenarioError(
            f"{tracks.path}: no vehicle {choice.ego} is recorded for {choice.horizon} steps; "
            f"choose from {known or 'none'}"
        )
    return found


def _window(tracks: Tracks, id: int, kind: str, step: int) -> Window:
    try:
        return Window(id, kind, step, tracks.scene(id, step))
    except ScenarioError as error:
        return Window(id, kind, step, None, str(error))


def rows_of(path: Path, choice: Choice) -> list[dict[str, Any]]:
    """The rows of one file; never none."""
    rows = []
    try:
        for window in windows_of(path, choice):
            rows.append(_row(path, window, choice))
    except SandraError as error:
        rows.append(_error(path, choice, str(error)))
    return rows or [_error(path, choice, f"{path}: there is no window; choose a shorter horizon")]


def _row(path: Path, window: Window, choice: Choice) -> dict[str, Any]:
    row = _error(path, choice, window.error) | {
        "ego_id": window.ego,
        "kind": window.kind,
        "step": window.step,
    }
    if window.scene is None:
        return row
    try:
        found = label(window.scene, choice.horizon, choice.labeler, choice.settings)
    except SandraError as error:
        return row | {"error": str(error)}
    recorded = Recorded.of(window.scene, choice.horizon)
    return row | {
        "scenario_id": window.scene.name,
        "dt": window.scene.dt,
        **told(found),
        "mean_acceleration": recorded.mean_acceleration,
        "speed": float(recorded.states[0, 3]),
        "final_speed": float(recorded.states[-1, 3]),
    }


def told(found: Label) -> dict[str, Any]:
    """A label as the cells of a row."""
    return {
        "label_lon": found.longitudinal.value if found.longitudinal else UNKNOWN,
        "label_lat": found.lateral.value if found.lateral else UNKNOWN,
        "holds": [str(pair) for pair in found.holds],
        "reason": found.reason,
        "areas": {str(pair): area for pair, area in found.areas.items()} or None,
    }


def _error(path: Path, choice: Choice, error: str | None) -> dict[str, Any]:
    return {
        "scenario_id": path.stem,
        "file": str(path),
        "ego_id": None,
        "kind": None,
        "step": None,
        "dt": None,
        "horizon": choice.horizon,
        "labeler": choice.labeler,
        "label_lon": UNKNOWN,
        "label_lat": UNKNOWN,
        "holds": [],
        "reason": None,
        "areas": None,
        "mean_acceleration": None,
        "speed": None,
        "final_speed": None,
        "error": error,
    }


def label_all(
    paths: Sequence[Path],
    choice: Choice = Choice(),
    *,
    journal: Path | None = None,
    workers: Workers = 1,
    progress: Callable[[int, int, str], None] = lambda done, total, name: None,
) -> Labels:
    """Label files; those that are in the journal already are not labelled again.

    Args:
        journal: of a run that can go on; see `Journal`. A file that has changed is labelled anew.
        workers: see `sandra.evaluation.workers`.
        progress: is told (files done, all files, name of the last one).

    Raises:
        SandraError: if the journal cannot be written or holds another run.
    """
    book = Journal(journal, {**asdict(choice), "settings": repr(choice.settings)})
    keys = {path: fingerprint(path) for path in paths}
    todo = [path for path, key in keys.items() if key not in book]
    done = len(keys) - len(todo)
    work = partial(rows_of, choice=choice)
    with closing(as_done(work, todo, workers, lambda path: (path,))) as answers:
        for path, found in answers:
            if isinstance(found, Broken):
                found = [_error(path, choice, f"internal error: {found.error}")]
            book.add(keys[path], found)
            done += 1
            progress(done, len(keys), path.stem)
    return Labels(tuple(row for key in keys.values() for row in book[key]))


def fingerprint(path: Path) -> str:
    """A file's path and content, as far as it can be read."""
    try:
        return f"{path} {hashlib.sha256(path.read_bytes()).hexdigest()[:16]}"
    except OSError:
        return f"{path} -"
