"""`sandra evaluate closed-loop`: the closed-loop table, beside the paper's."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

from sandra.cli.options import (
    add_format,
    add_server,
    add_workers,
    command,
    prices_of,
    workers_of,
)
from sandra.cli.output import (
    finite,
    print_json,
    progress,
    tables_in,
    tell_written,
    write_files,
)
from sandra.errors import SandraError

if TYPE_CHECKING:
    from sandra.evaluation.closed_loop.rows import Row
    from sandra.evaluation.closed_loop.table import Table


def add(actions: Any) -> None:
    parser = command(
        actions,
        "closed-loop",
        "drive all rows of the closed-loop table that are not in the folder yet, and print it "
        "beside the paper's; exit status 1 if an episode broke off with an error",
        "sandra evaluate closed-loop --settings 1,2,3 --paper-seeds --rows 'idm rules/*/paper' "
        "--workers auto --out runs/table; with a model: sandra evaluate closed-loop "
        "--ranker openai:MODEL --rows 'openai*' --deadline 5 --cache answers --prices prices.toml",
        "on a Dask cluster: sandra evaluate closed-loop --paper-seeds --scheduler tcp://HOST:8786",
    )
    parser.add_argument(
        "--rows",
        default="*",
        metavar="PATTERNS",
        help="names as of files, spaces between: DRIVER (idle, slower, faster, fail-safe, random, "
        "idm, oracle), RANKER/PREDICTION/RULES/ASSUMPTIONS, or the same with meta: before it",
    )
    parser.add_argument("--list", action="store_true", help="print the names of the rows, no more")
    parser.add_argument(
        "--ranker",
        action="append",
        default=[],
        metavar="NAME",
        help="rows of one more ranker, such as openai:gpt-4o or dilu:gpt-4o; may be repeated",
    )
    parser.add_argument(
        "--driver",
        action="append",
        default=[],
        metavar="NAME",
        help="a row of one more driver without a verifier: dilu:MODEL (docs/dilu.md)",
    )
    parser.add_argument("--command", dest="wish", metavar="TEXT", help="the driver's wish")
    add_server(parser)
    parser.add_argument("--settings", default="1,2,3", metavar="LIST", help="of the paper")
    seeds = parser.add_mutually_exclusive_group()
    seeds.add_argument("--seeds", default="0", metavar="LIST", help="of the traffic, e.g. 1,2,5-9")
    seeds.add_argument(
        "--paper-seeds", action="store_true", help="the ten seeds of the paper's evaluation"
    )
    parser.add_argument(
        "--profile",
        choices=("stock", "paper"),
        default="stock",
        help="highway-env as it is, or as the authors changed it",
    )
    parser.add_argument(
        "--assumptions",
        metavar="conformant:FILE",
        help="rows under these bounds too, as 'sandra conformance' writes them",
    )
    parser.add_argument(
        "--convention",
        choices=("ours", "paper"),
        default="ours",
        help="all 30 steps must be free of collision, or all but the last, as the authors count",
    )
    parser.add_argument(
        "--repeats", type=int, default=3, metavar="N", help="of each seed, for the random driver"
    )
    add_workers(parser)
    parser.add_argument(
        "--out",
        default="runs/closed-loop",
        metavar="FOLDER",
        help="run folders, and the table as table.md, .tex, .csv and .json",
    )
    add_format(parser)
    parser.add_argument(
        "--view",
        action="store_true",
        help="write view.jsonl into the episodes that are driven now, so that their pages of "
        "'sandra report' show the reachable sets",
    )
    parser.add_argument(
        "--figures",
        action="store_true",
        help="draw the action distribution, and robustness of the rules for each row, as .pdf",
    )
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    parser.set_defaults(run=_closed_loop)


def _closed_loop(arguments: argparse.Namespace) -> int:
    from sandra.cli.drive import seeds_of
    from sandra.evaluation.closed_loop import OURS, PAPER
    from sandra.evaluation.closed_loop.table import tabulate
    from sandra.rankers.usage import cost, told
    from sandra.simulation.highway import SEEDS
    from sandra.view.report import FrameLog

    prices = prices_of(arguments)
    rows = rows_of(arguments)
    if arguments.list:
        print("\n".join(row.name for row in rows))
        return 0
    settings = _numbers("settings", arguments.settings)
    seeds = list(SEEDS) if arguments.paper_seeds else seeds_of(arguments.seeds)
    out = Path(arguments.out)
    table = tabulate(
        out,
        rows,
        settings,
        seeds,
        convention=PAPER if arguments.convention == "paper" else OURS,
        workers=workers_of(arguments),
        command_line=["sandra", *sys.argv[1:]],
        frames=FrameLog if arguments.view else None,
        progress=lambda done, total, name: progress(f"{done} of {total} episodes: {name}"),
    )
    progress("")
    written = _write(table, out)
    if arguments.figures:
        progress("draw")
        written += _draw(table, out)
        progress("")
    usages = table.usages()
    if arguments.json:
        costs = {ranker: cost(usage, ranker, prices) for ranker, usage in usages.items()}
        files = [str(file) for file in written]
        print_json({**table.to_dict(), "costs": costs, "files": files})
    else:
        for sheet in (table.main(), table.beside()):
            print(sheet.text(arguments.format))
        for ranker, usage in usages.items():
            print(f"cost of {ranker}: {told(usage, ranker, prices)}", file=sys.stderr)
        tell_written(written)
    for words in table.broken:
        print(f"broke off: {words}", file=sys.stderr)
    return 1 if table.broken else 0


def rows_of(arguments: argparse.Namespace) -> tuple[Row, ...]:
    from sandra.evaluation.closed_loop.drive import Drive
    from sandra.evaluation.closed_loop.rows import all_rows, selected
    from sandra.rankers import create
    from sandra.rankers.client import address_of
    from sandra.settings import Assumptions
    from sandra.simulation.dilu import located
    from sandra.simulation.policies import policy

    if arguments.repeats < 1:
        raise SandraError(f"--repeats {arguments.repeats}: at least 1")
    if arguments.base_url is not None:
        address_of(arguments.base_url)
    for ranker in arguments.ranker:
        # Rather an error now than after minutes.
        create(
            ranker,
            base_url=arguments.base_url,
            deadline=arguments.deadline,
            cache=arguments.cache,
            max_concurrent=arguments.max_concurrent,
        )
    drivers = [located(name, arguments.base_url) for name in arguments.driver]
    for driver in drivers:
        policy(driver)
    base = Drive(
        profile=arguments.profile,
        command=arguments.wish,
        base_url=arguments.base_url,
        deadline=arguments.deadline,
        cache=arguments.cache,
        max_concurrent=arguments.max_concurrent,
        prices=arguments.prices,
    )
    chosen = arguments.assumptions
    rows = all_rows(
        base,
        rankers=arguments.ranker,
        drivers=drivers,
        conformant=None if chosen in (None, "paper") else (chosen, Assumptions.named(chosen)),
        repeats=arguments.repeats,
    )
    return selected(rows, arguments.rows)


def _write(table: Table, out: Path) -> list[Path]:
    import json

    files = tables_in(out, {"table": table.main(), "beside": table.beside()})
    files[out / "table.json"] = json.dumps(finite(table.to_dict()), indent=1) + "\n"
    return write_files(out, files)


def _draw(table: Table, out: Path) -> list[Path]:
    """The action distribution, and for each row the robustness of its first episode."""
    from sandra.evaluation.closed_loop.read import robustness_of
    from sandra.view.distribution import distribution_figure, shares

    folder = out / "figures"
    folder.mkdir(exist_ok=True)
    several = len({entry.setting for entry in table.entries}) > 1
    rows = {
        entry.row.title + (f", setting {entry.setting}" if several else ""): entry.pairs
        for entry in table.entries
    }
    files = []
    if any(any(shares(pairs).values()) for pairs in rows.values()):
        files.append(distribution_figure(rows, folder / "distribution.pdf"))
    for entry in table.entries:
        for episode in entry.folders[:1]:
            name = f"robustness_{'_'.join(episode.relative_to(out).parts)}.pdf"
            files.append(robustness_of(episode).figure(folder / name))
    return files


def _numbers(option: str, text: str) -> list[int]:
    try:
        return [int(word) for word in text.split(",")]
    except ValueError:
        raise SandraError(f"--{option} {text}: whole numbers, commas between") from None
