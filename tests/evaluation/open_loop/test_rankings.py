"""Scores of recorded rankings: the authors' records, and records made here."""

from __future__ import annotations

import csv
import json
import random
from pathlib import Path

import pytest

from sandra.actions import ALL_PAIRS, ActionPair
from sandra.cli import main
from sandra.errors import SandraError
from sandra.evaluation.open_loop.records import read_rankings, read_verdicts
from sandra.evaluation.open_loop.report import report_of_file

RUNS = {
    "gpt-4o": "llm_gpt4o",
    "gpt-4o finetuned": "ft",
    "qwen3-0.6b": "qwen",
    "qwen3-0.6b finetuned": "qwen_ft",
    "command none": "cmd_none",
    "command drive aggressively": "cmd_agg",
    "command drive cautiously": "cmd_caut",
}
CONSTANT = "constant ranking (keep, decelerate, accelerate) x follow-lane"
ROUNDED_UP = {("follow-lane", "safe3"): 98.748}
"""The one cell that the paper prints otherwise: 98.8."""
HEADER = "run,scenario_id,label_lon,label_lat,lon1,lat1,lon2,lat2,lon3,lat3,safe_top1,safe_top3"


def test_every_number_of_the_authors_records(shared: Path) -> None:
    mona = shared / "data" / "mona"
    found = report_of_file(mona / "mona_llm_rankings.csv", mona / "mona_pair_verdicts.csv")
    printed = json.loads((shared / "data" / "paper" / "tables.json").read_text("utf-8"))
    told = {x.run: x.to_dict() for x in (*found.runs, *found.baselines)}
    compared = 0
    for name, values in printed["open_loop_recomputed_percent"].items():
        constant = name.startswith("constant")
        run = told[CONSTANT if constant else RUNS[name]]
        assert run["n"] == 800
        for metric, value in values.items():
            digits = 1 if constant else 2
            assert f"{run[metric]:.{digits}f}" == f"{value:.{digits}f}", (name, metric)
            compared += 1
    for action, values in printed["action_type_percent"].items():
        row = found.actions[action].to_dict()
        for metric, value in zip(("safe1", "safe3", "top1", "top3"), values, strict=True):
            if (action, metric) in ROUNDED_UP:
                assert round(row[metric], 3) == ROUNDED_UP[action, metric]
            else:
                assert f"{row[metric]:.1f}" == f"{value:.1f}", (action, metric)
            compared += 1
    assert compared == 8 * 5 + 6 * 4
    assert len(found.pool) == 7
    labels = printed["label_counts_mona"]
    counts = {name: x.n for name, x in found.actions_of_runs["ft"].items()}
    assert counts == {name: n for name, n in labels.items() if n}


