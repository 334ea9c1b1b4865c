"""Bars with intervals, one group per metric (the paper's figure of ablation studies)."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from sandra.errors import SandraError
from sandra.view import palette
from sandra.view.lettering import fitted
from sandra.view.page import MARGIN, Page, checked

Bars = Mapping[str, Mapping[str, tuple[float, float, float]]]
"""By run and metric: (per cent, low, high)."""

_LOOKS = (
    (palette.BLUE, ""),
    (palette.ORANGE, "///"),
    (palette.GREEN, "|||"),
    (palette.VERMILLION, "\\\\\\"),
    (palette.faded_hex(palette.INK, 0.55), "---"),
    (palette.faded_hex(palette.BLUE, 0.6), "xxx"),
    (palette.faded_hex(palette.ORANGE, 0.6), ""),
    (palette.faded_hex(palette.GREEN, 0.6), "|||"),
)
"""Any two differ in hatching or in lightness."""
_AGAIN = ("", "...", "ooo", "+++")
"""Added to the hatching where there are more runs than looks."""
_HIGH, _BAR, _GAP, _ROW, _LEFT = 2.0, 0.13, 0.35, 0.2, 0.45


def ablation_figure(bars: Bars, path: str | Path, *, dpi: int = 150) -> Path:
    """Draw one bar for each run in each group of a metric, with its 95 % interval.

    Raises:
        SettingsError, SandraError: if no picture can be written there, or there is no bar.
    """
    where = checked(path, dpi)
    metrics = list(dict.fromkeys(name for found in bars.values() for name in found))
    if not metrics:
        raise SandraError(f"{where}: there is no score: nothing to draw")
    group = max(0.8, len(bars) * _BAR) + _GAP
    wide = max(4.0, len(metrics) * group)
    lines = -(-len(bars) // 2)
    page = Page(2 * MARGIN + _LEFT + wide, 2 * MARGIN + _HIGH + 0.35 + lines * _ROW)
    ax = page.axes(MARGIN + _LEFT, MARGIN, wide, _HIGH)
    step = wide / len(metrics)
    for row, (run, found) in enumerate(bars.items()):
        colour, hatch = _LOOKS[row % len(_LOOKS)]
        hatch += _AGAIN[min(row // len(_LOOKS), len(_AGAIN) - 1)]
        for column, metric in enumerate(metrics):
            if metric not in found:
                continue
            value, low, high = found[metric]
            x = (column + 0.5) * step + (row - (len(bars) - 1) / 2) * _BAR
            ax.bar(
                x,
                value,
                width=_BAR * 0.9,
                color=colour,
                hatch=hatch,
                edgecolor=palette.PAPER,
                linewidth=0.3,
                yerr=[[max(0.0, value - low)], [max(0.0, high - value)]],
                error_kw={"elinewidth": 0.7, "capsize": 1.2, "ecolor": palette.INK},
            )
        line, right = row % lines, row >= lines
        left, top = MARGIN + _LEFT + right * wide / 2, MARGIN + _HIGH + 0.4 + line * _ROW
        page.rectangle(
            left, top, 0.22, 0.11, facecolor=colour, hatch=hatch,
            edgecolor=palette.PAPER, linewidth=0.3,
        )  # fmt: skip
        page.text(left + 0.3, top - 0.02, fitted(run, wide / 2 - 0.4, 7.5), size=7.5)
    ax.set_xlim(0.0, wide)
    ax.set_ylim(0.0, 105.0)
    ax.set_xticks([(column + 0.5) * step for column in range(len(metrics))], metrics)
    ax.tick_params(labelsize=7)
    ax.tick_params(axis="x", length=0)
    ax.set_ylabel("share of all scenarios [%]", fontsize=8)
    ax.grid(axis="y", color=palette.RULE, linewidth=0.4)
    ax.set_axisbelow(True)
    for side in ("top", "right"):
        ax.spines[side].set_visible(False)
    return page.save(where, dpi)
