"""The table, as the command line prints it: real episodes of drivers without a verifier."""

import csv
import json
from dataclasses import replace

import pytest

from sandra.cli import main
from sandra.errors import SandraError
from sandra.evaluation.closed_loop import OURS, PAPER
from sandra.evaluation.closed_loop.drive import Drive
from sandra.evaluation.closed_loop.paper import TABLE, printed
from sandra.evaluation.closed_loop.rows import all_rows, selected
from sandra.evaluation.closed_loop.table import counted, tabulate
from sandra.evaluation.sheet import Sheet
from sandra.settings import Assumptions

pytest.importorskip("highway_env")
BASE = ["evaluate", "closed-loop", "--profile", "paper", "--seeds", "5838"]


def cells(file):
    with file.open(newline="") as text:
        return list(csv.reader(text))


def test_rows_by_driver_and_setting(capsys, tmp_path):
    words = [*BASE, "--rows", "idle random", "--settings", "2,3", "--repeats", "2"]
    assert main([*words, "--out", str(tmp_path / "t")]) == 0
    printed_text = capsys.readouterr().out
    assert (tmp_path / "t" / "table.md").read_text() in printed_text
    beside = cells(tmp_path / "t" / "beside.csv")[1:]
    assert [row[:3] for row in beside] == [
        ["always IDLE", "2", "1 (1)"],
        ["always IDLE", "3", "1 (1)"],
        ["random", "2", "2 (1)"],
        ["random", "3", "2 (1)"],
    ]
    table = cells(tmp_path / "t" / "table.csv")
    assert [row[0] for row in table[1:11]] == [f"paper: {x.method}" for x in TABLE if x.setting > 1]
    assert table[11][:9] == (
        ["always IDLE", "2", "0 [0, 79]", "5.0", "0.0", "5.0", "5.0", "0.0", "-"]
    )
    assert beside[0][3] == "29.7"


def test_what_is_there_is_not_driven_again(capsys, tmp_path):
    words = [*BASE, "--rows", "fail-safe", "--settings", "1", "--out", str(tmp_path), "--json"]
    assert main(words) == 0
    first = json.loads(capsys.readouterr().out)
    file = tmp_path / "fail-safe" / "setting-1" / "seed-5838" / "metrics.json"
    data = json.loads(file.read_text())
    data["metrics"]["distance"] = 1234.5
    file.write_text(json.dumps(data))
    assert main(words) == 0
    again = json.loads(capsys.readouterr().out)
    assert first["rows"][0]["distance"] == pytest.approx(44.125)
    assert first["rows"][0]["fail_safe_rate"] == 1.0
    assert again["rows"][0]["distance"] == 1234.5
    # The folder of another profile is not gone on with.
    assert main([*words, "--profile", "stock"]) == 2
    assert "differs in profile" in capsys.readouterr().err


def test_a_collision_in_the_last_step_is_counted_as_the_authors_do():
    data = {
        "success": False,
        "collision_free_steps": 29,
        "compliant_steps": {},
        "success_steps": 29,
        "distance": 90.0,
        "fail_safe_rate": 0.0,
        "relative_speed": None,
        "lane_changes": 0,
        "steps": 30,
    }
    assert not counted(data, OURS).success
    assert counted(data, PAPER).success
    assert not counted({**data, "collision_free_steps": 28, "steps": 29}, PAPER).success


