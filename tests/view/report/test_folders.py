"""Reports of folders: of a run with and without its sets, of several episodes, of an evaluation."""

import json
import shutil
from pathlib import Path

import pytest

from sandra.cli import main
from sandra.errors import SandraError
from sandra.evaluation.closed_loop.drive import Drive
from sandra.evaluation.closed_loop.folder import RunFolder
from sandra.view.report import FrameLog, episode_document, write_report
from sandra.view.report.document import Episode
from sandra.view.report.evaluation import closed_loop_document, open_loop_document, run_document
from sandra.view.report.frames import read_frames
from sandra.view.report.packing import unpack_frames, unpack_rows
from sandra.view.report.scenery import STATE

pytest.importorskip("highway_env")

HOW = Drive(ranker="exhaustive", steps=3, rules=("R_G1", "R_G2", "R_G3"))
SEED = 6382


@pytest.fixture(scope="module")
def run(tmp_path_factory) -> RunFolder:
    folder = RunFolder(tmp_path_factory.mktemp("runs") / "run", FrameLog)
    folder.open(HOW, ["sandra", "drive"])
    folder.drive(HOW, SEED)
    return folder


def without_sets(run: RunFolder, to: Path, seeds: tuple[int, ...] = (SEED,)) -> Path:
    """The run as one that was driven without view.jsonl, under several seeds."""
    to.mkdir(parents=True)
    shutil.copy(run.path / "run.json", to)
    for seed in seeds:
        shutil.copytree(run.episode(SEED), to / f"seed-{seed}")
        (to / f"seed-{seed}" / "view.jsonl").unlink()
    return to


def test_an_episode_shows_what_was_decided(run: RunFolder) -> None:
    document = episode_document(run.episode(SEED))
    lines = (run.episode(SEED) / "decisions.jsonl").read_text().splitlines()
    told = [json.loads(line) for line in lines]
    assert len(document.decisions) == len(told) == 3
    for shown, line in zip(document.decisions, told, strict=True):
        assert isinstance(shown, dict)
        asked = [x for x in shown["pairs"] if x["asked"]]
        assert [x["status"] for x in asked] == [x["status"] for x in line["verdicts"]]
        assert [x["reason"] for x in asked] == [x["reason"] for x in line["verdicts"]]
        assert shown["operation"] == line["operation"]
        assert document.texts[shown["prompt"]["system"]] == line["prompt"]["system"]
        assert len(shown["pairs"]) == 12
        assert any(unpack_frames(x["sets"])[0] for x in shown["pairs"])


def test_the_ways_pass_through_the_decisions(run: RunFolder) -> None:
    """The recording and the decisions are in the same coordinates."""
    document = episode_document(run.episode(SEED))
    episode = document.episode
    assert isinstance(episode, Episode)
    assert (episode.ticks, episode.decided_every) == (10, 3)
    rows = {x.id: (x.first, unpack_rows(x.states, STATE)) for x in episode.tracks}
    for shown in document.decisions:
        assert isinstance(shown, dict)
        tick = 3 * shown["step"]
        ego = rows[episode.ego][1][tick]
        assert ego[:2] == pytest.approx([shown["ego"]["x"], shown["ego"]["y"]], abs=0.02)
        assert ego[2] == pytest.approx(shown["ego"]["heading"], abs=0.002)
        for other in shown["others"][:5]:
            first, way = rows[other["id"]]
            here = unpack_rows(other["states"], STATE)[0]
            assert way[tick - first, :2] == pytest.approx(here[:2], abs=0.02)
    assert [x.name for x in episode.rules] == ["R_G1", "R_G2", "R_G3"]


def test_without_the_sets_the_page_says_so(run: RunFolder, tmp_path: Path) -> None:
    with_sets = episode_document(run.episode(SEED))
    folder = without_sets(run, tmp_path / "old")
    document = episode_document(folder / f"seed-{SEED}")
    assert "--no-view" in document.notes[0]
    for shown, full in zip(document.decisions, with_sets.decisions, strict=True):
        assert isinstance(shown, dict)
        assert isinstance(full, dict)
        asked = [x for x in full["pairs"] if x["asked"]]
        for name in ("pair", "status", "reason", "rank", "executed", "parts"):
            assert [x[name] for x in shown["pairs"]] == [x[name] for x in asked], name
        assert shown["curves"] == full["curves"]
        assert shown["prompt"]["user"] == full["prompt"]["user"]
        assert {x for p in shown["pairs"] for x in p["parts"]} <= shown["parts"].keys()


