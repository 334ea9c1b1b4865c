"""`sandra evaluate closed-loop`: drivers in the paper's three settings."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from sandra.cli.options import add_workers, command, workers_of
from sandra.cli.output import print_json, progress
from sandra.errors import SandraError


def add(actions: Any) -> None:
    parser = command(
        actions,
        "closed-loop",
        "let drivers without a verifier drive in highway-env, and say how far and how safely",
        "sandra evaluate closed-loop --drivers idle,idm,oracle --settings 1,2,3 --paper-seeds",
    )
    parser.add_argument(
        "--drivers",
        default="idle,slower,faster,fail-safe,random,idm",
        metavar="LIST",
        help="of idle, slower, faster, fail-safe, random, idm, oracle (minutes for each setting), "
        "dilu:MODEL (a language model; docs/dilu.md)",
    )
    parser.add_argument(
        "--base-url", metavar="URL", help="of an OpenAI-compatible server, for dilu"
    )
    parser.add_argument("--settings", default="1,2,3", metavar="LIST", help="of the paper")
    seeds = parser.add_mutually_exclusive_group()
    seeds.add_argument("--seeds", default="0", metavar="LIST", help="of the traffic (default: 0)")
    seeds.add_argument(
        "--paper-seeds", action="store_true", help="the ten seeds of the paper's evaluation"
    )
    parser.add_argument(
        "--profile",
        choices=("stock", "paper"),
        default="stock",
        help="highway-env as it is, or as the authors changed it (default: stock)",
    )
    parser.add_argument(
        "--convention",
        choices=("ours", "paper"),
        default="ours",
        help="all 30 steps must be free of collision, or all but the last, as the authors count",
    )
    parser.add_argument(
        "--repeats", type=int, default=3, metavar="N", help="of each seed, for random drivers"
    )
    add_workers(parser)
    parser.add_argument("--out", metavar="FILE", help="write the table as Markdown")
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    parser.set_defaults(run=_closed_loop)


def _closed_loop(arguments: argparse.Namespace) -> int:
    from sandra.evaluation.closed_loop import OURS, PAPER
    from sandra.evaluation.closed_loop.table import tabulate
    from sandra.simulation.dilu import located
    from sandra.simulation.highway import SEEDS
    from sandra.simulation.policies import policy

    words = arguments.drivers.split(",")
    drivers = [located(word.strip(), arguments.base_url) for word in words]
    for driver in drivers:
        policy(driver)  # rather an error now than after minutes
    if arguments.repeats < 1:
        raise SandraError(f"--repeats {arguments.repeats}: at least 1")
    table = tabulate(
        drivers,
        _numbers("settings", arguments.settings),
        SEEDS if arguments.paper_seeds else _numbers("seeds", arguments.seeds),
        profile=arguments.profile,
        convention=PAPER if arguments.convention == "paper" else OURS,
        repeats=arguments.repeats,
        workers=workers_of(arguments),
        progress=lambda done, total, name: progress(f"{done} of {total}: {name}"),
    )
    progress("")
    if arguments.out is not None:
        try:
            Path(arguments.out).write_text(table.markdown(), encoding="utf-8")
        except OSError as error:
            raise SandraError(
                f"{arguments.out}: cannot be written ({error.strerror}); choose another --out"
            ) from None
    if arguments.json:
        print_json(table.to_dict())
    else:
        print(table.markdown(), end="")
    return 0


def _numbers(option: str, text: str) -> list[int]:
    try:
        return [int(word) for word in text.split(",")]
    except ValueError:
        raise SandraError(f"--{option} {text}: whole numbers, commas between") from None
