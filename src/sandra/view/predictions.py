"""Where the others may be, by several predictions below one another (the paper's figure)."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from sandra.errors import SettingsError
from sandra.prediction import PredictionSource, predict
from sandra.scene.types import Scene
from sandra.settings import Settings
from sandra.view import legend, palette
from sandra.view.chart import CAPTION, TICKS, draw_chart, fit
from sandra.view.page import MARGIN, Page, checked
from sandra.view.scene import near
from sandra.view.shapes import View, Window

WIDTH = 8.0
"""Of the page [inch]."""
KINDS = ("most-likely", "set-based")
_ENTRIES = [
    ("ego", "ego"),
    ("other", "others now"),
    ("lane", "current lane"),
    ("occupancy", "where others may be until the horizon, later steps fainter"),
]


def window_of(scene: Scene) -> Window:
    """What is seen of the road: from 20 m behind the ego to three seconds ahead of it."""
    return -20.0, max(30.0, 3.0 * scene.ego.state.speed), -9.0, 9.0


def predictions_figure(
    scene: Scene,
    path: str | Path,
    kinds: Sequence[PredictionSource] = KINDS,
    *,
    horizon: int | None = None,
    settings: Settings | None = None,
    dpi: int = 150,
) -> Path:
    """Draw one map for each prediction, all of the same place.

    Args:
        path: its suffix says the format: .png, .pdf or .svg. kinds: as `sandra.predict` takes them.
        horizon: number of steps; default: that of the settings.

    Returns:
        The path of the file.

    Raises:
        SandraError: for an unknown prediction, no prediction at all, or a picture that cannot be
            written.
    """
    where = checked(path, dpi)
    if not kinds:
        raise SettingsError("name at least one prediction to draw")
    settings = settings or Settings()
    steps = settings.horizon if horizon is None else horizon
    found = [predict(scene, kind, steps, settings) for kind in kinds]
    view = View.of(scene)
    inner = WIDTH - 2 * MARGIN - TICKS
    window, high = fit(window_of(scene), inner, (1.5, 3.2), least=60.0)
    pitch = CAPTION + high + TICKS
    strip = legend.height(inner, _ENTRIES, bar=False)
    page = Page(WIDTH, 2 * MARGIN + len(found) * pitch + strip)
    left, top = MARGIN + TICKS, MARGIN
    for prediction in found:
        seconds = steps * scene.dt
        caption = f"{prediction.kind}: {steps} steps, {seconds:.1f} s"
        others = near(view, window, prediction)
        place = (left, top + CAPTION, inner, high)
        colours = palette.time_map()
        draw_chart(page, place, view, window, others, [], None, steps, colours, caption)
        top += pitch
    legend.draw(page, left, top, inner, _ENTRIES, None, None)
    return page.save(where, dpi)
