"""What a decision costs: the stages and their sums, and the command."""

import json

import pytest

import sandra
from sandra.cli import main
from sandra.evaluation.timing import STAGES, time_decision


def test_every_second_belongs_to_one_stage() -> None:
    runs = []
    scene = sandra.load(sandra.example("merge"))
    times = time_decision(scene, runs=1, all_pairs=True, progress=runs.append)
    assert runs == [0, 1]
    assert set(times.stages) == set(STAGES)
    assert all(times.stages[name] > 0.0 for name in ("predict", "ground", "verify", "check"))
    assert times.pairs == 12
    assert times.certified is not None
    assert times.decision == pytest.approx(sum(times.stages.values()))
    assert times.verification < times.decision
    assert times.ratio == pytest.approx(times.decision / times.verification)


def test_without_a_certificate_nothing_is_checked() -> None:
    times = time_decision(sandra.load(sandra.example("nothing-safe")), runs=1)
    assert times.certified is None
    assert times.stages["check"] == 0.0
    assert "no pair certified" in str(times)


def test_command(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["bench", "decide", "merge", "--runs", "1", "--json"]) == 0
    (found,) = json.loads(capsys.readouterr().out)["decisions"]
    assert found["ratio"] > 1.0
    assert found["stages_s"].keys() == set(STAGES)


@pytest.mark.parametrize("words", [["--runs", "0"], ["no-such-scenario"]])
def test_bad_words_are_one_line(words: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["bench", "decide", *words]) == 2
    assert capsys.readouterr().err.count("\n") == 1
