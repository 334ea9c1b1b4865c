"""A server on the loopback interface that does all that a chat server should not do.

It runs in a process of its own, so that its work is not counted as ours. What it plays is named by
the first part of the path: `http://127.0.0.1:PORT/stalls/v1`. One table, `CASES`, says what each
play must come to.
"""

from __future__ import annotations

import contextlib
import gzip
import itertools
import json
import re
import socket
import struct
import subprocess
import sys
import threading
import time
import urllib.request
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from email.utils import formatdate
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any
from urllib.parse import quote

LONGEST = 6.0
"""A play that never ends gives up after this, long after every deadline [s]."""
GOOD = [("accelerate", "follow-lane"), ("keep", "follow-lane"), ("stop", "follow-lane")]

Play = Callable[["Handler"], None]


@dataclass(frozen=True)
class Case:
    """What is played, request by request (the last is repeated), and what it must come to.

    `failure` by its name, None for none; `pairs`: how many of `GOOD` are ranked. `waits`: it takes
    the whole deadline.
    """

    plays: tuple[Play, ...]
    failure: str | None
    pairs: int = 0
    waits: bool = False


class Handler(BaseHTTPRequestHandler):
    protocol_version = "HTTP/1.1"
    server: Server

    def do_POST(self) -> None:
        self.rfile.read(int(self.headers["content-length"]))
        name = re.match(r"/([a-z0-9-]*)~?\w*/", self.path)
        with self.server.lock:
            place = self.server.asked[self.path]
            self.server.asked[self.path] += 1
        self.close_connection = True
        if name is None:
            return
        plays = CASES[name[1]].plays
        # The client hangs up at its deadline, as it should.
        with contextlib.suppress(BrokenPipeError, ConnectionResetError):
            plays[min(place, len(plays) - 1)](self)

    def do_GET(self) -> None:
        """How often a path was posted to."""
        told = str(self.server.asked[self.path]).encode()
        self.send_response(200)
        self.send_header("content-length", str(len(told)))
        self.end_headers()
        self.wfile.write(told)

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
        self.asked: Counter[str] = Counter()
        self.lock = threading.Lock()


def answer(*pairs: tuple[str, str], reasoning: str = "free road") -> str:
    ranking = [{"longitudinal": lon, "lateral": lat} for lon, lat in pairs]
    return json.dumps({"reasoning": reasoning, "ranking": ranking}, ensure_ascii=False)


def stream(text: str, finish: str | None = "stop", step: int = 7, usage: Any = None) -> Play:
    """The text in small pieces, as a model writes it."""

    def play(handler: Handler) -> None:
        handler.begin()
        for at in range(0, len(text), step):
            handler.chunk(text[at : at + step])
        if finish is not None:
            handler.chunk(finish=finish)
        handler.event({"choices": [], "usage": usage or {"total_tokens": 7}})
        handler.wfile.write(b"data: [DONE]\n\n")

    return play


def body(data: object, status: int = 200, kind: str = "application/json", **headers: str) -> Play:
    def play(handler: Handler) -> None:
        handler.begin(status, kind, **headers)
        handler.wfile.write(data if isinstance(data, bytes) else json.dumps(data).encode())

    return play


def whole(text: str | None, finish: str = "stop", **message: object) -> Play:
    choice = {"index": 0, "message": {"content": text, **message}, "finish_reason": finish}
    return body({"choices": [choice]})


def error(status: int, message: str = "sorry", **headers: str) -> Play:
    return body({"error": {"message": message}}, status, **headers)


def until_longest(pause: float) -> Iterator[int]:
    """Counts, with a pause after each number, for no longer than `LONGEST`."""
    end = time.monotonic() + LONGEST
    for n in itertools.count():
        yield n
        time.sleep(pause)
        if time.monotonic() > end:
            return


def stall(handler: Handler) -> None:
    time.sleep(LONGEST)


def then_stall(*plays: Play) -> Play:
    def play(handler: Handler) -> None:
        for part in plays:
            part(handler)
            handler.wfile.flush()
        stall(handler)

    return play


def raw(*parts: bytes, pause: float = 0.0, endless: bool = False) -> Play:
    """Bytes instead of a response; `endless` repeats the last ones."""

    def play(handler: Handler) -> None:
        for part in parts:
            handler.wfile.write(part)
        for _ in until_longest(pause) if endless else ():
            handler.wfile.write(parts[-1])

    return play


def events(*bodies: object) -> Play:
    def play(handler: Handler) -> None:
        handler.begin()
        for each in bodies:
            handler.event(each)

    return play


def endless(make: Callable[[Handler], None], pause: float) -> Play:
    def play(handler: Handler) -> None:
        handler.begin()
        for _ in until_longest(pause):
            make(handler)

    return play


