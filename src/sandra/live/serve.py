"""Serve the live page until it is interrupted."""

from __future__ import annotations

import socket
import webbrowser
from pathlib import Path

import uvicorn

from sandra.errors import SandraError
from sandra.live.guard import Access
from sandra.live.offer import Offer
from sandra.live.server import application

HOST = "127.0.0.1"


def listening(port: int) -> socket.socket:
    """A socket on this machine alone; port 0 takes a free one.

    Raises:
        SandraError: if the port cannot be had.
    """
    server = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
    server.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        server.bind((HOST, port))
    except (OSError, OverflowError) as error:
        server.close()
        raise SandraError(f"--port {port}: cannot be used ({error}); choose another") from None
    return server


def serving(offer: Offer, access: Access, run: Path | None = None) -> uvicorn.Server:
    """A server that is yet to run."""
    application_ = application(offer, access, run)
    config = uvicorn.Config(
        application_,
        log_level="warning",
        access_log=False,
        server_header=False,
        lifespan="off",
        ws="none",
        timeout_graceful_shutdown=1,
    )
    return uvicorn.Server(config)


def serve(offer: Offer, run: Path | None = None, *, port: int = 0, browser: bool = True) -> None:
    """Serve until interrupted; prints the address, and opens it in the browser if wanted."""
    with listening(port) as opened:
        access = Access(opened.getsockname()[1])
        print(access.address, flush=True)
        print("Control-C ends it. Only this machine can open the address.", flush=True)
        if browser:
            webbrowser.open(access.address)
        serving(offer, access, run).run(sockets=[opened])
