"""`dilu:MODEL` as a ranker, against a server that plays the model."""

import json
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest

import sandra
from chat_server import chat_server
from dilu_server import ModelServer, embeddings, model_server
from hostile_server import CASES, Handler, hostile_server, stall, stream, whole
from sandra.actions import META_ACTIONS, ActionPair
from sandra.cli import main
from sandra.describe import Prompt, describe, narrow
from sandra.errors import RankerError
from sandra.rankers import Failure, Ranking, Usage, as_ranker, create
from sandra.rankers.dilu import DiLuRanker, Experience, load
from sandra.rankers.dilu.loop import SYSTEM
from sandra.rankers.dilu.memory import dump
from sandra.rankers.dilu.situation import PAIRS, view_of
from straight_road import CAR, Road

ROAD = Road()
SCENE = ROAD.scene(
    ROAD.obstacle(7, 60.0, 0.0, 8.0),
    ROAD.obstacle(8, 30.0, 3.5, 12.0, kind="truck"),
    ROAD.obstacle(9, -20.0, 3.5, 14.0),
    ROAD.obstacle(10, 1.0, -3.5, 9.0),
    ROAD.obstacle(11, 40.0, -3.5, 9.0, speed_is_known=False),
    ROAD.obstacle(12, -80.0, 0.0, 9.0),
    lanes=ROAD.three_lanes(),
)
ONE_LANE = ROAD.scene(ROAD.obstacle(7, 60.0, 0.0, 8.0))
PROMPT = describe(SCENE, "drive faster")
WORDS = """\
The road has 3 lanes in your direction; lane 1 is the leftmost. You are in lane 2.
You drive 10.0 m/s, your acceleration is 0.0 m/s².
Your lane (lane 2):
- ahead: a car 55.5 m away, at 8.0 m/s, acceleration 0.0 m/s²
- behind: nobody within 50 m
The lane on your left (lane 1):
- ahead: a truck 25.5 m away, at 12.0 m/s, acceleration 0.0 m/s²
- behind: a car 15.5 m away, at 14.0 m/s, acceleration 0.0 m/s²
The lane on your right (lane 3):
- ahead: a car beside you, at 9.0 m/s, acceleration 0.0 m/s²
- behind: nobody within 50 m

You can choose:
0 LANE_LEFT: change to the lane on your left
1 IDLE: stay in the lane, and keep the speed
2 LANE_RIGHT: change to the lane on your right
3 FASTER: drive faster
4 SLOWER: drive slower"""

pytestmark = pytest.mark.usefixtures("no_openai_key")


@pytest.fixture
def server() -> Iterator[ModelServer]:
    with model_server() as server:
        yield server


def rank(
    server: ModelServer, prompt: Prompt = PROMPT, deadline: float = 5.0, spec: str = "dilu:m"
) -> Ranking:
    return create(spec, base_url=server.url).rank(prompt, deadline)


def pair(text: str) -> ActionPair:
    return ActionPair.parse(text)


def test_what_is_asked(server: ModelServer) -> None:
    ranking = rank(server)
    (body,) = server.asked
    first, *turns, last = body["messages"]
    assert first == {"role": "system", "content": SYSTEM}
    assert last == {"role": "user", "content": WORDS}
    assert [turn["role"] for turn in turns] == ["user", "assistant"] * 3
    shipped = {(item.question, item.answer) for item in load()}
    told = [turn["content"] for turn in turns]
    assert set(zip(told[::2], told[1::2], strict=True)) < shipped
    assert (body["model"], body["temperature"]) == ("m", 0.0)
    assert "response_format" not in body
    assert ranking.usage == Usage(requests=1, unknown=1)


@pytest.mark.parametrize(("number", "action"), list(enumerate(META_ACTIONS)))
def test_a_number_is_one_pair(server: ModelServer, number: int, action: str) -> None:
    server.says(f"It is like this.\n#### {number}")
    ranking = rank(server)
    assert ranking == Ranking(
        (PAIRS[action],),
        "dilu:m",
        reasoning="It is like this.",
        answer=f"It is like this.\n#### {number}",
        usage=ranking.usage,
    )


def test_the_actions_mean_what_they_mean_in_the_simulation() -> None:
    pytest.importorskip("highway_env")
    from sandra.simulation.meta import META
    from sandra.simulation.proposal import TABLE

    assert {META[p]: p for p in PAIRS.values()} == PAIRS
    assert {action: pairs[0] for action, pairs in TABLE.items()} == PAIRS


