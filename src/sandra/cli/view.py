"""`sandra view`: the live page in the browser."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from sandra.cli.options import command, settings_of
from sandra.errors import SandraError


def add(commands: Any) -> None:
    parser = command(
        commands,
        "view",
        "open a page in the browser that decides again as you change scenario, ranker, command, "
        "formulas and limits, and follows a running 'sandra drive'; only this machine can open it",
        "sandra view intersection",
        "sandra view runs/one",
    )
    parser.add_argument(
        "what",
        nargs="?",
        metavar="RUN|SCENARIO",
        help="a run folder to follow, a folder of CommonRoad files, a file, or a name of "
        "'sandra scenarios'",
    )
    parser.add_argument("--folder", metavar="DIR", help="more CommonRoad files to choose from")
    parser.add_argument(
        "--ranker",
        action="append",
        default=[],
        metavar="NAME",
        help="one more to choose from, as in 'sandra decide'; may be repeated; a key comes from "
        "the environment, never through the page",
    )
    parser.add_argument("--base-url", metavar="URL", help="of an OpenAI-compatible server")
    parser.add_argument(
        "--deadline", type=float, default=30.0, metavar="SECONDS", help="for a whole ranking"
    )
    parser.add_argument("--settings", metavar="FILE", help="a TOML file with parameters")
    parser.add_argument(
        "--port", type=int, default=0, metavar="N", help="of 127.0.0.1 (default: a free one)"
    )
    parser.add_argument("--no-browser", action="store_true", help="only print the address")
    parser.set_defaults(run=_view)


def _view(arguments: argparse.Namespace) -> int:
    try:
        from sandra.live.offer import Offer
        from sandra.live.serve import serve
    except ModuleNotFoundError as error:
        raise SandraError(
            f"this needs a web server ({error.name} is missing): pip install 'sandra[view]'"
        ) from None
    what = arguments.what
    path = None if what is None else Path(what)
    folder = Path(arguments.folder) if arguments.folder else None
    run = None
    if path is not None and path.is_dir():
        if (path / "run.json").exists():
            run = path
        elif folder is None:
            folder = path
        what = None
    offer = Offer.of(
        what,
        folder,
        arguments.ranker,
        base_url=arguments.base_url,
        deadline=arguments.deadline,
        settings=settings_of(arguments),
    )
    serve(offer, run, port=arguments.port, browser=not arguments.no_browser)
    return 0
