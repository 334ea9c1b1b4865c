"""Figures of one thing: predictions, one set, what is driven, drives compared."""

import re
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

import sandra
from sandra.cli import main
from sandra.errors import SandraError, SettingsError
from sandra.view import comparison_figure, maneuver_figure, predictions_figure, set_figure


@pytest.fixture(scope="module")
def scene():
    return sandra.load(sandra.example("intersection"))


@pytest.fixture(scope="module")
def verdicts(scene):
    return sandra.verify(scene, ["decelerate,follow-lane", "accelerate,right-lane"])


def pixels(path: Path) -> np.ndarray:
    with Image.open(path) as picture:
        return np.asarray(picture.convert("RGB")).astype(int)


def coloured(path: Path) -> int:
    """How many pixels are of the map of time steps: neither grey, nor pink, nor orange."""
    r, g, b = np.moveaxis(pixels(path), -1, 0)
    return int(np.sum((g > r + 25) & (g > 60) & (b < 200)))


def test_set_based_occupancies_are_larger(scene, tmp_path):
    def pink(kind):
        r, g, b = np.moveaxis(
            pixels(predictions_figure(scene, tmp_path / "a.png", [kind], horizon=10)), -1, 0
        )
        return int(np.sum((r > g + 15) & (b > g)))

    assert pink("set-based") > 2 * pink("most-likely") > 0


def test_predictions_are_vectors_with_a_title_each(scene, tmp_path):
    where = predictions_figure(scene, tmp_path / "a.svg", horizon=5)
    text = where.read_text()
    assert "<image" not in text
    assert predictions_figure(scene, tmp_path / "a.pdf", horizon=5).read_bytes()[:4] == b"%PDF"
    with pytest.raises(SettingsError, match="at least one"):
        predictions_figure(scene, tmp_path / "a.svg", [])
    with pytest.raises(SandraError, match="sideways"):
        predictions_figure(scene, tmp_path / "a.svg", ["sideways"])


def test_a_step_alone_is_part_of_the_set(verdicts, tmp_path):
    whole = set_figure(verdicts, "decelerate,follow-lane", tmp_path / "whole.png")
    step = set_figure(verdicts, "decelerate,follow-lane", tmp_path / "step.png", step=5)
    assert 0 < coloured(step) < coloured(whole)


def test_an_unsafe_set_says_when_it_ends(verdicts, tmp_path):
    verdict = verdicts["accelerate,right-lane"]
    end = verdict.first_empty_step
    assert end is not None
    set_figure(verdicts, "accelerate,right-lane", tmp_path / "a.svg")
    with pytest.raises(SettingsError, match="has sets from step 0 to"):
        set_figure(verdicts, "accelerate,right-lane", tmp_path / "a.svg", step=end)


def test_time_upwards(verdicts, tmp_path):
    where = set_figure(verdicts, 0, tmp_path / "a.svg", three_d=True)
    assert "<image" not in where.read_text()
    with pytest.raises(SettingsError, match="from above"):
        set_figure(verdicts, 0, tmp_path / "a.svg", three_d=True, step=3)


def test_what_is_driven(tmp_path):
    scene = sandra.load(sandra.example("nothing-safe"))
    decision = sandra.decide(scene, horizon=5)
    assert decision.executed is None
    where = maneuver_figure(decision, tmp_path / "a.svg")
    assert len(re.findall("<path", where.read_text())) > 20


def test_drives_are_compared(tmp_path):
    scene = sandra.load(sandra.example("recorded-ego"))
    found = sandra.robustness(scene)
    drives = {"one": found, "two": found}
    assert comparison_figure(drives, tmp_path / "a.pdf").stat().st_size > 1000
    fewer = sandra.robustness(scene, ["R_G2"])
    with pytest.raises(SandraError, match="same rules"):
        comparison_figure({"one": found, "two": fewer}, tmp_path / "a.pdf")
    with pytest.raises(SandraError, match="told apart"):
        comparison_figure({}, tmp_path / "a.pdf")


@pytest.mark.parametrize(
    "words",
    [
        "scenario merge",
        "predictions merge --horizon 4",
        "set merge --pair keep,follow-lane --horizon 4 --step 2",
        "maneuver merge --horizon 4",
        "robustness recorded-ego recorded-ego --names one,two",
    ],
)
def test_from_the_command_line(words, tmp_path, capsys):
    out = tmp_path / "figure.pdf"
    assert main(["figure", *words.split(), "--out", str(out)]) == 0
    assert capsys.readouterr().out.strip() == str(out)
    assert out.read_bytes().startswith(b"%PDF")


def test_names_must_differ(tmp_path, capsys):
    words = ["recorded-ego", "recorded-ego", "--out", str(tmp_path / "a.pdf")]
    assert main(["figure", "robustness", *words]) == 2
    assert "different names" in capsys.readouterr().err
