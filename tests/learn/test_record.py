"""Recorded data sets: whole, the same each time, split by seed, continued where they stopped."""

import json
from dataclasses import replace

import numpy as np
import pytest

from sandra.cli import main
from sandra.errors import SandraError, SettingsError
from sandra.evaluation.dataset.folder import INDEX, DataFolder
from sandra.learn.episodes import DT, ENVIRONMENTS, SPLITS, Recipe, split_of
from sandra.learn.record import play
from sandra.scene import load
from sandra.scene.network import lanelets_near

SMALL = Recipe(environments=("merge", "highway"), duration=0.6, warm_up=0.2, seed=5)


def bytes_of(folder):
    return {
        str(file.relative_to(folder)): file.read_bytes() for file in sorted(folder.rglob("*.xml"))
    }


def test_no_seed_is_in_two_splits_and_each_split_sees_all_traffic():
    recipe = Recipe()
    episodes = recipe.episodes(2000)
    splits = {}
    for episode in episodes:
        splits.setdefault(episode.seed, set()).add(episode.split)
        assert episode == replace(recipe, seed=episode.seed).episodes(1)[0]
    assert all(len(found) == 1 for found in splits.values())
    assert {split: sum(e.split == split for e in episodes) for split in SPLITS} == {
        "train": 1600,
        "validation": 200,
        "test": 200,
    }
    every = {(e.environment, e.density, e.lanes, e.drivers) for e in episodes}
    for split in SPLITS:
        there = {
            (e.environment, e.density, e.lanes, e.drivers) for e in episodes if e.split == split
        }
        assert there == every


def test_a_data_set_is_the_same_each_time_and_continued_where_it_stopped(tmp_path):
    whole, parts = DataFolder(tmp_path / "whole"), DataFolder(tmp_path / "parts")
    card = whole.record(SMALL, 5)
    parts.record(SMALL, 3, workers=2)
    before = bytes_of(parts.path)
    index = parts.path / INDEX
    index.write_text(index.read_text()[:-30])  # interrupted in the last entry
    again = parts.record(SMALL, 5)
    assert bytes_of(parts.path) == bytes_of(whole.path)
    assert len(before) == 3
    assert before.items() <= bytes_of(parts.path).items()
    assert again.facts["sha256 of all files"] == card.facts["sha256 of all files"]
    assert not list(tmp_path.rglob(".*draft*"))

    seeds = {split: set() for split in SPLITS}
    for file in whole.path.glob("*/*.xml"):
        seeds[file.parent.name].add(int(file.stem.split("-")[1]))
    assert set.union(*seeds.values()) == set(range(5, 10))
    assert sum(map(len, seeds.values())) == 5
    assert all(split_of(seed) == split for split, found in seeds.items() for seed in found)

    told = json.loads((whole.path / "card.json").read_text())
    assert told["episodes"] == 5
    on_highways = [e.split for e in SMALL.episodes(5) if e.environment == "highway"]
    assert told["tables"]["environment"]["highway"] == {
        split: on_highways.count(split) for split in SPLITS
    }
    assert told["versions"]["highway-env"] != "absent"
    assert "| episodes | 5 |" in (whole.path / "DATA.md").read_text()


def test_another_recipe_has_no_place_in_the_folder(tmp_path):
    folder = DataFolder(tmp_path)
    folder.record(SMALL, 1)
    with pytest.raises(SandraError, match="differs in densities"):
        folder.record(replace(SMALL, densities=(2.0,)), 1)
    (tmp_path / "other").mkdir()
    (tmp_path / "other" / "file").write_text("of somebody")
    with pytest.raises(SandraError, match="is not empty and no data set"):
        DataFolder(tmp_path / "other").record(SMALL, 1)


def test_an_episode_that_breaks_is_counted_and_tried_again(tmp_path, monkeypatch):
    from sandra.evaluation.dataset import folder as module

    def breaks(episode, steps, warm_up):
        if episode.seed == 6:
            raise RuntimeError("out of memory")
        return play(episode, steps, warm_up)

    monkeypatch.setattr(module, "play", breaks)
    card = DataFolder(tmp_path).record(SMALL, 2)
    assert card.facts["episodes with an error"] == 1
    assert card.errors == ("seed 6: RuntimeError: out of memory",)
    monkeypatch.undo()
    assert DataFolder(tmp_path).record(SMALL, 2).errors == ()


