"""DiLu's decision loop against a server that plays the model."""

import json
import logging
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from dilu_server import ModelServer, embeddings, model_server
from sandra.cli import main
from sandra.errors import RankerError, SettingsError
from sandra.rankers import Failure
from sandra.rankers.dilu.loop import REPAIR, SYSTEM, number_in
from sandra.simulation import Environment, highway
from sandra.simulation.dilu import DiLu, EmbeddingEndpoint, Experience, HashedWords, located, view
from sandra.simulation.policies import play, policy

pytest.importorskip("highway_env")

ITEMS = tuple(Experience(f"situation {i}", "1 IDLE: go on", f"{i}\n#### {i % 5}") for i in range(6))

pytestmark = pytest.mark.usefixtures("no_openai_key")


@pytest.fixture
def server() -> Iterator[ModelServer]:
    with model_server() as server:
        yield server


@pytest.fixture(scope="module")
def world() -> Environment:
    world = highway(2)
    world.reset(5838)
    return world


def test_the_three_likest_experiences_stand_before_the_question(
    server: ModelServer, world: Environment
) -> None:
    driver = DiLu("m", base_url=server.url)
    choice = driver.decide(world)
    (body,) = server.asked
    assert body["model"] == "m"
    assert body["temperature"] == 0.0
    assert "response_format" not in body
    messages = [(m["role"], m["content"]) for m in body["messages"]]

    items = driver.memory.items
    texts = [view(world).situation(), *(item.situation for item in items)]
    here, *there = HashedWords().embed(texts)
    likeness = [round(float(here @ vector), 9) for vector in there]
    order = sorted(range(len(items)), key=lambda i: (likeness[i], -i))
    likest = [items[i] for i in order[-3:]]
    turns = [t for e in likest for t in (("user", e.question), ("assistant", e.answer))]
    assert messages == [("system", SYSTEM), *turns, ("user", view(world).text())]
    assert choice.recalled == tuple(likest)
    assert (choice.action, choice.failure, choice.repaired) == ("IDLE", None, False)


@pytest.mark.parametrize("shots", [0, 1, 9])
def test_as_many_experiences_as_told(server: ModelServer, world: Environment, shots: int) -> None:
    driver = DiLu("m", base_url=server.url, shots=shots, items=ITEMS)
    driver.decide(world)
    assert len(server.asked[0]["messages"]) == 2 + 2 * min(shots, len(ITEMS))


@pytest.mark.parametrize(
    ("answer", "number"),
    [
        ("I think so.\n#### 3", 3),
        ("####0", 0),
        ("#### 1\nno, rather\n#### 4 \n", 4),
        ("2", 2),
        ("#### 5", None),
        ("#### -1", None),
        ("#### 3.0", None),
        ("#### 3 FASTER", None),
        ("#### FASTER", None),
        ("#### 2\n####", None),
        ("go on", None),
        ("", None),
        ("#### " + "1" * 5000, None),
    ],
)
def test_the_number_after_the_last_marks(answer: str, number: int | None) -> None:
    assert number_in(answer) == number


def test_an_answer_without_a_number_is_repaired(server: ModelServer, world: Environment) -> None:
    long = "x" * 5000 + " so I had better go to the right.\n#### LANE_RIGHT"
    server.says(long, " 2\n")
    choice = DiLu("m", base_url=server.url).decide(world)
    assert (choice.action, choice.repaired, choice.failure) == ("LANE_RIGHT", True, None)
    assert choice.answer == long
    first, second = (body["messages"] for body in server.asked)
    assert len(first) == 8
    assert [m["role"] for m in second] == ["system", "user"]
    assert second[0]["content"].startswith(REPAIR.split("{")[0])
    assert "0 LANE_LEFT, 1 IDLE, 2 LANE_RIGHT, 3 FASTER, 4 SLOWER" in second[0]["content"]
    assert long.endswith(second[1]["content"])
    assert len(second[1]["content"]) == 2000
    assert server.asked[1]["temperature"] == 0.0


