"""Run folders: complete, resumable, never mixed; every certificate in them is accepted."""

import json
from pathlib import Path

import numpy as np
import pytest

import sandra
from sandra.certificate import check, load
from sandra.cli import main
from sandra.errors import SandraError, SettingsError
from sandra.evaluation.closed_loop.drive import Drive
from sandra.evaluation.closed_loop.driven import at_decisions
from sandra.evaluation.closed_loop.folder import RunFolder

pytest.importorskip("highway_env")

HOW = Drive(ranker="exhaustive", steps=4, rules=("R_G1", "R_G2", "R_G3"))
SEED = 6382


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    folder = RunFolder(tmp_path_factory.mktemp("runs") / "run")
    folder.open(HOW, ["sandra", "drive"])
    return folder, folder.drive(HOW, SEED)


def test_all_of_it_is_there(run) -> None:
    folder, metrics = run
    about = json.loads((folder.path / "run.json").read_text())
    assert about["drive"]["ranker"] == "exhaustive"
    assert about["versions"]["highway-env"] == "1.12.1"
    assert about["command_line"] == ["sandra", "drive"]
    episode = folder.episode(SEED)
    lines = (episode / "decisions.jsonl").read_text().splitlines()
    assert len(lines) == metrics["metrics"]["steps"] == 4
    for i, line in enumerate(lines):
        told = json.loads(line)
        assert told["step"] == i
        assert {"system", "user", "schema"} == told["prompt"].keys()
        assert told["verdicts"]
        assert told["ranking"]
        assert told["operation"] in metrics["operations"]
    assert not list(folder.path.glob(".seed*"))


def test_every_certificate_is_accepted_by_the_checker(run) -> None:
    folder, metrics = run
    files = sorted((folder.episode(SEED) / "certificates").iterdir())
    assert len(files) == metrics["operations"]["certified"]
    assert all(check(load(file)).accepted for file in files)


def test_the_scenario_is_what_was_driven(run) -> None:
    folder, metrics = run
    scene = sandra.load(folder.episode(SEED) / "scenario.xml")
    assert scene.dt == pytest.approx(1 / 15)
    assert scene.recorded_ego is not None
    assert len(scene.recorded_ego) == metrics["ticks"] + 1 == 13
    driven = scene.recorded_ego[-1, 0] - scene.recorded_ego[0, 0]
    assert driven == pytest.approx(metrics["metrics"]["distance"], abs=0.01)
    assert {o.id for o in scene.obstacles} == set(range(10_001, 10_051))


def test_a_complete_episode_is_not_driven_again(run, monkeypatch) -> None:
    folder, metrics = run
    monkeypatch.setattr(
        "sandra.evaluation.closed_loop.folder.play", lambda *_: pytest.fail("driven again")
    )
    folder.open(HOW)
    assert folder.drive(HOW, SEED) == metrics


def test_an_episode_that_broke_off_leaves_nothing_and_is_driven_anew(tmp_path: Path) -> None:
    folder = RunFolder(tmp_path / "run")
    folder.open(HOW)

    def interrupt(step) -> None:
        if step.index == 1:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        folder.drive(HOW, SEED, interrupt)
    assert folder.metrics(SEED) is None
    assert folder.drive(HOW, SEED)["metrics"]["steps"] == 4


def test_another_run_is_refused(run, tmp_path: Path) -> None:
    folder, _ = run
    with pytest.raises(SandraError, match="differs in ranker"):
        folder.open(Drive(ranker="rules", steps=4, rules=HOW.rules))
    weak = Drive(
        ranker="exhaustive", steps=4, rules=HOW.rules, settings=sandra.Settings(a_lon_min=-5.0)
    )
    with pytest.raises(SandraError, match="differs in settings"):
        folder.open(weak)
    (tmp_path / "notes.txt").write_text("mine")
    with pytest.raises(SandraError, match="not empty and no run"):
        RunFolder(tmp_path).open(HOW)
    (tmp_path / "bad").mkdir()
    (tmp_path / "bad" / "run.json").write_text("[")
    with pytest.raises(SandraError, match="cannot be read"):
        RunFolder(tmp_path / "bad").open(HOW)


def test_rows_of_decisions_are_the_states_in_which_they_were_made() -> None:
    from sandra.evaluation.closed_loop.drive import play

    episode, _ = play(Drive(ranker="exhaustive", steps=3), SEED)
    scene = at_decisions(episode)
    assert scene.dt == pytest.approx(0.2)
    rows = scene.recorded_ego
    assert rows is not None
    assert len(rows) == 4
    for k, step in enumerate(episode.steps):
        state = step.decision.scene.ego.state
        assert np.allclose(rows[k, :4], [state.x, state.y, state.heading, state.speed])
    assert np.isnan(rows[:, 4]).all()


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"environment": "parking"}, "unknown"),
        ({"setting": 4}, "1, 2 and 3"),
        ({"steps": 0}, "at least 1"),
    ],
)
def test_what_cannot_be_driven(changes: dict[str, object], message: str) -> None:
    with pytest.raises(SettingsError, match=message):
        Drive(**changes)  # type: ignore[arg-type]


def test_the_command(tmp_path: Path, capsys) -> None:
    words = ["drive", "--seeds", str(SEED), "--steps", "2", "--ranker", "exhaustive"]
    out = ["--out", str(tmp_path / "run")]
    assert main([*words, *out, "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["episodes"][0]["metrics"]["steps"] == 2
    assert told["episodes"][0]["collision"] is None
    assert main([*words, *out]) == 0
    printed = capsys.readouterr().out
    assert f"seed {SEED}" in printed
    assert "run folder" in printed
    assert main([*words, "--out", str(tmp_path / "run"), "--rules", "R_G1"]) == 2
    assert "differs in rules" in capsys.readouterr().err
    assert main(["drive", "--seeds", "x"]) == 2
    assert "--seeds x" in capsys.readouterr().err
