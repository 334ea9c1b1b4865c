"""What the card says, on a small scale: ahead of `rules` and of the majority on fresh traffic."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

from sandra.actions import ActionPair
from sandra.describe import describe
from sandra.evaluation.dataset.build import build
from sandra.evaluation.dataset.folder import DataFolder
from sandra.evaluation.open_loop.baselines import majority
from sandra.learn.episodes import Recipe
from sandra.learn.rows import read_rows
from sandra.learn.windows import Windows
from sandra.rankers import create
from sandra.scene.tracks import Tracks
from sandra.settings import Settings

SEED = 9000
"""No seed of the training's, and none of those that the card was measured on."""


def test_it_is_ahead_of_the_rules_and_the_majority_on_balanced_labels(tmp_path: Path) -> None:
    settings = Settings(horizon=15)
    recipe = Recipe(environments=("merge", "roundabout"), duration=5.0, seed=SEED)
    DataFolder(tmp_path / "data").record(recipe, 10)
    how = Windows(per_vehicle=2, settings=settings)
    build(tmp_path / "data", tmp_path / "data.jsonl", how, balance=6)
    labels, asked = [], []
    tracks: dict[str, Tracks] = {}
    for row in read_rows(tmp_path / "data.jsonl"):
        if row.is_labelled:
            assert row.label is not None
            assert row.ego is not None
            assert row.step is not None
            if row.scenario not in tracks:
                tracks[row.scenario] = Tracks(tmp_path / "data" / row.scenario, settings)
            scene = tracks[row.scenario].scene(row.ego, row.step)
            labels.append(ActionPair.parse(row.label))
            asked.append(describe(scene, settings=settings))
    assert len(labels) > 40
    assert max(Counter(labels).values()) < len(labels) / 3

    def found(name: str) -> list[tuple[ActionPair, ...]]:
        ranker = create(name)
        return [ranker.rank(prompt, 60.0).pairs for prompt in asked]

    ours, rules = found("embedded"), found("rules")
    most = [majority(labels)] * len(labels)

    def hits(rankings: list[tuple[ActionPair, ...]], k: int) -> int:
        return sum(label in pairs[:k] for label, pairs in zip(labels, rankings, strict=True))

    told = {k: (hits(ours, k), hits(rules, k), hits(most, k)) for k in (1, 3)}
    for own, *others in told.values():
        assert own > max(others), (told, len(labels))
