"""OpenAI's interface for fine-tuning on the loopback interface, after its public description.

It keeps files, jobs and events in memory, checks what it is sent as the provider says that it does
(purpose, JSON lines of messages, at least ten examples, known files and fields), and trains
nothing: each look at a job is one step of the life that `plan` gives it. `faults` are played
first, by method and path: (status, body), or None for a connection that is closed without a word.
"""

from __future__ import annotations

import contextlib
import json
import re
import threading
from collections import defaultdict
from collections.abc import Iterator
from email.parser import BytesParser
from email.policy import HTTP
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any
from urllib.parse import parse_qs, urlsplit

from loopback import serving

KEY = "sk-of-the-tests-alone"
MODEL = "gpt-4.1-mini-2025-04-14"
NEW = {"created_at": 1764000000, "organization_id": "org-123", "result_files": []}
FIELDS = {"model", "training_file", "validation_file", "suffix", "seed", "method", "metadata"}
PLAN = ("validating_files", "queued", "succeeded")
Fault = tuple[int, dict[str, Any] | bytes] | None


def refusal(message: str, code: str | None = None, kind: str = "invalid_request_error") -> Any:
    return {"error": {"message": message, "type": kind, "param": None, "code": code}}


class TuningServer(ThreadingHTTPServer):
    daemon_threads = True

    def __init__(self) -> None:
        super().__init__(("127.0.0.1", 0), _Handler)
        self.key: str | None = KEY
        """None: any will do."""
        self.models = {MODEL}
        self.plan: tuple[str, ...] = PLAN
        self.failure: dict[str, Any] | None = None
        self.steps = 3
        self.faults: dict[str, list[Fault]] = defaultdict(list)
        self.after: dict[str, list[Fault]] = defaultdict(list)
        """Played after the request was carried out: what was done is not told."""
        self.files: dict[str, bytes] = {}
        self.jobs: dict[str, dict[str, Any]] = {}
        self.events: dict[str, list[dict[str, Any]]] = defaultdict(list)
        self.looks: dict[str, int] = defaultdict(int)
        self.seen: list[str] = []
        self.lock = threading.Lock()

    @property
    def url(self) -> str:
        return f"http://127.0.0.1:{self.server_port}/v1"

    def upload(self, content_type: str, body: bytes) -> tuple[int, Any]:
        head = f"content-type: {content_type}\r\n\r\n".encode()
        parts = list(BytesParser(policy=HTTP).parsebytes(head + body).iter_parts())
        named = {p.get_param("name", header="content-disposition"): p for p in parts}
        if named["purpose"].get_payload(decode=True) != b"fine-tune":
            return 400, refusal("purpose")
        content = named["file"].get_payload(decode=True)
        number = f"file-{len(self.files)}"
        self.files[number] = content
        about = {"bytes": len(content), "filename": named["file"].get_filename()}
        told = {"id": number, "object": "file", "purpose": "fine-tune", "status": "processed"}
        return 200, {**told, **about, "created_at": 1764000000}

    def create(self, body: dict[str, Any]) -> tuple[int, Any]:
        if set(body) - FIELDS:
            return 400, refusal(f"Unrecognized request arguments: {sorted(set(body) - FIELDS)}")
        if body["model"] not in self.models:
            words = f"The model `{body['model']}` does not exist or you do not have access to it."
            return 404, refusal(words, "model_not_found")
        for name in ("training_file", "validation_file"):
            if name in body and body[name] not in self.files:
                return 400, refusal(f"invalid {name}: {body[name]}", f"invalid_{name}")
        number = f"ftjob-{len(self.jobs)}"
        chosen = body.get("method", {}).get("supervised", {}).get("hyperparameters", {})
        auto = dict.fromkeys(("n_epochs", "batch_size", "learning_rate_multiplier"), "auto")
        self.jobs[number] = {
            "object": "fine_tuning.job", "id": number, **NEW, **body, "status": "validating_files",
            "fine_tuned_model": None, "trained_tokens": None, "error": None, "finished_at": None,
            "seed": body.get("seed", 42), "hyperparameters": {**auto, **chosen},
        }  # fmt: skip
        self.tell(number, f"Created fine-tuning job: {number}")
        return 200, self.jobs[number]

    def tell(self, number: str, message: str, **data: Any) -> None:
        events = self.events[number]
        events.append(
            {
                "object": "fine_tuning.job.event", "id": f"ftevent-{number}-{len(events)}",
                "created_at": 1764000000 + len(events), "level": "info", "message": message,
                "data": data, "type": "metrics" if data else "message",
            }
        )  # fmt: skip

    def look(self, number: str) -> tuple[int, Any]:
        """One step in the life of a job."""
        job = self.jobs.get(number)
        if job is None:
            return 404, refusal(f"Could not find fine tune: {number}", "fine_tune_not_found")
        if job["status"] in ("succeeded", "failed", "cancelled"):
            return 200, job
        status = self.plan[min(self.looks[number], len(self.plan) - 1)]
        self.looks[number] += 1
        content = self.files[job["training_file"]]
        lines = [json.loads(line) for line in content.splitlines()]
        assert all([m["role"] for m in line["messages"]][-1] == "assistant" for line in lines)
        if len(lines) < 10:
            status, self.failure = "failed", {"code": "invalid_n_examples", "param": None}
        if status == "running":
            step = sum("loss" in event["message"] for event in self.events[number]) + 1
            loss = {"train_loss": 1 / step, "valid_loss": 1.1 / step, "total_steps": self.steps}
            words = f"Step {step}/{self.steps}: training loss={1 / step:.2f}"
            self.tell(number, words, step=step, **loss, train_mean_token_accuracy=0.9)
        job |= {"status": status}
        if status == "succeeded":
            suffix = job.get("suffix", "")
            job |= {
                "fine_tuned_model": f"ft:{job['model']}:org::{suffix}7p4",
                "trained_tokens": 4321,
            }
            self.tell(number, "The job has successfully completed")
        if status == "failed":
            job |= {"error": self.failure}
        return 200, job

    def cancel(self, number: str) -> tuple[int, Any]:
        self.jobs[number]["status"] = "cancelled"
        return 200, self.jobs[number]

    def page(self, items: list[dict[str, Any]], query: dict[str, list[str]]) -> tuple[int, Any]:
        """The newest first."""
        items = items[::-1]
        if "after" in query:
            place = [item["id"] for item in items].index(query["after"][0])
            items = items[place + 1 :]
        limit = min(int(query.get("limit", ["20"])[0]), 4)
        return 200, {"object": "list", "data": items[:limit], "has_more": len(items) > limit}