def hang_up(handler: Handler) -> None:
    handler.connection.close()


def reset(handler: Handler) -> None:
    handler.connection.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
    handler.connection.close()


def hang_up_after(text: str) -> Play:
    """With a length in its head that it does not keep."""

    def play(handler: Handler) -> None:
        handler.begin(content_length="100000")
        handler.chunk(text)

    return play


def chunked(data: bytes, size: int, last: bytes = b"0\r\n\r\n") -> Play:
    """A stream of events in chunks of a few bytes, without regard to characters and lines."""

    def play(handler: Handler) -> None:
        handler.begin(transfer_encoding="chunked")
        for at in range(0, len(data), size):
            piece = data[at : at + size]
            handler.wfile.write(f"{len(piece):x}\r\n".encode() + piece + b"\r\n")
        handler.wfile.write(last)

    return play


def as_events(text: str) -> bytes:
    choice = {"index": 0, "delta": {"content": text}, "finish_reason": "stop"}
    told = json.dumps({"choices": [choice]}, ensure_ascii=False)
    return f"data: {told}\n\ndata: [DONE]\n\n".encode()


def refuse(handler: Handler) -> None:
    handler.begin()
    handler.chunk(refusal="I cannot ")
    handler.chunk(refusal="help with that.")
    handler.chunk(finish="stop")


