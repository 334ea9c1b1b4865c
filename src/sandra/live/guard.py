"""Who is answered: this machine's own page, and nobody else.

A page from elsewhere must not be able to use the server through the user's browser. So the Host
header must be one of the server's own names (against DNS rebinding), every request carries a token
that is known to the printed address and the served page alone, and what changes something must come
from the server's own origin, as JSON.
"""

from __future__ import annotations

import secrets
from dataclasses import dataclass, field
from urllib.parse import parse_qs

from starlette.datastructures import Headers
from starlette.responses import PlainTextResponse
from starlette.types import ASGIApp, Message, Receive, Scope, Send

LARGEST = 64 * 1024
"""Of a request's body [bytes]."""
TOKEN = "x-sandra-token"
HEADERS = {
    "cache-control": "no-store",
    "content-security-policy": "frame-ancestors 'none'",
    "cross-origin-opener-policy": "same-origin",
    "cross-origin-resource-policy": "same-origin",
    "referrer-policy": "no-referrer",
    "x-content-type-options": "nosniff",
    "x-frame-options": "DENY",
}
"""Of every answer."""


@dataclass(frozen=True, slots=True)
class Access:
    """The port that is served, and the token."""

    port: int
    token: str = field(default_factory=lambda: secrets.token_urlsafe(24), repr=False)

    @property
    def hosts(self) -> frozenset[str]:
        """Names under which the server may be spoken to."""
        return frozenset(f"{name}:{self.port}" for name in ("127.0.0.1", "localhost"))

    @property
    def address(self) -> str:
        """What the user opens."""
        return f"http://127.0.0.1:{self.port}/?token={self.token}"

    def why_not(self, scope: Scope) -> tuple[int, str] | None:
        """Status and words for a request that is refused; None for one that may pass."""
        headers = Headers(scope=scope)
        host = headers.get("host", "").lower()
        if host not in self.hosts:
            return 421, "This server answers to its own address only."
        if not secrets.compare_digest(self._given(scope, headers).encode(), self.token.encode()):
            return 403, "Open the whole address that 'sandra view' has printed."
        if scope["method"] in ("GET", "HEAD"):
            return None
        if headers.get("origin") != f"http://{host}":
            return 403, "This request comes from another page."
        if headers.get("content-type", "").split(";")[0].strip() != "application/json":
            return 415, "Send JSON."
        return None

    def _given(self, scope: Scope, headers: Headers) -> str:
        if scope["path"] != "/":
            return str(headers.get(TOKEN, ""))
        query = parse_qs(scope["query_string"].decode("latin-1"))
        return str(query.get("token", [""])[0])


class Guard:
    """Lets through what `Access` allows, no more than `LARGEST` of it, and adds `HEADERS`."""

    def __init__(self, app: ASGIApp, access: Access) -> None:
        self._app, self._access = app, access

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] != "http":
            if scope["type"] == "lifespan":
                await self._app(scope, receive, send)
            return
        refused = self._access.why_not(scope)
        length = Headers(scope=scope).get("content-length", "0")
        if refused is None and (not length.isdecimal() or int(length) > LARGEST):
            refused = 413, "That is too much."
        answer = self._app if refused is None else PlainTextResponse(refused[1], refused[0])
        received = 0

        async def bounded() -> Message:
            nonlocal received
            message = await receive()
            received += len(message.get("body", b""))
            # A body that says nothing of its length is cut off where it becomes too long.
            return message if received <= LARGEST else {"type": "http.disconnect"}

        async def marked(message: Message) -> None:
            if message["type"] == "http.response.start":
                extra = [(name.encode(), value.encode()) for name, value in HEADERS.items()]
                message = {**message, "headers": [*message.get("headers", ()), *extra]}
            await send(message)

        await answer(scope, bounded, marked)
