"""Answers kept on disk."""

import json
import multiprocessing
import os
import stat
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

import sandra
from chat_server import ChatServer, chat_server
from hostile_server import CASES, GOOD, answer, error, hostile_server, stream, whole
from sandra.actions import ActionPair
from sandra.cli import main
from sandra.describe import Prompt, describe
from sandra.errors import RankerError
from sandra.rankers import Ranking, Usage, create
from sandra.rankers.cache import Cache, Kept
from straight_road import Road

SCENE = Road().scene()
PROMPT = describe(SCENE, "drive faster")
PAIRS = tuple(ActionPair.of(*pair) for pair in GOOD)
ALL = answer(*GOOD, reasoning="Straße frei \ud83d\ude97")


pytestmark = pytest.mark.usefixtures("no_openai_key")


@pytest.fixture
def server() -> Iterator[ChatServer]:
    with chat_server(stream(ALL)) as server:
        yield server


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    return tmp_path / "answers"


def rank(
    server: ChatServer, folder: Path | None, prompt: Prompt = PROMPT, **how: object
) -> Ranking:
    spec = str(how.pop("spec", "openai:m"))
    return create(spec, base_url=server.url, cache=folder, **how).rank(prompt, 6.0)  # type: ignore[arg-type]


def test_off_unless_it_is_asked_for(server: ChatServer, folder: Path) -> None:
    assert rank(server, None) == rank(server, None)
    assert len(server.requests) == 2
    assert not folder.exists()


def test_the_same_question_is_asked_once(server: ChatServer, folder: Path) -> None:
    first, second = rank(server, folder), rank(server, folder)
    assert len(server.requests) == 1
    assert first.pairs == second.pairs == PAIRS
    assert second.reasoning == "Straße frei 🚗"
    assert (first.answer, first.reasoning) == (second.answer, second.reasoning)
    assert (first.cached, second.cached) == (False, True)
    assert second.usage == Usage(from_cache=1)
    (file,) = folder.iterdir()
    kept = json.loads(file.read_text(encoding="utf-8"))
    assert kept["answer"] == first.answer
    assert kept["question"]["model"] == "m"
    assert kept["question"]["system"] == PROMPT.system
    assert kept["question"]["turns"] == [["user", PROMPT.user]]
    assert kept["question"]["schema"] == PROMPT.schema
    assert kept["question"]["endpoint"] == f"{server.url}/chat/completions"
    assert second.recorded_s == kept["duration_s"] > 0.0


def test_a_decision_tells_both_durations(server: ChatServer, folder: Path) -> None:
    ranker = create("openai:m", base_url=server.url, cache=folder)
    first, second = (sandra.decide(SCENE, ranker, horizon=4).to_dict() for _ in range(2))
    assert (first["cached"], second["cached"]) == (False, True)
    assert first["recorded_rank_s"] is None
    assert second["recorded_rank_s"] > 0.0
    assert second["durations_s"]["rank"] < 1.0
    assert second["executed"] == first["executed"]
    assert "from the cache on disk" in str(sandra.decide(SCENE, ranker, horizon=4))


@pytest.mark.parametrize("mode", ["verify-first", "repair"])
def test_the_other_modes_keep_both_turns(server: ChatServer, folder: Path, mode: str) -> None:
    ranker = create("openai:m", base_url=server.url, cache=folder)
    first = sandra.decide(SCENE, ranker, horizon=4, mode=mode)
    asked = len(server.requests)
    second = sandra.decide(SCENE, ranker, horizon=4, mode=mode)
    assert len(server.requests) == asked
    assert (first.ranking.cached, second.ranking.cached) == (False, True)
    assert second.ranking.pairs == first.ranking.pairs


def test_whatever_an_answer_depends_on_makes_another_question(
    server: ChatServer, folder: Path
) -> None:
    other = describe(SCENE, "drive slower")
    asked: list[tuple[Prompt, dict[str, Any]]] = [
        (PROMPT, {}),
        (other, {}),
        (describe(SCENE, "drive faster", settings=sandra.Settings(k=2)), {}),
        (PROMPT, {"spec": "openai:n"}),
        (PROMPT, {"temperature": 0.0}),
        (PROMPT, {"temperature": 0.5}),
        (PROMPT, {"seed": 1}),
    ]
    for prompt, how in asked:
        assert not rank(server, folder, prompt, **how).cached
    for prompt, how in asked:
        assert rank(server, folder, prompt, **how).cached
    assert len(server.requests) == len(asked) == len(list(folder.iterdir()))
    with chat_server(stream(ALL)) as elsewhere:
        assert not rank(elsewhere, folder).cached


def test_failures_are_never_kept(folder: Path) -> None:
    slow = ("unreachable", "rate-limited", "server-error")
    bad = [n for n, c in CASES.items() if c.failure and c.failure not in slow and not c.waits]
    with hostile_server() as hostile:
        for name in (*bad, "500", "hangs-up"):
            ranker = create("openai:m", base_url=hostile.url(name), cache=folder)
            assert ranker.rank(PROMPT, 6.0).failure is not None
        # What is whole only because the deadline had passed is not kept either.
        for name in ("good-then-silence", "stalls-within-the-ranking"):
            ranker = create("openai:m", base_url=hostile.url(name), cache=folder)
            assert ranker.rank(PROMPT, 0.5).pairs
    assert list(folder.iterdir()) == []


