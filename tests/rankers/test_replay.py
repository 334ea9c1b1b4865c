import csv
import json
from pathlib import Path

import pytest

from sandra.actions import ActionPair
from sandra.describe import Prompt, describe
from sandra.errors import RankerError
from sandra.rankers import Failure, create
from straight_road import Road

HEADER = "run,scenario_id,lon1,lat1,lon2,lat2,timeout_fallback\n"


def prompt(name: str) -> Prompt:
    road = Road()
    lanes = (road.lane("current", 0), road.lane("left", 1))
    return describe(road.scene(lanes=lanes, name=name))


def test_the_authors_recording_plays_back_unchanged(shared: Path) -> None:
    path = shared / "data/mona/mona_llm_rankings.csv"
    ranker = create(f"replay:{path}#run=ft")
    with path.open(encoding="utf-8") as file:
        rows = [row for row in csv.DictReader(file) if row["run"] == "ft"]
    assert len(rows) == 800
    for row in rows[::7]:
        road = Road()
        lanes = [road.lane("current", 0)]
        if row["left_feasible"] == "1":
            lanes.append(road.lane("left", 1))
        if row["right_feasible"] == "1":
            lanes.append(road.lane("right", -1))
        told = describe(road.scene(lanes=tuple(lanes), name=row["scenario_id"]))
        ranking = ranker.rank(told)
        recorded = [ActionPair.of(row[f"lon{n}"], row[f"lat{n}"]) for n in (1, 2, 3)]
        distinct = list(dict.fromkeys(recorded))
        assert list(ranking.pairs) == [p for p in distinct if p in told.feasible]
        assert (ranking.failure is Failure.TIMEOUT) == (row["timeout_fallback"] == "1")
        assert ranking.pairs == () or ranking.detail is None or row["timeout_fallback"] == "1"


def test_a_file_of_several_runs_needs_a_choice(shared: Path) -> None:
    path = shared / "data/mona/mona_llm_rankings.csv"
    with pytest.raises(RankerError, match=r"several values of 'run'.*#run="):
        create(f"replay:{path}")
    with pytest.raises(RankerError, match="no column 'walk'"):
        create(f"replay:{path}#walk=ft")
    with pytest.raises(RankerError, match="no row"):
        create(f"replay:{path}#run=none")
    twice = create(f"replay:{path}#run=rule_T&rule_prompt=1")
    ranking = twice.rank(prompt("DEU_MONAEast-2_9724_T-9749"))
    assert "recorded 2 times, the last one is used" in ranking.warnings


def test_csv(tmp_path: Path) -> None:
    path = tmp_path / "r#1.csv"
    rows = ["a,S1,keep,follow_lane,stop,left,0", "a,S2,keep,right,,,0", "a,S3,stop,follow,,,1"]
    path.write_text(HEADER + "\n".join(rows), encoding="utf-8")
    ranker = create(f"replay:{path}")
    first = ranker.rank(prompt("S1"))
    assert [str(p) for p in first.pairs] == ["keep,follow-lane", "stop,left-lane"]
    assert first.failure is None
    assert ranker.rank(prompt("S2")).failure is Failure.INFEASIBLE
    late = ranker.rank(prompt("S3"))
    assert (late.failure, len(late.pairs)) == (Failure.TIMEOUT, 1)
    missing = ranker.rank(prompt("S4"))
    assert (missing.failure, missing.pairs) == (Failure.NOT_RECORDED, ())
    assert "S4" in (missing.detail or "")


def test_json_lines(tmp_path: Path) -> None:
    path = tmp_path / "r.jsonl"
    row = {"scenario": "S1", "ranking": [{"longitudinal": "stop", "lateral": "left-lane"}]}
    path.write_text(f"{json.dumps(row)}\n\n", encoding="utf-8")
    assert [str(p) for p in create(f"replay:{path}").rank(prompt("S1")).pairs] == ["stop,left-lane"]


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "no column 'scenario_id'"),
        (b"scenario_id,lon1\nS1,keep\n", "no column 'lat1'"),
        (HEADER.encode(), "no row"),
        (HEADER.encode() + b"a,S1,fly,up,,,0\n", r"line 2: unknown action pair"),
        (b'{"scenario": "S1"}\n', "line 1: not of the form"),
        (b"{broken\n", "line 1: not of the form"),
        (b'{"scenario": "S1", "ranking": 3}\n', "line 1: not of the form"),
        (b"\xff\xfe\x00", "not a text file"),
    ],
)
def test_a_bad_recording_is_refused_in_one_line(
    tmp_path: Path, content: bytes, message: str
) -> None:
    path = tmp_path / "bad"
    path.write_bytes(content)
    with pytest.raises(RankerError, match=message) as caught:
        create(f"replay:{path}")
    assert "\n" not in str(caught.value)


def test_no_file() -> None:
    with pytest.raises(RankerError, match="cannot be read"):
        create("replay:/no/such/file.csv")
