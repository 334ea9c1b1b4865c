"""From one file of recordings to its rows: whose window, which prompt, which label."""

from __future__ import annotations

import zlib
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from sandra.actions import ActionPair
from sandra.describe import describe, narrow
from sandra.errors import ScenarioError, SettingsError
from sandra.learn.episodes import SPLITS, split_of
from sandra.learn.labels import LABELERS, label
from sandra.learn.rows import Row, RowStatus
from sandra.learn.variety import bare, drawn, some
from sandra.scene.tracks import Track, Tracks
from sandra.settings import Settings

RULES = ("R_G1", "R_G2", "R_G3")
"""What a prompt with rules tells."""


@dataclass(frozen=True, slots=True)
class Windows:
    """What becomes a row.

    Args:
        labeler: see `sandra.learn.labels`. per_vehicle: windows of a trajectory, spread evenly.
        vehicles: of a scenario, chosen by the seed; 0: all. seed: also of the order of the pairs
                after the label.
        variety: chance that a prompt tells a wish, past pairs, the rules, and that only some pairs
            may be ranked, each (`sandra.learn.variety`).
        bare: chance that a prompt tells no accelerations, and no road type and limits, each.
        settings: `horizon` is the length of a window, in steps; all that prompts depend on.

    Raises:
        SettingsError: a value out of range.
    """

    labeler: str = "mean"
    per_vehicle: int = 3
    vehicles: int = 0
    seed: int = 0
    variety: float = 0.0
    bare: float = 0.0
    settings: Settings = field(default_factory=Settings)

    def __post_init__(self) -> None:
        for name, chance in (("variety", self.variety), ("bare", self.bare)):
            if not 0.0 <= chance <= 1.0:
                raise SettingsError(f"{name} = {chance}: a chance, from 0 to 1")
        if self.labeler not in LABELERS:
            known = ", ".join(LABELERS)
            raise SettingsError(f"labeler '{self.labeler}' is unknown; known are {known}")
        if self.per_vehicle < 1 or self.vehicles < 0 or self.seed < 0:
            raise SettingsError(
                f"windows = {self.per_vehicle}, vehicles = {self.vehicles}, seed = {self.seed}: "
                "at least 1, 0 and 0"
            )

    def to_dict(self) -> dict[str, Any]:
        return asdict(self)


def rows_of(path: Path, name: str, how: Windows, crashed: Mapping[int, int]) -> list[Row]:
    """The rows of a file. Nothing is left out: what has no label is a row that says why.

    Args:
        name: of the file, relative to the folder of scenarios. crashed: the step from which on a
            vehicle, by id, has crashed.
    """
    blank = Row(RowStatus.ERROR.value, split_of_file(name), name, None, None)
    try:
        tracks = Tracks(path, how.settings)
        chosen = _chosen(tracks, name, how)
    except ScenarioError as error:
        return [replace(blank, detail=_words(error, path))]
    if not chosen:
        return [replace(blank, detail="there is no recorded vehicle that could be the ego")]
    return [
        row
        for track in chosen
        for row in _rows_of_track(tracks, track, crashed.get(track.id), blank, how)
    ]


def split_of_file(name: str) -> str:
    """The split of a file: that of its folder if it is called so, else by a hash of its name."""
    parts = Path(name).parts
    named = next((part for part in parts[:-1] if part in SPLITS), None)
    return named or split_of(zlib.crc32(parts[-1].encode()))


def _chosen(tracks: Tracks, name: str, how: Windows) -> list[Track]:
    every = tracks.all()
    if not 0 < how.vehicles < len(every):
        return list(every)
    order = _rng(how.seed, name).permutation(len(every))[: how.vehicles]
    return [every[i] for i in sorted(order)]


def _rows_of_track(
    tracks: Tracks, track: Track, crash: int | None, blank: Row, how: Windows
) -> Iterator[Row]:
    horizon = how.settings.horizon
    blank = replace(blank, ego=track.id)
    starts = track.windows(horizon, 1)
    # Rather from the second step on: the first one's steering is not known (`Tracks.scene`).
    starts = starts[1:] or starts
    if not starts:
        detail = f"recorded for {track.last - track.first} steps, a window has {horizon}"
        yield replace(blank, status=RowStatus.SHORT.value, detail=detail)
        return
    places = np.linspace(0, len(starts) - 1, how.per_vehicle).round().astype(int)
    for step in dict.fromkeys(starts[i] for i in places.tolist()):
        row = replace(blank, step=step)
        if crash is not None and crash <= step + horizon:
            yield replace(row, status=RowStatus.CRASHED.value, detail=f"at step {crash}")
            continue
        try:
            yield _labelled(tracks, row, track.id, step, how)
        except ScenarioError as error:
            yield replace(row, detail=_words(error, tracks.path))


def _labelled(tracks: Tracks, row: Row, ego: int, step: int, how: Windows) -> Row:
    settings = how.settings
    scene = tracks.scene(ego, step)
    found = label(scene, settings.horizon, how.labeler, settings)
    if found.pair is None:
        return replace(row, status=RowStatus.UNKNOWN.value, detail=found.reason)
    where = f"{row.scenario} {ego} {step}"
    rng = _rng(how.seed, f"{where} variety")
    more = drawn(how.variety, found.pair, rng)
    scene = bare(scene, how.bare, _rng(how.seed, f"{where} bare"))
    prompt = describe(
        scene, more.command, more.past, RULES, rule_prompt=more.rule_prompt, settings=settings
    )
    row = replace(row, label=str(found.pair), feasible=tuple(map(str, prompt.feasible)))
    if found.pair not in prompt.feasible:
        return replace(row, status=RowStatus.INFEASIBLE.value, detail="not offered by the prompt")
    if more.narrowed:
        prompt = narrow(prompt, some(prompt.feasible, found.pair, rng))
    order = ranking(found.pair, prompt.feasible, _rng(how.seed, where))
    return replace(
        row,
        status=RowStatus.LABELLED.value,
        feasible=tuple(map(str, prompt.feasible)),
        system=prompt.system,
        user=prompt.user,
        schema=prompt.schema,
        ranking=tuple(map(str, order[: prompt.k])),
    )


def ranking(
    first: ActionPair, feasible: tuple[ActionPair, ...], rng: np.random.Generator
) -> tuple[ActionPair, ...]:
    """The label, then the other feasible pairs in random order, none twice."""
    others = [pair for pair in feasible if pair != first]
    return (first, *(others[i] for i in rng.permutation(len(others))))


def _rng(seed: int, words: str) -> np.random.Generator:
    return np.random.default_rng([seed, zlib.crc32(words.encode())])


def _words(error: ScenarioError, path: Path) -> str:
    """Without the place where the data lies on this machine."""
    return str(error).removeprefix(f"{path}: ")
