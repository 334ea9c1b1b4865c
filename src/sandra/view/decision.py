"""The pictures of a decision and of verdicts: scenario, sets, table, time upwards, on one page."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from sandra.actions import ALL_PAIRS
from sandra.planning.types import Maneuver
from sandra.reach import Ground, Status, Verdicts
from sandra.view import header, legend, palette, table
from sandra.view.chart import TICKS, draw_chart, fit
from sandra.view.header import Line
from sandra.view.lettering import fitted
from sandra.view.page import MARGIN, Page, checked
from sandra.view.scene import axes_in, draw_bodies, draw_map, near
from sandra.view.sets import draw_blocking, draw_sets
from sandra.view.shapes import View, Window, bounds, grown
from sandra.view.three_d import draw_stack

if TYPE_CHECKING:
    import shapely

    from sandra.decision import Decision

WIDTH = 13.0
"""Of the page [inch]."""
_MAP_SHARE = 0.62
"""Of the width, when the 3-D view is beside the map."""
_GAP = 0.18
_CAPTION = 0.26
"""Room for the line above the map [inch]."""
_TITLES = 0.36
"""Room for the two lines above a panel [inch]."""


@dataclass(frozen=True, slots=True)
class _Content:
    """What goes on the page, whether it comes from a decision or from verdicts alone."""

    base: Ground
    rows: list[table.Row]
    header: list[Line]
    positions: list[list[shapely.Geometry]]
    """Per row, the set's positions step by step."""
    main: list[shapely.Geometry]
    """Those that the map and the 3-D view show: the corridor, or the set of one pair."""
    caption: str
    maneuver: Maneuver | None


def decision_figure(
    decision: Decision, path: str | Path, *, three_d: bool = True, dpi: int = 150
) -> Path:
    """Draw a decision: map, one panel per verified pair, verdict table, time upwards.

    Args:
        path: its suffix says the format: .png, .pdf or .svg. three_d: with the 3-D view.
        dpi: dots per inch of a .png.

    Returns:
        The path of the file.

    Raises:
        SettingsError: an unknown suffix or resolution. SandraError: the file cannot be written.
    """
    where = checked(path, dpi)
    view = View.of(decision.scene)
    executed = decision.executed
    rows = _in_order(_ranked_rows(decision))
    positions = [view.positions(row.verdict.reachable_set) for row in rows]
    main, caption = _longest_lived(rows, positions)
    caption = f"fail-safe; {caption}"
    if executed is not None:
        main = view.positions(executed.reachable_set.corridor())
        caption = f"driving corridor of {table.pair_name(executed)}"
    lines = header.of_decision(decision)
    content = _Content(decision.ground, rows, lines, positions, main, caption, decision.maneuver)
    return _draw(content, view, three_d).save(where, dpi)


def verdict_figure(
    verdicts: Verdicts, path: str | Path, *, three_d: bool = True, dpi: int = 150
) -> Path:
    """Draw verdicts without a ranking: as `decision_figure`, with the set of the first pair that
    holds, else of the one that lasts longest.

    Args, returns, raises: see `decision_figure`.
    """
    where = checked(path, dpi)
    view = View.of(verdicts.ground.scene)
    rows = _in_order([table.Row(verdict, None, False) for verdict in verdicts])
    positions = [view.positions(row.verdict.reachable_set) for row in rows]
    main, caption = _longest_lived(rows, positions)
    lines = header.of_verdicts(verdicts)
    content = _Content(verdicts.ground, rows, lines, positions, main, caption, None)
    return _draw(content, view, three_d).save(where, dpi)


def _ranked_rows(decision: Decision) -> list[table.Row]:
    ranked = decision.ranking.pairs
    executed = decision.executed
    last = len(ranked) if executed is None else ranked.index(executed.pair)
    rows = []
    for verdict in decision.verdicts:
        rank = ranked.index(verdict.pair) if verdict.pair in ranked else None
        passed = rank is not None and rank < last and verdict.status is not Status.UNSAFE
        rows.append(
            table.Row(verdict, None if rank is None else rank + 1, verdict is executed, passed)
        )
    return rows


