"""Curves of time and memory against size."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from sandra.view import palette
from sandra.view.page import MARGIN, Page, checked

if TYPE_CHECKING:
    from sandra.evaluation.growth import Growth

STAGES = {
    "verify": ("all twelve pairs", palette.BLUE, "o", "-"),
    "ground": ("preparation", palette.VERMILLION, "s", "--"),
    "predict": ("prediction", palette.GREEN, "^", ":"),
}
"""Label, colour, marker and line of each time."""
LABELS = {"horizon": "horizon [steps]", "obstacles": "other vehicles", "lanes": "lanes"}
_WIDE, _HIGH, _GAP, _BELOW = 2.3, 1.7, 0.55, 0.25


def growth_figure(growth: Growth, path: str | Path, *, dpi: int = 150) -> Path:
    """Draw process CPU time (above) and memory (below) along each axis.

    Raises:
        SettingsError, SandraError: if no picture can be written there.
    """
    where = checked(path, dpi)
    axes = list(dict.fromkeys(point.axis for point in growth.points))
    left = MARGIN + 0.45
    width = left + len(axes) * (_WIDE + _GAP) - _GAP + MARGIN
    page = Page(width, 2 * MARGIN + 2 * _HIGH + 0.35 + _BELOW)
    for column, axis in enumerate(axes):
        points = growth.along(axis)
        x = [point.value for point in points]
        at = left + column * (_WIDE + _GAP)
        above = page.axes(at, MARGIN, _WIDE, _HIGH)
        for name, (label, colour, marker, line) in STAGES.items():
            y = [1e3 * getattr(point, name) for point in points]
            above.plot(x, y, color=colour, marker=marker, linestyle=line, ms=3, lw=1.2, label=label)
        below = page.axes(at, MARGIN + _HIGH + 0.35, _WIDE, _HIGH)
        below.plot(x, [p.memory for p in points], color=palette.INK, marker="o", ms=3, lw=1.2)
        below.set_xlabel(LABELS[axis], fontsize=8)
        for part in (above, below):
            part.set_ylim(0.0, 1.06 * part.get_ylim()[1])
            part.set_xlim(0.0, 1.03 * max(x))
            part.tick_params(labelsize=7)
            part.grid(color=palette.RULE, lw=0.5)
            part.set_axisbelow(True)
        if column == 0:
            above.set_ylabel("process CPU time [ms]", fontsize=8)
            below.set_ylabel("memory [MB]", fontsize=8)
            above.legend(fontsize=7, frameon=False)
    return page.save(where, dpi)