@pytest.mark.parametrize("setting", [1, 3])
def test_a_scene_is_told_like_the_environment_that_it_was_made_from(setting: int) -> None:
    """Beside the driver's own view; it also sees who is 50 to 100 m behind."""
    pytest.importorskip("highway_env")
    from sandra.scene.highway import Observer
    from sandra.simulation import highway
    from sandra.simulation.dilu import view

    compared = 0
    for seed in range(12):
        world = highway(setting)
        world.reset(seed)  # nobody is between two lanes yet
        scene = Observer.of(world.env, "test", 0.2).scene(world.ego)
        ours, theirs = view_of(describe(scene).situation), view(world)
        assert (ours.lanes, ours.own.number) == (theirs.lanes, theirs.own.number)
        assert (ours.speed, ours.acceleration) == (theirs.speed, theirs.acceleration)
        for mine, other in zip(
            (ours.own, ours.left, ours.right), (theirs.own, theirs.left, theirs.right), strict=True
        ):
            assert (mine is None) == (other is None)
            if mine is None or other is None:
                continue
            assert mine.number == other.number
            beside = [car for car in (other.ahead, other.behind) if car and car.gap <= 0.0]
            if beside:
                assert mine.ahead is not None
                assert mine.ahead.gap == 0.0
                continue
            near = other.behind if other.behind and other.behind.gap <= 50.0 else None
            for car, same in ((mine.ahead, other.ahead), (mine.behind, near)):
                assert (car is None) == (same is None)
                if car is not None and same is not None:
                    assert car.gap == pytest.approx(same.gap)
                    assert car.speed == pytest.approx(same.speed)
                    compared += 1
    assert compared > 15


def test_somebody_who_reaches_into_the_lane_is_told_in_both() -> None:
    reaching = ROAD.obstacle(7, 30.0, 2.2, 8.0)
    seen = view_of(describe(ROAD.scene(reaching, lanes=ROAD.three_lanes())).situation)
    assert seen.left is not None
    assert seen.own.ahead == seen.left.ahead is not None


def test_what_is_not_known_is_not_made_up() -> None:
    unknown = ROAD.obstacle(7, 30.0, 0.0, 8.0, kind="unknown", speed_is_known=False)
    text = view_of(describe(ROAD.scene(unknown)).situation).text()
    assert "- ahead: an unknown obstacle 25.5 m away, at an unknown speed, acc" in text
    assert "The road has 1 lane in your direction" in text
    assert "nan" not in text


@pytest.mark.parametrize(("number", "action"), [(0, "LANE_LEFT"), (2, "LANE_RIGHT")])
def test_a_lane_that_is_not_there_is_infeasible(
    server: ModelServer, number: int, action: str
) -> None:
    server.says(f"#### {number}")
    ranking = rank(server, describe(ONE_LANE))
    assert action not in server.asked[0]["messages"][-1]["content"]
    assert (ranking.pairs, ranking.failure) == ((), Failure.INFEASIBLE)
    assert ranking.detail == f"{action}: {PAIRS[action]} is not feasible here"
    assert ranking.usage == Usage(requests=1, unknown=1)


def test_only_pairs_that_hold_are_offered(server: ModelServer) -> None:
    held = [pair("stop,follow-lane"), PAIRS["SLOWER"], PAIRS["LANE_LEFT"]]
    server.says("#### 4")
    assert rank(server, narrow(PROMPT, held)).pairs == (PAIRS["SLOWER"],)
    offered = server.asked[0]["messages"][-1]["content"].partition("You can choose:\n")[2]
    assert [line[:5] for line in offered.splitlines()] == ["0 LAN", "4 SLO"]
    server.says("#### 3")
    assert rank(server, narrow(PROMPT, held)).failure is Failure.INFEASIBLE
    asked = len(server.asked)
    ranking = rank(server, narrow(PROMPT, held[:1]))
    assert (ranking.failure, ranking.usage) == (Failure.INFEASIBLE, None)
    assert len(server.asked) == asked


def test_a_second_question_repairs(server: ModelServer) -> None:
    server.says("To the right.\n#### LANE_RIGHT", "2")
    ranking = rank(server)
    assert (ranking.pairs, ranking.failure) == ((PAIRS["LANE_RIGHT"],), None)
    assert len(ranking.warnings) == 1
    assert (ranking.reasoning, ranking.answer) == (
        "To the right.",
        "To the right.\n#### LANE_RIGHT",
    )
    assert ranking.usage == Usage(requests=2, unknown=2)


