"""A model that is tuned at a provider's: what is ordered, what it costs, how far it is.

    OUT/train.jsonl, validation.jsonl   what is uploaded
    OUT/job.json                        the order, the files' hashes and ids, the job and its state
    OUT/events.jsonl                    what the job has told, the oldest first

Each step is in job.json as soon as it is done; who comes back goes on after it.
"""

from __future__ import annotations

import hashlib
import tempfile
import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from pydantic import BaseModel, ValidationError

from sandra.errors import SandraError
from sandra.learn.export import LEAST_EXAMPLES, Exported, export
from sandra.learn.rows import Row
from sandra.learn.tuning.curve import Curve
from sandra.learn.tuning.order import Estimate, Order, usual_passes
from sandra.learn.tuning.provider import Event, Job, Provider
from sandra.rankers.usage import Price

MOST_BYTES = 512_000_000
"""OpenAI takes no larger files."""
EVERY = 10.0
"""So often a job is looked at [s]."""
TRAIN, VALIDATION, RECORD, EVENTS = "train.jsonl", "validation.jsonl", "job.json", "events.jsonl"


class Record(BaseModel):
    """job.json."""

    address: str
    order: dict[str, Any]
    data: dict[str, str] = {}
    """SHA-256 of each uploaded file, by its name."""
    files: dict[str, str] = {}
    """The server's ids of them."""
    job: str | None = None
    state: Job | None = None


