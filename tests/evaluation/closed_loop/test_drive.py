"""Runs of `sandra drive`: what they are told apart by, and one in which a car broke its bounds."""

import json
from dataclasses import replace

import pytest

from sandra.cli import main
from sandra.cli.drive import default_name
from sandra.evaluation.closed_loop.drive import Drive
from sandra.settings import Assumptions, Settings

pytest.importorskip("highway_env")


def plain(how):
    """As run.json gives it back."""
    return json.loads(json.dumps(how.to_dict()).replace("Infinity", "null"))


def test_runs_with_other_assumptions_differ():
    paper = Drive()
    tight = Settings(assumptions=Assumptions(max_braking=6.0))
    assert paper.differs(plain(paper)) == []
    assert paper.differs(plain(replace(paper, settings=tight))) == ["assumptions"]
    assert paper.differs(plain(replace(paper, settings=Settings(k=2)))) == ["settings"]
    # The same bounds under another name are the same run.
    named = replace(paper, settings=tight, assumptions="conformant:a.toml")
    assert named.differs(plain(replace(named, assumptions="conformant:b.toml"))) == []
    assert default_name(named) != default_name(paper)


def test_assumptions_on_the_command_line(tmp_path, capsys):
    bounds = tmp_path / "tight.toml"
    bounds.write_text("[assumptions]\nmax_braking = 6.5\n")
    out = tmp_path / "run"
    words = f"drive highway --seeds 7294 --steps 1 --prediction most-likely --out {out}".split()
    assert main([*words, "--assumptions", f"conformant:{bounds}"]) in (0, 1)
    run = json.loads((out / "run.json").read_text())["drive"]
    assert run["assumptions"] == f"conformant:{bounds}"
    assert run["settings"]["assumptions"]["max_braking"] == 6.5
    capsys.readouterr()
    assert main(words) == 2
    assert "differs in assumptions" in capsys.readouterr().err
    assert main([*words, "--assumptions", "guess"]) == 2
    metrics = json.loads((out / "seed-7294" / "metrics.json").read_text())
    assert metrics["lapses"] == metrics["unexplained"] == metrics["told"] == []


@pytest.mark.slow
def test_a_car_that_breaks_its_bounds(tmp_path, capsys):
    """In this episode a car changes lanes more abruptly than assumed: the run says so."""
    out = tmp_path / "run"
    bounds = tmp_path / "tight.toml"
    bounds.write_text("[assumptions]\nmax_braking = 6.3\nmax_driving = 3.1\n")
    words = f"drive highway --setting 2 --seeds 9650 --prediction most-likely --out {out}"
    assert main([*words.split(), "--assumptions", f"conformant:{bounds}"]) == 0
    metrics = json.loads((out / "seed-9650" / "metrics.json").read_text())
    assert metrics["uncovered"]
    assert not metrics["unexplained"]
    (breach, *_) = metrics["lapses"][0]["breaches"]
    assert breach["assumption"] == "max_acceleration"
    assert breach["value"] > breach["allowed"]
    assert "broke max_" in capsys.readouterr().out