@pytest.mark.parametrize("environment", ENVIRONMENTS)
def test_what_is_recorded_is_what_the_simulation_did(environment, tmp_path):
    """Positions go on by the speed; nobody is recorded off the road; the file holds the same."""
    recipe = Recipe(
        environments=(environment,), drivers=("mixed",), duration=4.0, warm_up=6.0, seed=5
    )
    card = DataFolder(tmp_path).record(recipe, 1)
    assert not card.errors
    scene = load(next(tmp_path.glob("*/*.xml")))
    assert scene.dt == DT
    rows = [scene.recorded_ego, *(o.states for o in scene.obstacles if o.states is not None)]
    assert len(rows) >= 5
    moved = 0
    lanelets = {lanelet.id: lanelet for lanelet in scene.lanelets}
    for states in rows:
        last = states[np.isfinite(states[:, 0])][-1]
        assert lanelets_near(lanelets, last[0], last[1], 0.5)
        there = np.isfinite(states).all(axis=1)
        states = states[there]
        if len(states) < 2:
            continue
        gone = np.linalg.norm(np.diff(states[:, :2], axis=0), axis=1)
        speeds = np.abs(states[:, 3])
        slow, fast = np.minimum(speeds[1:], speeds[:-1]), np.maximum(speeds[1:], speeds[:-1])
        # Within a step, a controller may change the acceleration twice.
        assert (gone >= DT * slow - 0.3).all()
        assert (gone <= DT * fast + 0.3).all()
        moved += gone.sum() > 5.0
    assert moved >= 3


@pytest.mark.parametrize("environment", ["highway", "intersection"])
def test_a_step_tells_nothing_of_what_comes(environment):
    """What is recorded up to a step does not depend on later ones: nor does the acceleration."""
    episode = Recipe(environments=(environment,), drivers=("idm",)).episode(0)
    short, long = play(episode, 4, 5), play(episode, 9, 5)
    rows = {o.id: o.states for o in long.scene.obstacles if o.states is not None}
    assert np.array_equal(short.ego, long.ego[:5], equal_nan=True)
    for obstacle in short.scene.obstacles:
        if obstacle.states is not None:
            assert np.array_equal(obstacle.states, rows[obstacle.id][:5], equal_nan=True)
    assert any(np.nanmax(np.abs(np.diff(states[:, 4]))) > 0.01 for states in rows.values())


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"environments": ("desert",)}, "'desert' is unknown"),
        ({"drivers": ()}, "name at least one"),
        ({"densities": (0.0,)}, "above 0"),
        ({"lanes": (0,)}, "from 1 to 8"),
        ({"duration": 0.1}, "from 0.2"),
        ({"seed": -1}, "at least 0"),
    ],
)
def test_what_cannot_be_recorded_is_said(changes, words):
    with pytest.raises(SettingsError, match=words):
        Recipe(**changes)


def test_on_the_command_line(tmp_path, capsys):
    words = ["dataset", "record", "--out", str(tmp_path / "data"), "--environments", "merge"]
    words += ["--lanes", "2", "--drivers", "defensive", "--densities", "0.5", "--seed", "8"]
    words += ["--episodes", "2", "--duration", "0.4", "--warm-up", "0"]
    assert main([*words, "--json"]) == 0
    card = json.loads(capsys.readouterr().out)
    assert card["tables"]["drivers"] == {"defensive": {"train": 0, "validation": 1, "test": 1}}
    assert main(words) == 0  # Nothing is left to record.
    assert "| episodes | 2 |" in capsys.readouterr().out
    assert main([*words, "--lanes", "two"]) == 2
    assert "--lanes two: numbers" in capsys.readouterr().err
    assert main([*words, "--episodes", "0"]) == 2
    assert "at least 1" in capsys.readouterr().err
