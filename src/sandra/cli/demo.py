"""`sandra demo`: the first thing to try."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from sandra.cli.options import command
from sandra.errors import SandraError


def add(commands: Any) -> None:
    parser = command(
        commands,
        "demo",
        "decide the intersection scenario that comes with SanDRA, draw it, and make a page of it",
        "sandra demo --out demo",
    )
    parser.add_argument("--out", default="demo", metavar="FOLDER", help="where picture and page go")
    parser.set_defaults(run=_demo)


def _demo(arguments: argparse.Namespace) -> int:
    picture = Path(arguments.out) / "decision.png"
    page = picture.with_suffix(".html")
    print("sandra decide intersection --command 'drive faster' --walk all \\")
    print(f"    --figure {picture} --report {page}")
    print("(ranked by the small language model that comes along, docs/embedded.md)\n")
    try:
        picture.parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise SandraError(
            f"{picture.parent}: no folder can be made there ({error.strerror}); choose --out"
        ) from None
    from sandra.cli import main  # which imports this file

    words = ["intersection", "--command", "drive faster", "--walk", "all"]
    return main(["decide", *words, "--figure", str(picture), "--report", str(page)])
