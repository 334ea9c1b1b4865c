"""`sandra scenarios`: what comes with the package."""

from __future__ import annotations

import argparse
from typing import Any

from sandra.cli.options import command
from sandra.cli.output import print_json


def add(commands: Any) -> None:
    parser = command(
        commands, "scenarios", "list the scenarios that come with SanDRA", "sandra scenarios"
    )
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    parser.set_defaults(run=_scenarios)


def _scenarios(arguments: argparse.Namespace) -> int:
    from sandra.scenarios import examples

    found = {name: str(path) for name, path in examples().items()}
    if arguments.json:
        print_json(found)
    else:
        for name, path in found.items():
            print(f"{name:<20} {path}")
    return 0
