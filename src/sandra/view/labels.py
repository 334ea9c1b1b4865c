"""Labels on the map that never lie on one another: ids, lights, signs."""

from __future__ import annotations

from dataclasses import dataclass, field
from math import hypot
from typing import Any

import numpy as np

from sandra.scene.types import Obstacle, TrafficLight
from sandra.view import palette
from sandra.view.lettering import plain, width, write
from sandra.view.shapes import View, Window

MOST_IDS = 14
"""So many of the obstacles nearest to the ego get their id."""
_LINE = 1.35
"""Height of a line over its font size."""


@dataclass(slots=True)
class Places:
    """Rectangles of the page that labels have taken, in view coordinates of one map."""

    window: Window
    per_metre: float
    """Inches of the page per metre."""
    taken: list[Window] = field(default_factory=list)

    def free(self, x: float, y: float, text: str, size: float) -> Window | None:
        """The rectangle of a text centred at (x, y) if it is free and within the window."""
        half_w = (width(text, size) + 0.04) / 2 / self.per_metre
        half_h = _LINE * size / 72.0 / 2 / self.per_metre
        box = (x - half_w, x + half_w, y - half_h, y + half_h)
        low_x, high_x, low_y, high_y = self.window
        if box[0] < low_x or box[1] > high_x or box[2] < low_y or box[3] > high_y:
            return None
        apart = all(
            box[1] <= o[0] or box[0] >= o[1] or box[3] <= o[2] or box[2] >= o[3] for o in self.taken
        )
        return box if apart else None

    def take(self, box: Window) -> None:
        """Keep a rectangle free of further labels."""
        self.taken.append(box)


def draw_ids(ax: Any, places: Places, drawn: list[tuple[Obstacle, Window]], size: float) -> None:
    """Ids beside the obstacles nearest to the ego, where there is room for them."""
    ordered = sorted(drawn, key=lambda item: (_distance(item[1]), item[0].id))
    # Bodies come first: no id may hide another obstacle.
    bodies = [around for _, around in drawn]
    for obstacle, around in ordered[:MOST_IDS]:
        text = plain(obstacle.id, 12)
        high = _LINE * size / 72.0 / 2 / places.per_metre
        wide = (width(text, size) + 0.06) / 2 / places.per_metre
        x, y = (around[0] + around[1]) / 2, (around[2] + around[3]) / 2
        spots = [
            (x, around[3] + high),
            (x, around[2] - high),
            (around[1] + wide, y),
            (around[0] - wide, y),
        ]
        for spot in spots:
            box = places.free(*spot, text, size)
            if box is None or any(_overlap(box, body) for body in bodies):
                continue
            places.take(box)
            _outlined(write(ax, *spot, text, size=size, ha="center", va="center", zorder=7.0))
            break


def _distance(around: Window) -> float:
    return hypot((around[0] + around[1]) / 2, (around[2] + around[3]) / 2)


def _overlap(a: Window, b: Window) -> bool:
    return a[0] < b[1] and a[1] > b[0] and a[2] < b[3] and a[3] > b[2]


def draw_lights(ax: Any, view: View, places: Places, size: float) -> None:
    """Stop lines of the lights on the route, with the light's state as colour and letter."""
    scene = view.scene
    for light in scene.lights:
        if not np.isfinite(light.distance):
            continue
        s = scene.ego_curvilinear[0] + scene.ego.length / 2 + light.distance
        line = view.lane_points(np.array([[s, -1.75], [s, 1.75]]))
        colour, letter = light_style(light)
        ax.plot(line[:, 0], line[:, 1], color=colour, linewidth=2.2, zorder=3.9)
        x, y = line.mean(axis=0)
        box = places.free(x, y, letter, size + 2)
        if box is None:
            continue
        places.take(box)
        write(
            ax,
            x,
            y,
            letter,
            size=size,
            bold=True,
            color=palette.PAPER,
            ha="center",
            va="center",
            zorder=7.1,
            bbox={"boxstyle": "circle,pad=0.25", "facecolor": colour, "edgecolor": palette.PAPER},
        )


def light_style(light: TrafficLight) -> tuple[str, str]:
    """Colour and letters of a light."""
    return palette.LIGHTS.get(light.state, (palette.FAINT_INK, "?"))


def draw_signs(ax: Any, view: View, places: Places, size: float) -> None:
    """Signs ahead on the route, at the right-hand side of the lane."""
    scene = view.scene
    for sign in scene.signs:
        if not np.isfinite(sign.distance) or sign.distance <= 0.0:
            continue
        s = scene.ego_curvilinear[0] + scene.ego.length / 2 + sign.distance
        x, y = view.lane_points(np.array([[s, -2.2]]))[0]
        text = plain(" ".join((sign.name, *sign.values)), 28)
        box = places.free(x, y, text, size)
        if box is None:
            continue
        places.take(box)
        edge = {"boxstyle": "square,pad=0.15", "facecolor": palette.PAPER, "linewidth": 0.5}
        write(ax, x, y, text, size=size, ha="center", va="center", zorder=7.0, bbox=edge)


def _outlined(text: Any) -> None:
    from matplotlib.patheffects import withStroke

    text.set_path_effects([withStroke(linewidth=1.8, foreground=palette.PAPER)])