def test_every_variant_has_a_row():
    rows = all_rows(conformant=("conformant:x", replace(Assumptions(), max_braking=6.0)))
    names = [row.name for row in rows]
    assert len(set(names)) == len(names)
    for ranker in ("rules", "exhaustive", "random:0"):
        mine = selected(rows, f"{ranker}/*")
        assert len(mine) == 2 * 2 * 3
        assert {row.drives[0].prediction for row in mine} == {"most-likely", "set-based"}
        assert all(printed(row.paper, 1) is not None for row in mine)
        mine = selected(rows, f"meta:{ranker}/*")
        assert len(mine) == 2 * 2
        assert {row.drives[0].execution for row in mine} == {"meta"}
    (worst,) = selected(rows, "rules/set-based/rules/any-cut-in")
    (how,) = worst.in_setting(3)
    assert (how.setting, how.rules) == (3, ("R_G1", "R_G2", "R_G3"))
    assert not how.settings.assumptions.legal_cut_in
    (tight,) = selected(rows, "rules/set-based/no-rules/conformant")
    assert tight.drives[0].settings.assumptions.max_braking == 6.0
    assert len(selected(rows, "random idm")[0].drives) == 3
    # The server and the wish reach what is driven.
    (model,) = selected(all_rows(Drive(base_url="http://x"), rankers=["openai:m"]), "o*/s*/r*/p*")
    assert (model.drives[0].ranker, model.drives[0].base_url) == ("openai:m", "http://x")
    with pytest.raises(SandraError, match="no row has such a name"):
        selected(rows, "idm guess")


@pytest.mark.parametrize(
    ("option", "told"),
    [
        (["--rows", "x"], "--rows x"),
        (["--settings", "4", "--rows", "idle"], "setting: 4"),
        (["--seeds", "a"], "--seeds a"),
        (["--repeats", "0"], "--repeats 0"),
        (["--ranker", "guess"], "unknown ranker"),
        (["--assumptions", "guess"], "assumptions 'guess'"),
    ],
)
def test_what_is_wrong_is_told(option, told, capsys, tmp_path):
    assert main(["evaluate", "closed-loop", "--out", str(tmp_path / "t"), *option]) == 2
    assert told in capsys.readouterr().err


def test_progress_is_told(tmp_path):
    told = []
    rows = selected(all_rows(Drive(profile="paper")), "idle")
    for _ in range(2):
        tabulate(tmp_path, rows, [2], [5838], progress=lambda *words: told.append(words))
    assert told == [(1, 1, "idle, setting 2, seed 5838")]


def test_one_certified_row_with_figures(tmp_path, capsys):
    """Two seconds of it; what is told of proofs is there, and the figures are vectors."""
    rows = selected(all_rows(Drive(steps=2)), "rules/most-likely/no-rules/paper")
    table = tabulate(tmp_path, rows, [2], [7294])
    (row,) = table.beside().rows
    certified = 100 * table.entries[0].summary.operations.get("certified", 0.0)
    assert row[7].startswith(f"{certified:.0f} / ")
    assert row[9] == "0 / 0 (0)"
    assert "(" in row[11]
    from sandra.cli.closed_loop import _draw

    files = _draw(table, tmp_path)
    assert [file.suffix for file in files] == [".pdf", ".pdf"]
    assert all(file.read_bytes().startswith(b"%PDF") for file in files)


def test_sheets():
    sheet = Sheet("A & B", ("driver", "setting", "x_1 %"), (("a|b", "1", "2"), ("c", "1", "-")))
    assert "| a\\|b | 1 | 2 |" in sheet.markdown()
    assert "driver & setting & x\\_1 \\% \\\\" in sheet.latex()
    assert sheet.latex().count("addlinespace") == 1
    assert sheet.csv() == "driver,setting,x_1 %\na|b,1,2\nc,1,-\n"


def test_the_papers_numbers(shared):
    """They are those of the reference data."""
    file = shared / "data" / "paper" / "tables.json"
    if not file.exists():
        pytest.skip("no tables.json")
    theirs = json.loads(file.read_text())["closed_loop"]
    assert len(theirs) == len(TABLE) == 15
    for row in theirs:
        mine = printed(row["method"], row["setting"])
        assert mine is not None
        assert (mine.r_g1, mine.r_g2, mine.r_g3) == tuple(row["rule_compliant_steps"].values())
        assert mine.distance == row["traveled_distance_m"]
        assert mine.success_rate == row["success_rate"]
        assert mine.success_steps == row["success_steps"]
        assert mine.collision_free_steps == row["collision_free_steps"]
        assert mine.fail_safe_rate == row["fail_safe_rate"]
