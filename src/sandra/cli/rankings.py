"""`sandra evaluate rankings`: what recorded rankings score, beside trivial baselines."""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

from sandra.cli.options import add_format, command
from sandra.cli.output import finite, print_json, tables_in, tell_written, write_files

if TYPE_CHECKING:
    from sandra.evaluation.open_loop.report import Report


def add(actions: Any) -> None:
    parser = command(
        actions,
        "rankings",
        "score recorded rankings: Safe@k, Top-k, by action type, with intervals, beside trivial "
        "baselines",
        "sandra evaluate rankings rankings.csv --verdicts verdicts.csv --out runs/rankings "
        "--figure rankings.pdf",
    )
    parser.add_argument(
        "rankings",
        metavar="FILE",
        help="CSV with the columns label_lon, label_lat, lon1, lat1, lon2, ... and, where known, "
        "run, scenario_id, command, safe_top1, safe_top3 (docs/open-loop.md)",
    )
    parser.add_argument(
        "--verdicts",
        metavar="FILE",
        help="CSV with the columns scenario_id, lon, lat, safe: tells Safe@k of the baselines, "
        "and of runs without such a column",
    )
    parser.add_argument(
        "--pool",
        default="",
        metavar="RUNS",
        help="runs to take together by action, commas between (default: all without a command)",
    )
    add_output(parser)
    parser.set_defaults(run=_rankings)


def add_output(parser: argparse.ArgumentParser) -> None:
    add_format(parser)
    parser.add_argument(
        "--out", metavar="FOLDER", help="write the tables as .md, .tex, .csv, and scores.json"
    )
    parser.add_argument("--figure", metavar="FILE", help="draw bars with intervals: .pdf, .png")
    parser.add_argument("--json", action="store_true", help="print one JSON object")


def _rankings(arguments: argparse.Namespace) -> int:
    from sandra.evaluation.open_loop.report import report_of_file

    found = report_of_file(
        Path(arguments.rankings),
        None if arguments.verdicts is None else Path(arguments.verdicts),
        [name.strip() for name in arguments.pool.split(",") if name.strip()],
    )
    tell(found, arguments)
    return 0


def tell(found: Report, arguments: argparse.Namespace) -> None:
    """Write, draw and print a report as the options of `add_output` say."""
    written = [] if arguments.out is None else write_tables(found, Path(arguments.out))
    if arguments.figure is not None:
        from sandra.view.ablation import ablation_figure

        written.append(ablation_figure(found.bars(), arguments.figure))
    if arguments.json:
        print_json({**found.to_dict(), "files": [str(file) for file in written]})
        return
    for sheet in found.sheets().values():
        print(sheet.text(arguments.format))
    tell_written(written)


def write_tables(found: Report, out: Path) -> list[Path]:
    files = tables_in(out, found.sheets())
    files[out / "scores.json"] = json.dumps(finite(found.to_dict()), indent=1) + "\n"
    return write_files(out, files)
