"""The small maps, one per pair, all of the same place."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from sandra.reach import Ground
from sandra.view import palette
from sandra.view.chart import TICKS, fit
from sandra.view.lettering import fitted
from sandra.view.page import MARGIN, Page
from sandra.view.scene import axes_in, draw_bodies, draw_map
from sandra.view.sets import draw_blocking, draw_sets
from sandra.view.shapes import View, Window
from sandra.view.table import Row, pair_name

if TYPE_CHECKING:
    import shapely

GAP = 0.18
"""Between parts of a page [inch]."""
_TITLES = 0.36
"""Room for the two lines above a panel [inch]."""


@dataclass(frozen=True, slots=True)
class Grid:
    """The grid of small maps: all show the same window."""

    count: int
    columns: int
    window: Window
    wide: float
    high: float

    @staticmethod
    def of(count: int, window: Window, inner: float) -> Grid:
        """The grid for so many panels on a page with `inner` inches between its margins."""
        columns = {0: 1, 1: 2, 2: 2, 4: 4}.get(count, 3)
        wide = (inner - TICKS - (columns - 1) * GAP) / columns
        window, high = fit(window, wide, (0.95, 2.3 if count <= 6 else 1.5), least=30.0)
        return Grid(count, columns, window, wide, high)

    @property
    def height(self) -> float:
        """Of the whole grid [inch]."""
        rows = -(-self.count // self.columns)
        return rows * self._pitch + 0.1 if rows else 0.0

    @property
    def _pitch(self) -> float:
        return self.high + _TITLES + 0.08

    def corner(self, index: int) -> tuple[float, float]:
        """(left, top) of a panel's titles [inch], from the top of the grid."""
        row, column = divmod(index, self.columns)
        return MARGIN + TICKS + column * (self.wide + GAP), row * self._pitch

    def is_outer(self, index: int) -> tuple[bool, bool]:
        """Whether nothing is (left of, below) a panel."""
        return index % self.columns == 0, index + self.columns >= self.count


def draw_panel(
    page: Page,
    view: View,
    row: Row,
    base: Ground,
    positions: list[shapely.Geometry],
    grid: Grid,
    index: int,
    top: float,
    colours: Any,
) -> None:
    """One pair: name, verdict, its set over time, and what is in the way when it ends.

    `top` is that of the grid [inch], `index` the panel's place in it.
    """
    left, below = grid.corner(index)
    top, width = top + below, grid.wide
    verdict = row.verdict
    style = palette.STATUS[verdict.status]
    rank = "" if row.rank is None else f"{row.rank}. "
    name = fitted(rank + pair_name(verdict), width - 0.9, 8.5, bold=True)
    page.text(left, top, name, size=8.5, bold=True)
    if row.executed:
        page.text(left + width, top, "▶ executed", size=8.0, bold=True, ha="right")
    step = verdict.first_empty_step
    end = f"empty at step {step}" if step is not None else f"through step {base.horizon}"
    line = fitted(f"{style.symbol} {verdict.status.value}: {end}", width, 8.0)
    page.text(left, top + 0.16, line, size=8.0, color=style.colour)

    ax = page.axes(left, top + _TITLES, width, grid.high)
    axes_in(ax, grid.window, size=6.5)
    at_left, at_bottom = grid.is_outer(index)
    ax.tick_params(labelleft=at_left, labelbottom=at_bottom)
    draw_map(ax, view, grid.window, arrows=False)
    draw_sets(ax, positions, base.horizon, colours)
    draw_bodies(ax, view, grid.window)
    draw_blocking(ax, view, verdict, base)
    for spine in ax.spines.values():
        spine.set_zorder(9.0)
        if row.executed:
            spine.set_color(palette.EXECUTED)
            spine.set_linewidth(2.0)
