"""The document of many episodes: of a run, or of an evaluation, each row linked to its episodes."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from sandra.errors import SandraError
from sandra.view.report.document import Cell, Document, Row, Table
from sandra.view.report.episode import read_json
from sandra.view.report.results import (
    closed_loop_charts,
    open_loop_charts,
    table_of,
    title_in,
)


@dataclass(frozen=True, slots=True)
class Found:
    """A document, and the folders of the episodes that it links to, by the file of their page."""

    document: Document
    episodes: Mapping[str, Path]


def kind_of(folder: Path) -> str:
    """ "episode", "run", "closed-loop" or "open-loop".

    Raises:
        SandraError: if the folder is none of these.
    """
    if (folder / "metrics.json").exists():
        return "episode"
    if (folder / "run.json").exists():
        return "run"
    if (folder / "table.json").exists():
        return "closed-loop"
    if (folder / "scores.json").exists():
        return "open-loop"
    raise SandraError(
        f"{folder}: holds neither an episode (metrics.json), nor a run (run.json), nor an "
        "evaluation (table.json, scores.json); name such a folder"
    )


def episodes_in(run: Path) -> list[Path]:
    """The whole episodes of a run, by their seeds."""
    found = [x.parent for x in run.glob("seed-*/metrics.json")]
    return sorted(found, key=lambda x: (len(x.name), x.name))


def run_document(run: Path, pages: str, linked: bool = True) -> Found:
    """A run of several seeds: one row for each episode.

    Args:
        pages: name of the folder of the pages of episodes. linked: whether they are there.
    """
    about = read_json(run / "run.json").get("drive", {})
    folders = episodes_in(run)
    if not folders:
        raise SandraError(f"{run}: holds no whole episode yet")
    episodes = _pages(run, folders, pages) if linked else {}
    names = {folder: page for page, folder in episodes.items()}
    rows = []
    for folder in folders:
        measured = read_json(folder / "metrics.json")
        m = measured.get("metrics", {})
        operations = ", ".join(f"{k} {n}" for k, n in measured.get("operations", {}).items())
        cells = (
            str(measured.get("seed")),
            "success" if m.get("success") else "no success",
            f"{m.get('distance', 0.0):.1f}",
            str(m.get("steps")),
            f"{100 * m.get('fail_safe_rate', 0.0):.0f}",
            *(
                str(m.get("compliant_steps", {}).get(rule, "-"))
                for rule in ("R_G1", "R_G2", "R_G3")
            ),
            operations,
            "; ".join(map(str, measured.get("told", ()))),
        )
        link = (Cell("open", names[folder]),) if folder in names else ()
        rows.append(Row(cells, link))
    headers = ("seed", "outcome", "distance (m)", "steps", "fail-safe %", "R_G1", "R_G2", "R_G3")
    table = Table(
        "Episodes",
        "Steps that keep each rule; by what the ego was driven.",
        (*headers, "driven by", "told"),
        tuple(rows),
    )
    facts = tuple(
        (name, str(about.get(key) or "none"))
        for name, key in (
            ("ranked by", "ranker"),
            ("command", "command"),
            ("prediction", "prediction"),
        )
    )
    rules = ", ".join(about.get("rules") or ()) or "none"
    document = Document("evaluation", run.name, (*facts, ("rules", rules)), tables=(table,))
    return Found(document, episodes)


def closed_loop_document(folder: Path, pages: str, linked: bool = True) -> Found:
    """A folder of `sandra evaluate closed-loop`; see `run_document`."""
    told = read_json(folder / "table.json")
    entries = [x for x in told.get("rows", ()) if isinstance(x, dict)]
    behind = [_behind(folder, entry) for entry in entries]
    every = [episode for some in behind for episode in some]
    episodes = _pages(folder, every, pages) if linked else {}
    names = {path: page for page, path in episodes.items()}
    main = table_of(folder / "table.csv", "", "")
    # The paper's rows come first; ours are the entries, in their order.
    first = 0 if main is None else len(main.rows) - len(entries)
    cells = [tuple(Cell(_short(x), names.get(x)) for x in some) for some in behind]
    tables = (
        table_of(
            folder / "table.csv",
            "The paper's metrics",
            title_in(folder / "table.md", ""),
            {first + i: x for i, x in enumerate(cells)},
        ),
        table_of(
            folder / "beside.csv",
            "Beside them",
            title_in(folder / "beside.md", ""),
            dict(enumerate(cells)),
        ),
    )
    pairs = {
        f"{entry['row']}, setting {entry['setting']}": _pairs(some)
        for entry, some in zip(entries, behind, strict=True)
    }
    document = Document(
        "evaluation",
        f"Closed loop: {folder.name}",
        (("profile", str(told.get("profile"))), ("episodes", str(len(every)))),
        tables=tuple(x for x in tables if x is not None),
        charts=closed_loop_charts(entries, pairs),
    )
    return Found(document, episodes)


def open_loop_document(folder: Path) -> Document:
    """A folder of `sandra evaluate open-loop` or `rankings`."""
    tables = (
        table_of(folder / f"{file}.csv", name, title_in(folder / f"{file}.md", ""))
        for file, name in (
            ("scores", "Scores"),
            ("actions", "By action"),
            ("runtimes", "Durations"),
        )
    )
    shown = tuple(table for table in tables if table is not None)
    charts = open_loop_charts(folder / "scores.json")
    return Document("evaluation", f"Open loop: {folder.name}", (), tables=shown, charts=charts)


def _behind(folder: Path, entry: Mapping[str, Any]) -> list[Path]:
    """The episodes of an entry: those of its run folder, and of the repeats of it."""
    name = "".join(
        c if c.isalnum() or c in "-_." else "-" for c in str(entry["row"]).replace("/", "_")
    )
    runs = [x for x in folder.iterdir() if re.fullmatch(re.escape(name) + r"(_\d+)?", x.name)]
    found = [x for run in sorted(runs) for x in episodes_in(run / f"setting-{entry['setting']}")]
    return found


def _pairs(episodes: list[Path]) -> Counter[str]:
    found: Counter[str] = Counter()
    for episode in episodes:
        found.update(read_json(episode / "metrics.json").get("pairs", {}))
    return found


def _pages(folder: Path, episodes: list[Path], pages: str) -> dict[str, Path]:
    """A file for each episode, named after its place below the folder."""
    found: dict[str, Path] = {}
    for episode in episodes:
        text = "_".join(episode.relative_to(folder).parts)
        safe = "".join(c if (c.isalnum() and c.isascii()) or c in "-_." else "-" for c in text)
        found[f"{pages}/{safe}.html"] = episode
    return found


def _short(episode: Path) -> str:
    return episode.name.removeprefix("seed-")
