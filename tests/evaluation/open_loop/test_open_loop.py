"""Recordings ranked, verified and held against labels: nothing dropped, nothing told beforehand."""

from __future__ import annotations

import json
import shutil
from collections import Counter
from dataclasses import replace
from pathlib import Path

import pytest

import sandra
from sandra.actions import ActionPair
from sandra.cli import main
from sandra.describe import describe
from sandra.errors import SandraError, SettingsError
from sandra.evaluation.labelling import Choice, label_all
from sandra.evaluation.open_loop.evaluate import VERIFIED_FIRST, OpenLoop, open_loop
from sandra.evaluation.open_loop.report import report_of_file
from sandra.evaluation.open_loop.setups import Conditions, Setup, ablations, grid
from sandra.learn.rows import read_rows
from sandra.scene.tracks import Tracks

CHOICE = Choice(ego="all", horizon=20, stride=40)
KEEP = Setup("always:keep,follow-lane", horizon=20)
RULES = Setup("rules", horizon=20)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two scenarios, and a file that is none."""
    folder = tmp_path_factory.mktemp("scenarios")
    for name in ("merge", "roadworks"):
        shutil.copy(sandra.example(name), folder)
    (folder / "A_bad.xml").write_text("<commonRoad>")
    return folder


def files(folder: Path) -> list[Path]:
    return sorted(folder.glob("*.xml"))


@pytest.fixture(scope="module")
def found(folder: Path) -> OpenLoop:
    return open_loop(files(folder), (KEEP, RULES), CHOICE)


def test_every_window_is_a_row_of_every_run(found: OpenLoop) -> None:
    # 8 vehicles of 61 steps, 4 of 71, windows of 20 steps every 40; and the bad file.
    assert {name: len(rows) for name, rows in found.rows.items()} == {
        KEEP.name: 1 + 8 * 2 + 4 * 2,
        RULES.name: 1 + 8 * 2 + 4 * 2,
    }
    assert len(found.errors) == 2
    for score in found.report.runs:
        assert (score.n, score.failures["error"]) == (25, 1)


def test_labels_are_those_of_the_label_command(found: OpenLoop, folder: Path) -> None:
    labelled = label_all(files(folder), CHOICE).rows
    rows = found.rows[RULES.name]
    for name in ("file", "ego_id", "step", "label_lon", "label_lat"):
        assert [row[name] for row in rows] == [row[name] for row in labelled]


def test_verdicts_are_those_of_verify(found: OpenLoop) -> None:
    for row in found.rows[RULES.name][1::7]:
        scene = Tracks(row["file"]).scene(row["ego_id"], row["step"])
        verdicts = sandra.verify(scene, horizon=20, reasons=False)
        assert row["verdicts"] == {str(v.pair): v.status.value for v in verdicts}
        assert row["verified"] == [p for p, s in row["verdicts"].items() if s == "REACHABLE"]


def test_scores_count_the_rows(found: OpenLoop) -> None:
    keep = found.report.runs[0]
    rows = found.rows[KEEP.name]
    pair = "keep,follow-lane"
    hits = sum(f"{row['label_lon']},{row['label_lat']}" == pair for row in rows)
    safe = sum(pair in row["verified"] for row in rows)
    assert 0 < hits < 24
    assert 0 < safe < 24
    assert keep.top[0].hits == hits
    assert keep.safe[0] is not None
    assert keep.safe[0].hits == safe


def test_nobody_is_safer_than_what_is_verified_first(found: OpenLoop) -> None:
    best = next(x for x in found.report.baselines if x.run == VERIFIED_FIRST)
    some = sum(bool(row["verified"]) for row in found.rows[RULES.name])
    assert [rate.hits for rate in best.safe if rate] == [some] * 3
    for score in (*found.report.runs, *found.report.baselines):
        for rate in score.safe:
            assert rate is not None
            assert rate.hits <= some


def test_where_nothing_is_verified_it_is_said_why(found: OpenLoop) -> None:
    rows = [row for row in found.rows[RULES.name] if not row["error"]]
    for row in rows:
        assert (row["nothing_verified"] is None) == bool(row["verified"])
    told = {row["nothing_verified"] for row in rows if not row["verified"]}
    assert any("exceeds v_max = 30 m/s" in why for why in told)
    counted = found.nothing_verified().rows
    assert sum(int(n) for *_, n in counted) == sum(not row["verified"] for row in rows) > 0


def test_what_was_driven_is_not_told(found: OpenLoop) -> None:
    row = found.rows[RULES.name][3]
    scene = Tracks(row["file"]).scene(row["ego_id"], row["step"])
    assert scene.recorded_ego is not None
    settings = Conditions().settings.replace(horizon=20)
    prompt = describe(replace(scene, recorded_ego=None), settings=settings)
    assert row["prompt"] == {"system": prompt.system, "user": prompt.user}


def test_answers_that_fail_are_counted(folder: Path) -> None:
    score = open_loop(files(folder)[1:], (Setup("garbage", horizon=10),), CHOICE).report.runs[0]
    assert sum(score.failures.values()) == score.n == 24
    assert [rate.hits for rate in score.top] == [0, 0, 0]
    assert [rate.hits for rate in score.safe if rate] == [0, 0, 0]


def test_a_run_goes_on_and_takes_more_setups(folder: Path, tmp_path: Path, found: OpenLoop) -> None:
    journal = tmp_path / "journal.jsonl"
    open_loop(files(folder), (KEEP,), CHOICE, journal=journal)
    lines = journal.read_text().splitlines(keepends=True)
    journal.write_text("".join(lines[:-1]) + lines[-1][:200])
    told: list[str] = []
    again = open_loop(
        files(folder),
        (KEEP, RULES),
        CHOICE,
        journal=journal,
        workers=2,
        progress=lambda done, total, name: told.append(name),
    )
    assert len(told) == 3
    assert _timeless(again) == _timeless(found)
    before = journal.read_bytes()
    assert _timeless(open_loop(files(folder), (RULES,), CHOICE, journal=journal))
    assert journal.read_bytes() == before
    with pytest.raises(SandraError, match="differs in asked"):
        open_loop(files(folder), (RULES,), CHOICE, Conditions(k=2), journal=journal)


def _timeless(found: OpenLoop) -> dict[str, list[dict[str, object]]]:
    return {
        name: [{k: v for k, v in row.items() if not k.endswith("_s")} for row in rows]
        for name, rows in found.rows.items()
    }


def test_certified_is_a_subset_of_reachable(folder: Path) -> None:
    choice = Choice(ego="chosen", horizon=10, stride=10, windows=1)
    setup = (Setup("rules", horizon=10),)
    paths = files(folder)[1:]
    loose = open_loop(paths, setup, choice).rows["rules, h = 10"]
    strict = open_loop(paths, setup, choice, Conditions(accept="certified")).rows["rules, h = 10"]
    for a, b in zip(loose, strict, strict=True):
        assert set(b["verified"]) <= set(a["verified"])
        assert set(b["verified"]) == {p for p, s in b["verdicts"].items() if s == "CERTIFIED"}


def test_the_grid_and_its_ablations() -> None:
    setups = grid(["rules", "random:0"], [None, "drive fast"], [False, True], [10, 25])
    assert len(setups) == len({s.name for s in setups}) == 16
    found = ablations(setups)
    assert {name: len(runs) for name, runs in found.items()} == dict.fromkeys(
        ("ranker", "command", "rule_prompt", "horizon"), 2
    )
    assert [s.horizon for s in found["horizon"]] == [10, 25]
    assert ablations(grid(["rules"])) == {}
    with pytest.raises(SettingsError, match="horizon = 0"):
        grid(["rules"], horizons=[10, 0])
    with pytest.raises(SettingsError, match="accept = 'maybe'"):
        Conditions(accept="maybe")
    with pytest.raises(SettingsError, match="deadline = 0"):
        Conditions(deadline=0.0)
    with pytest.raises(SettingsError, match="k = 0"):
        Conditions(k=0)
    with pytest.raises(SettingsError, match="unknown prediction 'none'"):
        Conditions(prediction="none")


def test_durations_are_those_of_the_rows(found: OpenLoop) -> None:
    told = found.durations()
    rows = [row for row in found.rows[RULES.name] if not row["error"]]
    assert list(told) == [KEEP.name, RULES.name, "all twelve pairs, nobody asked, h = 20"]
    parts = ("rank_s", "predict_s", "verify_s")
    assert told[RULES.name] == [sum(row[part] for part in parts) for row in rows]


def test_no_password_of_an_address_is_written() -> None:
    told = Conditions(base_url="http://user:secret@host:80/v1?key=secret").to_dict()
    assert told["server"] == "host:80/v1"
    assert "secret" not in json.dumps(told)
    with pytest.raises(SettingsError, match="is no address"):
        Conditions(base_url="http://host:port/").to_dict()


def test_the_command_line_and_back_through_rankings(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    words = ["evaluate", "open-loop", str(folder), "--ranker", "rules", "--ranker", "random:1"]
    words += ["--horizon", "10,20", "--command", "none", "--command", "drive fast"]
    words += ["--label-horizon", "20", "--out", str(out), "--figures", "--json"]
    assert main(words) == 1  # One file is bad.
    told = json.loads(capsys.readouterr().out)
    assert len(told["runs"]) == 8
    assert told["errors"] == 8
    pictures = sorted(x.name for x in out.glob("*.pdf"))
    varied = [f"ablation-{x}.pdf" for x in ("command", "horizon", "ranker")]
    assert pictures == [*varied, "runtimes.pdf"]
    again = report_of_file(out / "rankings.csv")
    for run, score in zip(told["runs"], again.runs, strict=True):
        back = score.to_dict()
        for key in ("run", "n", "safe1", "safe2", "safe3", "top1", "top2", "top3", "failures"):
            assert back[key] == run[key], key
    rows = [json.loads(line) for line in (out / "rows.jsonl").read_text().splitlines()]
    assert len(rows) == 8 * 3
    assert all(ActionPair.parse(p) for row in rows for p in row["ranking"])


def test_bad_words_are_refused_at_once(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for words, text in (
        (["--ranker", "nobody"], "unknown ranker 'nobody'"),
        (["--horizon", "ten"], "--horizon ten: whole numbers"),
        (["--horizon", "0"], "horizon = 0 must be at least 1"),
        (["--accept", "maybe"], "accept = 'maybe'"),
    ):
        assert main(["evaluate", "open-loop", str(folder), *words]) == 2
        assert text in capsys.readouterr().err


def test_the_windows_of_a_data_set_are_taken(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The same vehicles at the same steps, with the labels that the rows hold, in each split."""
    rows, out = tmp_path / "data.jsonl", tmp_path / "run"
    words = ["--horizon", "10", "--windows", "2", "--vehicles", "3", "--balance", "2"]
    assert main(["dataset", "build", str(folder), "--out", str(rows), *words]) == 0
    kept = [row for row in read_rows(rows) if row.is_labelled]
    words = ["--rows", str(rows), "--split", "all", "--label-horizon", "10", "--horizon", "10"]
    words += ["--ranker", "rules", "--out", str(out)]
    assert main(["evaluate", "open-loop", str(folder), *words]) == 0
    lines = (out / "rows.jsonl").read_text(encoding="utf-8").splitlines()
    told = [json.loads(line) for line in lines]
    places = {(Path(t["file"]).name, t["ego_id"], t["step"]) for t in told}
    assert places == {(row.scenario, row.ego, row.step) for row in kept}
    assert Counter(f"{t['label_lon']},{t['label_lat']}" for t in told) == Counter(
        row.label for row in kept
    )
    capsys.readouterr()
    words[words.index("all")] = "test"
    absent = not any(row.split == "test" for row in kept)
    assert main(["evaluate", "open-loop", str(folder), *words]) == (2 if absent else 0)
    assert main(["evaluate", "open-loop", str(folder), str(folder), *words]) == 2
    assert "the one folder" in capsys.readouterr().err
