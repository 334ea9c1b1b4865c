"""What is driven: the bodies along the planned and along the fail-safe path, and their profiles."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from sandra.reach import Ground
from sandra.view import palette
from sandra.view.chart import TICKS, fit
from sandra.view.lettering import fitted, width, write
from sandra.view.page import MARGIN, Page
from sandra.view.profile import AXIS, BELOW, Curve, draw_profile
from sandra.view.scene import axes_in, draw_bodies, draw_map, draw_path, patch
from sandra.view.shapes import View, Window, bounds, clipped, grown

if TYPE_CHECKING:
    import shapely

Array = NDArray[np.float64]

SHARE = 0.62
"""Of the width, for the maps."""
CAPTION = 0.24
"""Room for the line above each map [inch]."""
GAP = 0.1
"""Between the maps [inch]."""
APART = 1.2
"""Bodies are drawn at least at this distance from one another, in their lengths."""
MOST = 4
"""So many bodies are drawn along a path, or one more."""
HATCH = 0.6
"""Distance of hatching lines along the map [m]."""
_SIZE = 8.5
_TIME = 6.5


@dataclass(frozen=True, slots=True, eq=False)
class Strip:
    """One map: a trajectory, what is written above it, and the others at its end.

    `others`: their bodies then, as predicted; `possible`: wherever they may be then, if that is
    what the trajectory is safe against. In view coordinates.
    """

    curve: Curve
    caption: str
    others: shapely.Geometry | None = None
    possible: shapely.Geometry | None = None
    before: Curve | None = None
    """What is driven until then, if it does not begin now."""


@dataclass(frozen=True, slots=True)
class Driven:
    """The row of a page: maps below one another at the left, the profiles beside them.

    `window` is that of all maps, each `wide` by `high` [inch].
    """

    strips: list[Strip]
    window: Window
    wide: float
    high: float
    curves: list[Curve]
    """Those of the profiles."""

    @staticmethod
    def of(
        view: View, strips: list[Strip], inner: float, curves: list[Curve] | None = None
    ) -> Driven:
        """The row on a page with `inner` inches between its margins.

        `curves` are those of the profiles, if not those of the strips.
        """
        ego = view.scene.ego
        start = (ego.state.x, ego.state.y, ego.state.heading)
        shapes = [view.body(ego.outline, start)]
        shapes += [view.body(ego.outline, row) for strip in strips for row in strip.curve.states]
        focus = bounds(shapes)
        assert focus is not None, "the ego has a body"
        wide = SHARE * inner - TICKS
        highest = 2.2 if len(strips) == 1 else 1.6
        window, high = fit(grown(focus, 3.0, 1.6), wide, (1.0, highest), least=25.0)
        shown = [strip.curve for strip in strips] if curves is None else curves
        return Driven(strips, window, wide, high, shown)

    @property
    def height(self) -> float:
        """Of the row [inch]."""
        return max(len(self.strips) * self._pitch - GAP + BELOW, 2.3)

    @property
    def _pitch(self) -> float:
        return CAPTION + self.high + GAP

    def draw(self, page: Page, view: View, base: Ground, top: float) -> None:
        """Draw it; `top` is that of the row [inch]."""
        left = MARGIN + TICKS
        for index, strip in enumerate(self.strips):
            above = top + index * self._pitch
            caption = fitted(strip.caption, self.wide, _SIZE, bold=True)
            page.text(left, above, caption, size=_SIZE, bold=True)
            ax = page.axes(left, above + CAPTION, self.wide, self.high)
            axes_in(ax, self.window, size=6.5)
            ax.tick_params(labelbottom=strip is self.strips[-1])
            draw_map(ax, view, self.window, arrows=False)
            if strip.others is None and strip.possible is None:
                draw_bodies(ax, view, self.window)
            else:
                _draw_others(ax, strip, self.window)
            if strip.before is not None:
                kind, rows = strip.before.parts[0]
                draw_path(ax, view.points(strip.before.states[rows]), kind, 5.5)
            _draw_along(ax, view, strip.curve, self.wide / (self.window[1] - self.window[0]))
        beside = left + self.wide + 0.25
        _profiles(page, (beside, top, page.width - MARGIN - beside, self.height), self, base)


def others_at(base: Ground, view: View, time: float) -> shapely.Geometry | None:
    """The others' bodies as predicted for a time [s]; None if it lies beyond the horizon."""
    import shapely

    step = round(time / base.scene.dt)
    if step > base.horizon:
        return None
    predicted = base.prediction.obstacles
    return shapely.union_all([view.body(o.obstacle.outline, o.states[step]) for o in predicted])


