"""The reachable set of one pair alone: from above, at one step, or with time upwards."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from sandra.actions import ActionPair
from sandra.errors import SettingsError
from sandra.prediction.types import PredictedObstacle
from sandra.reach import Verdict, Verdicts
from sandra.view import legend, palette, table
from sandra.view.chart import CAPTION, TICKS, draw_chart, fit
from sandra.view.page import MARGIN, Page, checked
from sandra.view.scene import near, patch
from sandra.view.sets import draw_blocking
from sandra.view.shapes import View, Window, bounds, grown
from sandra.view.three_d import draw_stack

if TYPE_CHECKING:
    import shapely

WIDTH = 8.0
"""Of the page [inch]."""
_HIGH_3D = 5.2


def set_figure(
    verdicts: Verdicts,
    pair: ActionPair | str | int,
    path: str | Path,
    *,
    step: int | None = None,
    three_d: bool = False,
    dpi: int = 150,
) -> Path:
    """Draw the set of one verified pair among the others.

    Args:
        pair: as in `verdicts[pair]`.
        path: its suffix says the format: .png, .pdf or .svg.
        step: only the set and the others' occupancy at this step; default: all steps, by colour.
        three_d: time upwards instead of the map.

    Returns:
        The path of the file.

    Raises:
        SandraError: for a step at which there is no set, a step in 3-D, or a picture that cannot
            be written. KeyError: for a pair that was not verified.
    """
    where = checked(path, dpi)
    verdict, base = verdicts[pair], verdicts.ground
    view = View.of(base.scene)
    positions = view.positions(verdict.reachable_set)
    if step is not None and three_d:
        raise SettingsError("a step alone is drawn from above: leave out the step, or the 3-D view")
    if step is not None and not 0 <= step < len(positions):
        last = len(positions) - 1
        raise SettingsError(f"step {step}: {verdict.pair} has sets from step 0 to {last}")
    ego = base.scene.ego
    state = (ego.state.x, ego.state.y, ego.state.heading)
    focus = bounds([view.body(ego.outline, state), *positions])
    assert focus is not None, "the ego has a body"
    caption = f"{table.pair_name(verdict)}: {verdict.status.value}"
    if verdict.first_empty_step is not None:
        caption += f", empty at step {verdict.first_empty_step}"
    drawn = _stack if three_d else _chart
    return drawn(verdicts, verdict, view, focus, positions, step, caption).save(where, dpi)


def _chart(
    verdicts: Verdicts,
    verdict: Verdict,
    view: View,
    focus: Window,
    positions: list[shapely.Geometry],
    step: int | None,
    caption: str,
) -> Page:
    base, colours = verdicts.ground, palette.time_map()
    inner = WIDTH - 2 * MARGIN - TICKS
    window, high = fit(grown(focus, 8.0, 4.0), inner, (1.8, 4.0), least=45.0)
    room = "where others may be " + ("then" if step is not None else "until the horizon")
    last = "the set then" if step is not None else "last non-empty set"
    entries = [("ego", "ego now"), ("other", "others now"), ("occupancy", room), ("last", last)]
    if step is None and verdict.first_empty_step is not None:
        entries.append(("contested", "the set at the first empty step, before cuts"))
    strip = legend.height(inner, entries, bar=True)
    page = Page(WIDTH, 2 * MARGIN + CAPTION + high + TICKS + strip)
    place = (MARGIN + TICKS, MARGIN + CAPTION, inner, high)
    others = near(view, window, base.prediction)
    if step is not None:
        caption += f"; step {step}, {step * base.scene.dt:.1f} s"
        draw_chart(page, place, view, window, (), [], None, base.horizon, colours, caption)
        _draw_step(page.figure.axes[-1], view, others, positions[step], step, base.horizon)
    else:
        shown = (positions, None, base.horizon, colours, caption)
        draw_chart(page, place, view, window, others, *shown)
        draw_blocking(page.figure.axes[-1], view, verdict, base)
    below = MARGIN + CAPTION + high + TICKS
    legend.draw(page, MARGIN + TICKS, below, inner, entries, base.horizon, colours)
    return page


def _draw_step(
    ax: Any,
    view: View,
    others: tuple[PredictedObstacle, ...],
    position: shapely.Geometry,
    step: int,
    horizon: int,
) -> None:
    """The set and the others' occupancy at one step."""
    import shapely

    known = [o for o in others if step < len(o.at)]
    room = shapely.union_all([view.occupancy(o, step) for o in known])
    light = palette.faded(palette.OCCUPANCY, 0.6)
    edge = {"edgecolor": palette.OCCUPANCY, "linewidth": 0.7, "linestyle": (0, (3, 2))}
    patch(ax, room, facecolor=light, **edge, zorder=2.9)
    colour = palette.time_map()(step / max(1, horizon))
    patch(ax, position, facecolor=colour, edgecolor=palette.INK, linewidth=0.8, zorder=3.5)


def _stack(
    verdicts: Verdicts,
    verdict: Verdict,
    view: View,
    focus: Window,
    positions: list[shapely.Geometry],
    step: int | None,
    caption: str,
) -> Page:
    base = verdicts.ground
    page = Page(WIDTH, 2 * MARGIN + CAPTION + _HIGH_3D)
    page.text(MARGIN, MARGIN, f"{caption}; time upwards", size=9.0, bold=True)
    wide = WIDTH - 2 * MARGIN
    ax = page.axes(MARGIN, MARGIN + 0.2, wide, _HIGH_3D + CAPTION - 0.2, projection="3d")
    window = grown(focus, 4.0, 3.0)
    least = 0.3 * (window[1] - window[0])
    more = max(0.0, least - (window[3] - window[2])) / 2
    window = grown(window, 0.0, more)
    others = near(view, window, base.prediction)
    draw_stack(ax, view, window, others, positions, None, base.horizon, palette.time_map())
    return page