def test_after_a_failure_the_server_is_asked_again(server: ChatServer, folder: Path) -> None:
    server.plays = [whole("an essay"), stream(ALL)]
    assert rank(server, folder).failure is not None
    assert not rank(server, folder).cached
    assert rank(server, folder).cached


@pytest.mark.parametrize(
    "text",
    [
        "",
        "{",
        "[]",
        "null",
        '{"format": 2}',
        "\x00" * 100,
        "[" * 100_000,
        '{"format": 1, "question": {}, "answer": "x", "duration_s": 1}',
    ],
)
def test_a_broken_file_is_a_miss_with_a_warning(
    server: ChatServer, folder: Path, text: str, caplog: pytest.LogCaptureFixture
) -> None:
    rank(server, folder)
    (file,) = folder.iterdir()
    file.write_text(text, encoding="utf-8")
    again = rank(server, folder)
    assert again.pairs == PAIRS
    assert not again.cached
    assert f"{file}: not used" in caplog.text
    # It is mended by the new answer.
    assert rank(server, folder).cached


@pytest.mark.parametrize("key", ["answer", "duration_s", "question"])
def test_a_file_with_something_else_in_it_is_a_miss(
    server: ChatServer, folder: Path, key: str
) -> None:
    rank(server, folder)
    (file,) = folder.iterdir()
    data = json.loads(file.read_text(encoding="utf-8"))
    for value in (None, {"x": 1}, [1], -1.0):
        file.write_text(json.dumps({**data, key: value}), encoding="utf-8")
        assert not rank(server, folder).cached


def test_an_answer_on_disk_is_read_as_that_of_a_server(server: ChatServer, folder: Path) -> None:
    """Whoever can write there can change the ranking, like the server itself, and no more."""
    rank(server, folder)
    (file,) = folder.iterdir()
    data = json.loads(file.read_text(encoding="utf-8"))
    data["answer"] = answer(("keep", "left-lane"), GOOD[2])
    file.write_text(json.dumps(data), encoding="utf-8")
    ranking = rank(server, folder)
    assert ranking.cached
    assert list(map(str, ranking.pairs)) == ["stop,follow-lane"]


def test_a_folder_that_cannot_be_used(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "file"
    file.write_text("", encoding="utf-8")
    for place in (file, file / "below"):
        with pytest.raises(RankerError, match="choose another --cache"):
            create("openai:m", base_url="http://localhost:1/v1", cache=place)
    words = ["--ranker", "openai:m", "--base-url", "http://localhost:1/v1", "--cache", str(file)]
    assert main(["decide", "merge", *words]) == 2
    assert len(capsys.readouterr().err.splitlines()) == 1


def test_what_cannot_be_written_is_a_warning(
    folder: Path, caplog: pytest.LogCaptureFixture
) -> None:
    cache = Cache(folder)
    cache.file({"a": 1}).mkdir()  # in its way
    cache.put({"a": 1}, Kept("x", 1.0))
    assert "the answer is not kept" in caplog.text
    assert [file.suffix for file in folder.iterdir()] == [".json"]
    cache.put({"a": "\ud800"}, Kept("x", 1.0))
    assert caplog.text.count("the answer is not kept") == 2


def test_files_are_for_their_owner(server: ChatServer, folder: Path) -> None:
    rank(server, folder)
    (file,) = folder.iterdir()
    if os.name == "posix":
        assert stat.S_IMODE(file.stat().st_mode) & 0o077 == 0


def write_many(folder: str, number: int) -> None:
    cache = Cache(folder)
    for n in range(200):
        cache.put({"same": "question"}, Kept(f"{number} {n} " * 2000, 1.0))


def test_writers_do_not_get_in_each_other_s_way(folder: Path) -> None:
    """A reader meets whole answers only, whoever writes."""
    context = multiprocessing.get_context("spawn")
    cache = Cache(folder)
    cache.put({"same": "question"}, Kept("0 0 " * 2000, 1.0))
    writers = [context.Process(target=write_many, args=(str(folder), n)) for n in (1, 2)]
    for writer in writers:
        writer.start()
    while any(writer.is_alive() for writer in writers):
        kept = cache.get({"same": "question"})
        assert kept is not None
        assert len(set(kept.text.split(" "))) <= 3
    for writer in writers:
        writer.join()
        assert writer.exitcode == 0
    assert len(list(folder.iterdir())) == 1


def test_an_error_before_the_answer_is_not_in_the_way(server: ChatServer, folder: Path) -> None:
    server.plays = [error(400, "response_format?"), stream(ALL)]
    assert rank(server, folder).pairs == PAIRS
    # Kept under the question, however it had to be put.
    assert rank(server, folder).cached
