"""The picture of a scenario alone, with or without a prediction."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from sandra.prediction.types import Prediction
from sandra.scene.types import Scene
from sandra.view import header, legend, palette
from sandra.view.chart import CAPTION, TICKS, draw_chart, fit
from sandra.view.header import Line
from sandra.view.lettering import plain
from sandra.view.page import MARGIN, Page, checked
from sandra.view.scene import near, shows_goal
from sandra.view.shapes import View

WIDTH = 11.0
"""Of the page [inch]."""


def scene_figure(
    scene: Scene, path: str | Path, prediction: Prediction | None = None, *, dpi: int = 150
) -> Path:
    """Draw a scene: map, obstacles with ids near the ego, and where the others may be.

    Args:
        path: its suffix says the format: .png, .pdf or .svg. dpi: dots per inch of a .png.

    Returns:
        The path of the file.

    Raises:
        SettingsError: an unknown suffix or resolution. SandraError: the file cannot be written.
    """
    where = checked(path, dpi)
    view = View.of(scene)
    inner = WIDTH - 2 * MARGIN
    laid = header.laid_out(_lines(scene, prediction), inner)
    reach = scene.ego.state.speed * 3.0
    window, high = fit((-20.0, max(30.0, reach), -9.0, 9.0), inner - TICKS, (3.0, 6.5), least=60.0)
    entries = [("ego", "ego"), ("other", "others now"), ("lane", "current lane")]
    if prediction is not None and prediction.obstacles:
        entries.append(("occupancy", "where others may be until the horizon"))
    if shows_goal(view, window):
        entries.append(("goal", "goal"))
    strip = legend.height(inner - TICKS, entries, bar=False)
    page = Page(WIDTH, 2 * MARGIN + header.height(laid) + CAPTION + high + TICKS + strip)
    top = header.draw(page, MARGIN, MARGIN, inner, scene.name, laid)
    others = () if prediction is None else near(view, window, prediction)
    place = (MARGIN + TICKS, top + CAPTION, inner - TICKS, high)
    horizon = 0 if prediction is None else prediction.horizon
    colours = palette.time_map()
    draw_chart(page, place, view, window, others, [], None, horizon, colours, _caption(prediction))
    legend.draw(
        page, MARGIN + TICKS, top + CAPTION + high + TICKS, inner - TICKS, entries, None, None
    )
    return page.save(where, dpi)


def _caption(prediction: Prediction | None) -> str:
    return "scenario at step 0" + ("" if prediction is None else ", and its prediction")


def _lines(scene: Scene, prediction: Prediction | None) -> list[Line]:
    shown = len(scene.obstacles)
    moving = int(np.sum([not o.is_static for o in scene.obstacles]))
    parts = [f"road: {plain(scene.road_type, 40)}", f"{shown} others, {moving} of them not static"]
    known = (("country", scene.country), ("weather", scene.weather), ("time", scene.time_of_day))
    parts += [f"{name}: {plain(value, 40)}" for name, value in known if value]
    parts.append(f"dt = {scene.dt:g} s")
    lines = [("   ·   ".join(parts), palette.INK)]
    if prediction is not None:
        kind = plain(prediction.kind, 40)
        lines.append((f"prediction: {kind}   ·   h = {prediction.horizon}", palette.INK))
    return lines
