"""A chat server on the loopback interface that takes its time, as a language model does.

It reads what it has not read before, then writes the reasoning, then the ranking, as far as the
schema asks for them. What it has read and written it remembers (a prefix cache).
"""

from __future__ import annotations

import contextlib
import json
import threading
import time
from collections.abc import Iterator
from dataclasses import dataclass, field
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any

from loopback import serving

PIECES = 20
"""A text is written in so many pieces."""


@dataclass
class Request:
    """One request, and what became of it. Times are on the clock `time.monotonic`."""

    body: dict[str, Any]
    begin: float
    read: int = 0
    """Characters that were new."""
    end: float | None = None
    """When the last piece was sent; None if the client hung up before."""

    @property
    def schema(self) -> dict[str, Any]:
        schema: dict[str, Any] = self.body["response_format"]["json_schema"]["schema"]
        return schema

    @property
    def admitted(self) -> set[tuple[str, str]]:
        """The pairs that its schema admits; none where it does not ask for a ranking."""
        if "ranking" not in self.schema["properties"]:
            return set()
        items = self.schema["properties"]["ranking"]["items"]
        return {
            (lon, lat)
            for branch in items.get("anyOf", [items])
            for lon in branch["properties"]["longitudinal"]["enum"]
            for lat in branch["properties"]["lateral"]["enum"]
        }


@dataclass
class Pace:
    """How long it takes to read 1000 characters, to write a reasoning, and a ranking [s].

    `structured` False: a server that ignores `response_format`, and always writes both parts.
    """

    read: float = 0.0
    reason: float = 0.0
    rank: float = 0.0
    remembers: bool = True
    structured: bool = True
    preference: list[tuple[str, str]] = field(default_factory=list)
    """Pairs that it likes best, where the schema admits them."""


class SlowServer(ThreadingHTTPServer):
    daemon_threads = True

    def __init__(self, pace: Pace) -> None:
        super().__init__(("127.0.0.1", 0), Handler)
        self.pace = pace
        self.requests: list[Request] = []
        self.known: list[str] = []
        self.lock = threading.Lock()

    @property
    def url(self) -> str:
        return f"http://127.0.0.1:{self.server_port}/v1"


@contextlib.contextmanager
def slow_server(pace: Pace) -> Iterator[SlowServer]:
    server = SlowServer(pace)
    with serving(server):
        yield server


class Handler(BaseHTTPRequestHandler):
    protocol_version = "HTTP/1.1"
    server: SlowServer

    def log_message(self, *args: object) -> None:
        """Silent."""

    def do_POST(self) -> None:
        body = json.loads(self.rfile.read(int(self.headers["content-length"])))
        request = Request(body, time.monotonic())
        with self.server.lock:
            self.server.requests.append(request)
        self.close_connection = True
        with contextlib.suppress(BrokenPipeError, ConnectionResetError):
            self.answer(request)
            request.end = time.monotonic()

    def answer(self, request: Request) -> None:
        pace = self.server.pace
        text = "".join(
            m["content"] if isinstance(m["content"], str) else json.dumps(m["content"])
            for m in request.body["messages"]
        )
        with self.server.lock:
            known = max((len(k) for k in self.server.known if text.startswith(k)), default=0)
        request.read = len(text) - known
        time.sleep(pace.read * request.read / 1000)
        self.send_response(200)
        self.send_header("content-type", "text/event-stream")
        self.send_header("connection", "close")
        self.end_headers()
        if "response_format" not in request.body:
            self.write("The road ahead is free.\n#### 1", pace.reason + pace.rank)
            self.wfile.write(b"data: [DONE]\n\n")
            return
        parts = list(request.schema["properties"]) if pace.structured else ["reasoning", "ranking"]
        written = ""
        for part in parts:
            if part == "reasoning":
                piece, took = '"reasoning": "The road ahead is free."', pace.reason
            else:
                piece, took = f'"ranking": {json.dumps(self.ranking(request))}', pace.rank
            piece = ("{" if not written else ", ") + piece
            self.write(piece, took)
            written += piece
        self.write("}", 0.0)
        if pace.remembers:
            with self.server.lock:
                self.server.known.append(text + written + "}")
        self.wfile.write(b"data: [DONE]\n\n")

    def ranking(self, request: Request) -> list[dict[str, str]]:
        pace = self.server.pace
        admitted = request.admitted if pace.structured else set(pace.preference)
        best = [pair for pair in pace.preference if pair in admitted]
        best += sorted(admitted - set(best))
        ranking = request.schema["properties"].get("ranking", {"maxItems": 3})
        return [{"longitudinal": lon, "lateral": lat} for lon, lat in best[: ranking["maxItems"]]]

    def write(self, text: str, seconds: float) -> None:
        size = -(-len(text) // PIECES)
        for at in range(0, len(text), size):
            time.sleep(seconds * min(size, len(text) - at) / len(text))
            delta = {"content": text[at : at + size]}
            chunk = {"choices": [{"index": 0, "delta": delta, "finish_reason": None}]}
            self.wfile.write(f"data: {json.dumps(chunk)}\n\n".encode())
            self.wfile.flush()
