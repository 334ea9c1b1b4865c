"""How long decisions took: one box for each run (the paper's figure of runtimes)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from sandra.errors import SandraError
from sandra.view import palette
from sandra.view.lettering import fitted
from sandra.view.page import MARGIN, Page, checked

_LABELS, _WIDE, _ROW, _AXIS = 2.6, 4.2, 0.3, 0.5


def durations_figure(
    durations: Mapping[str, Sequence[float]], path: str | Path, *, dpi: int = 150
) -> Path:
    """Draw durations [s] on a logarithmic axis.

    A box holds the middle half with the median, its whiskers reach from the 5th to the 95th
    percentile; what lies beyond is a dot, and nothing is left out.

    Raises:
        SettingsError, SandraError: if no picture can be written there, or nothing took any time.
    """
    where = checked(path, dpi)
    told = {name: [v for v in values if v > 0.0] for name, values in durations.items()}
    told = {name: values for name, values in told.items() if values}
    if not told:
        raise SandraError(f"{where}: no duration is known: nothing to draw")
    high = len(told) * _ROW
    page = Page(2 * MARGIN + _LABELS + _WIDE, 2 * MARGIN + high + _AXIS)
    ax = page.axes(MARGIN + _LABELS, MARGIN, _WIDE, high)
    for row, values in enumerate(told.values()):
        low, first, middle, third, top = np.percentile(values, [5, 25, 50, 75, 95])
        ax.plot([low, top], [row, row], color=palette.INK, linewidth=0.8, zorder=1)
        ax.barh(
            row, third - first, left=first, height=0.55, zorder=2,
            color=palette.faded_hex(palette.BLUE, 0.6), edgecolor=palette.INK, linewidth=0.8,
        )  # fmt: skip
        ends = [row - 0.28, row + 0.28]
        ax.plot([middle, middle], ends, color=palette.VERMILLION, linewidth=1.4, zorder=3)
        beyond = [v for v in values if not low <= v <= top]
        ax.plot(beyond, [row] * len(beyond), ".", markersize=2.5, color=palette.FAINT_INK)
    ax.set_xscale("log")
    _label(ax, max(map(max, told.values())) / min(map(min, told.values())))
    ax.set_ylim(len(told) - 0.5, -0.5)
    ax.set_yticks([])
    ax.tick_params(labelsize=7)
    ax.set_xlabel("time of a decision [s]", fontsize=8)
    ax.grid(axis="x", color=palette.RULE, linewidth=0.4)
    ax.set_axisbelow(True)
    for side in ("top", "right"):
        ax.spines[side].set_visible(False)
    for row, name in enumerate(told):
        text = fitted(name, _LABELS - 0.1, 7.5)
        page.text(MARGIN, MARGIN + (row + 0.5) * _ROW, text, size=7.5, va="center")
    return page.save(where, dpi)


def _label(ax: Any, span: float) -> None:
    """Plain numbers, as many as there is room for."""
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

    ax.xaxis.set_major_locator(LogLocator(subs=(1, 2, 5) if span < 100 else (1,)))
    ax.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    ax.xaxis.set_minor_formatter(NullFormatter())
