"""The addresses of the live page."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable
from pathlib import Path
from typing import Any

from starlette.applications import Starlette
from starlette.concurrency import run_in_threadpool
from starlette.middleware import Middleware
from starlette.requests import ClientDisconnect, Request
from starlette.responses import HTMLResponse, JSONResponse, Response
from starlette.routing import Route

from sandra.errors import SandraError
from sandra.live.asking import answered, question_of
from sandra.live.following import Follower
from sandra.live.guard import Access, Guard
from sandra.live.offer import Offer
from sandra.view.report import Document, page

Answering = Callable[[Request], Awaitable[Response]]


def application(offer: Offer, access: Access, run: Path | None = None) -> Starlette:
    """The server's application; `run`: a run folder to follow, which may not be there yet."""
    follower = None if run is None else Follower(run)
    # One at a time: a second one would only make both slow.
    busy = asyncio.Lock()

    async def home(request: Request) -> Response:
        title = "SanDRA" if run is None else run.name
        live = {"token": access.token, "offer": offer.to_dict(), "follows": run is not None}
        return HTMLResponse(page(Document("decision", title, ()), live=live))

    async def ask(request: Request) -> Response:
        question = question_of(await request.body())
        async with busy:
            document = await run_in_threadpool(answered, offer, question)
        return _json(document.to_dict())

    async def follow(request: Request) -> Response:
        if follower is None:
            raise SandraError("no run is followed")
        name = request.query_params.get("episode", "")
        known = request.query_params.get("known", "0")
        async with busy:
            episodes = await run_in_threadpool(follower.episodes)
            names = [x["name"] for x in episodes]
            wanted = name if name in names else (names[-1] if names else "")
            news: dict[str, Any] = {}
            # Of a whole episode there is no news: the page asks whether another one has begun.
            if wanted and not (known == "all" and wanted == name):
                same = int(known) if known.isdecimal() and wanted == name else 0
                news = await run_in_threadpool(follower.news, wanted, same)
        return _json({"episodes": episodes, "episode_name": wanted, **news})

    return Starlette(
        routes=[
            Route("/", home),
            Route("/api/decide", _told(ask), methods=["POST"]),
            Route("/api/run", _told(follow)),
        ],
        middleware=[Middleware(Guard, access=access)],
    )


def _told(answer: Answering) -> Answering:
    """What a user can mend is said in words; anything else is a bug, and no answer."""

    async def telling(request: Request) -> Response:
        try:
            return await answer(request)
        except SandraError as error:
            return _json({"error": str(error)}, 400)
        except ClientDisconnect:
            return _json({"error": "the question broke off"}, 400)

    return telling


def _json(data: dict[str, Any], status: int = 200) -> JSONResponse:
    return JSONResponse(data, status)
