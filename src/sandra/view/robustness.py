"""Robustness of traffic rules over time, one panel for each rule."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from sandra.errors import SandraError
from sandra.view import palette
from sandra.view.lettering import fitted
from sandra.view.page import MARGIN, Page, checked

if TYPE_CHECKING:
    from sandra.monitor import Robustness

STYLES = {
    "R_G1": (palette.BLUE, "-", "distance beyond the safe one [m]"),
    "R_G2": (palette.VERMILLION, "--", "acceleration above abrupt [m/s^2]"),
    "R_G3": (palette.GREEN, "-.", "speed below the limit [m/s]"),
}
"""Colour, line and what is measured."""
_WIDE, _HIGH, _GAP, _LEFT = 5.6, 1.15, 0.34, 0.4


def robustness_figure(robustness: Robustness, path: str | Path, *, dpi: int = 150) -> Path:
    """Draw each rule's robustness over time with a line at zero; below it the ground is shaded.

    Steps at which a rule is broken carry a cross. Where nothing is demanded there is no line.

    Raises:
        SettingsError, SandraError: if no picture can be written there.
    """
    where = checked(path, dpi)
    count = len(robustness.rules)
    top = MARGIN + 0.45
    page = Page(_WIDE + _LEFT + 2 * MARGIN, top + count * (_HIGH + _GAP) + MARGIN)
    title = fitted(f"{robustness.scene}: robustness (negative: broken)", _WIDE, 9.0, bold=True)
    page.text(MARGIN + _LEFT, MARGIN - 0.1, title, size=9.0, bold=True)
    times = robustness.times
    for row, rule in enumerate(robustness.rules):
        colour, line, measured = STYLES[rule.rule]
        above = top + row * (_HIGH + _GAP)
        word = "kept" if rule.holds else "broken"
        page.text(MARGIN + _LEFT, above - 0.2, f"{rule.rule}, {word}: {measured}", size=7.5)
        ax = page.axes(MARGIN + _LEFT, above, _WIDE, _HIGH)
        values = np.where(np.isfinite(rule.values), rule.values, np.nan)
        ax.plot(times, values, color=colour, linestyle=line, lw=1.4, marker=".", ms=2.5)
        broken = ~rule.kept
        ax.plot(times[broken], values[broken], color=palette.INK, marker="x", ms=4, lw=0)
        ax.axhline(0.0, color=palette.INK, lw=0.9)
        low, high = ax.get_ylim()
        low, high = min(low, -0.05 * (high - low)), max(high, 0.05 * (high - low))
        ax.axhspan(low, 0.0, color=palette.RULE, alpha=0.5, lw=0)
        ax.set_ylim(low, high)
        ax.set_xlim(0.0, max(float(times[-1]), robustness.dt))
        ax.tick_params(labelsize=7, labelbottom=row == count - 1)
        ax.grid(color=palette.RULE, lw=0.5)
        ax.set_axisbelow(True)
    ax.set_xlabel("time [s]", fontsize=8)
    return page.save(where, dpi)


COMPARED = (
    (palette.VERMILLION, "-.", "x"),
    (palette.BLUE, "-", "o"),
    (palette.INK, "--", "s"),
    (palette.GREEN, ":", "^"),
)
"""Colour, line and marker of each trajectory that is compared, told apart in grey by the line."""


def comparison_figure(
    drives: Mapping[str, Robustness], path: str | Path, *, dpi: int = 150
) -> Path:
    """Draw the normalised robustness of several trajectories, one panel for each rule.

    -1 and 1 are the bounds to which it is cut off, and 0 is where a rule is broken; where nothing
    is demanded, the line is at 1.

    Args:
        drives: at most four, by the name that the legend gives them, monitored for the same rules.

    Raises:
        SandraError: for none or more than four, or other rules; or no picture can be written there.
    """
    where = checked(path, dpi)
    if not 1 <= len(drives) <= len(COMPARED):
        raise SandraError(
            f"{where}: from 1 to {len(COMPARED)} drives can be told apart in a figure"
        )
    rules = [rule.rule for rule in next(iter(drives.values())).rules]
    if any([rule.rule for rule in drive.rules] != rules for drive in drives.values()):
        raise SandraError(f"{where}: the drives were not monitored for the same rules")
    top = MARGIN + 0.55
    page = Page(_WIDE + _LEFT + 2 * MARGIN, top + len(rules) * (_HIGH + _GAP) + MARGIN)
    last = max(float(drive.times[-1]) for drive in drives.values())
    for row, rule in enumerate(rules):
        above = top + row * (_HIGH + _GAP)
        page.text(MARGIN + _LEFT, above - 0.2, f"{rule}: normalised robustness", size=7.5)
        ax = page.axes(MARGIN + _LEFT, above, _WIDE, _HIGH)
        for (name, drive), (colour, line, marker) in zip(drives.items(), COMPARED, strict=False):
            look = {"color": colour, "linestyle": line, "marker": marker}
            every = max(1, len(drive.times) // 12)
            ax.plot(drive.times, drive[rule].normalised, lw=1.3, ms=3, markevery=every,
                    label=fitted(name, _WIDE / len(drives) - 0.45, 7.0), **look)  # fmt: skip
        ax.axhspan(-1.1, 0.0, color=palette.RULE, alpha=0.5, lw=0)
        ax.axhline(0.0, color=palette.INK, lw=0.9)
        ax.set_ylim(-1.1, 1.1)
        ax.set_xlim(0.0, max(last, 1e-3))
        ax.tick_params(labelsize=7, labelbottom=row == len(rules) - 1)
        ax.grid(color=palette.RULE, lw=0.5)
        ax.set_axisbelow(True)
        if row == 0:
            ax.legend(fontsize=7, frameon=False, ncols=len(drives), loc="lower left",
                      columnspacing=1.0, bbox_to_anchor=(0.0, 1.2), borderaxespad=0.0)  # fmt: skip
    ax.set_xlabel("time [s]", fontsize=8)
    return page.save(where, dpi)
