"""The table, as the command line prints it."""

import json

import pytest

from sandra.cli import main
from sandra.evaluation.closed_loop.table import tabulate

pytest.importorskip("highway_env")


def test_rows_by_driver_and_setting(capsys, tmp_path):
    out = tmp_path / "table.md"
    command = "evaluate closed-loop --drivers idle,random --settings 2,3 --seeds 5838 --repeats 2"
    assert main([*command.split(), "--profile", "paper", "--out", str(out)]) == 0
    printed = capsys.readouterr().out
    assert printed == out.read_text()
    rows = [line.split(" | ") for line in printed.splitlines()[2:]]
    assert [(row[0], row[1], row[2]) for row in rows] == [
        ("| always IDLE", "2", "1 (1)"),
        ("| always IDLE", "3", "1 (1)"),
        ("| random", "2", "2 (1)"),
        ("| random", "3", "2 (1)"),
    ]
    assert rows[0][3:7] == ["0 [0, 79]", "5.0", "-", "29.7"]


def test_conventions_and_json(capsys):
    command = "evaluate closed-loop --drivers fail-safe --settings 1 --seeds 2421 --json"
    assert main([*command.split(), "--convention", "paper", "--profile", "paper"]) == 0
    table = json.loads(capsys.readouterr().out)
    assert table["convention"] == {"steps": 30, "decisive": 29}
    (row,) = table["rows"]
    assert row["distance"] == pytest.approx(44.125)
    assert row["fail_safe_rate"] == 1.0
    assert row["success_rate"] == 1.0


@pytest.mark.parametrize(
    ("option", "told"),
    [
        (["--drivers", "x"], "policy: 'x'"),
        (["--settings", "4", "--drivers", "idle"], "setting: 4"),
        (["--seeds", "a"], "--seeds a"),
        (["--repeats", "0"], "--repeats 0"),
    ],
)
def test_what_is_wrong_is_told(option, told, capsys):
    assert main(["evaluate", "closed-loop", *option]) == 2
    assert told in capsys.readouterr().err


def test_progress_is_told():
    told = []
    tabulate(["idle"], [2], [5838], profile="paper", progress=lambda *words: told.append(words))
    assert told == [(1, 1, "idle, setting 2, seed 5838")]