@pytest.mark.parametrize(
    ("answers", "failure", "requests"),
    [
        (("garbage", "more garbage"), Failure.MALFORMED, 2),
        (("#### 7", "#### 7"), Failure.MALFORMED, 2),
        (("",), Failure.EMPTY, 1),
        (("garbage", ""), Failure.EMPTY, 2),
        ((500,), Failure.SERVER_ERROR, 3),
        ((404,), Failure.REJECTED, 1),
        ((429,), Failure.RATE_LIMITED, 3),
        (("garbage", 401), Failure.REJECTED, 2),
    ],
)
def test_what_goes_wrong_has_a_name_and_a_price(
    server: ModelServer, answers: tuple[str | int, ...], failure: Failure, requests: int
) -> None:
    server.says(*answers)
    ranking = rank(server)
    assert (ranking.pairs, ranking.failure) == ((), failure)
    assert ranking.detail
    assert ranking.usage is not None
    assert ranking.usage.requests == len(server.asked) == requests


def test_nobody_there() -> None:
    assert create("dilu:m", base_url="http://127.0.0.1:9/v1").rank(PROMPT, 5.0).failure is (
        Failure.UNREACHABLE
    )


def test_one_deadline_for_both_questions() -> None:
    def slowly(handler: Handler) -> None:
        time.sleep(0.4)
        stream("garbage")(handler)

    for plays, requests in (((stall,), 1), ((slowly, stall), 2), ((slowly, slowly), 2)):
        with chat_server(*plays) as server:
            ranker = create("dilu:m", base_url=server.url, deadline=0.7)
            begin = time.monotonic()
            ranking = ranker.rank(PROMPT)
            assert time.monotonic() - begin < 0.7 + 0.3
            assert (ranking.pairs, ranking.failure) == ((), Failure.TIMEOUT)
            assert ranking.detail == "no decision within 0.7 s"
            assert ranking.usage is not None
            assert ranking.usage.requests == len(server.requests) == requests


@pytest.mark.parametrize(
    ("said", "pairs"),
    [
        ("Free road.\n#### 3", ("accelerate,follow-lane",)),
        ("Free road. 3", ()),
        ("#### 3\nNo, rather ####", ()),
        ("3", ()),
    ],
)
def test_a_number_that_had_arrived_by_the_deadline_counts(
    said: str, pairs: tuple[str, ...]
) -> None:
    def without_end(handler: Handler) -> None:
        handler.begin()
        handler.chunk(said)
        stall(handler)

    with chat_server(without_end) as server:
        ranking = create("dilu:m", base_url=server.url).rank(PROMPT, 0.8)
    assert ranking.failure is Failure.TIMEOUT
    assert ranking.pairs == tuple(map(pair, pairs))
    assert ranking.answer == said
    assert ("; FASTER had arrived" in str(ranking.detail)) == bool(pairs)


def test_whatever_a_server_does_is_named_in_time() -> None:
    with hostile_server() as server:
        for name in list(CASES)[::7]:
            ranker = create("dilu:m", base_url=server.url(name))
            begin = time.monotonic()
            ranking = ranker.rank(PROMPT, 0.5)
            assert time.monotonic() - begin < 0.5 + 0.3, name
            assert (ranking.pairs, ranking.failure is None) == ((), False), name
            assert ranking.detail is not None
            assert "\n" not in ranking.detail


def test_a_refusal() -> None:
    with chat_server(whole(None, refusal="I do not\ndrive.")) as server:
        ranking = create("dilu:m", base_url=server.url).rank(PROMPT, 5.0)
    assert (ranking.failure, ranking.detail) == (Failure.REFUSED, "I do not drive.")


def test_good_answers_are_kept_on_disk(server: ModelServer, tmp_path: Path) -> None:
    ranker = create("dilu:m", base_url=server.url, cache=tmp_path)
    server.says("Left?", "0", 500)
    fresh, kept = ranker.rank(PROMPT, 5.0), ranker.rank(PROMPT, 5.0)
    assert len(server.asked) == 2
    assert kept.pairs == fresh.pairs == (PAIRS["LANE_LEFT"],)
    assert kept.usage == Usage(from_cache=2)
    assert (fresh.cached, kept.cached) == (False, True)


def test_bad_answers_are_not(server: ModelServer, tmp_path: Path) -> None:
    ranker = create("dilu:m", base_url=server.url, cache=tmp_path)
    for answer in ("what?", "#### 0"):
        server.says(answer)
        assert not ranker.rank(describe(ONE_LANE), 5.0).pairs
    assert list(tmp_path.iterdir()) == []


