"""A real server on the loopback interface that misbehaves in every way known."""

from __future__ import annotations

import contextlib
import json
import threading
import time
from collections.abc import Callable, Iterator
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any

import pytest

from sandra.actions import ActionPair
from sandra.describe import describe
from sandra.errors import RankerError
from sandra.rankers import Failure, create
from sandra.rankers.chat import ChatRanker
from straight_road import Road

DEADLINE = 0.5
PROMPT = describe(Road().scene(), "drive faster")
GOOD = [("accelerate", "follow-lane"), ("keep", "follow-lane"), ("stop", "follow-lane")]


def answer(*pairs: tuple[str, str]) -> str:
    ranking = [{"longitudinal": lon, "lateral": lat} for lon, lat in pairs]
    return json.dumps({"reasoning": "free road", "ranking": ranking})


class Handler(BaseHTTPRequestHandler):
    """Each request is answered by the next of the server's plays; the last one is repeated."""

    protocol_version = "HTTP/1.1"
    server: Server

    def do_POST(self) -> None:
        body = json.loads(self.rfile.read(int(self.headers["content-length"])))
        with self.server.lock:
            place = min(len(self.server.requests), len(self.server.plays) - 1)
            self.server.requests.append(body)
        self.close_connection = True
        # The client hangs up at its deadline, as it should.
        with contextlib.suppress(BrokenPipeError, ConnectionResetError):
            self.server.plays[place](self)

    def log_message(self, *args: object) -> None:
        """Silent."""

    def begin(self, status: int = 200, kind: str = "text/event-stream", **headers: str) -> None:
        self.send_response(status)
        self.send_header("content-type", kind)
        self.send_header("connection", "close")
        for name, value in headers.items():
            self.send_header(name.replace("_", "-"), value)
        self.end_headers()

    def event(self, body: object) -> None:
        self.wfile.write(f"data: {json.dumps(body)}\n\n".encode())

    def chunk(self, content: str | None = None, finish: str | None = None, **delta: Any) -> None:
        if content is not None:
            delta["content"] = content
        self.event({"choices": [{"index": 0, "delta": delta, "finish_reason": finish}]})


class Server(ThreadingHTTPServer):
    daemon_threads = True

    def __init__(self) -> None:
        super().__init__(("127.0.0.1", 0), Handler)
        self.plays: list[Play] = []
        self.requests: list[dict[str, Any]] = []
        self.lock = threading.Lock()
        self.stopping = threading.Event()

    @property
    def url(self) -> str:
        return f"http://127.0.0.1:{self.server_port}/v1"


Play = Callable[[Handler], None]


@pytest.fixture
def server() -> Iterator[Server]:
    server = Server()
    thread = threading.Thread(target=server.serve_forever, args=(0.01,), daemon=True)
    thread.start()
    yield server
    server.stopping.set()
    server.shutdown()
    server.server_close()
    thread.join()