class _Handler(BaseHTTPRequestHandler):
    protocol_version = "HTTP/1.1"
    server: TuningServer

    def do_POST(self) -> None:
        self._serve("POST", self.rfile.read(int(self.headers.get("content-length", 0))))

    def do_GET(self) -> None:
        self._serve("GET", b"")

    def _serve(self, method: str, body: bytes) -> None:
        parts = urlsplit(self.path)
        what = f"{method} {re.sub(r'ftjob-[^/]+', 'ID', parts.path.removeprefix('/v1'))}"
        server = self.server
        with server.lock:
            server.seen.append(what)
            if server.faults[what]:
                self._answer(server.faults[what].pop(0))
                return
            shown = self.headers["authorization"]
            if server.key is not None and shown != f"Bearer {server.key}":
                words = f"Incorrect API key provided: {shown}."
                self._answer((401, refusal(words, "invalid_api_key")))
                return
            found = self._carry_out(what, parts.path, parse_qs(parts.query), body)
            self._answer(server.after[what].pop(0) if server.after[what] else found)

    def _carry_out(
        self, what: str, path: str, query: dict[str, list[str]], body: bytes
    ) -> tuple[int, Any]:
        server = self.server
        number = next(iter(re.findall(r"ftjob-[^/]+", path)), "")
        if what == "POST /files":
            return server.upload(self.headers["content-type"], body)
        if what == "POST /fine_tuning/jobs":
            return server.create(json.loads(body))
        if what == "GET /fine_tuning/jobs":
            return server.page(list(server.jobs.values()), query)
        if what == "GET /fine_tuning/jobs/ID":
            return server.look(number)
        if what == "GET /fine_tuning/jobs/ID/events":
            return server.page(server.events[number], query)
        if what == "POST /fine_tuning/jobs/ID/cancel":
            return server.cancel(number)
        return 404, refusal(f"Invalid URL ({what})")

    def _answer(self, fault: Fault) -> None:
        self.close_connection = True
        if fault is None:
            return
        status, body = fault
        data = body if isinstance(body, bytes) else json.dumps(body).encode()
        self.send_response(status)
        self.send_header("content-type", "application/json")
        self.send_header("content-length", str(len(data)))
        self.send_header("connection", "close")
        self.end_headers()
        self.wfile.write(data)

    def log_message(self, *args: object) -> None:
        """Silent."""


@contextlib.contextmanager
def tuning_server() -> Iterator[TuningServer]:
    server = TuningServer()
    with serving(server):
        yield server
