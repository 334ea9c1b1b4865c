"""Named servers: where they are, whose key they see, and what is sent to them."""

from __future__ import annotations

import gc
import json
import warnings
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any

import pytest

from chat_server import chat_server
from hostile_server import body, whole
from loopback import serving
from sandra.describe import describe
from sandra.errors import RankerError
from sandra.rankers import Failure, create
from sandra.rankers.responses import take
from sandra.rankers.stream import Reply
from straight_road import Road

PROMPT = describe(Road().scene(), "drive faster")
ANSWER = json.dumps(
    {
        "reasoning": "free road",
        "ranking": [
            {"longitudinal": action, "lateral": "follow-lane"}
            for action in ("accelerate", "keep", "stop")
        ],
    }
)
KEYS = {"OPENAI_API_KEY": "sk-openai", "VLLM_API_KEY": "sk-vllm"}


@pytest.fixture(autouse=True)
def _environment(monkeypatch: pytest.MonkeyPatch) -> None:
    for server in ("OPENAI", "OLLAMA", "VLLM"):
        for variable in ("API_KEY", "BASE_URL"):
            monkeypatch.delenv(f"{server}_{variable}", raising=False)


@pytest.mark.parametrize("kind", ["openai", "ollama", "vllm"])
def test_the_address_is_that_of_the_call_then_of_the_environment(
    monkeypatch: pytest.MonkeyPatch, kind: str
) -> None:
    with chat_server(whole(ANSWER)) as named, chat_server(whole(ANSWER)) as of_environment:
        monkeypatch.setenv(f"{kind.upper()}_BASE_URL", of_environment.url)
        assert create(f"{kind}:m").rank(PROMPT, 5.0).failure is None
        assert (len(named.requests), len(of_environment.requests)) == (0, 1)
        assert create(f"{kind}:m", base_url=named.url).rank(PROMPT, 5.0).failure is None
        assert (len(named.requests), len(of_environment.requests)) == (1, 1)


@pytest.mark.parametrize(("kind", "port"), [("ollama", 11434), ("vllm", 8000)])
def test_by_default_a_server_is_on_this_machine(kind: str, port: int) -> None:
    ranker: Any = create(f"{kind}:m")  # needs no key
    assert str(ranker._endpoint._client.base_url) == f"http://localhost:{port}/v1/"


@pytest.mark.parametrize(
    ("kind", "seen"), [("openai", "sk-openai"), ("vllm", "sk-vllm"), ("ollama", None)]
)
def test_a_key_is_shown_to_its_own_server_alone(
    monkeypatch: pytest.MonkeyPatch, kind: str, seen: str | None
) -> None:
    for name, key in KEYS.items():
        monkeypatch.setenv(name, key)
    with chat_server(whole(ANSWER)) as server:
        create(f"{kind}:m", base_url=server.url).rank(PROMPT, 5.0)
    (headers,) = server.headers
    told = json.dumps(headers)
    assert [key for key in KEYS.values() if key in told] == ([seen] if seen else [])


def test_options_follow_the_name() -> None:
    with chat_server(whole(ANSWER)) as server:
        ranker = create("ollama:qwen3:4b#temperature=0.5&seed=3", base_url=server.url, seed=9)
        assert ranker.name == "ollama:qwen3:4b#temperature=0.5&seed=3"
        ranker.rank(PROMPT, 5.0)
    (sent,) = server.requests
    assert (sent["model"], sent["temperature"], sent["seed"]) == ("qwen3:4b", 0.5, 3)


@pytest.mark.parametrize(
    ("spec", "message"),
    [
        ("ollama:", "no model named"),
        ("vllm:#seed=1", "no model named"),
        ("ollama:m#speed=1", "with one of api, temperature, seed"),
        ("ollama:m#seed", "option=value"),
        ("ollama:m#seed=x", "write an integer"),
        ("ollama:m#temperature=-1", "at least 0"),
        ("ollama:m#temperature=nan", "finite"),
        ("ollama:m#api=telepathy", "choose from chat, responses"),
    ],
)
def test_a_bad_option_is_refused_in_one_line(spec: str, message: str) -> None:
    with pytest.raises(RankerError, match=message) as caught:
        create(spec)
    assert "\n" not in str(caught.value)


def test_what_responses_is_sent() -> None:
    nothing = {"object": "response", "status": "completed", "output": []}
    with chat_server(body(nothing)) as server:
        ranker = create("openai:m#api=responses&temperature=0", base_url=server.url)
        assert ranker.rank(PROMPT, 5.0).failure is Failure.EMPTY
    (sent,) = server.requests
    assert [m["role"] for m in sent["input"]] == ["system", "user"]
    assert [m["content"] for m in sent["input"]] == [PROMPT.system, PROMPT.user]
    format = sent["text"]["format"]
    assert (format["type"], format["strict"]) == ("json_schema", True)
    assert format["schema"] == PROMPT.schema
    assert set(sent) == {"model", "input", "store", "stream", "temperature", "text"}
    assert sent["store"] is False


@pytest.mark.parametrize(
    ("data", "failure"),
    [
        (b"<html>", Failure.MALFORMED),
        (b"[1, 2]", Failure.MALFORMED),
        (b"null", Failure.MALFORMED),
        (b'{"choices": []}', Failure.MALFORMED),
        (b'{"type": "error", "message": "sorry"}', Failure.SERVER_ERROR),
        (b'{"error": "sorry"}', Failure.SERVER_ERROR),
        (
            b'{"type": "response.failed", "response": {"error": {"message": 7}}}',
            Failure.SERVER_ERROR,
        ),
        (b'{"type": "response.failed", "response": null}', None),
        (b'{"type": "response.output_text.delta", "delta": 7}', None),
        (b'{"type": "response.something.new", "delta": "x"}', None),
        (b'{"object": "response", "output": [null, {"content": 7}, {"content": [3]}]}', None),
        (b"[" * 100_000, Failure.MALFORMED),
    ],
)
def test_whatever_responses_says_is_taken_without_an_exception(
    data: bytes, failure: Failure | None
) -> None:
    reply = Reply()
    take(data, reply)
    assert reply.failure is failure
    assert reply.text == ""


class KeepsOpen(BaseHTTPRequestHandler):
    """Answers, and waits for the next request on the same connection."""

    protocol_version = "HTTP/1.1"

    def log_message(self, *args: object) -> None:
        """Silent."""

    def do_POST(self) -> None:
        self.rfile.read(int(self.headers["content-length"]))
        choice = {"message": {"content": ANSWER}, "finish_reason": "stop"}
        data = json.dumps({"choices": [choice]}).encode()
        self.send_response(200)
        self.send_header("content-type", "application/json")
        self.send_header("content-length", str(len(data)))
        self.end_headers()
        self.wfile.write(data)


def test_a_ranker_that_is_gone_leaves_no_connection_open() -> None:
    server = ThreadingHTTPServer(("127.0.0.1", 0), KeepsOpen)
    server.daemon_threads = True
    with serving(server):
        ranker = create("openai:m", base_url=f"http://127.0.0.1:{server.server_port}/v1")
        assert ranker.rank(PROMPT).failure is None
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            del ranker
            gc.collect()
    assert [str(w.message) for w in caught if w.category is ResourceWarning] == []
