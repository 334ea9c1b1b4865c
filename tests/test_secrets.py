"""Keys never reach what is printed, logged, written, drawn or raised.

A server that echoes the key wherever it can, the libraries at their most talkative, and every byte
looked through afterwards.
"""

from __future__ import annotations

import copy
import io
import json
import logging
import os
import pickle
import subprocess
import sys
import traceback
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

import sandra
from chat_server import ChatServer, chat_server
from hostile_server import GOOD, Handler, Play, answer, body, raw, stall
from sandra.cli import main
from sandra.describe import describe
from sandra.errors import RankerError, SandraError
from sandra.evaluation.closed_loop.drive import Drive
from sandra.rankers import Failure, create
from sandra.rankers.chat import ChatRanker
from sandra.rankers.client import address_of
from sandra.rankers.secret import Secret
from straight_road import Road

CANARY = "sk-canary-4bf92f3577b34da6a3ce929d0e0e4736"
PARTS = (CANARY, CANARY[:24], CANARY[8:])
"""None of these, not even most of it."""
SCENE = Road().scene()
PROMPT = describe(SCENE)


@pytest.fixture(autouse=True)
def _key(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("OPENAI_API_KEY", CANARY)
    monkeypatch.delenv("OPENAI_BASE_URL", raising=False)


@pytest.fixture
def server() -> Iterator[ChatServer]:
    with chat_server() as server:
        yield server


def echo(play: Play) -> Play:
    """The play, with the key in the reason phrase and in headers too."""

    def played(handler: Handler) -> None:
        begin = handler.begin

        def louder(*arguments: Any, **headers: str) -> None:
            begin(*arguments, x_echo=f"Bearer {CANARY}", set_cookie=CANARY, **headers)

        handler.begin = louder  # type: ignore[method-assign]
        play(handler)

    return played


def events(*bodies: object, end: str = "data: [DONE]\n\n") -> Play:
    def play(handler: Handler) -> None:
        handler.begin()
        for each in bodies:
            handler.event(each)
        handler.wfile.write(end.encode())

    return play


def said(*pieces: str, **delta: object) -> Play:
    return events(*({"choices": [{"delta": {"content": piece, **delta}}]} for piece in pieces))


GOOD_ANSWER = answer(*GOOD, reasoning=f"Your key is {CANARY}.")
ECHOES: dict[str, Play] = {
    "401": body({"error": {"message": f"Incorrect API key provided: {CANARY}."}}, 401),
    "400-nested": body({"error": {"message": [{"key": CANARY}]}}, 400),
    "429": body({"error": {"message": f"slow down, {CANARY}"}}, 429, retry_after="3600"),
    "500-text": body(f"Traceback: Authorization: Bearer {CANARY}".encode(), 500, "text/plain"),
    "500-cut": body(b"x" * (64_000 - 30) + CANARY.encode(), 500, "text/plain"),
    "redirect": body(b"", 307, location=f"http://{CANARY}@127.0.0.1:9/{CANARY}"),
    "stream-error": events({"error": {"message": f"no such key: {CANARY}"}}),
    "refusal": said("", refusal=f"I will not tell {CANARY}"),
    "essay": said(f"The key is {CANARY}, is it not?"),
    "answer": said(GOOD_ANSWER),
    "answer-in-pieces": said(*GOOD_ANSWER),
    "answer-cut-in-the-key": said(GOOD_ANSWER[: GOOD_ANSWER.index(CANARY) + 30]),
    "pair": said(answer((CANARY, "follow-lane"), *GOOD)),
    "no-http": raw(f"HTTP/9 {CANARY}\r\n\r\n".encode()),
    "not-json": body(CANARY.encode()),
    "encoded": body(b"", content_encoding=CANARY),
}


def leaks(text: str) -> list[str]:
    return [part for part in PARTS if part in text]


@pytest.mark.parametrize("name", ECHOES)
def test_what_a_server_echoes_is_not_told(
    server: ChatServer, name: str, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level(logging.DEBUG)
    server.plays = [echo(ECHOES[name])]
    ranker = create("openai:m", base_url=server.url)
    decision = sandra.decide(SCENE, ranker, horizon=3, deadline=5.0)
    assert server.headers[0]["authorization"] == f"Bearer {CANARY}"
    told = "\n".join(
        (repr(decision.ranking), str(decision), json.dumps(decision.to_dict()), caplog.text)
    )
    assert leaks(told) == []
    assert caplog.records, "the libraries were to be talkative"
    if name in ("answer", "answer-in-pieces"):
        assert "[key]" in (decision.ranking.reasoning or "")
        assert len(decision.ranking.pairs) == 3


def test_an_answer_that_is_late_within_the_key(server: ChatServer) -> None:
    def play(handler: Handler) -> None:
        handler.begin()
        handler.chunk(f'{{"reasoning": "{CANARY[:-3]}')
        handler.wfile.flush()
        stall(handler)

    server.plays = [play]
    ranking = create("openai:m", base_url=server.url).rank(PROMPT, 0.5)
    assert ranking.failure is Failure.TIMEOUT
    assert leaks(repr(ranking)) == []


def test_the_key_is_not_carried_off_by_a_redirect(server: ChatServer) -> None:
    with chat_server(body({"choices": []})) as elsewhere:
        for status in (301, 302, 303, 307, 308):
            server.plays = [body(b"", status, location=f"{elsewhere.url}/chat/completions")]
            ranking = create("openai:m", base_url=server.url).rank(PROMPT, 5.0)
            assert ranking.failure is Failure.REJECTED
            assert "redirects to http://127.0.0.1" in (ranking.detail or "")
    assert elsewhere.requests == []


def test_objects_do_not_tell_the_key(server: ChatServer) -> None:
    server.plays = [ECHOES["answer"]]
    ranker = create("openai:m", base_url=server.url)
    assert isinstance(ranker, ChatRanker)
    ranking = ranker.rank(PROMPT, 5.0)
    shown = [ranker, ranker._endpoint, ranking, Secret(CANARY), sandra.Decider(ranker)]
    for thing in shown:
        assert leaks(f"{thing!r} {thing}") == []
    assert leaks(repr(pickle.dumps(ranking))) == []
    assert leaks(repr(copy.deepcopy(ranking))) == []


def test_a_ranker_that_breaks_tells_no_key_in_its_traceback(
    server: ChatServer, caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    ranker = create("openai:m", base_url=server.url)

    def breaks(*arguments: object) -> None:
        raise ValueError(f"Illegal header value b'Bearer {CANARY}'")

    monkeypatch.setattr("sandra.rankers.endpoint.read", breaks)
    server.plays = [body({})]
    ranking = ranker.rank(PROMPT, 5.0)
    assert ranking.failure is Failure.INTERNAL
    assert "Traceback" in caplog.text
    assert leaks(caplog.text + repr(ranking)) == []


@pytest.mark.parametrize("key", [f"{CANARY}\nX-Evil: 1", f"{CANARY} x", f"{CANARY}é", "\x00" * 9])
def test_a_key_that_is_none_is_refused_without_being_told(
    key: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    if "\x00" in key:
        monkeypatch.setattr(os, "environ", {"OPENAI_API_KEY": key})
    else:
        monkeypatch.setenv("OPENAI_API_KEY", key)
    with pytest.raises(RankerError, match="OPENAI_API_KEY") as caught:
        create("openai:m", base_url="http://localhost:1/v1")
    told = "".join(traceback.format_exception(caught.value))
    assert leaks(told) == []


def test_white_space_around_a_key_is_no_part_of_it(
    server: ChatServer, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("OPENAI_API_KEY", f" {CANARY}\n")
    server.plays = [body({})]
    create("openai:m", base_url=server.url).rank(PROMPT, 5.0)
    assert server.headers[0]["authorization"] == f"Bearer {CANARY}"


BAD_ADDRESSES = (
    f"https://user:{CANARY}@example.org/v1",
    f"https://{CANARY}@example.org/v1",
    f"http://localhost:8000/v1?api_key={CANARY}",
    f"http://localhost:8000/v1#{CANARY}",
    f"user:{CANARY}@example.org",
    f"http://user:{CANARY}@[::1/v1",
    f"http://user:{CANARY}@host:port/v1",
)


@pytest.mark.parametrize("address", BAD_ADDRESSES)
def test_an_address_with_a_secret_in_it_is_refused_before_anything_is_written(
    address: str,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    with pytest.raises(RankerError) as caught:
        address_of(address)
    with pytest.raises(SandraError):
        Drive(ranker="openai:m", base_url=address)
    assert leaks("".join(traceback.format_exception(caught.value))) == []
    out = tmp_path / "run"
    commands = [
        ["decide", "merge", "--ranker", "openai:m"],
        ["drive", "--ranker", "openai:m", "--out", str(out)],
        ["evaluate", "closed-loop", "--rows", "openai*", "--ranker", "openai:m", "--out", str(out)],
        ["evaluate", "closed-loop", "--rows", "dilu*", "--driver", "dilu:m", "--out", str(out)],
    ]
    for words in commands:
        assert main([*words, "--base-url", address]) == 2
    monkeypatch.setenv("OPENAI_BASE_URL", address)
    assert main(commands[0]) == 2
    output = capsys.readouterr()
    assert leaks(output.out + output.err) == []
    assert not out.exists()


# A program around the command line that has everything logged.
TALKATIVE = """
import logging, sys
logging.basicConfig(level=logging.DEBUG, stream=sys.stderr)
from sandra.cli import main
sys.exit(main(sys.argv[1:]))
"""


def run(folder: Path, *words: str) -> subprocess.CompletedProcess[bytes]:
    path = os.pathsep.join(map(os.path.abspath, sys.path))
    environment = {"OPENAI_API_KEY": CANARY, "OPENAI_LOG": "debug", "PYTHONPATH": path}
    return subprocess.run(
        [sys.executable, "-c", TALKATIVE, *words],
        capture_output=True,
        timeout=240,
        cwd=folder,
        env={**os.environ, **environment},
        check=False,
    )


def everything(folder: Path) -> bytes:
    """Every name and every byte below a folder."""
    files = [file for file in sorted(folder.rglob("*")) if file.is_file()]
    assert files
    return b"\n".join(bytes(file) + b"\n" + file.read_bytes() for file in files)


def alternate(request: dict[str, Any], plays: list[Play]) -> Play:
    """By chance, but the same for the same request."""
    return plays[sum(json.dumps(request).encode()) % len(plays)]


def test_an_episode_and_a_decision_leave_no_key_behind(server: ChatServer, tmp_path: Path) -> None:
    pytest.importorskip("highway_env")
    plays = [echo(ECHOES[name]) for name in ("answer", "401", "500-text", "refusal", "pair")]
    server.answer = lambda request: alternate(request, plays)
    asked = ["--ranker", "openai:m", "--base-url", server.url, "--deadline", "5"]
    asked += ["--cache", "cache"]
    drive = run(tmp_path, "drive", "--steps", "6", "--out", "run", *asked)
    assert drive.returncode in (0, 1), drive.stderr[-2000:]
    told = [drive.stdout, drive.stderr]
    decisions = (tmp_path / "run" / "seed-5838" / "decisions.jsonl").read_text(encoding="utf-8")
    assert len(decisions.splitlines()) == 6
    assert "[key]" in decisions
    figures = [f"decision.{ending}" for ending in ("png", "svg", "pdf")]
    for figure in figures:
        decide = run(tmp_path, "decide", "merge", "--figure", figure, *asked)
        assert decide.returncode == 0, decide.stderr[-2000:]
        told += [decide.stdout, decide.stderr]
    as_json = run(tmp_path, "decide", "merge", "--json", "--certificate", "c.json", *asked)
    told += [as_json.stdout, as_json.stderr]
    json.load(io.BytesIO(as_json.stdout))
    assert b"httpcore2" in drive.stderr, "the libraries were to be talkative"
    assert all(h["authorization"] == f"Bearer {CANARY}" for h in server.headers)
    found = everything(tmp_path) + b"\n".join(told)
    for part in PARTS:
        assert part.encode() not in found
    assert list((tmp_path / "cache").glob("*.json")), "something was to be kept"