def _in_order(rows: list[table.Row]) -> list[table.Row]:
    """As asked; all twelve as in the paper's table, longitudinal by lateral."""
    if len(rows) == len(ALL_PAIRS) and {row.verdict.pair for row in rows} == set(ALL_PAIRS):
        return sorted(rows, key=lambda row: ALL_PAIRS.index(row.verdict.pair))
    return rows


def _longest_lived(
    rows: list[table.Row], positions: list[list[shapely.Geometry]]
) -> tuple[list[shapely.Geometry], str]:
    """The set of the first pair that holds, else of the one that lasts longest; and its caption."""
    if not rows:
        return [], "no pair was verified"
    # The sort is stable: of equals, the first asked for.
    best = max(range(len(rows)), key=lambda i: (len(positions[i]), -i))
    verdict = rows[best].verdict
    caption = f"reachable set of {table.pair_name(verdict)}"
    if verdict.status is Status.UNSAFE:
        caption += ", the one that lasts longest"
    return positions[best], caption


def _draw(content: _Content, view: View, three_d: bool) -> Page:
    colours = palette.time_map()
    horizon = content.base.horizon
    inner = WIDTH - 2 * MARGIN
    focus = _focus(content, view)
    laid = header.laid_out(content.header, inner)
    map_width = (_MAP_SHARE if three_d else 1.0) * inner - TICKS
    window, map_height = fit(grown(focus, 8.0, 4.5), map_width, (2.4, 5.0), least=50.0)
    panels = _Panels.of(len(content.rows), grown(focus, 3.0, 2.0), inner)
    entries = _entries(content)
    strip = legend.height(map_width, entries, bar=True)
    scenery = max(_CAPTION + map_height + TICKS + strip, 3.6 if three_d else 0.0)
    table_height = table.height(content.rows, inner)
    parts = (header.height(laid), scenery, _GAP + panels.height, _GAP + table_height)
    page = Page(WIDTH, 2 * MARGIN + sum(parts))

    top = header.draw(page, MARGIN, MARGIN, inner, view.scene.name, laid)
    others = near(view, window, content.base.prediction)
    left = MARGIN + TICKS
    caption = fitted(content.caption, map_width, 9.0, bold=True)
    page.text(left, top + 0.04, caption, size=9.0, bold=True)
    place = (left, top + _CAPTION, map_width, map_height)
    shown = (content.main, content.maneuver, horizon, colours)
    draw_chart(page, place, view, window, others, *shown)
    below = top + _CAPTION + map_height + TICKS
    legend.draw(page, left, below, map_width, entries, horizon, colours)
    if three_d:
        left += map_width + _GAP
        page.text(left + 0.2, top + 0.04, "the same, time upwards", size=9.0, bold=True)
        ax = page.axes(left, top + 0.2, WIDTH - MARGIN - left, scenery - 0.2, projection="3d")
        draw_stack(ax, view, _ground_window(grown(focus, 4.0, 3.0)), others, *shown)
    top += scenery + _GAP
    for index in range(len(content.rows)):
        _panel(page, content, view, index, panels, top, colours)
    top += panels.height + _GAP
    table.draw(page, MARGIN, top, inner, content.rows)
    return page


@dataclass(frozen=True, slots=True)
class _Panels:
    """The grid of small maps: all show the same window."""

    count: int
    columns: int
    window: Window
    wide: float
    high: float

    @staticmethod
    def of(count: int, window: Window, inner: float) -> _Panels:
        columns = {0: 1, 1: 2, 2: 2, 4: 4}.get(count, 3)
        wide = (inner - TICKS - (columns - 1) * _GAP) / columns
        window, high = fit(window, wide, (0.95, 2.3 if count <= 6 else 1.5), least=30.0)
        return _Panels(count, columns, window, wide, high)

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
        return MARGIN + TICKS + column * (self.wide + _GAP), row * self._pitch

    def is_outer(self, index: int) -> tuple[bool, bool]:
        """Whether nothing is (left of, below) a panel."""
        return index % self.columns == 0, index + self.columns >= self.count


