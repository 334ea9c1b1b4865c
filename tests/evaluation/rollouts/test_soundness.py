"""Many certificates: reproducible, the same with workers, told in words and as JSON."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from sandra.cli import main
from sandra.errors import SettingsError
from sandra.evaluation.rollouts.cases import Cases, cases, moved, perturbed, varied
from sandra.evaluation.rollouts.outcome import Event
from sandra.evaluation.rollouts.report import Report
from sandra.evaluation.rollouts.soundness import soundness
from sandra.scenarios import example
from sandra.scene import load
from sandra.settings import Settings

ROADWORKS = (example("roadworks"),)
SHORT = Settings(horizon=6)


@pytest.fixture(scope="module")
def report() -> Report:
    return soundness(ROADWORKS, rollouts=30, seed=1, per_certificate=12, settings=SHORT)


def test_report(report: Report) -> None:
    data = report.to_dict()
    assert report.holds
    assert data["admissible"] >= 30
    assert data["certificates"] == len(report.tried) == 3
    assert data["collisions"]["rollouts"] == 0
    assert data["collisions"]["upper_bound_per_rollout"] == pytest.approx(
        1 - 0.05 ** (1 / data["admissible"])
    )
    assert data["collisions"]["upper_bound_per_certificate"] == pytest.approx(1 - 0.05 ** (1 / 3))
    assert sum(row["rollouts"] for row in data["adversaries"].values()) == data["rollouts"]
    text = str(report)
    assert "collisions: 0 rollouts of 0 certificates" in text
    assert "cut-in" in text


def test_failures_are_counted_by_rollout_and_by_certificate(report: Report) -> None:
    hits = tuple(
        Event("collision", b, "brake", 7, "car", 1.0, 5.0) for b in (0, 0, 3)
    )  # one rollout may meet two others
    first = replace(report.tried[0], played=replace(report.tried[0].played, events=hits))
    failed = Report((first, *report.tried[1:]), report.scenes, report.seed)
    assert not failed.holds
    assert failed.failed("collision") == (2, 1)
    assert "collision with car 7 at 1.00 s (brake)" in str(failed)
    broken = replace(report.tried[0], played=replace(report.tried[0].played, rules=("R_G2",)))
    assert not Report((broken,), 1, 0).holds


def test_workers_find_the_same(report: Report) -> None:
    other = soundness(ROADWORKS, rollouts=30, seed=1, workers=2, per_certificate=12, settings=SHORT)
    assert other.to_dict() == report.to_dict()
    assert [len(t.played.kind) for t in other.tried] == [12] * len(other.tried)


def test_a_scene_that_breaks_is_told_and_the_others_are_played(
    report: Report, monkeypatch: pytest.MonkeyPatch
) -> None:
    def brittle(files: tuple[Path, ...], index: int, seed: int, settings: Settings) -> Cases:
        if index == 0:
            raise ZeroDivisionError("too flat")
        return cases(files, index, seed, settings)

    monkeypatch.setattr("sandra.evaluation.rollouts.soundness.cases", brittle)
    found = soundness(ROADWORKS, rollouts=30, seed=1, per_certificate=12, settings=SHORT)
    (line,) = found.broken
    assert line == "scene 0 (DEU_Roadworks-1_1_T-1): ZeroDivisionError: too flat"
    assert found.to_dict()["admissible"] >= 30
    assert line in str(found)
    # What was left out may have been the one that collides.
    assert report.holds
    assert not found.holds


def test_scenes_are_many_and_reproducible() -> None:
    files = (example("merge"), *ROADWORKS)
    scenes = [varied(files, i, 3, Settings())[1] for i in (0, 1, 2, 3, 4, 5, 2)]
    assert str(scenes[2]) == str(scenes[-1])
    assert len(set(map(str, scenes))) >= 5
    assert str(scenes[0]) == str(load(files[0]))


def test_a_later_scene_is_as_recorded() -> None:
    now = load(example("merge"))
    later = moved(now, 10)
    for before, after in zip(now.obstacles, later.obstacles, strict=True):
        assert after.state.x == pytest.approx(before.states[10, 0])
        assert np.array_equal(after.states, before.states[10:], equal_nan=True)
    s0, s1 = now.ego_curvilinear[0], later.ego_curvilinear[0]
    assert s1 - s0 == pytest.approx(now.ego.state.speed * 10 * now.dt, rel=1e-3)
    shaken = perturbed(later, np.random.default_rng(0))
    assert all(o.states is None for o in shaken.obstacles)
    assert shaken.ego.state.speed != later.ego.state.speed


def test_command(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "soundness.json"
    settings = tmp_path / "settings.toml"
    settings.write_text("horizon = 6")
    words = ["roadworks", "--rollouts", "10", "--per-certificate", "6", "--seed", "1"]
    words += ["--settings", str(settings)]
    assert main(["evaluate", "soundness", *words, "--out", str(out), "--json"]) == 0
    printed = capsys.readouterr()
    data = json.loads(printed.out)
    assert data == json.loads(out.read_text())
    assert data["admissible"] >= 10
    assert "10 rollouts" in printed.err


def test_what_cannot_be_done_is_said(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    for words, said in (
        (["roadworks", "--rollouts", "0"], "must be at least 1"),
        (["roadworks", "--workers", "many"], "--workers many"),
        (["no-such-scenario"], "no-such-scenario"),
        (["no-such-scenario", "--workers", "2"], "no-such-scenario"),
    ):
        assert main(["evaluate", "soundness", *words]) == 2
        assert said in capsys.readouterr().err
    monkeypatch.setattr("sandra.evaluation.rollouts.soundness.IN_VAIN", -1)
    with pytest.raises(SettingsError, match="no certificate in 1 scenes"):
        soundness([example("nothing-safe")])
