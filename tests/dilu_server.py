"""A server on the loopback interface that plays a language model and an embedding model."""

from __future__ import annotations

import contextlib
import json
import threading
from collections.abc import Callable, Iterator
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any

from loopback import serving

Body = dict[str, Any]


class ModelServer(ThreadingHTTPServer):
    """`answer` makes a text of a chat request, `vectors` an answer of an embedding request.

    A number instead of it is an HTTP status, None means that no answer ever comes.
    """

    daemon_threads = True

    def __init__(self) -> None:
        super().__init__(("127.0.0.1", 0), Handler)
        self.answer: Callable[[Body], str | int | None] = lambda body: "#### 1"
        self.vectors: Callable[[list[str]], Any] = lambda texts: 404
        self.asked: list[Body] = []
        self.embedded: list[Body] = []
        self.stopping = threading.Event()

    @property
    def url(self) -> str:
        return f"http://127.0.0.1:{self.server_port}/v1"

    def says(self, *answers: str | int | None) -> None:
        """One answer after the other; the last one is repeated."""
        first = len(self.asked)
        self.answer = lambda body: answers[min(len(self.asked) - first, len(answers)) - 1]


class Handler(BaseHTTPRequestHandler):
    server: ModelServer

    def log_message(self, *args: object) -> None:
        """Silent."""

    def do_POST(self) -> None:
        body = json.loads(self.rfile.read(int(self.headers["content-length"])))
        if self.path.endswith("/embeddings"):
            self.server.embedded.append(body)
            self.send(self.server.vectors(body["input"]))
            return
        self.server.asked.append(body)
        answer = self.server.answer(body)
        if isinstance(answer, str):
            message = {"role": "assistant", "content": answer}
            answer = {"choices": [{"index": 0, "message": message, "finish_reason": "stop"}]}
        self.send(answer)

    def send(self, answer: Any) -> None:
        if answer is None:
            self.server.stopping.wait(10.0)
            return
        status = answer if isinstance(answer, int) else 200
        data = json.dumps({"error": {"message": "no"}} if status != 200 else answer).encode()
        self.send_response(status)
        self.send_header("content-type", "application/json")
        self.send_header("content-length", str(len(data)))
        self.end_headers()
        with contextlib.suppress(BrokenPipeError, ConnectionResetError):
            self.wfile.write(data)


def embeddings(vectors: list[list[float]]) -> Body:
    """The body of an answer with these vectors."""
    data = [{"object": "embedding", "index": i, "embedding": v} for i, v in enumerate(vectors)]
    return {"object": "list", "model": "m", "data": data, "usage": {}}


@contextlib.contextmanager
def model_server() -> Iterator[ModelServer]:
    server = ModelServer()
    with serving(server):
        try:
            yield server
        finally:
            server.stopping.set()
