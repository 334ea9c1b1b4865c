"""Which actions were driven, fail-safe steps left aside (the paper's figure of distributions)."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from sandra.actions import ALL_PAIRS, Lateral, Longitudinal
from sandra.errors import SandraError
from sandra.view import palette
from sandra.view.lettering import fitted
from sandra.view.page import MARGIN, Page, checked

LOOKS: dict[str, tuple[str, str]] = {
    "keep": (palette.faded_hex(palette.INK, 0.55), ""),
    "accelerate": (palette.GREEN, "|||"),
    "decelerate": (palette.ORANGE, "///"),
    "stop": (palette.VERMILLION, "xxx"),
    "follow-lane": (palette.faded_hex(palette.INK, 0.55), ""),
    "left-lane": (palette.BLUE, "///"),
    "right-lane": (palette.VERMILLION, "\\\\\\"),
}
"""Colour and hatching of each action."""
_NAMES = {str(pair): pair for pair in ALL_PAIRS}
_LABELS, _WIDE, _HIGH, _GAP = 2.6, 2.3, 0.24, 0.35
_HEAD = 0.4


def shares(pairs: Mapping[str, int]) -> dict[str, float]:
    """Shares of the longitudinal and of the lateral actions among the steps that drove a pair.

    What is no pair (fail-safe steps) is left out; all are zero where nothing is left.
    """
    known = {_NAMES[name]: n for name, n in pairs.items() if name in _NAMES}
    total = max(sum(known.values()), 1)
    names = [x.value for x in (*Longitudinal, *Lateral)]
    return {
        name: sum(n for p, n in known.items() if name in (p.longitudinal.value, p.lateral.value))
        / total
        for name in names
    }


def distribution_figure(
    rows: Mapping[str, Mapping[str, int]], path: str | Path, *, dpi: int = 150
) -> Path:
    """Draw one pair of bars for each row: longitudinal and lateral actions.

    Args:
        rows: by title, how often each pair was driven ("keep,follow-lane": 12).

    Raises:
        SettingsError, SandraError: if no picture can be written there, or there is no pair.
    """
    where = checked(path, dpi)
    told = {title: shares(pairs) for title, pairs in rows.items()}
    told = {title: found for title, found in told.items() if any(found.values())}
    if not told:
        raise SandraError(f"{where}: no pair was driven in any row: nothing to draw")
    high = len(told) * _HIGH
    page = Page(MARGIN * 2 + _LABELS + 2 * _WIDE + _GAP, MARGIN + _HEAD + high + 0.5)
    for column, (kind, names) in enumerate(
        (
            ("longitudinal", [x.value for x in Longitudinal]),
            ("lateral", [x.value for x in Lateral]),
        )
    ):
        left = MARGIN + _LABELS + column * (_WIDE + _GAP)
        ax = page.axes(left, MARGIN + _HEAD, _WIDE, high)
        start = [0.0] * len(told)
        for name in names:
            values = [100.0 * found[name] for found in told.values()]
            colour, hatch = LOOKS[name]
            ax.barh(
                range(len(told)),
                values,
                left=start,
                height=0.7,
                color=colour,
                hatch=hatch,
                edgecolor=palette.PAPER,
                linewidth=0.3,
                label=name,
            )
            start = [a + b for a, b in zip(start, values, strict=True)]
        ax.set_ylim(len(told) - 0.5, -0.5)
        ax.set_xlim(0.0, 100.0)
        ax.set_yticks([])
        ax.tick_params(labelsize=7)
        ax.set_xlabel(f"{kind} actions [%]", fontsize=8)
        ax.legend(
            fontsize=7, frameon=False, ncols=2, loc="lower left", bbox_to_anchor=(-0.03, 1.0),
            borderaxespad=0.1, handlelength=1.4, columnspacing=1.0,
        )  # fmt: skip
    for row, title in enumerate(told):
        text = fitted(title, _LABELS - 0.1, 7.5)
        page.text(MARGIN, MARGIN + _HEAD + (row + 0.5) * _HIGH, text, size=7.5, va="center")
    return page.save(where, dpi)
