"""The document of an episode, from the folder that `sandra drive` has written (docs/drive.md).

Where the folder has a view.jsonl, the page shows the very sets and predictions of the drive;
without one it shows what decisions.jsonl holds: verdicts, reasons, texts and what was driven.
"""

from __future__ import annotations

import json
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np

from sandra.errors import SandraError, ScenarioError, SettingsError
from sandra.evaluation.closed_loop.driven import every
from sandra.monitor import monitor
from sandra.scene import load
from sandra.scene.types import Scene
from sandra.settings import Settings
from sandra.view.report.bare import bare
from sandra.view.report.document import Document, Episode, Series, Track, plain
from sandra.view.report.frames import NAME, Frames, read_frames
from sandra.view.report.lines import decisions_of
from sandra.view.report.scenery import map_of, outline_of, pack_states
from sandra.view.shapes import Array, View

WITHOUT = (
    "This run was driven without a record of its reachable sets (view.jsonl), so the page shows "
    "verdicts and reasons, but no sets and no predictions. 'sandra drive' writes them unless it is "
    "given --no-view, 'sandra evaluate closed-loop' if it is given --view."
)


def episode_document(folder: Path, home: str | None = None) -> Document:
    """What the page of RUN/seed-N shows; `home`: a link back to the page of the whole run.

    Raises:
        SandraError: if it is no folder of a whole episode.
    """
    about, measured = read_json(folder.parent / "run.json"), read_json(folder / "metrics.json")
    try:
        scene = load(folder / "scenario.xml")
        stride = int(measured["ticks_per_step"])
    except (ScenarioError, KeyError, TypeError, ValueError) as error:
        raise SandraError(f"{folder}: is no folder of an episode ({error})") from None
    if scene.recorded_ego is None:
        raise SandraError(f"{folder}: scenario.xml has no recorded ego; drive the episode again")
    frames = read_frames(folder / NAME) if (folder / NAME).exists() else Frames()
    view = View.of(scene) if frames.view is None else view_at(scene, frames.view)
    notes: tuple[str, ...] = ()
    maps: tuple[Any, ...] = tuple(frames.maps)
    decisions, texts = frames.decisions, frames.texts
    if not decisions:
        decisions, texts = decisions_of(folder / "decisions.jsonl", view)
        maps = (map_of(view, scene),)
        notes = (WITHOUT,) if decisions else ()
        if not decisions:
            decisions, texts = [plain(bare(view, scene, stride))], [""]
    how = about.get("drive", {})
    told = Episode(
        ego=scene.ego.id,
        dt=scene.dt,
        ticks=len(scene.recorded_ego),
        decided_every=stride,
        tracks=_tracks(view, scene),
        rules=_robustness(scene, stride, settings_of(how)),
        crash=_tick(measured.get("crashed", {}).get(str(scene.ego.id))),
        told=tuple(map(str, measured.get("told", ()))),
    )
    return Document(
        "episode",
        _title(how, measured) or scene.name,
        _facts(how, measured),
        maps=maps,
        decisions=tuple(decisions),
        texts=tuple(texts),
        episode=told,
        home=home,
        notes=notes,
    )


def read_json(file: Path) -> dict[str, Any]:
    """A JSON object. Raises `SandraError` if the file holds none."""
    try:
        found = json.loads(file.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise SandraError(f"{file}: cannot be read ({error}); name a folder of a run") from None
    if not isinstance(found, dict):
        raise SandraError(f"{file}: is no JSON object; name a folder of a run")
    return found


def view_at(scene: Scene, place: list[float]) -> View:
    """The view whose origin and direction a file tells."""
    x, y, angle = map(float, place)
    return View.at(scene, (x, y), angle)


def settings_of(how: dict[str, Any]) -> Settings:
    """Those of a run, as far as they are told; what is infinite is null there."""
    told = how.get("settings") or {}
    known = {x.name for x in fields(Settings)} - {"assumptions"}
    try:
        return Settings().replace(**{k: v for k, v in told.items() if k in known and v is not None})
    except SettingsError:
        return Settings()


def _tracks(view: View, scene: Scene) -> tuple[Track, ...]:
    assert scene.recorded_ego is not None
    ego = scene.ego
    found = [
        Track(ego.id, "ego", outline_of(ego.outline), 0, pack_states(view, scene.recorded_ego))
    ]
    for obstacle in scene.obstacles:
        first, states = _present(obstacle.states)
        if len(states) == 0:
            state = obstacle.state
            row = [state.x, state.y, state.heading, state.speed, state.acceleration]
            first, states = 0, np.tile(row, (len(scene.recorded_ego), 1))
        packed = pack_states(view, states)
        found.append(Track(obstacle.id, obstacle.kind, outline_of(obstacle.outline), first, packed))
    return tuple(found)


def _present(states: Array | None) -> tuple[int, Array]:
    """The first row in which somebody was seen, and the rows from then to the last one."""
    if states is None:
        return 0, np.zeros((0, 5))
    seen = np.flatnonzero(np.isfinite(states[:, :3]).all(axis=1))
    return (int(seen[0]), states[seen[0] : seen[-1] + 1]) if len(seen) else (0, np.zeros((0, 5)))


def _robustness(scene: Scene, stride: int, settings: Settings) -> tuple[Series, ...]:
    found = monitor(every(scene, stride), settings=settings)
    return tuple(
        Series(
            rule.rule,
            rule.unit,
            found.dt,
            tuple(float(x) if np.isfinite(x) else None for x in rule.values),
            tuple(np.flatnonzero(~rule.kept).tolist()),
        )
        for rule in found.rules
    )


def _title(how: dict[str, Any], measured: dict[str, Any]) -> str | None:
    if "environment" not in how:
        return None
    setting = f", setting {how.get('setting')}" if how["environment"] == "highway" else ""
    return f"{how['environment']}{setting}, seed {measured.get('seed')}"


def _tick(value: Any) -> int | None:
    return value if isinstance(value, int) else None


def _facts(how: dict[str, Any], measured: dict[str, Any]) -> tuple[tuple[str, str], ...]:
    m = measured.get("metrics", {})
    driver = how.get("driver") or how.get("ranker", "?")
    rules = ", ".join(how.get("rules") or ()) or "none"
    told = [("driven by" if how.get("driver") else "ranked by", driver)]
    if not how.get("driver"):
        told += [
            ("command", how.get("command") or "none"),
            ("prediction", how.get("prediction", "?")),
            ("rules", rules),
        ]
    told += [
        ("outcome", "success" if m.get("success") else "no success"),
        ("distance", f"{m.get('distance', float('nan')):.1f} m in {m.get('steps', '?')} steps"),
        ("fail-safe", f"{100 * m.get('fail_safe_rate', float('nan')):.0f} % of steps"),
    ]
    return tuple((name, str(value)) for name, value in told)
