"""A chat server on the loopback interface: it notes what it is asked, and plays what it is told."""

from __future__ import annotations

import contextlib
import json
import threading
from collections.abc import Callable, Iterator
from http.server import ThreadingHTTPServer
from typing import Any

from hostile_server import Handler, Play
from loopback import serving


class ChatServer(ThreadingHTTPServer):
    """Each request is answered by the next of `plays`; the last one is repeated.

    `answer`, if it is set, makes a play of a request's body instead.
    """

    daemon_threads = True

    def __init__(self, *plays: Play) -> None:
        super().__init__(("127.0.0.1", 0), NotingHandler)
        self.plays = list(plays)
        self.answer: Callable[[dict[str, Any]], Play] | None = None
        self.requests: list[dict[str, Any]] = []
        self.headers: list[dict[str, str]] = []
        self.lock = threading.Lock()
        self.under_way = 0
        self.most_at_once = 0

    @property
    def url(self) -> str:
        return f"http://127.0.0.1:{self.server_port}/v1"


class NotingHandler(Handler):
    server: ChatServer  # type: ignore[assignment]

    def do_POST(self) -> None:
        body = json.loads(self.rfile.read(int(self.headers["content-length"])))
        server = self.server
        with server.lock:
            place = min(len(server.requests), len(server.plays) - 1)
            server.requests.append(body)
            server.headers.append({k.lower(): v for k, v in self.headers.items()})
            server.under_way += 1
            server.most_at_once = max(server.most_at_once, server.under_way)
        self.close_connection = True
        with contextlib.suppress(BrokenPipeError, ConnectionResetError):
            play = server.plays[place] if server.answer is None else server.answer(body)
            play(self)
        with server.lock:
            server.under_way -= 1


@contextlib.contextmanager
def chat_server(*plays: Play) -> Iterator[ChatServer]:
    server = ChatServer(*plays)
    with serving(server):
        yield server
