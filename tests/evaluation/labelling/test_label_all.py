"""Many files labelled: nothing is dropped, and a run goes on where it stopped."""

from __future__ import annotations

import csv
import json
import shutil
from pathlib import Path

import pytest

import sandra
from sandra.cli import main
from sandra.errors import SandraError, SettingsError
from sandra.evaluation.labelling import Choice, label_all

CHOICE = Choice(ego="all", horizon=20, stride=20)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Two scenarios, and a file that is none."""
    folder = tmp_path / "scenarios"
    folder.mkdir()
    for name in ("merge", "roadworks"):
        shutil.copy(sandra.example(name), folder)
    (folder / "A_bad.xml").write_text("<commonRoad>")
    return folder


def files(folder: Path) -> list[Path]:
    return sorted(folder.glob("*.xml"))


def test_every_window_and_every_bad_file_is_a_row(folder: Path) -> None:
    found = label_all(files(folder), CHOICE)
    assert [Path(row["file"]).name for row in found.errors] == ["A_bad.xml"]
    # 8 vehicles of 61 steps; 4 of 71.
    assert len(found.rows) == 1 + 8 * 3 + 4 * 3
    for counts in found.counts().values():
        assert sum(counts.values()) == len(found.rows)
    assert found.counts()["pair"]["error"] == 1


def test_unknown_labels_are_counted(folder: Path) -> None:
    strict = label_all(files(folder), Choice(ego="all", horizon=20, stride=20, labeler="strict"))
    counts = strict.counts()
    assert counts["pair"]["unknown"] == counts["longitudinal"]["unknown"] > 0
    assert sum(counts["pair"].values()) == len(strict.rows)
    unknown = [row for row in strict.rows if row["label_lon"] == "unknown" and not row["error"]]
    assert all(row["reason"] and not row["holds"] for row in unknown)


def test_two_processes_find_the_same(folder: Path) -> None:
    assert label_all(files(folder), CHOICE, workers=2) == label_all(files(folder), CHOICE)


def test_a_run_goes_on_where_it_was_cut_short(folder: Path, tmp_path: Path) -> None:
    journal = tmp_path / "out" / "journal.jsonl"
    whole = label_all(files(folder), CHOICE, journal=journal)
    text = journal.read_bytes()
    journal.write_bytes(text[: text.rindex(b"{", 0, len(text) - 40)][:-300])
    told: list[tuple[int, int, str]] = []
    again = label_all(
        files(folder), CHOICE, journal=journal, progress=lambda *words: told.append(words)
    )
    assert again == whole
    assert [total for _, total, _ in told] == [3] * len(told)
    assert 1 <= len(told) < 3
    assert journal.read_bytes() == text


def test_a_changed_file_is_labelled_anew_and_another_run_is_refused(
    folder: Path, tmp_path: Path
) -> None:
    journal = tmp_path / "journal.jsonl"
    label_all(files(folder), CHOICE, journal=journal)
    shutil.copy(sandra.example("urban-parked"), folder / "A_bad.xml")
    assert not label_all(files(folder), CHOICE, journal=journal).errors
    with pytest.raises(SandraError, match="holds a run that differs in horizon"):
        label_all(files(folder), Choice(ego="all", horizon=10, stride=20), journal=journal)
    journal.write_text("something else\n")
    with pytest.raises(SandraError, match="is no journal of ours"):
        label_all(files(folder), CHOICE, journal=journal)


def test_given_and_chosen_egos() -> None:
    path = Path(sandra.example("recorded-ego"))
    given = label_all([path], Choice(horizon=20, stride=20)).rows
    assert [row["step"] for row in given] == [0, 20, 40]
    assert len({row["scenario_id"] for row in given}) == 1
    two = label_all([path], Choice(horizon=20, stride=20, windows=2)).rows
    assert two == given[:2]
    chosen = label_all([path], Choice(ego="chosen", seed=3, horizon=20, stride=20)).rows
    number = str(chosen[0]["ego_id"])
    assert label_all([path], Choice(ego=number, horizon=20, stride=20)).rows == chosen
    (error,) = label_all([path], Choice(ego="5", horizon=20, stride=20)).rows
    assert "no vehicle 5 is recorded for 20 steps" in error["error"]
    (error,) = label_all([Path(sandra.example("merge"))], Choice(ego="given")).rows
    assert "the ego is not recorded" in error["error"]


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"ego": "somebody"}, "ego = 'somebody': choose from"),
        ({"labeler": "best"}, "unknown labeler 'best'"),
        ({"horizon": 0}, "must be at least 1"),
        ({"stride": 0}, "must be at least 1"),
    ],
)
def test_choices_that_cannot_be_made(options: dict[str, object], words: str) -> None:
    with pytest.raises(SettingsError, match=words):
        Choice(**options)  # type: ignore[arg-type]


def test_the_command_line(folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "out"
    words = ["label", str(folder), "--horizon", "20", "--ego", "all", "--out", str(out)]
    assert main([*words, "--json"]) == 1  # One file is bad.
    told = json.loads(capsys.readouterr().out)
    assert told["summary"]["rows"] == len(told["rows"]) == 37
    with (out / "labels.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    lines = (out / "labels.jsonl").read_text().splitlines()
    assert [json.loads(line) for line in lines] == told["rows"]
    assert [row["label_lon"] for row in rows] == [row["label_lon"] for row in told["rows"]]
    assert main([*words, "--format", "latex"]) == 1
    assert capsys.readouterr().out.count(r"\begin{tabular}") == 2
    (folder / "A_bad.xml").unlink()
    assert main(["label", str(folder), "--horizon", "20"]) == 0
    assert main(["label", str(tmp_path / "out")]) == 2
    assert "there is no .xml file in this folder" in capsys.readouterr().err
    assert main(["label", str(tmp_path / "absent.xml")]) == 2
    assert "absent.xml: no such file" in capsys.readouterr().err