def _profiles(
    page: Page, place: tuple[float, float, float, float], row: Driven, base: Ground
) -> None:
    left, top, wide, high = place
    page.text(left + AXIS, top, "speed and acceleration", size=_SIZE, bold=True)
    settings = base.settings
    draw_profile(
        page,
        (left, top + CAPTION, wide, high - CAPTION),
        row.curves,
        (settings.a_lon_min, settings.a_lon_max),
        base.scene.speed_limit,
    )


def _draw_others(ax: Any, strip: Strip, window: Window) -> None:
    from matplotlib.collections import LineCollection

    if strip.possible is not None:
        # Hatched, as its light colour is that of a lane in a grey print.
        light, line = (palette.faded(palette.OCCUPANCY, part) for part in (0.8, 0.35))
        patch(ax, strip.possible, facecolor=light, edgecolor="none", zorder=3.0)
        lines = LineCollection(_hatching(strip.possible, window), colors=[line], linewidths=0.4)
        lines.set_zorder(3.05)
        ax.add_collection(lines, autolim=False)
        edge = {"edgecolor": palette.OCCUPANCY, "linewidth": 0.7, "linestyle": (0, (3, 2))}
        patch(ax, strip.possible, facecolor="none", zorder=3.1, **edge)
    if strip.others is not None:
        look = {"facecolor": palette.OTHER, "edgecolor": palette.INK, "linewidth": 0.5}
        patch(ax, strip.others, zorder=4.0, **look)


def _hatching(shape: shapely.Geometry, window: Window) -> list[Array]:
    """Slanted lines within a shape."""
    import shapely

    low_x, high_x, low_y, high_y = window
    rise = high_y - low_y
    ends = np.arange(low_x - rise, high_x, HATCH)
    slanted = np.stack(
        [
            np.column_stack([ends, np.full_like(ends, low_y)]),
            np.column_stack([ends + rise, np.full_like(ends, high_y)]),
        ],
        axis=1,
    )
    inside = shapely.intersection(shapely.linestrings(slanted), clipped(shape, window))
    parts = shapely.get_parts(inside)
    return [shapely.get_coordinates(part) for part in parts if part.geom_type == "LineString"]


def _draw_along(ax: Any, view: View, curve: Curve, per_metre: float) -> None:
    """The path, and the body at a few instants with their times."""
    ego = view.scene.ego
    path = view.points(curve.states)
    for kind, rows in curve.parts:
        draw_path(ax, path[rows], kind, 5.5)
    state = ego.state
    now = view.body(ego.outline, (state.x, state.y, state.heading))
    patch(ax, now, facecolor=palette.faded(palette.EGO, 0.25), edgecolor="none", zorder=5.1)
    patch(ax, now, facecolor="none", edgecolor=palette.EGO, linewidth=1.2, zorder=5.55)
    labels = [("now", view.points(np.array([[state.x, state.y]]))[0])]
    colour = palette.LINES[curve.kind]["color"]
    for i in instants(path, ego.length):
        body = view.body(ego.outline, curve.states[i])
        patch(ax, body, facecolor=(1.0, 1.0, 1.0, 0.72), edgecolor="none", zorder=5.2)
        patch(ax, body, facecolor="none", edgecolor=colour, linewidth=1.2, zorder=5.6)
        labels.append((f"{curve.times[i]:.1f} s", path[i]))
    for text, (x, y) in labels:
        if width(text, _TIME) < 0.9 * ego.length * per_metre:
            under = {"boxstyle": "square,pad=0.15", "facecolor": palette.PAPER, "edgecolor": "none"}
            write(ax, x, y, text, size=_TIME, ha="center", va="center", zorder=6.5, bbox=under)


def instants(path: Array, length: float) -> list[int]:
    """Rows of a path (n, 2) at which bodies of this length do not lie on one another.

    Always the last one, if it is away from the first, where the body of now is.
    """
    last = len(path) - 1
    whole = float(np.hypot(*np.diff(path, axis=0).T).sum())
    apart = max(APART * length, whole / (MOST + 0.5))
    kept: list[int] = []
    at = path[0]
    for i in range(1, last + 1):
        if np.hypot(*(path[i] - at)) >= apart:
            kept.append(i)
            at = path[i]
    if kept and kept[-1] != last:
        kept[-1] = last
    elif not kept and np.hypot(*(path[last] - path[0])) > 0.3 * length:
        kept = [last]
    return kept