def test_the_command_line_prints_one_object_per_run(
    shared: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["evaluate", "rankings", str(_mona(shared)), "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    first = {run["run"]: run for run in told["runs"]}["llm_gpt4o"]
    assert (first["n"], first["safe1"], first["top3"]) == (800, 89.625, 74.75)
    assert {run["run"]: run["repeated"] for run in told["runs"] if run["repeated"]} == {"rule_T": 1}
    assert all(x["safe1"] is None for x in told["baselines"])


def _mona(shared: Path) -> Path:
    return shared / "data" / "mona" / "mona_llm_rankings.csv"


def test_random_records_are_counted_as_they_are_defined(tmp_path: Path) -> None:
    source = random.Random(3)
    rows = []
    for i in range(200):
        label = source.choice([None, *ALL_PAIRS])
        ranking = source.sample(ALL_PAIRS, source.randint(0, 3))
        safe = [source.random() < 0.4 for _ in ranking]
        rows.append((f"s{i}", label, ranking, safe))
    file = tmp_path / "made.csv"
    verdicts = tmp_path / "verdicts.csv"
    with file.open("w", newline="") as out, verdicts.open("w", newline="") as other:
        table, judged = csv.writer(out), csv.writer(other)
        table.writerow(HEADER.split(","))
        judged.writerow(["scenario_id", "lon", "lat", "safe"])
        for name, label, ranking, safe in rows:
            cells = [c for p in ranking for c in str(p).split(",")] + [""] * (6 - 2 * len(ranking))
            lon, lat = str(label).split(",") if label else ("unknown", "")
            table.writerow(["made", name, lon, lat, *cells, int(any(safe[:1])), int(any(safe[:3]))])
            for pair, good in zip(ranking, safe, strict=True):
                judged.writerow([name, *str(pair).split(","), int(good)])
    (found,) = report_of_file(file, verdicts).runs
    told = found.to_dict()
    for k in (1, 2, 3):
        hits = sum(label is not None and label in ranking[:k] for _, label, ranking, _ in rows)
        assert told[f"top{k}"] == pytest.approx(100 * hits / 200)
        safe_hits = sum(any(safe[:k]) for *_, safe in rows)
        assert told[f"safe{k}"] == pytest.approx(100 * safe_hits / 200)
        low, high = told[f"safe{k}_interval"]
        assert low < told[f"safe{k}"] < high
    assert found.n == 200
    assert found.unknown_labels == sum(label is None for _, label, _, _ in rows) > 0
    assert found.failures == {"no ranking": sum(not ranking for *_, ranking, _ in rows)}


def _written(tmp_path: Path, *lines: str, header: str = HEADER) -> Path:
    file = tmp_path / "r.csv"
    file.write_text("\n".join([header, *lines]) + "\n")
    return file


KEEP = "keep,follow_lane"
GOOD = f"a,s1,{KEEP},{KEEP},stop,left,decelerate,right,1,1"


def test_what_is_repeated_is_left_out_and_counted(tmp_path: Path) -> None:
    other = f"a,s1,{KEEP},stop,left,{KEEP},decelerate,right,0,1"
    (found,) = report_of_file(_written(tmp_path, GOOD, other)).runs
    assert (found.n, found.repeated, found.top[0].hits) == (1, 1, 1)


def test_a_row_that_is_marked_does_not_count_wherever_it_stands(tmp_path: Path) -> None:
    marked = f"a,s1,{KEEP},stop,left,{KEEP},decelerate,right,0,1,1"
    file = _written(tmp_path, marked, GOOD + ",0", header=HEADER + ",duplicate")
    (found,) = report_of_file(file).runs
    assert (found.n, found.repeated, found.top[0].hits) == (1, 1, 1)


def test_an_unknown_label_stays_in_the_denominator(tmp_path: Path) -> None:
    unknown = f"a,s2,unknown,unknown,{KEEP},stop,left,decelerate,right,1,1"
    found = report_of_file(_written(tmp_path, GOOD, unknown))
    assert [x.hits / x.n for x in found.runs[0].top] == [0.5, 0.5, 0.5]
    assert found.runs[0].unknown_labels == 1
    assert list(found.actions) == ["keep", "follow-lane", "unknown"]
    assert all(x.n == 2 and x.unknown_labels == 1 for x in found.baselines)


def test_a_verdict_that_is_not_known_is_never_safe(tmp_path: Path) -> None:
    file = tmp_path / "v.csv"
    file.write_text("scenario_id,lon,lat,safe\ns1,decelerate,follow_lane,0\ns1,keep,left,1\n")
    found = report_of_file(_written(tmp_path, GOOD), file)
    constant = next(x for x in found.baselines if x.run == CONSTANT)
    assert constant.safe == (None, None, None)
    cautious = next(x for x in found.baselines if "(decelerate," in x.run)
    assert [None if r is None else r.hits for r in cautious.safe] == [0, None, None]
    assert read_verdicts(file)["s1"][ActionPair.parse("keep,left-lane")] is True


def test_safe_at_two_follows_where_it_can(tmp_path: Path) -> None:
    lines = [GOOD, GOOD.replace("s1", "s2")[:-3] + "0,0", GOOD.replace("s1", "s3")[:-3] + "0,1"]
    run = read_rankings(_written(tmp_path, *lines))["a"]
    assert [case.safe for case in run.cases] == [
        (True, True, True),
        (False, False, False),
        (False, None, True),
    ]


@pytest.mark.parametrize(
    ("line", "words"),
    [
        (GOOD.replace("stop,left", "fly,left"), "line 3, columns lon2, lat2: unknown action"),
        (GOOD.replace("stop,left", "stop,"), "line 3, columns lon2, lat2: unknown action"),
        ("a,s9,keep,up" + GOOD[21:], "line 3, columns label_lon, label_lat"),
        (GOOD[:-3] + "2,1", "line 3, column safe_top1: '2' is neither"),
        (GOOD[:-3] + "1,0", "line 3, column safe_top3: is 0 though"),
        (GOOD[:-4], "line 3, column safe_top1: the line ends"),
        (GOOD + ",1", "line 3: has more cells"),
        (GOOD.replace("a,s1,keep", "b,s1,stop"), "run b labels s1 stop,follow-lane"),
    ],
)
def test_errors_name_file_line_and_column(tmp_path: Path, line: str, words: str) -> None:
    line = line.replace("a,s1", "a,s2") if line.startswith("a,s1") else line
    file = _written(tmp_path, GOOD, line)
    with pytest.raises(SandraError) as error:
        report_of_file(file)
    assert str(file) in str(error.value)
    assert words in str(error.value)


@pytest.mark.parametrize(
    ("header", "words"),
    [
        (HEADER.replace("lon1", "first"), "line 1: there is no column lon1"),
        (HEADER.replace("lon2", "lat2"), "line 1, column lat2: is there twice"),
    ],
)
def test_a_header_that_cannot_be_used(tmp_path: Path, header: str, words: str) -> None:
    with pytest.raises(SandraError, match=words):
        report_of_file(_written(tmp_path, GOOD, header=header))


def test_files_that_hold_nothing(tmp_path: Path) -> None:
    with pytest.raises(SandraError, match="holds no row"):
        report_of_file(_written(tmp_path))
    with pytest.raises(SandraError, match="cannot be read"):
        report_of_file(tmp_path / "absent.csv")
    with pytest.raises(SandraError, match="unknown run 'x': choose from a"):
        report_of_file(_written(tmp_path, GOOD), pool=["x"])


def test_files_without_names_of_runs_and_scenarios(tmp_path: Path) -> None:
    header = HEADER.removeprefix("run,scenario_id,")
    bare = GOOD.removeprefix("a,s1,")
    found = report_of_file(_written(tmp_path, bare, bare, header=header))
    assert [(x.run, x.n, x.repeated) for x in found.runs] == [("r", 2, 0)]


def test_tables_in_three_formats_and_a_figure(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out, figure = tmp_path / "out", tmp_path / "f.pdf"
    words = [str(_written(tmp_path, GOOD)), "--out", str(out), "--figure", str(figure)]
    assert main(["evaluate", "rankings", *words, "--format", "csv"]) == 0
    assert capsys.readouterr().out.startswith("run,n,Safe@1")
    assert sorted(file.name for file in out.iterdir()) == [
        *(f"{name}.{end}" for name in ("actions",) for end in ("csv", "md", "tex")),
        "scores.csv",
        "scores.json",
        "scores.md",
        "scores.tex",
    ]
    text = (out / "scores.md").read_text()
    assert "| a | 1 | 100.00 [20.7, 100.0] |" in text
    assert f"| baseline: {CONSTANT} | 1 |" in text
    assert figure.read_bytes().startswith(b"%PDF")