@pytest.mark.parametrize(
    ("answers", "failure"),
    [
        (("garbage", "more garbage"), Failure.MALFORMED),
        (("#### 7", "#### 7"), Failure.MALFORMED),
        (("",), Failure.EMPTY),
        (("garbage", ""), Failure.EMPTY),
        ((500,), Failure.SERVER_ERROR),
        ((404,), Failure.REJECTED),
        ((429,), Failure.RATE_LIMITED),
    ],
)
def test_what_goes_wrong_has_a_name(
    server: ModelServer,
    world: Environment,
    answers: tuple[str | int, ...],
    failure: Failure,
) -> None:
    server.says(*answers)
    choice = DiLu("m", base_url=server.url, default="IDLE").decide(world)
    assert (choice.action, choice.failure) == ("IDLE", failure)
    assert choice.detail
    assert len(choice.recalled) == 3


def test_an_answer_that_never_comes(server: ModelServer, world: Environment) -> None:
    for answers in ((None,), ("garbage", None)):
        server.says(*answers)
        driver = DiLu("m", base_url=server.url, deadline=0.4)
        begin = time.monotonic()
        choice = driver.decide(world)
        assert time.monotonic() - begin < 0.8
        assert (choice.action, choice.failure) == ("SLOWER", Failure.TIMEOUT)


def test_failures_are_told_and_the_episode_goes_on(
    server: ModelServer, caplog: pytest.LogCaptureFixture
) -> None:
    server.says("#### 1", "?", "?", "#### 3", 404)
    driver = DiLu("m", base_url=server.url)
    with caplog.at_level(logging.WARNING):
        run = play(highway(1), 2421, driver, steps=4)
    assert run.actions == ("IDLE", "SLOWER", "FASTER", "SLOWER")
    assert [choice.failure for choice in driver.choices] == [
        None,
        Failure.MALFORMED,
        None,
        Failure.REJECTED,
    ]
    told = [r.getMessage() for r in caplog.records if r.name.startswith("sandra")]
    assert [t.split(" (")[0] for t in told] == [
        "dilu:m, seed 2421, step 1: malformed",
        "dilu:m, seed 2421, step 3: rejected",
    ]


def test_a_server_that_was_never_there_is_an_error(server: ModelServer) -> None:
    server.says(404)
    with pytest.raises(RankerError, match="dilu:m: rejected: HTTP 404"):
        play(highway(1), 2421, DiLu("m", base_url=server.url), steps=2)
    with pytest.raises(RankerError, match="unreachable"):
        play(highway(1), 2421, DiLu("m", base_url="http://127.0.0.1:9/v1"), steps=2)


def test_an_episode_is_that_of_its_actions(server: ModelServer) -> None:
    server.says("Slow down.\n#### 4")
    world = highway(2)
    run = play(world, 5838, policy(f"dilu:m@{server.url}"), steps=8)
    same = play(world, 5838, policy("slower"), steps=8)
    assert run.driver == "dilu:m"
    assert run.actions == same.actions
    assert np.array_equal(run.x, same.x)
    assert len(server.asked) == run.steps == 8


def test_at_1_hz_the_ego_goes_on_between_the_decisions(server: ModelServer) -> None:
    server.says("#### 0", "#### 3", "#### 4")
    driver = DiLu("m", base_url=server.url, hold=3)
    run = play(highway(1), 2421, driver, steps=7)
    idle = ("IDLE", "IDLE")
    assert run.actions == ("LANE_LEFT", *idle, "FASTER", *idle, "SLOWER")
    assert len(driver.choices) == 3
    play(highway(1), 2421, driver, steps=2)
    assert [choice.action for choice in driver.choices] == ["SLOWER"]


def test_embeddings_of_a_server_find_the_experiences(
    server: ModelServer, world: Environment
) -> None:
    angles = {item.situation: 0.1 * i * (-1) ** i for i, item in enumerate(ITEMS)}

    def vectors(texts: list[str]) -> dict[str, object]:
        at = [angles.get(text, 0.26) for text in texts]
        return embeddings([[3 * np.cos(a), 3 * np.sin(a)] for a in at])

    server.vectors = vectors
    embedding = EmbeddingEndpoint("e", server.url)
    driver = DiLu("m", base_url=server.url, items=ITEMS, embedding=embedding)
    choice = driver.decide(world)
    assert choice.recalled == (ITEMS[0], ITEMS[4], ITEMS[2])
    driver.decide(world)
    assert [len(body["input"]) for body in server.embedded] == [6, 1, 1]
    assert {body["model"] for body in server.embedded} == {"e"}


