"""How a loss fell over the steps of a training."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from sandra.view import palette
from sandra.view.page import MARGIN, Page, checked

if TYPE_CHECKING:
    from sandra.learn.tuning.curve import Curve

_WIDE, _HIGH = 4.6, 2.4


def learning_figure(
    curve: Curve, path: str | Path, *, per: str = "example", dpi: int = 150
) -> Path:
    """Draw the losses of training and validation, as far as they were measured.

    Args:
        per: what a loss is the mean over.

    Raises:
        SettingsError, SandraError: if no picture can be written there.
    """
    where = checked(path, dpi)
    page = Page(2 * MARGIN + _WIDE + 0.5, 2 * MARGIN + _HIGH + 0.4)
    ax = page.axes(MARGIN + 0.5, MARGIN, _WIDE, _HIGH)
    for points, label, colour, marker in (
        (curve.training, "training", palette.BLUE, ""),
        (curve.validation, "validation", palette.VERMILLION, "o"),
    ):
        if not points:
            continue
        ax.plot(*zip(*points, strict=True), color=colour, marker=marker, ms=3, lw=1.2, label=label)
    ax.set_xlabel("step", fontsize=8)
    ax.set_ylabel(f"loss [nat per {per}]", fontsize=8)
    ax.set_ylim(0.0, None)
    ax.tick_params(labelsize=7)
    ax.grid(color=palette.RULE, lw=0.5)
    ax.set_axisbelow(True)
    ax.legend(fontsize=7, frameon=False)
    return page.save(where, dpi)