def test_several_episodes_are_a_table_with_links(run: RunFolder, tmp_path: Path) -> None:
    folder = without_sets(run, tmp_path / "many", (1, 2, 10))
    written = write_report(folder, tmp_path / "all.html")
    assert [x.name for x in written] == ["all.html", "seed-1.html", "seed-2.html", "seed-10.html"]
    assert all("../all.html" in x.read_text() for x in written[1:])
    (table,) = run_document(folder, "all-episodes").document.tables
    assert [row.cells[0] for row in table.rows] == ["6382"] * 3
    assert [row.links[0].href for row in table.rows] == [
        f"all-episodes/seed-{n}.html" for n in (1, 2, 10)
    ]
    assert write_report(folder, tmp_path / "one.html", episodes=False) == [tmp_path / "one.html"]


def test_an_evaluation_links_rows_to_episodes(
    run: RunFolder, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "table"
    words = ["--settings", "1", "--seeds", "3", "--repeats", "2", "--rows", "random", "--view"]
    assert main(["evaluate", "closed-loop", *words, "--out", str(out)]) == 0
    found = closed_loop_document(out, "pages")
    main_table, beside = found.document.tables
    links = {row.cells[0]: [x.href for x in row.links] for row in main_table.rows if row.links}
    assert links == {
        "random": [f"pages/random{x}_setting-1_seed-3.html" for x in ("", "_1")],
    }
    assert all(path.is_dir() for path in found.episodes.values())
    assert len(beside.rows) == 1
    assert {x.name for x in found.document.charts} >= {"Success", "Distance", "Actions"}
    capsys.readouterr()
    page = tmp_path / "page.html"
    assert main(["report", str(out), "--out", str(page), "--no-episodes"]) == 0
    assert capsys.readouterr().out.strip() == str(page)
    driven = episode_document(out / "random" / "setting-1" / "seed-3")
    assert len(driven.decisions) == 1, "a driver without a verifier decides nothing"


def test_an_open_loop_evaluation_has_tables_and_intervals(tmp_path: Path) -> None:
    (tmp_path / "scores.csv").write_text("run,n\nrules,8\n")
    (tmp_path / "scores.md").write_text("Per cent of all.\n\n| run | n |\n")
    run = {"run": "rules", "safe1": 87.5, "safe1_interval": [52.9, 97.8]}
    (tmp_path / "scores.json").write_text(json.dumps({"runs": [run], "baselines": []}))
    document = open_loop_document(tmp_path)
    assert document.tables[0].title == "Per cent of all."
    assert document.charts[0].bars[0].values == (("Safe@1", 87.5, 52.9, 97.8),)


@pytest.mark.parametrize("what", ["nothing", "broken", "other version"])
def test_what_is_no_run_is_said_in_one_line(tmp_path: Path, what: str) -> None:
    if what == "broken":
        (tmp_path / "run.json").write_text("{}")
        (tmp_path / "seed-1").mkdir()
        (tmp_path / "seed-1" / "metrics.json").write_text("[]")
    if what == "other version":
        file = tmp_path / "view.jsonl"
        file.write_text('{"format": "sandra-report", "version": 99}\n')
        with pytest.raises(SandraError, match="another version"):
            read_frames(file)
        return
    with pytest.raises(SandraError) as error:
        write_report(tmp_path, tmp_path / "x.html")
    assert "\n" not in str(error.value)


def test_the_command_line_writes_pages(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    page, out = tmp_path / "d.html", tmp_path / "run"
    words = ["merge", "--horizon", "3", "--accept", "reachable"]
    assert main(["decide", *words, "--report", str(page), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["report"] == str(page)
    assert '"kind": "decision"' in page.read_text()
    drive = ["drive", "highway", "--seeds", "1", "--steps", "1", "--horizon", "2", "--no-view"]
    assert main([*drive, "--out", str(out)]) == 0
    assert not (out / "seed-1" / "view.jsonl").exists()
    assert main(["report", str(out)]) == 0
    assert "--no-view" in (out / "report.html").read_text()
    assert main(["report", str(tmp_path / "none")]) == 2


def test_a_line_that_is_being_written_is_left_out(run: RunFolder, tmp_path: Path) -> None:
    text = (run.episode(SEED) / "view.jsonl").read_text()
    file = tmp_path / "view.jsonl"
    file.write_text(text[: len(text) - 40])
    assert len(read_frames(file).decisions) == 2
