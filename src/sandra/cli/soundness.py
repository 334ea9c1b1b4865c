"""`sandra evaluate soundness`: certificates against adversaries."""

from __future__ import annotations

import argparse
import json
import sys
from typing import Any

from sandra.cli.options import (
    add_assumptions,
    add_workers,
    command,
    path_of,
    settings_of,
    workers_of,
)
from sandra.cli.output import finite, print_json
from sandra.errors import SandraError


def add(actions: Any) -> None:
    parser = command(
        actions,
        "soundness",
        "execute certificates while the others do their worst: exit status 0 if there was neither "
        "a collision nor a broken rule, else 1",
        "sandra evaluate soundness intersection merge --rollouts 1000 --workers auto",
        "on a Dask cluster: sandra evaluate soundness --rollouts 1000000 --scheduler tcp://HOST:8786",
    )
    parser.add_argument(
        "scenarios",
        nargs="*",
        metavar="SCENARIO",
        help="CommonRoad files, or names of 'sandra scenarios' (default: all of those)",
    )
    parser.add_argument(
        "--rollouts", type=int, default=10_000, metavar="N", help="admissible ones, at least"
    )
    parser.add_argument(
        "--per-certificate", type=int, default=100, metavar="N", help="rollouts of each certificate"
    )
    parser.add_argument("--seed", type=int, default=0, metavar="S", help="of all that is random")
    add_workers(parser)
    add_assumptions(parser)
    parser.add_argument("--settings", metavar="FILE", help="a TOML file with parameters")
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    parser.add_argument("--out", metavar="FILE", help="write the JSON object to a file, too")
    parser.set_defaults(run=_soundness)


def _soundness(arguments: argparse.Namespace) -> int:
    from sandra.evaluation.rollouts.soundness import soundness

    _write(arguments.out, "")  # rather now than after minutes
    report = soundness(
        [path_of(name) for name in arguments.scenarios],
        arguments.rollouts,
        arguments.seed,
        workers_of(arguments),
        arguments.per_certificate,
        settings_of(arguments),
        _progress,
    )
    _progress("")
    _write(arguments.out, json.dumps(finite(report.to_dict()), indent=1, allow_nan=False))
    if arguments.json:
        print_json(report.to_dict())
    else:
        print(report)
    return 0 if report.holds else 1


def _write(path: str | None, text: str) -> None:
    if path is None:
        return
    try:
        with open(path, "w", encoding="utf-8") as file:
            file.write(text)
    except OSError as error:
        raise SandraError(
            f"{path}: cannot be written ({error.strerror}); choose another --out"
        ) from None


def _progress(words: str) -> None:
    """On one line of a terminal; elsewhere one line each, so that a log shows it, too."""
    if sys.stderr.isatty():
        print(f"\r\x1b[K{words}", end="", file=sys.stderr, flush=True)
    elif words:
        print(words, file=sys.stderr, flush=True)
