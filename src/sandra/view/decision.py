"""The pictures of a decision and of verdicts: scenario, sets, table, time upwards, on one page."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from sandra.actions import ALL_PAIRS
from sandra.reach import Status, Verdicts
from sandra.view import header, table
from sandra.view.page import checked
from sandra.view.shapes import View
from sandra.view.sheet import Content, compose

if TYPE_CHECKING:
    import shapely

    from sandra.decision import Decision


def decision_figure(
    decision: Decision, path: str | Path, *, three_d: bool = True, dpi: int = 150
) -> Path:
    """Draw a decision: map, one panel per verified pair, verdict table, time upwards.

    Args:
        path: its suffix says the format: .png, .pdf or .svg. three_d: with the 3-D view.
        dpi: dots per inch of a .png.

    Returns:
        The path of the file.

    Raises:
        SettingsError: an unknown suffix or resolution. SandraError: the file cannot be written.
    """
    where = checked(path, dpi)
    view = View.of(decision.scene)
    executed = decision.executed
    rows = _in_order(_ranked_rows(decision))
    positions = [view.positions(row.verdict.reachable_set) for row in rows]
    main, caption = _longest_lived(rows, positions)
    caption = f"fail-safe; {caption}"
    if executed is not None:
        main = view.positions(executed.reachable_set.corridor())
        caption = f"driving corridor of {table.pair_name(executed)}"
    lines = header.of_decision(decision)
    shown = (positions, main, caption, decision.maneuver, decision.certificate)
    content = Content(decision.ground, rows, lines, *shown)
    return compose(content, view, three_d=three_d).save(where, dpi)


def verdict_figure(
    verdicts: Verdicts, path: str | Path, *, three_d: bool = True, dpi: int = 150
) -> Path:
    """Draw verdicts without a ranking: as `decision_figure`, with the set of the first pair that
    holds, else of the one that lasts longest.

    Args, returns, raises: see `decision_figure`.
    """
    where = checked(path, dpi)
    view = View.of(verdicts.ground.scene)
    rows = _in_order([table.Row(verdict, None, False) for verdict in verdicts])
    positions = [view.positions(row.verdict.reachable_set) for row in rows]
    main, caption = _longest_lived(rows, positions)
    lines = header.of_verdicts(verdicts)
    content = Content(verdicts.ground, rows, lines, positions, main, caption, None)
    return compose(content, view, three_d=three_d).save(where, dpi)


def _ranked_rows(decision: Decision) -> list[table.Row]:
    ranked = decision.ranking.pairs
    executed = decision.executed
    last = len(ranked) if executed is None else ranked.index(executed.pair)
    rows = []
    for verdict in decision.verdicts:
        rank = ranked.index(verdict.pair) if verdict.pair in ranked else None
        passed = rank is not None and rank < last and verdict.status is not Status.UNSAFE
        rows.append(
            table.Row(verdict, None if rank is None else rank + 1, verdict is executed, passed)
        )
    return rows


def _in_order(rows: list[table.Row]) -> list[table.Row]:
    """As asked; all twelve as in the paper's table, longitudinal by lateral."""
    if len(rows) == len(ALL_PAIRS) and {row.verdict.pair for row in rows} == set(ALL_PAIRS):
        return sorted(rows, key=lambda row: ALL_PAIRS.index(row.verdict.pair))
    return rows


def _longest_lived(
    rows: list[table.Row], positions: list[list[shapely.Geometry]]
) -> tuple[list[shapely.Geometry], str]:
    """The set of the first pair that holds, else of the one that lasts longest; and its caption."""
    if not rows:
        return [], "no pair was verified"
    # Of equals, the first asked for.
    best = max(range(len(rows)), key=lambda i: (len(positions[i]), -i))
    verdict = rows[best].verdict
    caption = f"reachable set of {table.pair_name(verdict)}"
    if verdict.status is Status.UNSAFE:
        caption += ", the one that lasts longest"
    return positions[best], caption
