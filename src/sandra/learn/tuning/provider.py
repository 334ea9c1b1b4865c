"""OpenAI's interface for fine-tuning: files, jobs, and what a job tells of itself.

https://platform.openai.com/docs/api-reference/fine-tuning

What a server says is read as data from outside: texts are cut to one line, without the key. A
request that failed in a way that may pass is repeated, except where that could start a second job.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Annotated, Any, TypeVar

from pydantic import AfterValidator, BaseModel, ValidationError

from sandra.describe.outside import one_line
from sandra.errors import RankerError
from sandra.rankers.client import Problem, client_for, problem_of
from sandra.rankers.secret import hidden
from sandra.rankers.types import Failure

T = TypeVar("T")
Read = TypeVar("Read", bound=BaseModel)

ATTEMPTS = 7
"""Of one request, if the first ones fail in a way that may pass."""
LONGEST_PAUSE = 60.0
"""Between two attempts, unless the server asks for more [s]."""
TIMEOUT, UPLOAD_TIMEOUT = 60.0, 1800.0
"""Of one request [s]."""
MOST_EVENTS = 20_000
"""More of one job are not read."""
PAGE = 100

_PASSING = (Failure.RATE_LIMITED, Failure.SERVER_ERROR, Failure.UNREACHABLE, Failure.TIMEOUT)
_MEND = {
    401: "set the variable {key} to a key of this server",
    403: "this key may not fine-tune; use another one, or ask who owns the project",
    404: "check --model, --job and --base-url",
    413: "take fewer rows",
    429: "wait, or raise the limit of your account at the provider",
}


def _line(text: str) -> str:
    return one_line(hidden(text), 400)


Line = Annotated[str, AfterValidator(_line)]


class JobError(BaseModel):
    """Why a job failed."""

    code: Line | None = None
    message: Line | None = None
    param: Line | None = None

    def __str__(self) -> str:
        where = f" ({self.param})" if self.param else ""
        return f"{self.code or 'unknown'}: {self.message or 'no reason was told'}{where}"


class Job(BaseModel):
    """A fine-tuning job at a provider's."""

    id: Line
    status: Line
    model: Line = ""
    training_file: Line = ""
    fine_tuned_model: Line | None = None
    trained_tokens: int | None = None
    estimated_finish: int | None = None
    error: JobError | None = None

    @property
    def is_over(self) -> bool:
        """Whether nothing more will happen."""
        return self.status in ("succeeded", "failed", "cancelled")


class Event(BaseModel):
    """What a job tells of itself: a message, and with it numbers, where it is about a step."""

    id: Line
    created_at: int = 0
    level: Line = "info"
    message: Line = ""
    data: dict[str, Any] | None = None

    def number(self, name: str) -> float | None:
        """A finite number of its data."""
        value = (self.data or {}).get(name)
        if not isinstance(value, int | float) or isinstance(value, bool):
            return None
        return float(value) if abs(value) < 1e12 else None


class _File(BaseModel):
    id: Line


