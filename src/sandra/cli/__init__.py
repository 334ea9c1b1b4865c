"""The command line: reads words, calls the rooms, prints what they return. Nothing else.

One file per command. Exit status: 0; 1 where a negative outcome was asked for (`sandra verify
--pair` finds it UNSAFE); 2 for bad input, with one line that says what, where and how to mend it.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from typing import NoReturn

from sandra.cli import (
    bench,
    certificate,
    conformance,
    dataset,
    decide,
    demo,
    drive,
    evaluate,
    figure,
    film,
    finetune,
    label,
    monitor,
    prompt,
    report,
    scenarios,
    verify,
    view,
)
from sandra.errors import SandraError


class _Parser(argparse.ArgumentParser):
    def error(self, message: str) -> NoReturn:
        self.exit(2, f"{self.prog}: {message} (see '{self.prog} --help')\n")


def main(argv: Sequence[str] | None = None) -> int:
    """Run one command; returns the exit status."""
    arguments = _parser().parse_args(argv)
    try:
        return int(arguments.run(arguments))
    except SandraError as error:
        print(f"sandra {arguments.command}: {error}", file=sys.stderr)
        return 2
    except BrokenPipeError:
        # The reader of the output went away (`| head`); nothing is left to be said.
        sys.stderr.close()
        return 0
    except KeyboardInterrupt:
        print("interrupted", file=sys.stderr)
        return 130


def _parser() -> argparse.ArgumentParser:
    from sandra import __version__

    parser = _Parser(
        prog="sandra",
        description="Safe decisions of language models for automated vehicles: every action pair "
        "is verified by reachability analysis before it is driven.",
        epilog="example: sandra decide intersection --command 'drive faster' --figure decision.png",
    )
    parser.add_argument("--version", action="version", version=f"sandra {__version__}")
    commands = parser.add_subparsers(dest="command", metavar="COMMAND", required=True)
    deciding = (decide, verify, drive, prompt, certificate)
    watching = (report, view, monitor, conformance, figure, film, label)
    others = (evaluate, dataset, finetune, bench, scenarios, demo)
    for each in (*deciding, *watching, *others):
        each.add(commands)
    return parser
