"""What the colours and lines mean, in one strip, with the colour bar of the time steps."""

from __future__ import annotations

from typing import Any

from sandra.view import palette
from sandra.view.lettering import FAMILY, font, width
from sandra.view.page import Page

SIZE = 8.0
HEIGHT = 0.5
"""Of the strip [inch]."""
_BAR = 2.2


def draw(
    page: Page,
    left: float,
    top: float,
    entries: list[tuple[str, str]],
    horizon: int | None,
    colours: Any,
) -> None:
    """Entries are (kind, text); kinds: see `_sample`. The bar is drawn if there is a horizon."""
    x = left
    middle = top + 0.16
    for kind, text in entries:
        wide = 0.36 + width(text, SIZE) + 0.22
        if x + wide > page.width - left - (_BAR + 0.2 if horizon is not None else 0.0) and x > left:
            x, middle = left, middle + 0.2
        _sample(page, x, middle, kind)
        page.text(x + 0.36, middle, text, size=SIZE, va="center_baseline", color=palette.FAINT_INK)
        x += wide
    if horizon is not None:
        _bar(page, page.width - left - _BAR, top + 0.04, horizon, colours)


def height(page_width: float, left: float, entries: list[tuple[str, str]], *, bar: bool) -> float:
    """Height that the strip needs [inch]."""
    room = page_width - 2 * left - (_BAR + 0.2 if bar else 0.0)
    x, lines = 0.0, 1
    for _, text in entries:
        wide = 0.36 + width(text, SIZE) + 0.22
        if x + wide > room and x > 0.0:
            x, lines = 0.0, lines + 1
        x += wide
    return max(HEIGHT if bar else 0.34, 0.14 + 0.2 * lines)


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
    "other": {"facecolor": palette.OTHER, "edgecolor": "none"},
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
    colour = palette.FAIL_SAFE if kind == "fail-safe" else palette.TRAJECTORY
    page.rectangle(x, middle, 0.27, 0.0, facecolor="none", edgecolor=colour, linewidth=1.6)