def megabytes(n: int, piece: str) -> Play:
    def play(handler: Handler) -> None:
        handler.begin()
        for _ in range(10 * n):
            handler.chunk(piece * (100_000 // len(piece)))

    return play


def retry_at(seconds: float) -> Play:
    def play(handler: Handler) -> None:
        error(429, retry_after=formatdate(time.time() + seconds, usegmt=True))(handler)

    return play


def head(text: str = "HTTP/1.1 200 OK\r\ncontent-type: text/event-stream\r\n") -> bytes:
    return text.encode()


ALL = answer(*GOOD)
CUT = ALL[:-40]
"""Breaks off within the third pair."""
CAR = answer(*GOOD, reasoning="Straße frei – überholen? 🚗💨 日本")
NESTS = '{"a":[1,' * 200 + "1," * 90_000
"""Object within object, none of which ends: each costs as much as all that follows."""
BOMB = gzip.compress(b" " * 50_000_000)

# name: what is played, request by request; which failure; how many pairs; takes the whole deadline
CASES: dict[str, Case] = {
    # What is as it should be, or nearly
    "good": Case((stream(ALL),), None, 3),
    "good-by-the-byte": Case((stream(ALL, step=1),), None, 3),
    "good-in-one-body": Case((whole(ALL),), None, 3),
    "good-in-an-essay": Case((whole(f"I think:\n```json\n{ALL}\n```"),), None, 3),
    "good-on-the-second-try": Case((error(503), whole(ALL)), None, 3),
    "good-after-a-hang-up": Case((hang_up, whole(ALL)), None, 3),
    "good-after-429": Case((error(429), stream(ALL)), None, 3),
    "good-after-a-moment": Case((error(429, retry_after="0.05"), whole(ALL)), None, 3),
    "good-after-a-date": Case((retry_at(0.0), whole(ALL)), None, 3),
    "good-but-no-end": Case((then_stall(stream(ALL, finish=None)),), None, 3),
    "good-then-endless": Case(
        (raw(head() + b"\r\n" + as_events(ALL)[:-14], b": still here\n\n", endless=True),),
        None,
        3,
        True,
    ),
    "good-then-silence": Case(
        (then_stall(raw(head(), b"\r\n", as_events(ALL)[:-14])),), None, 3, True
    ),
    "good-in-odd-chunks": Case((chunked(as_events(CAR), 1),), None, 3),
    "good-in-odder-chunks": Case((chunked(as_events(CAR), 3),), None, 3),
    "good-with-nonsense-counts": Case(
        (stream(ALL, usage={"prompt_tokens": -3, "completion_tokens": "many"}),), None, 3
    ),
    # Too slow
    "stalls": Case((stall,), "timeout", 0, True),
    "head-then-silence": Case((then_stall(raw(head(), b"\r\n")),), "timeout", 0, True),
    "half-a-head": Case((then_stall(raw(head())),), "timeout", 0, True),
    "drips-its-head": Case((raw(b"H", pause=0.05, endless=True),), "timeout", 0, True),
    "drips-a-body": Case(
        (
            raw(
                head().replace(b"text/event-stream", b"application/json"),
                b"\r\n",
                b" ",
                pause=0.05,
                endless=True,
            ),
        ),
        "timeout",
        0,
        True,
    ),
    "a-token-each-second": Case((endless(lambda h: h.chunk("The "), 1.0),), "timeout", 0, True),
    "drips-tokens": Case((endless(lambda h: h.chunk("The "), 0.02),), "timeout", 0, True),
    "drips-reasoning": Case(
        (endless(lambda h: h.chunk(reasoning_content="hm "), 0.02),), "timeout", 0, True
    ),
    "drips-white-space": Case((endless(lambda h: h.chunk("\n"), 0.02),), "timeout", 0, True),
    "drips-comments": Case(
        (endless(lambda h: h.wfile.write(b": wait\n\n") and None, 0.02),), "timeout", 0, True
    ),
    "drips-an-error": Case(
        (raw(head("HTTP/1.1 500 No\r\n\r\n"), b"a", pause=0.05, endless=True),),
        "timeout",
        0,
        True,
    ),
    "says-100-continue": Case(
        (raw(b"HTTP/1.1 100 Continue\r\n\r\n", pause=0.02, endless=True),), "timeout", 0, True
    ),
    "stalls-within-the-ranking": Case(
        (then_stall(raw(head(), b"\r\n", as_events(CUT)[:-14])),), "timeout", 2, True
    ),
    "stalls-within-nests-of-objects": Case(
        (then_stall(raw(head(), b"\r\n", as_events(NESTS)[:-14])),), "timeout", 0, True
    ),
    # Gone
    "hangs-up": Case((hang_up,), "unreachable"),
    "resets": Case((reset,), "unreachable"),
    "hangs-up-in-its-head": Case((raw(head()),), "unreachable"),
    "hangs-up-before-a-word": Case((raw(head(), b"content-length: 99\r\n\r\n"),), "unreachable"),
    "hangs-up-within-the-ranking": Case((hang_up_after(CUT),), "truncated", 2),
    "ends-within-the-ranking": Case((raw(head(), b"\r\n", as_events(CUT)[:-14]),), "truncated", 2),
    "lies-about-a-chunk": Case((chunked(as_events(CUT)[:-14], 50, b"zz\r\n"),), "truncated", 2),
    "speaks-no-http": Case((raw(bytes(range(256)) * 10),), "unreachable"),
    "head-of-a-megabyte": Case((raw(head(), b"x: " + b"y" * 10**6 + b"\r\n\r\n"),), "unreachable"),
    # Errors
    "429": Case((error(429),), "rate-limited"),
    "429-for-an-hour": Case((error(429, retry_after="3600"),), "rate-limited"),
    "429-until-tomorrow": Case((retry_at(86400.0),), "rate-limited"),
    "429-at-no-known-time": Case((error(429, retry_after="soon"),), "rate-limited"),
    "429-for-minus-an-hour": Case((error(429, retry_after="-3600"),), "rate-limited"),
    "500": Case((error(500),), "server-error"),
    "503": Case((error(503),), "server-error"),
    "503-for-an-hour": Case((error(503, retry_after="3600"),), "server-error"),
    "502-in-html": Case((body(b"<html>Bad Gateway", 502, "text/html"),), "server-error"),
    "500-of-ten-megabytes": Case((body(b"x" * 10**7, 500),), "server-error"),
    "500-nested": Case((body(b"[" * 100_000, 500),), "server-error"),
    "500-without-end": Case(
        (raw(head("HTTP/1.1 500 No\r\n\r\n"), b"a" * 1000, endless=True),), "server-error"
    ),
    "400": Case((error(400, "no such thing"),), "rejected"),
    "401": Case((error(401),), "rejected"),
    "404": Case((error(404, "no such model"),), "rejected"),
    "redirects": Case((body(b"", 307, location="http://127.0.0.1:9/v1"),), "rejected"),
    "redirects-in-a-circle": Case((body(b"", 302, location="/v1"),), "rejected"),
    "error-in-the-stream": Case((body({"error": {"message": "no memory"}}),), "server-error"),
    "error-within-the-ranking": Case(
        (events({"choices": [{"delta": {"content": CUT}}]}, {"error": {"message": "no memory"}}),),
        "truncated",
        2,
    ),
    "error-without-words": Case((events({"error": [[[]]]}),), "server-error"),
    # No completion
    "no-body": Case((body(b""),), "malformed"),
    "html": Case((body(b"<html>"),), "malformed"),
    "other-json": Case((body({"hello": "world"}),), "malformed"),
    "a-list": Case((body([1, 2]),), "malformed"),
    "odd-types": Case((events({"choices": [{"delta": [], "finish_reason": 3}]}),), "empty"),
    "no-choices": Case((body({"choices": []}),), "empty"),
    "a-tool-call": Case((whole(None, "tool_calls", tool_calls=[{"id": 1}]),), "empty"),
    "bad-utf8": Case((raw(head(), b"\r\ndata: {\xff\xfe\n\n"),), "malformed"),
    "bad-utf8-in-a-body": Case((body(b'{"choices": "\xff\xc0"}'),), "malformed"),
    "nested-body": Case((body(b"[" * 100_000),), "malformed"),
    "nested-event": Case((raw(head(), b"\r\ndata: " + b'{"a":' * 100_000 + b"\n\n"),), "malformed"),
    "huge-number": Case((body(b'{"choices": ' + b"9" * 100_000 + b"}"),), "malformed"),
    "gzip": Case((body(gzip.compress(b"{}"), content_encoding="gzip"),), "malformed"),
    "gzip-bomb": Case((body(BOMB, content_encoding="gzip"),), "malformed"),
    "gzip-bomb-500": Case((body(BOMB, 500, content_encoding="gzip"),), "malformed"),
    # Another answer than was asked for
    "invalid-json": Case((whole("{'ranking': none}"),), "malformed"),
    "other-schema": Case((whole('{"action": "keep"}'),), "malformed"),
    "essay": Case((whole("First I would look around."),), "malformed"),
    "truncated": Case((stream(CUT, finish="length"),), "truncated", 2),
    "truncated-early": Case((whole('{"reasoning": "We', finish="length"),), "truncated"),
    "refusal": Case((refuse,), "refused"),
    "refusal-in-one-body": Case((whole(None, refusal="No."),), "refused"),
    "content-filter": Case((whole("", finish="content_filter"),), "refused"),
    "empty": Case((whole(""),), "empty"),
    "no-content": Case((whole(None),), "empty"),
    "empty-list": Case((whole(answer()),), "empty"),
    "duplicates": Case((whole(answer(GOOD[0], GOOD[0], GOOD[1])),), None, 2),
    "one-infeasible": Case((whole(answer(("keep", "left-lane"), GOOD[0])),), None, 1),
    "infeasible": Case((whole(answer(("keep", "left-lane"))),), "infeasible"),
    "unknown-word": Case((whole(answer(("hover", "follow-lane"))),), "infeasible"),
    "nested-answer": Case((stream("[" * 100_000, step=1000),), "malformed"),
    "nests-of-objects": Case((stream(NESTS, step=1000),), "truncated"),
    "huge-number-in-the-answer": Case(
        (whole('{"ranking": [' + "9" * 100_000 + "]}"),), "malformed"
    ),
    "infinite-number-in-the-answer": Case((whole('{"ranking": [1e999, NaN]}'),), "infeasible"),
    # Too much
    "ten-megabytes": Case((megabytes(10, "x"),), "truncated"),
    "ten-megabytes-of-brackets": Case((megabytes(10, '{"'),), "truncated"),
    "ten-megabytes-of-white-space": Case((megabytes(10, " "),), "truncated"),
    "ten-megabytes-in-one-event": Case((events({"choices": "x" * 10**7}),), "truncated"),
    "ten-megabytes-in-one-body": Case((whole("x" * 10**7),), "truncated"),
    "ten-megabytes-of-numbers": Case((body(b"[" + b"1," * 5_000_000),), "truncated"),
    "endless-reasoning": Case(
        (endless(lambda h: h.chunk(reasoning_content="hm " * 30_000), 0.0),), "truncated"
    ),
}


class Hostile:
    """The server's process, as tests see it."""

    def __init__(self) -> None:
        self._process = subprocess.Popen(
            [sys.executable, __file__], stdout=subprocess.PIPE, stdin=subprocess.PIPE, text=True
        )
        assert self._process.stdout is not None
        self.port = int(self._process.stdout.readline())
        self._count = itertools.count()

    def url(self, name: str) -> str:
        """An address that plays the case, and that nobody has asked yet."""
        return f"http://127.0.0.1:{self.port}/{quote(name)}~{next(self._count)}/v1"

    def asked(self, url: str) -> int:
        """How often this address was asked."""
        with urllib.request.urlopen(f"{url}/chat/completions", timeout=10.0) as found:
            return int(found.read())

    def stop(self) -> None:
        """End it."""
        self._process.kill()
        self._process.communicate()


@contextlib.contextmanager
def hostile_server() -> Iterator[Hostile]:
    server = Hostile()
    try:
        yield server
    finally:
        server.stop()


def main() -> None:
    server = Server()
    threading.Thread(target=server.serve_forever, args=(0.05,), daemon=True).start()
    print(server.server_port, flush=True)
    sys.stdin.read()  # ends with whoever started it


if __name__ == "__main__":
    main()
