"""The loss over the steps of a training."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from sandra.errors import SandraError
from sandra.learn.tuning.curve import Point
from sandra.view import palette
from sandra.view.page import MARGIN, Page, checked

_WIDE, _HIGH, _LEFT, _BELOW = 4.6, 2.4, 0.5, 0.35


def loss_figure(points: Sequence[Point], path: str | Path, *, dpi: int = 150) -> Path:
    """Draw the loss in training (line) and on held-out rows (line with markers).

    Raises:
        SettingsError, SandraError: if no picture can be written there, or there is no point.
    """
    where = checked(path, dpi)
    if not points:
        raise SandraError(f"{where}: no loss was measured: nothing to draw")
    page = Page(2 * MARGIN + _LEFT + _WIDE, 2 * MARGIN + _HIGH + _BELOW)
    ax = page.axes(MARGIN + _LEFT, MARGIN, _WIDE, _HIGH)
    looks = {
        "train": ("training", palette.BLUE, "", "-"),
        "validation": ("validation", palette.VERMILLION, "o", "--"),
    }
    for name, (label, colour, marker, line) in looks.items():
        known = [(p.step, value) for p in points if (value := getattr(p, name)) is not None]
        if known:
            x, y = zip(*known, strict=True)
            if len(known) == 1 and not marker:
                marker = "."
            ax.plot(x, y, color=colour, marker=marker, linestyle=line, ms=3.5, lw=1.2, label=label)
    ax.set_ylim(0.0, 1.06 * ax.get_ylim()[1])
    ax.set_xlabel("step", fontsize=8)
    ax.set_ylabel("loss of the answer's tokens [nat]", fontsize=8)
    ax.tick_params(labelsize=7)
    ax.grid(color=palette.RULE, lw=0.5)
    ax.set_axisbelow(True)
    ax.legend(fontsize=7, frameon=False)
    return page.save(where, dpi)
