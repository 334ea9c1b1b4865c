"""What the colours and lines mean, in one strip, with the colour bar of the time steps."""

from __future__ import annotations

from typing import Any

from sandra.view import palette
from sandra.view.lettering import FAMILY, HINTING, font, width
from sandra.view.page import Page

SIZE = 8.0
_BAR = 2.2
"""Width of the colour bar with its label [inch]."""
_SAMPLE = 0.36
_LINE = 0.2


def draw(
    page: Page,
    left: float,
    top: float,
    wide: float,
    entries: list[tuple[str, str]],
    horizon: int | None,
    colours: Any,
) -> None:
    """Draw the strip, `wide` inches wide. The bar at its right is drawn if there is a horizon.

    Entries are (kind, text); for the kinds see `_BOXES`, others are those of `palette.LINES`.
    """
    for x, line, (kind, text) in _placed(entries, wide, horizon is not None):
        middle = top + 0.14 + line * _LINE
        _sample(page, left + x, middle, kind)
        page.text(
            left + x + _SAMPLE,
            middle,
            text,
            size=SIZE,
            va="center_baseline",
            color=palette.FAINT_INK,
        )
    if horizon is not None:
        _bar(page, left + wide - _BAR, top + 0.06, horizon, colours)


def height(wide: float, entries: list[tuple[str, str]], *, bar: bool) -> float:
    """Height that the strip needs [inch]."""
    lines = max((line for _, line, _ in _placed(entries, wide, bar)), default=0) + 1
    return max(0.45 if bar else 0.0, 0.14 + _LINE * lines)


def _placed(
    entries: list[tuple[str, str]], wide: float, bar: bool
) -> list[tuple[float, int, tuple[str, str]]]:
    """(x, line, entry) of each entry."""
    x, line = 0.0, 0
    found = []
    for entry in entries:
        needed = _SAMPLE + (1.0 + HINTING) * width(entry[1], SIZE)
        # The bar and its numbers stand beside the first two lines.
        room = wide - (_BAR + 0.2 if bar and line < 2 else 0.0)
        if x > 0.0 and x + needed > room:
            x, line = 0.0, line + 1
        found.append((x, line, entry))
        x += needed + 0.16
    return found


def _bar(page: Page, left: float, top: float, horizon: int, colours: Any) -> None:
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Normalize
    from matplotlib.ticker import MaxNLocator

    label = 0.75
    ax = page.axes(left + label, top, _BAR - label - 0.1, 0.11)
    page.text(
        left, top + 0.055, "time step", size=SIZE, va="center_baseline", color=palette.FAINT_INK
    )
    bar = page.figure.colorbar(
        ScalarMappable(Normalize(0, max(1, horizon)), colours), cax=ax, orientation="horizontal"
    )
    bar.outline.set_linewidth(0.0)
    ax.xaxis.set_major_locator(MaxNLocator(5, integer=True))
    ax.tick_params(
        labelsize=SIZE - 1, labelfontfamily=FAMILY, labelcolor=palette.FAINT_INK, length=2, pad=1
    )
    ax.xaxis.label.set_fontproperties(font(SIZE))


_BOXES: dict[str, dict[str, Any]] = {
    "ego": {"facecolor": palette.EGO, "edgecolor": "none"},
    "other": {"facecolor": palette.OTHER, "edgecolor": palette.INK, "linewidth": 0.5},
    "occupancy": {
        "facecolor": palette.faded(palette.OCCUPANCY, 0.6),
        "edgecolor": palette.OCCUPANCY,
        "linestyle": (0, (3, 2)),
        "linewidth": 0.7,
    },
    "lane": {"facecolor": palette.CURRENT_LANE, "edgecolor": palette.BORDER, "linewidth": 0.5},
    "goal": {"facecolor": palette.GOAL, "edgecolor": "none", "alpha": 0.7},
    "last": {"facecolor": "none", "edgecolor": palette.INK, "linewidth": 0.8},
    "contested": {
        "facecolor": "none",
        "edgecolor": palette.BLOCKING,
        "linewidth": 0.8,
        "linestyle": (0, (1.5, 1.5)),
    },
    "blocking": {
        "facecolor": palette.faded(palette.BLOCKING, 0.55),
        "edgecolor": palette.BLOCKING,
        "linewidth": 1.0,
    },
}


def _sample(page: Page, x: float, middle: float, kind: str) -> None:
    if kind in _BOXES:
        page.rectangle(x, middle - 0.05, 0.27, 0.1, **_BOXES[kind])
        return
    page.line(x, middle, 0.29, **palette.LINES[kind])
