"""`sandra report`: an episode or an evaluation as one HTML page."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from sandra.cli.options import command
from sandra.cli.output import progress


def add(commands: Any) -> None:
    parser = command(
        commands,
        "report",
        "write one HTML page that needs no network: of an episode, of a run, or of an evaluation",
        "sandra report runs/one --out one.html",
    )
    parser.add_argument(
        "folder",
        metavar="RUN",
        help="a run folder of 'sandra drive', one of its episodes (RUN/seed-N), or a folder of "
        "'sandra evaluate closed-loop' or 'open-loop'",
    )
    parser.add_argument(
        "--out", metavar="F.html", help="the page (default: report.html in the folder)"
    )
    parser.add_argument(
        "--no-episodes",
        action="store_true",
        help="of several episodes: only the page with their table, not one for each beside it",
    )
    parser.set_defaults(run=_report)


def _report(arguments: argparse.Namespace) -> int:
    from sandra.view.report import write_report

    folder = Path(arguments.folder)
    out = Path(arguments.out) if arguments.out else folder / "report.html"
    written = write_report(
        folder,
        out,
        episodes=not arguments.no_episodes,
        progress=lambda done, total: progress(f"page {done} of {total}"),
    )
    progress("")
    for file in written[:1]:
        print(file)
    if len(written) > 1:
        print(f"and the pages of {len(written) - 1} episodes in {written[1].parent}")
    return 0
