"""The large map of a picture, with labels and a line of facts; and how maps fill their place."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from sandra.planning.types import Maneuver
from sandra.prediction.types import PredictedObstacle
from sandra.scene.types import Scene
from sandra.view import palette
from sandra.view.labels import Places, draw_ids, draw_lights, draw_signs
from sandra.view.lettering import fitted, plain
from sandra.view.page import Page
from sandra.view.scene import axes_in, draw_bodies, draw_map, draw_occupancies
from sandra.view.sets import draw_sets, draw_trajectory
from sandra.view.shapes import View, Window, with_aspect

if TYPE_CHECKING:
    import shapely

TICKS = 0.32
"""Room for tick labels at the left, and for them and the axis title below [inch]."""
CAPTION = 0.42
"""Room for the caption and the line of facts above [inch]."""
_SIZE = 7.5


def fit(
    window: Window, wide: float, limits: tuple[float, float], *, least: float = 0.0
) -> tuple[Window, float]:
    """The window grown to fill axes `wide` inches wide and as high as `limits` allow.

    It shows at least `least` metres along the lane. Returns it and the axes' height [inch].
    """
    more = max(0.0, least - (window[1] - window[0])) / 2
    window = window[0] - more, window[1] + more, window[2], window[3]
    aspect = (window[1] - window[0]) / (window[3] - window[2])
    high = min(max(wide / aspect, limits[0]), limits[1])
    return with_aspect(window, wide / high), high


def draw_chart(
    page: Page,
    place: tuple[float, float, float, float],
    view: View,
    window: Window,
    others: tuple[PredictedObstacle, ...],
    positions: list[shapely.Geometry],
    maneuver: Maneuver | None,
    horizon: int,
    colours: Any,
    caption: str,
) -> None:
    """The map at `place` (left, top, width, height) [inch] with all that belongs on it.

    Above it, in `CAPTION` inches, stand the caption and a line of facts.
    """
    left, top, wide, high = place
    page.text(
        left, top - CAPTION + 0.04, fitted(caption, wide, 9.0, bold=True), size=9.0, bold=True
    )
    line = fitted(facts(view.scene), wide, _SIZE)
    page.text(left, top - 0.2, line, size=_SIZE, color=palette.FAINT_INK)
    ax = page.axes(left, top, wide, high)
    axes_in(ax, window)
    draw_map(ax, view, window)
    draw_occupancies(ax, view, window, others)
    draw_sets(ax, positions, horizon, colours)
    drawn = draw_bodies(ax, view, window)
    if maneuver is not None:
        draw_trajectory(ax, view, maneuver, horizon, colours)
    places = Places(window, wide / (window[1] - window[0]))
    draw_lights(ax, view, places, 7.0)
    draw_signs(ax, view, places, 6.5)
    draw_ids(ax, places, drawn, 6.5)
    page.text(
        left + wide / 2,
        top + high + 0.17,
        "ahead of the ego, along its lane [m]",
        size=_SIZE,
        color=palette.FAINT_INK,
        ha="center",
    )


def facts(scene: Scene) -> str:
    """One line: speeds, the next light, the signs that hold here."""
    parts = [f"ego {scene.ego.state.speed:.1f} m/s"]
    limit = scene.speed_limit
    if limit is not None:
        parts.append(f"limit {limit:.1f} m/s")
    parts += [f"light {plain(li.state, 12)} in {li.distance:.0f} m" for li in scene.lights[:1]]
    signs = dict.fromkeys(" ".join((s.name, *s.values)) for s in scene.signs if s.distance <= 0.0)
    if signs:
        parts.append("signs here: " + ", ".join(plain(sign, 40) for sign in signs))
    return " · ".join(parts)