class Hosted:
    """A run in a folder. Raises `SandraError` where that cannot be read or written."""

    def __init__(self, out: Path) -> None:
        self.out = out
        self.record: Record | None = None
        file = out / RECORD
        try:
            if file.exists():
                self.record = Record.model_validate_json(file.read_bytes())
        except (OSError, ValidationError):
            raise SandraError(f"{file}: is no job of ours; choose another --out") from None

    def prepare(
        self, rows: Iterable[Row], order: Order, address: str, price: Price | None = None
    ) -> Estimate:
        """Write the files that will be uploaded; what they will cost.

        Raises:
            SandraError: too few examples, too large a file, or a folder with another order in it.
        """
        rows = list(rows)
        try:
            self.out.mkdir(parents=True, exist_ok=True)
            with tempfile.TemporaryDirectory(prefix=".draft", dir=self.out) as draft:
                made = _files(rows, Path(draft))
                data = {name: _sha256(Path(draft, name)) for name in made}
                wanted = Record(address=address, order=asdict(order), data=data)
                if self.record is not None:
                    _refuse_another(self.out, self.record, wanted)
                for name in made:
                    _check_size(Path(draft, name))
                    Path(draft, name).replace(self.out / name)
        except OSError as error:
            raise SandraError(
                f"{self.out}: cannot be written ({error.strerror}); choose another --out"
            ) from None
        if self.record is None:
            self._keep(wanted)
        train, epochs = made[TRAIN], order.epochs or usual_passes(made[TRAIN].examples)
        return Estimate(train, made.get(VALIDATION), epochs, order.epochs is not None, price)

    def adopt(self, number: str, address: str) -> None:
        """Watch a job that was started elsewhere."""
        if self.record is not None and self.record.job not in (None, number):
            raise SandraError(f"{self.out}: holds the job {self.record.job}; choose another --out")
        known = self.record or Record(address=address, order={})
        self._keep(known.model_copy(update={"job": number}))

    def start(self, provider: Provider, say: Callable[[str], None] = lambda words: None) -> str:
        """Upload what is not there yet, and start the job if there is none; its id."""
        record = self._known()
        for name in record.data:
            if name not in record.files:
                say(f"upload {name}")
                number = provider.upload(self.out / name)
                record = record.model_copy(update={"files": {**record.files, name: number}})
                self._keep(record)
        if record.job is None:
            training = record.files[TRAIN]
            # An answer may have been lost; a second job would cost a second time.
            job = provider.job_with(training)
            if job is None:
                say("start the job")
                request = Order(**record.order).request(training, record.files.get(VALIDATION))
                job = provider.create(request)
            record = record.model_copy(update={"job": job.id, "state": job})
            self._keep(record)
        assert record.job is not None
        return record.job

    def watch(
        self,
        provider: Provider,
        say: Callable[[Job, Event | None], None] = lambda job, event: None,
        every: float = EVERY,
    ) -> Job:
        """Until the job is over; `say` is called for each new event, and after each look."""
        number = self._known().job
        assert number is not None
        while True:
            job = provider.job(number)
            for event in self._new_events(provider, number):
                say(job, event)
            say(job, None)
            self._keep(self._known().model_copy(update={"state": job}))
            if job.is_over:
                return job
            time.sleep(every)

    def cancel(self, provider: Provider) -> Job:
        """Stop the job."""
        number = self._known().job
        if number is None:
            raise SandraError(f"{self.out}: no job was started; there is nothing to cancel")
        job = provider.cancel(number)
        self._keep(self._known().model_copy(update={"state": job}))
        return job

    def events(self) -> list[Event]:
        """What was told until now, the oldest first."""
        file = self.out / EVENTS
        if not file.exists():
            return []
        lines = file.read_text(encoding="utf-8").split("\n")[:-1]
        try:
            return [Event.model_validate_json(line) for line in lines]
        except ValidationError:
            raise SandraError(f"{file}: is no list of events of ours; remove it") from None

    def losses(self) -> Curve:
        """What was told of the loss, step by step."""
        log = []
        for event in self.events():
            numbers = {
                "step": event.number("step"),
                "loss": event.number("train_loss"),
                # Of all held-out rows where that is told, else of a batch of them.
                "eval_loss": event.number("full_valid_loss") or event.number("valid_loss"),
            }
            if numbers["step"] is not None:
                log.append({name: value for name, value in numbers.items() if value is not None})
        return Curve.of(sorted(log, key=lambda entry: entry["step"]))

    def _new_events(self, provider: Provider, number: str) -> list[Event]:
        known = {event.id for event in self.events()}
        found: list[Event] = []
        for event in provider.events(number):
            if event.id in known:
                break
            found.append(event)
        found.reverse()
        with (self.out / EVENTS).open("a", encoding="utf-8") as file:
            file.writelines(event.model_dump_json() + "\n" for event in found)
        return found

    def _known(self) -> Record:
        if self.record is None:
            raise SandraError(
                f"{self.out}: there is no job in this folder; name DATA.jsonl and --model, or --job"
            )
        return self.record

    def _keep(self, record: Record) -> None:
        file = self.out / RECORD
        draft = file.with_name(RECORD + ".draft")
        try:
            self.out.mkdir(parents=True, exist_ok=True)
            draft.write_text(record.model_dump_json(indent=1) + "\n", encoding="utf-8")
            draft.replace(file)
        except OSError as error:
            raise SandraError(
                f"{file}: cannot be written ({error.strerror}); choose another --out"
            ) from None
        self.record = record


def _refuse_another(out: Path, known: Record, wanted: Record) -> None:
    old, new = ({**r.order, "server": r.address, "data": r.data} for r in (known, wanted))
    differs = [name for name in new if old.get(name) != new[name]]
    if differs:
        raise SandraError(
            f"{out}: holds a job that differs in {', '.join(differs)}; choose another --out, or "
            "leave the data away to go on watching"
        )


def _files(rows: Sequence[Row], folder: Path) -> dict[str, Exported]:
    """Write what is uploaded; validation only where there is something for it."""
    found = {TRAIN: export(rows, "openai", folder / TRAIN, "train")}
    if found[TRAIN].examples < LEAST_EXAMPLES:
        raise SandraError(
            f"{found[TRAIN].examples} labelled rows for training: OpenAI's fine-tuning takes at "
            f"least {LEAST_EXAMPLES}; record more, or balance less"
        )
    if any(row.is_labelled and row.split == "validation" for row in rows):
        found[VALIDATION] = export(rows, "openai", folder / VALIDATION, "validation")
    return found


def _check_size(path: Path) -> None:
    size = path.stat().st_size
    if size > MOST_BYTES:
        raise SandraError(
            f"{path.name} has {size} bytes, and at most {MOST_BYTES} can be uploaded; balance more"
        )


def _sha256(path: Path) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
