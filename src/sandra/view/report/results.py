"""Tables and charts of folders with results, as a page shows them."""

from __future__ import annotations

import csv
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from sandra.errors import SandraError
from sandra.view.report.document import Bar, Cell, Chart, Row, Table
from sandra.view.report.episode import read_json

RATES = ("safe1", "safe3", "top1", "top2", "top3")
"""Keys of scores.json that are drawn, per cent."""

MOST = 6
"""So many shares of a bar can be told apart."""


def table_of(
    file: Path, name: str, title: str, links: Mapping[int, Sequence[Cell]] | None = None
) -> Table | None:
    """A table from a CSV file with a header; None if there is no such file.

    Args:
        links: by the number of a row, the episodes behind it.
    """
    if not file.exists():
        return None
    try:
        with file.open(encoding="utf-8", newline="") as opened:
            lines = [row for row in csv.reader(opened) if row]
    except (OSError, ValueError, csv.Error) as error:
        raise SandraError(f"{file}: cannot be read ({error})") from None
    if not lines:
        return None
    known = links or {}
    rows = (Row(tuple(cells), tuple(known.get(i, ()))) for i, cells in enumerate(lines[1:]))
    return Table(name, title, tuple(lines[0]), tuple(rows))


def title_in(markdown: Path, otherwise: str) -> str:
    """The sentence above a table in its .md file."""
    try:
        lines = markdown.read_text(encoding="utf-8").splitlines()
    except (OSError, ValueError):
        return otherwise
    return next((x for x in lines if x.strip() and not x.startswith("|")), otherwise)


def closed_loop_charts(
    entries: Sequence[Mapping[str, Any]], pairs: Mapping[str, Mapping[str, int]]
) -> tuple[Chart, ...]:
    """Success, by what was driven, distance, and the distribution of actions.

    Args:
        entries: rows of table.json. pairs: by the name of a row, how often each was driven.
    """
    measured = [x for x in entries if x.get("success_rate") is not None]
    named = [(f"{x['row']}, setting {x['setting']}", x) for x in measured]
    success = tuple(
        Bar(
            name, (("success", 100 * x["success_rate"], *(100 * y for y in x["success_interval"])),)
        )
        for name, x in named
    )
    distance = tuple(
        Bar(name, (("distance", x["distance_all"], None, None),))
        for name, x in named
        if x.get("distance_all") is not None
    )
    operations = _shares({name: x["operations"] for name, x in named if x.get("operations")})
    driven = _shares(pairs)
    charts = (
        Chart(
            "Success",
            "Episodes without a collision, with Wilson's 95 % interval.",
            "bars",
            "%",
            success,
        ),
        Chart(
            "Distance",
            "Mean distance over all episodes, to the collision where there was one.",
            "bars",
            "m",
            distance,
        ),
        Chart(
            "Driven by",
            "Share of all steps, by what the ego was driven.",
            "shares",
            "%",
            operations,
        ),
        Chart("Actions", "What was driven, as a share of all steps.", "shares", "%", driven),
    )
    return tuple(chart for chart in charts if chart.bars)


def _shares(counts: Mapping[str, Mapping[str, float]]) -> tuple[Bar, ...]:
    """Of each row, the most frequent of all, the rest together: more could not be told apart."""
    total: Counter[str] = Counter()
    for some in counts.values():
        whole = sum(some.values()) or 1
        total.update({key: n / whole for key, n in some.items()})
    shown = [key for key, _ in total.most_common(len(total) if len(total) <= MOST else MOST - 1)]
    bars = []
    for name, some in counts.items():
        values = [(key, float(some[key]), None, None) for key in shown if key in some]
        rest = sum(n for key, n in some.items() if key not in shown)
        values += [("all others", float(rest), None, None)] if rest else []
        bars += [Bar(name, tuple(values))] if values else []
    return tuple(bars)


def open_loop_charts(scores: Path) -> tuple[Chart, ...]:
    """Rates with their intervals, and how long what took."""
    told = read_json(scores)
    runs = [*told.get("runs", ()), *told.get("baselines", ())]

    def bar(run: Mapping[str, Any]) -> Bar:
        name = f"baseline: {run['run']}" if run.get("baseline") else str(run["run"])
        values = []
        for key in RATES:
            if run.get(key) is not None and run.get(f"{key}_interval"):
                low, high = map(float, run[f"{key}_interval"])
                values.append((_rate(key), float(run[key]), low, high))
        return Bar(name, tuple(values))

    def seconds(run: Mapping[str, Any]) -> Bar:
        timed = run.get("seconds") or {}
        means = tuple(
            (key.removesuffix("_s"), 1e3 * float(t["mean"]), None, None) for key, t in timed.items()
        )
        return Bar(str(run["run"]), means)

    try:
        rates = tuple(bar(run) for run in runs)
        times = tuple(x for x in map(seconds, told.get("runs", ())) if x.values)
    except (KeyError, TypeError, ValueError) as error:
        raise SandraError(f"{scores}: is no result of an evaluation ({error})") from None
    charts = (
        Chart(
            "Rates", "Per cent of all situations, with Wilson's 95 % interval.", "bars", "%", rates
        ),
        Chart("Durations", "Means.", "bars", "ms", times),
    )
    return tuple(chart for chart in charts if chart.bars)


def _rate(key: str) -> str:
    return f"Safe@{key[-1]}" if key.startswith("safe") else f"Top-{key[-1]}"