@pytest.fixture(autouse=True)
def _no_key(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("OPENAI_API_KEY", "OPENAI_BASE_URL"):
        monkeypatch.delenv(name, raising=False)


def stream(text: str, finish: str = "stop", step: int = 7) -> Play:
    def play(handler: Handler) -> None:
        handler.begin()
        for at in range(0, len(text), step):
            handler.chunk(text[at : at + step])
        handler.chunk(finish=finish)
        handler.event({"choices": [], "usage": {"total_tokens": 7}})
        handler.wfile.write(b"data: [DONE]\n\n")

    return play


def body(data: object, status: int = 200, **headers: str) -> Play:
    def play(handler: Handler) -> None:
        handler.begin(status, "application/json", **headers)
        handler.wfile.write(data if isinstance(data, bytes) else json.dumps(data).encode())

    return play


def whole(text: str | None, finish: str = "stop", **message: object) -> Play:
    choice = {"index": 0, "message": {"content": text, **message}, "finish_reason": finish}
    return body({"choices": [choice]})


def error(status: int, message: str = "sorry", **headers: str) -> Play:
    return body({"error": {"message": message}}, status, **headers)


def stall(handler: Handler) -> None:
    handler.server.stopping.wait(10.0)


def stall_after(text: str) -> Play:
    def play(handler: Handler) -> None:
        handler.begin()
        handler.chunk(text)
        stall(handler)

    return play


def drip_events(handler: Handler) -> None:
    handler.begin()
    while not handler.server.stopping.wait(0.02):
        handler.chunk("a")


def drip_body(handler: Handler) -> None:
    handler.begin(kind="application/json")
    while not handler.server.stopping.wait(0.02):
        handler.wfile.write(b" ")


def drip_head(handler: Handler) -> None:
    while not handler.server.stopping.wait(0.02):
        handler.wfile.write(b"H")
        handler.wfile.flush()


def hang_up(handler: Handler) -> None:
    handler.connection.close()


def hang_up_after(text: str) -> Play:
    def play(handler: Handler) -> None:
        handler.send_response(200)
        handler.send_header("content-type", "text/event-stream")
        handler.send_header("content-length", "100000")
        handler.end_headers()
        handler.chunk(text)
        handler.wfile.flush()

    return play


def refuse(handler: Handler) -> None:
    handler.begin()
    handler.chunk(refusal="I cannot ")
    handler.chunk(refusal="help with that.")
    handler.chunk(finish="stop")


def ten_megabytes(handler: Handler) -> None:
    handler.begin()
    for _ in range(100):
        handler.chunk("x" * 100_000)


PAIRS = [ActionPair.of(*pair) for pair in GOOD]
CASES: dict[str, tuple[list[Play], Failure | None, int]] = {
    "good stream": ([stream(answer(*GOOD))], None, 3),
    "good, one byte at a time": ([stream(answer(*GOOD), step=1)], None, 3),
    "good, no stream": ([whole(answer(*GOOD))], None, 3),
    "429, then good": ([error(429), stream(answer(*GOOD))], None, 3),
    "429 for a moment": ([error(429, retry_after="0.01"), whole(answer(*GOOD))], None, 3),
    "503, then good": ([error(503), whole(answer(*GOOD))], None, 3),
    "hangs up, then good": ([hang_up, whole(answer(*GOOD))], None, 3),
    "duplicates": ([whole(answer(GOOD[0], GOOD[0], GOOD[1]))], None, 2),
    "one infeasible": ([whole(answer(("keep", "left-lane"), GOOD[0]))], None, 1),
    "inside an essay": ([whole("I think:\n```json\n" + answer(*GOOD) + "\n```")], None, 3),
    "stalls": ([stall], Failure.TIMEOUT, 0),
    "drips events": ([drip_events], Failure.TIMEOUT, 0),
    "drips a body": ([drip_body], Failure.TIMEOUT, 0),
    "drips its head": ([drip_head], Failure.TIMEOUT, 0),
    "stalls within the ranking": ([stall_after(answer(*GOOD)[:-40])], Failure.TIMEOUT, 2),
    "stalls after the whole answer": ([stall_after(answer(*GOOD))], None, 3),
    "hangs up": ([hang_up], Failure.UNREACHABLE, 0),
    "hangs up within the ranking": ([hang_up_after(answer(*GOOD)[:-40])], Failure.TRUNCATED, 2),
    "429 always": ([error(429)], Failure.RATE_LIMITED, 0),
    "429 for an hour": ([error(429, retry_after="3600")], Failure.RATE_LIMITED, 0),
    "429 at no known time": ([error(429, retry_after="soon")], Failure.RATE_LIMITED, 0),
    "500": ([error(500)], Failure.SERVER_ERROR, 0),
    "503": ([error(503)], Failure.SERVER_ERROR, 0),
    "401": ([error(401)], Failure.REJECTED, 0),
    "404": ([error(404, "no such model")], Failure.REJECTED, 0),
    "error in the stream": (
        [body({"error": {"message": "out of memory"}})],
        Failure.SERVER_ERROR,
        0,
    ),
    "no JSON": ([body(b"<html>")], Failure.MALFORMED, 0),
    "another JSON": ([body({"hello": "world"})], Failure.MALFORMED, 0),
    "a list": ([body([1, 2])], Failure.MALFORMED, 0),
    "invalid JSON": ([whole("{'ranking': none}")], Failure.MALFORMED, 0),
    "another schema": ([whole('{"action": "keep"}')], Failure.MALFORMED, 0),
    "essay": ([whole("First I would look around.")], Failure.MALFORMED, 0),
    "truncated": ([stream(answer(*GOOD)[:-40], finish="length")], Failure.TRUNCATED, 2),
    "truncated early": ([whole('{"reasoning": "We', finish="length")], Failure.TRUNCATED, 0),
    "refusal": ([refuse], Failure.REFUSED, 0),
    "refusal, no stream": ([whole(None, refusal="No.")], Failure.REFUSED, 0),
    "content filter": ([whole("", finish="content_filter")], Failure.REFUSED, 0),
    "empty": ([whole("")], Failure.EMPTY, 0),
    "no content": ([whole(None)], Failure.EMPTY, 0),
    "empty list": ([whole(answer())], Failure.EMPTY, 0),
    "no body": ([body(b"")], Failure.MALFORMED, 0),
    "infeasible": ([whole(answer(("keep", "left-lane")))], Failure.INFEASIBLE, 0),
    "unknown word": ([whole(answer(("hover", "follow-lane")))], Failure.INFEASIBLE, 0),
    "10 MB": ([ten_megabytes], Failure.TRUNCATED, 0),
}


@pytest.mark.parametrize("name", CASES)
def test_whatever_the_server_does_is_named_within_the_deadline(server: Server, name: str) -> None:
    plays, failure, count = CASES[name]
    server.plays = plays
    # Who never ends meets a short deadline; the others get time enough for a busy machine.
    deadline = DEADLINE if name.startswith(("stalls", "drips")) else 3.0
    ranker = ChatRanker("some-model", base_url=server.url, deadline=deadline)
    start = time.monotonic()
    ranking = ranker.rank(PROMPT)
    took = time.monotonic() - start
    assert took < deadline + 0.1
    assert ranking.failure is failure, ranking
    assert len(ranking.pairs) == count
    assert list(ranking.pairs) == PAIRS[:count]
    assert (ranking.detail is None) == (failure is None)
    assert ranking.ranker == "openai:some-model"
    if failure in (Failure.REJECTED, Failure.REFUSED, Failure.INFEASIBLE):
        assert len(server.requests) == 1  # asking again would not help


def test_the_deadline_of_a_call_goes_before_the_one_of_the_ranker(server: Server) -> None:
    server.plays = [stall]
    ranker = ChatRanker("m", base_url=server.url, deadline=60.0)
    start = time.monotonic()
    ranking = ranker.rank(PROMPT, 0.3)
    assert time.monotonic() - start < 0.4
    assert ranking.failure is Failure.TIMEOUT
    assert "0.3 s" in (ranking.detail or "")


def test_what_is_sent(server: Server) -> None:
    server.plays = [whole(answer(*GOOD))]
    create("openai:a:b", base_url=server.url).rank(PROMPT)
    (sent,) = server.requests
    assert sent["model"] == "a:b"
    assert [m["role"] for m in sent["messages"]] == ["system", "user"]
    assert [m["content"] for m in sent["messages"]] == [PROMPT.system, PROMPT.user]
    schema = sent["response_format"]["json_schema"]
    assert (schema["strict"], schema["schema"]) == (True, PROMPT.schema)
    assert sent["stream_options"] == {"include_usage": True}
    assert set(sent) == {"model", "messages", "response_format", "stream", "stream_options"}
    create("openai:m", base_url=server.url, temperature=0.0, seed=4).rank(PROMPT)
    assert (server.requests[-1]["temperature"], server.requests[-1]["seed"]) == (0.0, 4)


def test_a_server_without_structured_outputs_is_told_the_schema_in_words(server: Server) -> None:
    server.plays = [error(400, "Unknown field: response_format"), whole(answer(*GOOD))]
    ranking = ChatRanker("m", base_url=server.url, deadline=3.0).rank(PROMPT)
    assert list(ranking.pairs) == PAIRS
    first, second = server.requests
    assert "response_format" in first
    assert "response_format" not in second
    assert json.dumps(PROMPT.schema, ensure_ascii=False) in second["messages"][0]["content"]
    server.requests.clear()
    server.plays = [error(400, "response_format again")]
    ranking = ChatRanker("m", base_url=server.url, deadline=3.0).rank(PROMPT)
    assert ranking.failure is Failure.REJECTED
    assert len(server.requests) == 2


def test_a_server_that_is_not_there() -> None:
    ranking = ChatRanker("m", base_url="http://127.0.0.1:9/v1", deadline=DEADLINE).rank(PROMPT)
    assert ranking.failure is Failure.UNREACHABLE
    assert "127.0.0.1:9" in (ranking.detail or "")


def test_what_cannot_work_is_refused_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(RankerError, match="OPENAI_API_KEY"):
        create("openai:gpt-4o")
    with pytest.raises(RankerError, match="OPENAI_API_KEY"):
        create("openai:gpt-4o", base_url="https://api.openai.com/v1")
    with pytest.raises(RankerError, match="no model"):
        create("openai:", base_url="http://localhost:1/v1")
    for address in ("localhost:8000", "ftp://x/v1", "http://"):
        with pytest.raises(RankerError, match="http://localhost:8000/v1"):
            create("openai:m", base_url=address)
    for deadline in (0.0, -1.0, float("inf"), float("nan")):
        with pytest.raises(RankerError, match="deadline"):
            create("openai:m", base_url="http://localhost:1/v1", deadline=deadline)
    monkeypatch.setenv("OPENAI_API_KEY", "key")
    assert create("openai:gpt-4o").name == "openai:gpt-4o"
    monkeypatch.delenv("OPENAI_API_KEY")
    monkeypatch.setenv("OPENAI_BASE_URL", "http://localhost:1/v1")
    assert create("openai:m").name == "openai:m"
