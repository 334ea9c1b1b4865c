"""The scene from above, for models that look at pictures.

Drawn is what is known now: lanes, lights, bodies, their ids and speeds, the ego. Nothing that is
predicted or verified, and nothing that the text does not choose from: obstacles that beams do not
see, or that appear only later, are left out.
"""

from __future__ import annotations

import io
import math
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sandra.describe.relations import VULNERABLE
from sandra.describe.types import Picture
from sandra.scene.types import Lanelet, Obstacle, Region, Scene, State

Array = NDArray[np.float64]

SIZE = 512
"""Width and height [pixel]."""
SCALE = 0.2
"""Length of a pixel [m]."""
BELOW = 25.6
"""With the ego's heading up, the ego is this far from the lower edge; else in the middle [m]."""
ARROW = 0.5
"""An arrow is as long as the way at the present velocity within this time [s]."""
_FINE = 2
"""The picture is drawn so many times larger, then made small: edges become smooth."""
_SMALL = 1.0
"""Bodies shorter than this are drawn this long: they would hardly be seen [m]."""

_GROUND = "#f4f2ec"
_LANE = "#dfe2e5"
_CURRENT = "#bcd6ea"
_BORDER = "#7d848b"
_INK = "#1a1a1a"
_EGO = "#0057c2"
_VEHICLE = "#6e6e6e"
_VULNERABLE = "#d55e00"
_STATIC = "#b08a2e"
_LIGHTS = {"red": "#d00000", "yellow": "#e6b800", "redYellow": "#e67300", "green": "#009e73"}
_BESIDE = ((9, 0, "lm"), (-9, 0, "rm"), (6, -9, "lm"), (6, 9, "lm"), (-6, -9, "rm"), (-6, 9, "rm"))
"""Places for an id: from the middle of the body [pixel], and which end of the text is there."""
_SHORTEST_ARROW = 0.3
"""Speed from which on an arrow is drawn [m/s]."""


@dataclass(frozen=True, slots=True, eq=False)
class _Canvas:
    """From the plane to pixels; `draw` is Pillow's."""

    draw: Any
    origin: Array
    rotation: Array
    ego: Array
    """Pixel of the ego's centre."""

    def points(self, xy: Array) -> list[tuple[float, float]]:
        """(n, 2) points in the plane [m] as pixels of the large picture."""
        seen = (np.asarray(xy, dtype=float)[:, :2] - self.origin) @ self.rotation.T
        pixels = (self.ego + seen * [1.0, -1.0] / SCALE) * _FINE
        return [(float(x), float(y)) for x, y in pixels]

    def body(self, outline: Region, pose: State, colour: str) -> None:
        """Fill a body, with an edge if it is large enough for one."""
        import shapely

        placed = outline.placed(pose.x, pose.y, pose.heading)
        low, high = outline.vertices.min(axis=0), outline.vertices.max(axis=0)
        lacking = _SMALL - 2.0 * placed.radius - float((high - low).max())
        radius = placed.radius + max(0.0, lacking / 2.0)
        shape = shapely.MultiPoint(placed.vertices).convex_hull.buffer(max(radius, 1e-3))
        if shape.is_empty:
            return  # So far away that its corners are one number.
        edge = colour if colour in (_EGO, _VULNERABLE) else _INK
        corners = self.points(np.array(shape.exterior.coords))
        self.draw.polygon(corners, fill=colour, outline=edge, width=_FINE)

    def line(self, xy: Array, colour: str, width: float) -> None:
        """A line of a width in pixels of the small picture."""
        self.draw.line(
            self.points(xy), fill=colour, width=max(1, round(width * _FINE)), joint="curve"
        )

    def velocity(self, length: float, state: State) -> None:
        """An arrow from the end of a body of a length, as long as its way within `ARROW`."""
        if not abs(state.speed) > _SHORTEST_ARROW:
            return
        along = np.array([math.cos(state.heading), math.sin(state.heading)])
        along *= math.copysign(1.0, state.speed)
        aside = np.array([-along[1], along[0]])
        tail = np.array([state.x, state.y]) + along * length / 2
        tip = tail + ARROW * abs(state.speed) * along
        self.line(np.array([tail, tip]), _INK, 1.5)
        head = np.array([tip, tip - 1.4 * along + 0.7 * aside, tip - 1.4 * along - 0.7 * aside])
        self.draw.polygon(self.points(head), fill=_INK)


