"""`sandra conformance`: what the set-based prediction assumes, beside what was recorded."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import Any

from sandra.cli.options import (
    add_assumptions,
    add_workers,
    command,
    path_of,
    settings_of,
    workers_of,
)
from sandra.cli.output import print_json


def add(commands: Any) -> None:
    parser = command(
        commands,
        "conformance",
        "how often, and by how much, recorded vehicles break what the set-based prediction assumes "
        "of them, and the tightest bounds that none of them breaks: exit status 0 if none is "
        "broken and all are covered, else 1",
        "sandra conformance recordings/ --keep legal_cut_in,no_rear_end --out measured.toml; "
        "sandra decide merge --prediction set-based --assumptions conformant:measured.toml",
    )
    parser.add_argument(
        "recordings",
        nargs="+",
        metavar="FILE|FOLDER",
        help="CommonRoad files with recorded vehicles, names of 'sandra scenarios', or folders; "
        "FILE.crashed.json beside FILE.xml may hold {ID: STEP}, crashed from then on",
    )
    parser.add_argument(
        "--towards",
        choices=("all", "ego"),
        default="all",
        help="who is taken for the ego by no_rear_end and legal_cut_in",
    )
    parser.add_argument(
        "--touching", action="store_true", help="bodies that touch have crashed, too: left out"
    )
    parser.add_argument(
        "--coverage",
        type=int,
        default=0,
        metavar="H",
        help="predict H steps and see whether the sets hold what was driven; 0: do not",
    )
    parser.add_argument(
        "--every", type=int, default=10, metavar="N", help="predict from every N-th step"
    )
    parser.add_argument(
        "--step",
        type=float,
        default=0.0,
        metavar="S",
        help="look at every S seconds, e.g. the step that is verified; 0: each recorded step",
    )
    parser.add_argument(
        "--noise", type=float, default=0.02, metavar="M", help="of recorded positions [m]"
    )
    parser.add_argument(
        "--margin", type=float, default=0.05, metavar="M", help="share added to the bounds found"
    )
    parser.add_argument(
        "--keep", default="", metavar="LIST", help="assumptions to keep as they are in --out"
    )
    parser.add_argument("--out", metavar="FILE.toml", help="write the tightest bounds")
    parser.add_argument("--name", metavar="NAME", help="of that set (default: the file's)")
    add_assumptions(parser)
    parser.add_argument("--settings", metavar="FILE", help="a TOML file with parameters")
    add_workers(parser)
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    parser.set_defaults(run=_conformance)


def _conformance(arguments: argparse.Namespace) -> int:
    from sandra.evaluation.conformance import conformance, recordings_in, write

    found = conformance(
        recordings_in([Path(path_of(name)) for name in arguments.recordings]),
        settings_of(arguments),
        towards=arguments.towards,
        touching=arguments.touching,
        horizon=arguments.coverage,
        every=arguments.every,
        noise=arguments.noise,
        step=arguments.step,
        workers=workers_of(arguments),
        progress=_progress,
    )
    _progress("")
    keep = [word.strip() for word in arguments.keep.split(",") if word.strip()]
    tightest = found.tightest(arguments.margin, keep)
    if arguments.out:
        write(found, arguments.out, arguments.name, arguments.margin, keep)
    if arguments.json:
        from dataclasses import asdict

        print_json({**found.to_dict(), "tightest": asdict(tightest), "out": arguments.out})
    else:
        print(found)
        if arguments.out:
            print(f"tightest bounds: {arguments.out} (--assumptions conformant:{arguments.out})")
    return 0 if found.holds else 1


def _progress(words: str) -> None:
    if sys.stderr.isatty():
        print(f"\r\x1b[K{words}", end="", file=sys.stderr, flush=True)
