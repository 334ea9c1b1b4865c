"""The page of verdicts: header, map, time upwards, legend, one panel per pair, table."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from sandra.certificate import Certificate
from sandra.planning.types import Maneuver
from sandra.reach import Ground
from sandra.view import header, legend, palette, table
from sandra.view.chart import CAPTION, TICKS, draw_chart, fit
from sandra.view.driven import Driven, Strip, others_at
from sandra.view.page import MARGIN, Page
from sandra.view.panels import GAP, Grid, draw_panel
from sandra.view.profile import curves_of
from sandra.view.scene import near, shows_goal
from sandra.view.sets import blocking
from sandra.view.shapes import View, Window, bounds, grown
from sandra.view.three_d import draw_stack

if TYPE_CHECKING:
    import shapely

WIDTH = 13.0
"""Of the page [inch]."""
_MAP_SHARE = 0.62
"""Of the width, when the 3-D view is beside the map."""


@dataclass(frozen=True, slots=True)
class Content:
    """What goes on the page, whether it comes from a decision or from verdicts alone."""

    base: Ground
    rows: list[table.Row]
    header: list[header.Line]
    positions: list[list[shapely.Geometry]]
    """Per row, the set's positions step by step."""
    main: list[shapely.Geometry]
    """Those that the map and the 3-D view show: the corridor, or the set of one pair."""
    caption: str
    maneuver: Maneuver | None
    certificate: Certificate | None = None
    """That of the maneuver, where it has one."""


def compose(content: Content, view: View, *, three_d: bool = True) -> Page:
    """The whole page, top down: header, map beside the 3-D view, legend, panels, table."""
    colours = palette.time_map()
    horizon = content.base.horizon
    inner = WIDTH - 2 * MARGIN
    focus = _focus(content, view)
    laid = header.laid_out(content.header, inner)
    map_width = (_MAP_SHARE if three_d else 1.0) * inner - TICKS
    window, map_height = fit(grown(focus, 8.0, 4.5), map_width, (2.4, 5.0), least=50.0)
    panels = Grid.of(len(content.rows), grown(focus, 3.0, 2.0), inner)
    entries = _entries(content, view, window)
    strip = legend.height(map_width, entries, bar=True)
    scenery = max(CAPTION + map_height + TICKS + strip, 3.6 if three_d else 0.0)
    driven = driven_of(content.base, content.maneuver, content.certificate, view, inner)
    driven_height = 0.0 if driven is None else GAP + driven.height
    table_height = table.height(content.rows, inner)
    parts = (header.height(laid), scenery, driven_height, GAP + panels.height, GAP + table_height)
    page = Page(WIDTH, 2 * MARGIN + sum(parts))

    top = header.draw(page, MARGIN, MARGIN, inner, view.scene.name, laid)
    others = near(view, window, content.base.prediction)
    left = MARGIN + TICKS
    place = (left, top + CAPTION, map_width, map_height)
    shown = (content.main, content.maneuver, horizon, colours)
    draw_chart(page, place, view, window, others, *shown, content.caption)
    below = top + CAPTION + map_height + TICKS
    legend.draw(page, left, below, map_width, entries, horizon, colours)
    if three_d:
        left += map_width + GAP
        page.text(left + 0.2, top + 0.04, "the same, time upwards", size=9.0, bold=True)
        ax = page.axes(
            left + 0.1, top + 0.2, WIDTH - MARGIN - left - 0.1, scenery - 0.2, projection="3d"
        )
        draw_stack(ax, view, _ground_window(grown(focus, 4.0, 3.0)), others, *shown)
    top += scenery + GAP
    if driven is not None:
        driven.draw(page, view, content.base, top)
        top += driven_height
    for index in range(len(content.rows)):
        draw_panel(
            page,
            view,
            content.rows[index],
            content.base,
            content.positions[index],
            panels,
            index,
            top,
            colours,
        )
    top += panels.height + GAP
    table.draw(page, MARGIN, top, inner, content.rows)
    return page


