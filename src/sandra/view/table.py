"""The verdict table: one row per pair, reasons wrapped, the executed row marked."""

from __future__ import annotations

from dataclasses import dataclass

from sandra.reach import Status, Verdict
from sandra.view import palette
from sandra.view.lettering import fitted, wrapped
from sandra.view.page import Page, line_height

SIZE = 8.5
_PAD = 0.055
"""Above and below the text of a row [inch]."""
_COLUMNS = (("", 0.42), ("action pair", 2.05), ("verdict", 1.25), ("empty at step", 1.15))
_TIME = 0.85
_LINES = 3
"""A reason has at most so many lines."""


@dataclass(frozen=True, slots=True)
class Row:
    """One row as it is drawn. `rank` is None for a pair that was not ranked."""

    verdict: Verdict
    rank: int | None
    executed: bool
    passed_over: bool = False
    """It holds and was ranked before what is executed, but no trajectory was found for it."""


def height(rows: list[Row], width: float) -> float:
    """Height of the table [inch]; 0 without rows."""
    if not rows:
        return 0.0
    return _row_height(1) + sum(_row_height(len(_reason(row, width))) for row in rows)


def draw(page: Page, left: float, top: float, width: float, rows: list[Row]) -> float:
    """Draw the table; returns where the next thing may begin."""
    if not rows:
        return top
    titles = [*(name for name, _ in _COLUMNS), "time", "reason"]
    for x, title in zip(_lefts(left), titles, strict=True):
        page.text(x, top + _PAD, title, size=SIZE - 0.5, color=palette.FAINT_INK)
    top += _row_height(1)
    _line(page, left, top, width, palette.FAINT_INK, 0.8)
    for row in rows:
        top = _draw_row(page, left, top, width, row)
        _line(page, left, top, width, palette.RULE, 0.5)
    return top


def pair_name(verdict: Verdict) -> str:
    """The pair as the paper writes it."""
    return f"{verdict.pair.longitudinal.value}, {verdict.pair.lateral.value}"


def _draw_row(page: Page, left: float, top: float, width: float, row: Row) -> float:
    verdict = row.verdict
    reason = _reason(row, width)
    tall = _row_height(len(reason))
    style = palette.STATUS[verdict.status]
    step = verdict.first_empty_step
    if row.executed:
        page.rectangle(
            left, top, width, tall, facecolor=palette.EXECUTED_ROW, edgecolor="none", zorder=-1
        )
    rank = "" if row.rank is None else f"{row.rank}."
    cells = [
        (("▶ " if row.executed else "   ") + rank, palette.INK),
        (pair_name(verdict), palette.INK),
        (f"{style.symbol} {verdict.status.value}", style.colour),
        ("–" if step is None else str(step), palette.INK),
        (f"{1e3 * verdict.duration_s:.0f} ms", palette.FAINT_INK),
    ]
    lefts = _lefts(left)
    for x, following, (text, colour) in zip(lefts, lefts[1:], cells, strict=False):
        bold = row.executed or text.startswith(style.symbol)
        line = fitted(text, following - x, SIZE, bold=bold) if text.strip() == text else text
        page.text(x, top + _PAD, line, size=SIZE, bold=bold, color=colour)
    page.lines(lefts[-1], top + _PAD, reason, size=SIZE, bold=row.executed)
    return top + tall


def _lefts(left: float) -> list[float]:
    found = [left]
    for _, wide in (*_COLUMNS, ("time", _TIME)):
        found.append(found[-1] + wide)
    return found


def _reason(row: Row, width: float) -> list[str]:
    text = row.verdict.reason
    if text is None and row.verdict.first_empty_step is not None:
        text = "the cause was not asked for"
    elif text is None:
        certified = row.verdict.status is Status.CERTIFIED
        text = "certificate accepted" if certified else "non-empty through the horizon"
        if row.executed:
            text += "; executed"
        elif row.passed_over:
            text += "; not executed, as no trajectory was found in its corridor"
    room = width - (_lefts(0.0)[-1])
    return wrapped(text, room, SIZE, bold=row.executed, lines=_LINES)


def _row_height(lines: int) -> float:
    return max(1, lines) * line_height(SIZE) + 2 * _PAD


def _line(page: Page, left: float, top: float, width: float, colour: str, wide: float) -> None:
    page.rectangle(left, top, width, 0.0, facecolor="none", edgecolor=colour, linewidth=wide)
