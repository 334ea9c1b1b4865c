"""A client of an OpenAI-compatible server that is kept on a short leash.

What the library leaves open is bounded here: redirects are not followed (nor is the key carried
off), answers are not decompressed (a small body may unpack to gigabytes), and a response, an error
included, ends with its time-out as a whole, however slowly it drips.
"""

from __future__ import annotations

import os
import time
import weakref
from collections.abc import Iterator
from dataclasses import dataclass
from datetime import UTC, datetime
from email.utils import parsedate_to_datetime
from typing import TYPE_CHECKING, Any
from urllib.parse import urlsplit, urlunsplit

from sandra.errors import RankerError
from sandra.rankers.secret import NO_KEY, Secret, veil_logs
from sandra.rankers.types import Failure

if TYPE_CHECKING:
    import httpx2
    import openai

MAX_ERROR = 64_000
"""Most bytes of the body of an error that are read."""
MAX_PAUSE = 3600.0
"""Longer than this nobody is kept waiting by a `Retry-After` [s]."""

_LATE = "the server did not answer in time"
_OPENAI_HOST = "api.openai.com"


@dataclass(frozen=True, slots=True)
class Problem:
    """Why a request brought no reply. `pause`: what the server asks to wait [s], if anything."""

    failure: Failure
    detail: str
    status: int | None = None
    pause: float | None = None


def address_of(base_url: str | None, server: str = "OPENAI") -> str:
    """The address of a server; None: that of `{server}_BASE_URL`, else OpenAI's.

    Raises:
        RankerError: no address, or one with a name, a password, or a query in it: addresses are
            written into run folders, secrets are not. The error does not repeat them.
    """
    text = base_url or os.environ.get(f"{server}_BASE_URL") or f"https://{_OPENAI_HOST}/v1"
    example = "write for example http://localhost:8000/v1"
    try:
        parts = urlsplit(text.strip())
        host, _ = parts.hostname, parts.port
    except ValueError:
        raise RankerError(f"openai: base_url is no address; {example}") from None
    if "@" in text or parts.query or parts.fragment:
        raise RankerError(
            f"openai: the base_url of '{host or 'a server'}' holds a name, a password, a query or "
            f"a fragment; write the address alone, and put the key into {server}_API_KEY"
        )
    if parts.scheme not in ("http", "https") or not host:
        raise RankerError(f"openai: base_url '{text}' is no address; {example}")
    return urlunsplit(parts)


def client_for(base_url: str | None, server: str = "OPENAI") -> openai.OpenAI:
    """A client of a server; see `address_of`. It is shown the key in `{server}_API_KEY`.

    Raises:
        RankerError: no key for OpenAI's own server, a key that is none, or a bad address.
    """
    import openai

    address = address_of(base_url, server)
    key = os.environ.get(f"{server}_API_KEY", "").strip()
    if not key and urlsplit(address).hostname == _OPENAI_HOST:
        raise RankerError(
            "openai: no API key; set OPENAI_API_KEY, or give the base_url of a local server"
        )
    if not (key.isascii() and key.isprintable()) or " " in key:
        raise RankerError(f"{server}_API_KEY holds characters that no key has; set it anew")
    veil_logs(key)
    http = openai.DefaultHttpxClient(
        follow_redirects=False, event_hooks={"response": [_bounded]}, timeout=None
    )
    # Retries and the deadline are kept here: the library's are per attempt.
    client = openai.OpenAI(
        api_key=key or NO_KEY,
        base_url=address,
        max_retries=0,
        http_client=http,
        default_headers={"Accept-Encoding": "identity"},
    )
    # The library closes the connections of its own clients when they go, not those it is given.
    weakref.finalize(client, http.close).atexit = False
    return client


def problem_of(error: openai.APIError, client: openai.OpenAI) -> Problem:
    """What went wrong with a request, by name; without the key, whatever the server echoes."""
    import httpx2
    import openai

    hide = Secret(client.api_key)
    if isinstance(error, openai.APIStatusError):
        return _refused_request(error, hide)
    if isinstance(error, openai.APITimeoutError):
        return Problem(Failure.TIMEOUT, _LATE)
    if isinstance(error, openai.APIConnectionError):
        cause = error.__cause__
        if isinstance(cause, httpx2.DecodingError):
            return Problem(Failure.MALFORMED, hide(str(cause)))
        words = f"{client.base_url} cannot be reached ({cause or error})"
        return Problem(Failure.UNREACHABLE, hide(words))
    words = f"the server's answer cannot be read ({error.message})"
    return Problem(Failure.MALFORMED, hide(words))


def _refused_request(error: openai.APIStatusError, hide: Secret) -> Problem:
    status, headers = error.status_code, error.response.headers
    detail = hide(f"HTTP {status}: {error.message}")
    pause = _pause(headers.get("retry-after"), headers.get("date"))
    if 300 <= status < 400:
        where = hide(headers.get("location", "nowhere"))
        detail = f"HTTP {status}: the server redirects to {where}, which is not followed"
        return Problem(Failure.REJECTED, detail, status)
    if status == 429:
        return Problem(Failure.RATE_LIMITED, detail, status, pause)
    if status >= 500:
        return Problem(Failure.SERVER_ERROR, detail, status, pause)
    return Problem(Failure.TIMEOUT if status == 408 else Failure.REJECTED, detail, status)


def _pause(text: str | None, now: str | None) -> float | None:
    """Seconds that `Retry-After` asks for: a number, or a date on the server's own clock."""
    try:
        value = float(text or "")
    except ValueError:
        until = _date(text)
        if until is None:
            return None
        value = max((until - (_date(now) or datetime.now(UTC))).total_seconds(), 0.0)
    return min(value, MAX_PAUSE) if value >= 0.0 else None


def _date(text: str | None) -> datetime | None:
    try:
        found = parsedate_to_datetime(text or "")
    except (ValueError, OverflowError):
        return None
    return found if found.tzinfo else found.replace(tzinfo=UTC)


def _bounded(response: httpx2.Response) -> None:
    """Called when the head of a response is there: watch over its body."""
    import httpx2

    encoding = response.headers.get("content-encoding", "").strip().lower()
    if encoding not in ("", "identity"):
        raise httpx2.DecodingError("the server compresses its answer, which it was not asked to")
    limits: dict[str, Any] = response.request.extensions.get("timeout", {})
    seconds = limits.get("read")
    end = None if seconds is None else time.monotonic() + seconds
    most = MAX_ERROR if response.status_code >= 300 else None
    response.stream = _watched(response.stream, most, end)


def _watched(inner: Any, most: int | None, end: float | None) -> httpx2.SyncByteStream:
    """A body of at most so many bytes, until that moment on the clock `time.monotonic`."""
    import httpx2

    class Watched(httpx2.SyncByteStream):
        def __iter__(self) -> Iterator[bytes]:
            left = most
            for block in inner:
                if left is not None:
                    block = block[:left]
                    left -= len(block)
                yield block
                if left == 0:
                    return
                if end is not None and time.monotonic() > end:
                    raise httpx2.ReadTimeout("the response did not end in time")

        def close(self) -> None:
            inner.close()

    return Watched()