class Provider:
    """One server, as far as fine-tuning goes.

    Args:
        base_url: of the server, up to `/v1`; default: OPENAI_BASE_URL, else OpenAI's.
        pause: before the second attempt, doubled for each further one [s].

    Raises:
        RankerError: no key for OpenAI's own server, or a bad address.
    """

    def __init__(self, base_url: str | None = None, *, pause: float = 1.0) -> None:
        self._client = client_for(base_url)
        self.address = str(self._client.base_url)
        self._pause = pause

    def upload(self, path: Path) -> str:
        """Upload a file for fine-tuning; its id.

        Raises:
            RankerError: whatever goes wrong; here and below it names the request, and how to mend.
        """

        def work() -> Any:
            with path.open("rb") as file:
                return self._client.files.create(
                    file=(path.name, file), purpose="fine-tune", timeout=UPLOAD_TIMEOUT
                )

        return _read(_File, self._ask(f"upload {path.name}", work), "upload").id

    def create(self, request: dict[str, Any]) -> Job:
        """Start a job. Only refused requests are repeated: a lost answer may hide a job."""

        def work() -> Any:
            return self._client.fine_tuning.jobs.create(**request, timeout=TIMEOUT)

        again = (Failure.RATE_LIMITED,)
        return _read(Job, self._ask("start the job", work, again), "start the job")

    def job(self, number: str) -> Job:
        """How a job stands."""

        def work() -> Any:
            return self._client.fine_tuning.jobs.retrieve(number, timeout=TIMEOUT)

        return _read(Job, self._ask(f"read the job {number}", work), "read the job")

    def cancel(self, number: str) -> Job:
        """Stop a job; what was trained until then is lost, and may have to be paid."""

        def work() -> Any:
            return self._client.fine_tuning.jobs.cancel(number, timeout=TIMEOUT)

        return _read(Job, self._ask(f"cancel the job {number}", work), "cancel the job")

    def job_with(self, training_file: str) -> Job | None:
        """The latest job on an uploaded file, if one is among the last ones of this account."""

        def work() -> Any:
            return self._client.fine_tuning.jobs.list(limit=PAGE, timeout=TIMEOUT)

        page = self._ask("list the jobs", work)
        jobs = [_read(Job, each, "list the jobs") for each in _items(page, "list the jobs")]
        return next((job for job in jobs if job.training_file == training_file), None)

    def events(self, number: str) -> Iterator[Event]:
        """What a job has told, the newest first, page by page."""
        import openai

        after: str | openai.Omit = openai.omit
        words = "read the events"
        for _ in range(MOST_EVENTS // PAGE):

            def work(after: str | openai.Omit = after) -> Any:
                return self._client.fine_tuning.jobs.list_events(
                    number, after=after, limit=PAGE, timeout=TIMEOUT
                )

            page = self._ask(words, work)
            events = [_read(Event, each, words) for each in _items(page, words)]
            yield from events
            if not events or getattr(page, "has_more", None) is not True:
                return
            after = events[-1].id

    def _ask(self, what: str, work: Callable[[], T], again: tuple[Failure, ...] = _PASSING) -> T:
        import openai

        for attempt in range(ATTEMPTS):
            try:
                return work()
            except openai.APIError as error:
                problem = problem_of(error, self._client)
                spent = getattr(error, "code", None) == "insufficient_quota"
            except (ValueError, TypeError, AttributeError, RecursionError) as error:
                raise RankerError(
                    f"{what}: {self.address} does not answer as OpenAI's interface does "
                    f"({type(error).__name__}); check --base-url"
                ) from None
            except OSError as error:
                raise RankerError(f"{what}: {error.strerror}; check the file") from None
            if spent or problem.failure not in again or attempt + 1 == ATTEMPTS:
                raise RankerError(self._told(what, problem))
            pause = min(self._pause * 2**attempt, LONGEST_PAUSE)
            time.sleep(max(problem.pause or 0.0, pause))
        raise AssertionError("unreachable")

    def _told(self, what: str, problem: Problem) -> str:
        mend = _MEND.get(problem.status or 0, "mend what it says, and give the same command again")
        if problem.failure in (Failure.UNREACHABLE, Failure.TIMEOUT):
            mend = "check the network and --base-url, and give the same command again"
        detail = _line(problem.detail).rstrip(".")
        return f"{what}: {detail}; {mend.format(key='OPENAI_API_KEY')}"


def _items(page: Any, what: str) -> list[Any]:
    items = getattr(page, "data", None)
    if not isinstance(items, list):
        raise RankerError(
            f"{what}: the server does not answer as OpenAI's interface does; check --base-url"
        )
    return items


def _read(model: type[Read], answer: Any, what: str) -> Read:
    """An object of the library, which checks nothing, as one of ours."""
    try:
        data = answer if isinstance(answer, dict) else answer.to_dict()
        return model.model_validate(data)
    except (AttributeError, ValidationError, TypeError) as error:
        first = error.errors()[0]["loc"] if isinstance(error, ValidationError) else ()
        where = f", field '{'.'.join(map(str, first))}'" if first else ""
        raise RankerError(
            f"{what}: the server does not answer as OpenAI's interface does{where}; "
            f"check --base-url"
        ) from None
