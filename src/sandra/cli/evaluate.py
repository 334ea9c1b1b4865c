"""`sandra evaluate`: what the whole achieves on many scenarios."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from sandra.cli import closed_loop, open_loop, rankings, soundness
from sandra.cli.options import (
    add_assumptions,
    add_workers,
    command,
    path_of,
    settings_of,
    workers_of,
)
from sandra.cli.output import print_json, progress
from sandra.errors import SandraError


def add(commands: Any) -> None:
    parser = command(
        commands,
        "evaluate",
        "measure what the whole achieves on many scenarios",
        "sandra evaluate verdicts intersection merge",
    )
    actions = parser.add_subparsers(dest="action", metavar="ACTION", required=True)
    _add_verdicts(actions)
    soundness.add(actions)
    closed_loop.add(actions)
    rankings.add(actions)
    open_loop.add(actions)


def _add_verdicts(actions: Any) -> None:
    parser = command(
        actions,
        "verdicts",
        "count the twelve pairs by verdict, and say why what is REACHABLE has no certificate",
        "sandra evaluate verdicts scenarios/ --rules 'none;R_G1,R_G2,R_G3' --workers auto "
        "--out verdicts.md",
    )
    parser.add_argument(
        "scenarios",
        metavar="SCENARIO|FOLDER",
        nargs="+",
        help="CommonRoad files, names of 'sandra scenarios', or folders of .xml files",
    )
    parser.add_argument(
        "--predictions",
        default="most-likely,set-based",
        metavar="LIST",
        help="of the other traffic, commas between",
    )
    parser.add_argument(
        "--rules",
        default="none;R_G1,R_G2,R_G3",
        metavar="LISTS",
        help="sets of traffic rules, semicolons between",
    )
    parser.add_argument("--horizon", type=int, metavar="H", help="steps to verify (default: 25)")
    add_assumptions(parser)
    parser.add_argument("--settings", metavar="FILE", help="a TOML file with parameters")
    add_workers(parser)
    parser.add_argument("--out", metavar="FILE", help="write the tables as Markdown")
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    parser.set_defaults(run=_verdicts)


def _verdicts(arguments: argparse.Namespace) -> int:
    from sandra.evaluation.verdicts import tabulate
    from sandra.logic import parse_rules
    from sandra.prediction import KINDS

    settings = settings_of(arguments)
    if arguments.horizon is not None:
        settings = settings.replace(horizon=arguments.horizon)
    predictions = [word.strip() for word in arguments.predictions.split(",")]
    for kind in predictions:
        if kind not in KINDS:
            raise SandraError(f"unknown prediction '{kind}': choose from {', '.join(KINDS)}")
    paths = [path for given in arguments.scenarios for path in _files(given)]
    _write(arguments.out, "")  # rather now than after minutes
    table = tabulate(
        paths,
        predictions,
        [parse_rules(text) for text in arguments.rules.split(";")],
        settings=settings,
        workers=workers_of(arguments),
        progress=lambda done, total, name: progress(f"{done} of {total}: {name}"),
    )
    progress("")
    _write(arguments.out, table.markdown())
    if arguments.json:
        print_json(table.to_dict())
    else:
        print(table, end="")
    return 1 if table.failed else 0


def _write(path: str | None, text: str) -> None:
    if path is None:
        return
    try:
        Path(path).write_text(text, encoding="utf-8")
    except OSError as error:
        raise SandraError(
            f"{path}: cannot be written ({error.strerror}); choose another --out"
        ) from None


def _files(given: str) -> list[Path]:
    """The scenarios that a word stands for: those of a folder, or one."""
    folder = Path(given)
    if not folder.is_dir():
        return [path_of(given)]
    found = sorted(folder.glob("*.xml"))
    if not found:
        raise SandraError(f"{given}: there is no .xml file in this folder; name another one")
    return found