def _focus(content: _Content, view: View) -> Window:
    """The ego, every reachable set, and what of the maneuver lies within the horizon."""
    import shapely

    state = view.scene.ego.state
    shapes = [view.body(view.scene.ego.outline, (state.x, state.y, state.heading))]
    for steps in content.positions:
        shapes += steps
    shapes += content.main
    if content.maneuver is not None and len(content.maneuver.states) > 1:
        shapes.append(shapely.LineString(view.points(content.maneuver.states)))
    found = bounds(shapes)
    assert found is not None
    return found


def _ground_window(window: Window) -> Window:
    """Not so narrow that the stack becomes a wall."""
    least = 0.3 * (window[1] - window[0])
    more = max(0.0, least - (window[3] - window[2])) / 2
    return window[0], window[1], window[2] - more, window[3] + more


def _panel(
    page: Page,
    content: _Content,
    view: View,
    index: int,
    panels: _Panels,
    top: float,
    colours: Any,
) -> None:
    """One pair: name, verdict, its set over time, and what is in the way when it ends."""
    left, below = panels.corner(index)
    top, width = top + below, panels.wide
    row = content.rows[index]
    verdict = row.verdict
    style = palette.STATUS[verdict.status]
    rank = "" if row.rank is None else f"{row.rank}. "
    name = fitted(rank + table.pair_name(verdict), width - 0.9, 8.5, bold=True)
    page.text(left, top, name, size=8.5, bold=True)
    if row.executed:
        page.text(left + width, top, "▶ executed", size=8.0, bold=True, ha="right")
    step = verdict.first_empty_step
    end = f"empty at step {step}" if step is not None else f"through step {content.base.horizon}"
    line = fitted(f"{style.symbol} {verdict.status.value}: {end}", width, 8.0)
    page.text(left, top + 0.16, line, size=8.0, color=style.colour)

    ax = page.axes(left, top + _TITLES, width, panels.high)
    axes_in(ax, panels.window, size=6.5)
    at_left, at_bottom = panels.is_outer(index)
    ax.tick_params(labelleft=at_left, labelbottom=at_bottom)
    draw_map(ax, view, panels.window, arrows=False)
    draw_sets(ax, content.positions[index], content.base.horizon, colours)
    draw_bodies(ax, view, panels.window)
    draw_blocking(ax, view, verdict, content.base)
    for spine in ax.spines.values():
        spine.set_zorder(9.0)
        if row.executed:
            spine.set_color(palette.EXECUTED)
            spine.set_linewidth(2.0)


def _entries(content: _Content) -> list[tuple[str, str]]:
    """The legend's entries, only for what the page shows."""
    entries = [("ego", "ego"), ("other", "others now"), ("lane", "current lane")]
    if content.base.prediction.obstacles:
        entries.append(("occupancy", "where others may be until the horizon"))
    if content.rows:
        entries.append(("last", "last non-empty set (of the ego's centre)"))
    contested = any(
        row.verdict.first_empty_step is not None
        and row.verdict.reachable_set.contested is not None
        and bool(np.any(row.verdict.reachable_set.contested))
        for row in content.rows
    )
    if contested:
        entries.append(("contested", "the set at the first empty step, before cuts"))
        entries.append(("blocking", "what is in its way then"))
    if content.maneuver is not None:
        safe = content.maneuver.pair is None
        entries.append(
            ("fail-safe", "fail-safe path")
            if safe
            else ("trajectory", "planned path, dot: 5 steps")
        )
    if content.base.scene.goal is not None:
        entries.append(("goal", "goal"))
    return entries