def test_options(server: ModelServer, tmp_path: Path) -> None:
    path = tmp_path / "memory.json"
    item = Experience("s", "c", "#### 1")
    path.write_text(dump([item]), encoding="utf-8")
    spec = f"dilu:org/m:7b#shots=2&memory={path}&temperature=none&seed=4"
    ranker = create(spec, base_url=server.url)
    assert ranker.name == spec
    assert as_ranker(ranker) is ranker
    assert isinstance(ranker, DiLuRanker)
    ranker.rank(PROMPT, 5.0)
    (body,) = server.asked
    assert (body["model"], body["seed"]) == ("org/m:7b", 4)
    assert "temperature" not in body
    assert [m["content"] for m in body["messages"][1:3]] == [item.question, item.answer]
    assert len(body["messages"]) == 4
    rank(server, spec="dilu:m#shots=0&temperature=0.5")
    assert len(server.asked[1]["messages"]) == 2
    assert server.asked[1]["temperature"] == 0.5
    create("dilu:m", base_url=server.url, temperature=0.2, seed=3).rank(PROMPT, 5.0)
    assert (server.asked[2]["temperature"], server.asked[2]["seed"]) == (0.2, 3)


def test_embeddings_of_the_server_under_the_same_deadline(server: ModelServer) -> None:
    spec = "dilu:m#embedding=openai:e"
    server.vectors = lambda texts: embeddings([[1.0, 0.1 * i] for i in range(len(texts))])
    assert rank(server, spec=spec).pairs == (PAIRS["IDLE"],)
    assert [len(body["input"]) for body in server.embedded] == [21, 1]
    server.vectors = lambda texts: None
    begin = time.monotonic()
    ranking = rank(server, spec=spec, deadline=0.4)
    assert time.monotonic() - begin < 0.7
    assert (ranking.failure, ranking.usage) == (Failure.TIMEOUT, Usage())


@pytest.mark.parametrize(
    ("spec", "message"),
    [
        ("dilu:", "no model named"),
        ("dilu:m#hold=5", "'hold=5' is no option"),
        ("dilu:m#shots=-1", "at least 0"),
        ("dilu:m#temperature=hot", "write a number"),
        ("dilu:m#embedding=bert", "embedding = bert"),
        ("dilu:m#embedding=openai:", "no model named"),
        ("dilu:m#memory=nowhere.json", "nowhere.json"),
        ("dilu", "unknown ranker"),
    ],
)
def test_bad_specs(spec: str, message: str) -> None:
    with pytest.raises(RankerError, match=message) as caught:
        create(spec, base_url="http://127.0.0.1:9/v1")
    assert "\n" not in str(caught.value)


def test_bad_addresses_and_deadlines() -> None:
    with pytest.raises(RankerError, match="no API key"):
        create("dilu:m")
    with pytest.raises(RankerError, match="deadline = 0"):
        create("dilu:m", base_url="http://127.0.0.1:9/v1", deadline=0.0)


def test_what_it_says_is_verified(server: ModelServer) -> None:
    wall = ROAD.obstacle(7, 14.0, 0.0, 0.0, outline=CAR)
    blocked = ROAD.scene(wall, speed=8.0, lanes=ROAD.three_lanes())
    told = {}
    for number, action in enumerate(META_ACTIONS):
        server.says(f"#### {number}")
        decision = sandra.decide(blocked, "dilu:m", base_url=server.url, horizon=20)
        (verdict,) = decision.verdicts
        assert verdict.pair == PAIRS[action]
        assert decision.maneuver.kind in ("certified", "fail-safe")
        told[action] = verdict.status is sandra.Status.CERTIFIED
        assert (decision.maneuver.pair == PAIRS[action]) == told[action]
    assert not told["FASTER"]
    assert told["SLOWER"]


def test_driving_with_it(
    server: ModelServer, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip("highway_env")
    words = ["drive", "--ranker", "dilu:m", "--base-url", server.url, "--steps", "2"]
    assert main([*words, "--seeds", "1", "--out", str(tmp_path), "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["cost"]["usage"]["requests"] == len(server.asked) == 2


def test_a_row_of_the_closed_loop_table(
    server: ModelServer, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip("highway_env")
    words = ["--ranker", "dilu:m", "--rows", "dilu:m/*", "--base-url", server.url, "--list"]
    assert main(["evaluate", "closed-loop", *words]) == 0
    rows = capsys.readouterr().out.split()
    assert "dilu:m/set-based/no-rules/paper" in rows


def test_a_prompt_of_another_kind(server: ModelServer) -> None:
    """Facts that nobody filled in: no lanes beside, though a change is feasible."""
    bare = replace(PROMPT, situation=replace(PROMPT.situation, lanes_left=0, lanes_right=0))
    server.says("#### 0")
    assert rank(server, bare).pairs == (PAIRS["LANE_LEFT"],)