def _focus(content: Content, view: View) -> Window:
    """The ego, every reachable set, and the path of the maneuver."""
    import shapely

    state = view.scene.ego.state
    shapes = [view.body(view.scene.ego.outline, (state.x, state.y, state.heading))]
    for steps in content.positions:
        shapes += steps
    shapes += content.main
    if content.maneuver is not None:
        path = view.points(content.maneuver.states)
        shapes.append(shapely.MultiPoint(path[np.isfinite(path).all(axis=1)]))
    found = bounds(shapes)
    assert found is not None
    return found


def _ground_window(window: Window) -> Window:
    """Not so narrow that the stack becomes a wall."""
    least = 0.3 * (window[1] - window[0])
    more = max(0.0, least - (window[3] - window[2])) / 2
    return window[0], window[1], window[2] - more, window[3] + more


def _entries(content: Content, view: View, window: Window) -> list[tuple[str, str]]:
    """The legend's entries, only for what the page shows."""
    entries = [("ego", "ego"), ("other", "others now"), ("lane", "current lane")]
    if content.maneuver is not None:
        entries += _line_entries(content.maneuver)
    if content.base.prediction.obstacles:
        entries.append(("occupancy", "where others may be until the horizon"))
    if content.rows:
        entries.append(("last", "last non-empty set (of the ego's centre)"))
    failed = [row.verdict for row in content.rows if row.verdict.first_empty_step is not None]
    if any(bool(np.any(verdict.reachable_set.contested)) for verdict in failed):
        entries.append(("contested", "the set at the first empty step, before cuts"))
    if any(blocking(verdict, content.base) for verdict in failed):
        entries.append(("blocking", "what is in its way then"))
    if shows_goal(view, window):
        entries.append(("goal", "goal"))
    return entries


def _line_entries(maneuver: Maneuver) -> list[tuple[str, str]]:
    if maneuver.pair is None:
        return [("fail-safe", "fail-safe path, dot: 5 steps")]
    if maneuver.fail_safe is None:
        return [("planned", "planned path, dot: 5 steps")]
    return [
        ("planned", "planned until the next decision"),
        ("planned on", "and beyond it, dot: 5 steps"),
        ("fail-safe", "fail-safe, if no new decision comes"),
    ]


def driven_of(
    base: Ground,
    maneuver: Maneuver | None,
    certificate: Certificate | None,
    view: View,
    inner: float,
) -> Driven | None:
    """The row that shows what is driven; None if there is nothing to show."""
    if maneuver is None or not np.isfinite(maneuver.states).all():
        return None
    strips: list[Strip] = []
    for curve in curves_of(maneuver):
        before = strips[0].curve if strips else None
        end = float(curve.times[-1])
        others, possible = others_at(base, view, end), None
        if curve.kind == "planned":
            assert maneuver.pair is not None
            pair = f"{maneuver.pair.longitudinal.value}, {maneuver.pair.lateral.value}"
            caption = f"planned: {pair}, through {end:.1f} s; the others as predicted for then"
        else:
            path = curve.states
            if before is not None:
                path = np.vstack([before.states[before.parts[0][1]], path])
            gone = np.hypot(*np.diff(path[:, :2], axis=0).T).sum()
            caption = "fail-safe" + (" if no new decision comes" if maneuver.pair else "")
            caption += f": stands at {end:.1f} s, after {gone:.1f} m" if end else ": stands"
            possible = _possible_at(certificate, view, end)
            if possible is not None:
                others = None
                caption += "; hatched: where others may be then"
        strips.append(Strip(curve, caption, others, possible, before))
    return Driven.of(view, strips, inner)


def _possible_at(
    certificate: Certificate | None, view: View, time: float
) -> shapely.Geometry | None:
    """Where the others may be at a time, by the certificate; None if there is none."""
    import shapely

    if certificate is None:
        return None
    found = []
    for each in certificate.obstacles:
        step = min(max(round(time / certificate.dt) - 1, 0), len(each.possible) - 1)
        found += [view.region(region) for region in each.possible[step]]
    return shapely.union_all(found)