@pytest.mark.parametrize(
    ("answer", "failure"),
    [
        (500, Failure.SERVER_ERROR),
        (401, Failure.REJECTED),
        (None, Failure.TIMEOUT),
        ({"data": []}, Failure.MALFORMED),
        (["no"], Failure.MALFORMED),
        (embeddings([[1.0, 0.0]]), Failure.MALFORMED),
        (embeddings([[float("nan")]] * 21), Failure.MALFORMED),
        (embeddings([[1.0]] * 20 + [[1.0, 2.0]]), Failure.MALFORMED),
        ({"data": [{"embedding": "x"}] * 21}, Failure.MALFORMED),
    ],
)
def test_a_bad_embedding_is_a_failure_of_the_decision(
    server: ModelServer, world: Environment, answer: object, failure: Failure
) -> None:
    server.vectors = lambda texts: answer
    driver = policy(f"dilu:m@{server.url}#embedding=openai:e&deadline=0.5")
    assert isinstance(driver, DiLu)
    choice = driver.decide(world)
    assert (choice.failure, choice.action) == (failure, "SLOWER")
    assert server.asked == []


def test_names_and_their_options(server: ModelServer) -> None:
    driver = policy(f"dilu:org/model:7b@{server.url}#hold=5&shots=1&deadline=2.5&default=IDLE")
    assert isinstance(driver, DiLu)
    assert driver.name == "dilu:org/model:7b"
    assert (driver.hold, driver.shots, driver.deadline, driver.default) == (5, 1, 2.5, "IDLE")
    assert located("dilu:m", "http://h/v1") == "dilu:m@http://h/v1"
    assert located("dilu:m#hold=5", "http://h/v1") == "dilu:m@http://h/v1#hold=5"
    assert located("dilu:m@http://g/v1", "http://h/v1") == "dilu:m@http://g/v1"
    assert located("dilu:m", None) == "dilu:m"
    assert located("idle", "http://h/v1") == "idle"


@pytest.mark.parametrize(
    ("name", "error", "message"),
    [
        ("dilu:", RankerError, "no model"),
        ("dilu:m", RankerError, "no API key"),
        ("dilu:m@http://h/v1#speed=3", SettingsError, "'speed=3' cannot be read"),
        ("dilu:m@http://h/v1#hold=x", SettingsError, "'hold=x' cannot be read"),
        ("dilu:m@http://h/v1#hold=0", SettingsError, "hold = 0"),
        ("dilu:m@http://h/v1#deadline=0", RankerError, "deadline = 0"),
        ("dilu:m@http://h/v1#default=STOP", SettingsError, "default = STOP"),
        ("dilu:m@http://h/v1#embedding=bert", SettingsError, "embedding = bert"),
        ("dilu:m@http://h/v1#embedding=openai:", RankerError, "no model named"),
        ("dilu:m@http://h/v1#memory=nowhere.json", SettingsError, "nowhere.json"),
        ("dil", SettingsError, "dilu:MODEL"),
    ],
)
def test_bad_names(name: str, error: type[Exception], message: str) -> None:
    with pytest.raises(error, match=message) as caught:
        policy(name)
    assert "\n" not in str(caught.value)


def test_a_row_of_the_closed_loop_table(
    server: ModelServer, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    server.says("#### 4")
    words = ["--settings", "1", "--seeds", "2421", "--workers", "1", "--json"]
    words += ["--out", str(tmp_path)]
    drivers = ["--driver", "dilu:m", "--rows", "slower dilu*", "--base-url", server.url]
    assert main(["evaluate", "closed-loop", *drivers, *words]) == 0
    slower, dilu = json.loads(capsys.readouterr().out)["rows"]
    assert slower.pop("row") == "slower"
    assert dilu.pop("row").startswith("dilu:m")
    assert (slower.pop("paper"), dilu.pop("paper")["method"]) == (None, "DiLu")
    assert slower.pop("usage") is None
    assert dilu.pop("usage")["requests"] == dilu["episodes"] * 30
    assert slower == dilu
    assert len(server.asked) == 30