def bird_eye(
    scene: Scene, up: str, obstacles: Sequence[Obstacle], told: Collection[int]
) -> Picture:
    """Draw the scene from above, 512 x 512 pixels of 0.2 m.

    Args:
        up: "ego" (the ego's heading points up, the ego is 76.8 m from the upper edge) or "north"
            (the map's y axis points up, the ego is in the middle).
        obstacles: those that are drawn. told: ids that are written beside their bodies.
    """
    from PIL import Image, ImageDraw

    state = scene.ego.state
    turn = math.pi / 2 - state.heading if up == "ego" else 0.0
    c, s = math.cos(turn), math.sin(turn)
    row = SIZE - BELOW / SCALE if up == "ego" else SIZE / 2
    large = Image.new("RGB", (SIZE * _FINE, SIZE * _FINE), _GROUND)
    canvas = _Canvas(
        ImageDraw.Draw(large),
        np.array([state.x, state.y]),
        np.array([[c, -s], [s, c]]),
        np.array([SIZE / 2, row]),
    )
    _road(canvas, scene)
    lights = _lights(canvas, scene)
    # Arrows first: none of them hides a body.
    canvas.velocity(scene.ego.length, state)
    for obstacle in obstacles:
        if not obstacle.is_static and obstacle.speed_is_known:
            canvas.velocity(obstacle.length, obstacle.state)
    for obstacle in obstacles:
        canvas.body(obstacle.outline, obstacle.state, _colour(obstacle))
    canvas.body(scene.ego.outline, state, _EGO)
    small = large.reduce(_FINE)
    _ids(ImageDraw.Draw(small), canvas, obstacles, told, lights)
    file = io.BytesIO()
    small.save(file, "PNG")
    return Picture(file.getvalue(), SIZE, SIZE, up, SCALE)


def _road(canvas: _Canvas, scene: Scene) -> None:
    far = SIZE * SCALE * math.sqrt(2.0)
    current = set(scene.current.lanelets)
    near = [lanelet for lanelet in scene.lanelets if _comes_near(lanelet, canvas.origin, far)]
    for lanelet in sorted(near, key=lambda lanelet: lanelet.id in current):
        colour = _CURRENT if lanelet.id in current else _LANE
        canvas.draw.polygon(canvas.points(lanelet.outline), fill=colour)
    for lanelet in near:
        canvas.line(lanelet.left, _BORDER, 1.0)
        canvas.line(lanelet.right, _BORDER, 1.0)


def _comes_near(lanelet: Lanelet, place: Array, far: float) -> bool:
    """Whether the box around a lanelet comes within `far` of a place, along both axes."""
    outline = lanelet.outline - place
    return bool((outline.min(axis=0) < far).all() and (outline.max(axis=0) > -far).all())


def _lights(canvas: _Canvas, scene: Scene) -> list[Array]:
    """A bar across the ego's lane at each stop line ahead; the boxes around them [pixel]."""
    boxes: list[Array] = []
    s = scene.ego_curvilinear[0]
    for light in scene.lights:
        if light.distance >= 0.0:
            at = s + scene.ego.length / 2 + light.distance
            ends = scene.frame.to_cartesian(np.array([[at, -1.75], [at, 1.75]]))
            canvas.line(ends, _LIGHTS.get(light.state, _BORDER), 3.0)
            pixels = np.array(canvas.points(ends)) / _FINE
            boxes.append(np.concatenate([pixels.min(axis=0) - 2, pixels.max(axis=0) + 2]))
    return boxes


def _colour(obstacle: Obstacle) -> str:
    if obstacle.kind in VULNERABLE:
        return _VULNERABLE
    return _STATIC if obstacle.is_static else _VEHICLE


def _ids(
    draw: Any,
    canvas: _Canvas,
    obstacles: Sequence[Obstacle],
    told: Collection[int],
    lights: Sequence[Array],
) -> None:
    """Each id beside its body, where it hides no other body, light or id if that is possible."""
    from PIL import ImageFont

    font = ImageFont.load_default(11)
    at = {
        o.id: np.array(canvas.points(np.array([[o.state.x, o.state.y]]))[0]) / _FINE
        for o in obstacles
    }
    taken = [np.array([x - 8, y - 8, x + 8, y + 8]) for x, y in [*at.values(), canvas.ego]]
    taken += lights
    for id in (i for i in at if i in told):
        places = []
        for dx, dy, anchor in _BESIDE:
            x, y = at[id] + [dx, dy]
            box = np.array(draw.textbbox((x, y), str(id), font=font, anchor=anchor))
            hidden = sum(bool((box[:2] < b[2:]).all() and (b[:2] < box[2:]).all()) for b in taken)
            places.append((hidden, x, y, anchor, box))
        _, x, y, anchor, box = min(places, key=lambda place: place[0])
        taken.append(box)
        draw.text(
            (x, y),
            str(id),
            fill=_INK,
            font=font,
            anchor=anchor,
            stroke_width=2,
            stroke_fill="#ffffff",
        )
