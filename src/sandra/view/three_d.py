"""The scene with time upwards: sets, occupancies and the trajectory as a stack of slices."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from sandra.planning.types import Maneuver
from sandra.prediction.types import PredictedObstacle
from sandra.view import palette
from sandra.view.lettering import FAMILY, font
from sandra.view.profile import curves_of
from sandra.view.shapes import Array, View, Window, clipped, polygons, touches

if TYPE_CHECKING:
    import shapely

SLICES = 13
"""So many steps of the sets are drawn as slices."""
OCCUPANCY_SLICES = 7
_LARGE = 60.0
"""From this size on an occupancy is almost clear [m^2]."""
MOST_OBSTACLES = 12
"""So many of the others that are nearest to the ego are drawn."""
ELEVATION, AZIMUTH = 26.0, -118.0
"""Where the reader stands: behind the ego and to its right [degrees]."""


def draw_stack(
    ax: Any,
    view: View,
    window: Window,
    obstacles: tuple[PredictedObstacle, ...],
    positions: list[shapely.Geometry],
    maneuver: Maneuver | None,
    horizon: int,
    colours: Any,
) -> None:
    """Draw into 3-D axes; the upward axis is the time step."""
    from mpl_toolkits.mplot3d.art3d import Line3DCollection, Poly3DCollection

    faces: list[Array] = []
    fills: list[tuple[float, ...]] = []
    edges: list[tuple[float, ...]] = []

    for k in _slices(horizon, OCCUPANCY_SLICES):
        for obstacle in _nearest(view, obstacles):
            if k < len(obstacle.at):
                room = view.occupancy(obstacle, k)
                _add(faces, room, window, k)
                # Large sets are almost clear, else their stack hides all that is within.
                alpha = 0.2 if room.area < _LARGE else 0.06
                fill = (*palette.faded(palette.OCCUPANCY, 0.2), alpha)
                edge = (*palette.faded(palette.OCCUPANCY, 0.0), 2.5 * alpha)
                fills += [fill] * (len(faces) - len(fills))
                edges += [edge] * (len(faces) - len(edges))
    for k in _slices(horizon, SLICES):
        if k < len(positions):
            rgb = colours(k / max(1, horizon))[:3]
            _add(faces, positions[k], window, k)
            fills += [(*rgb, 0.5)] * (len(faces) - len(fills))
            edges += [(*(0.7 * c for c in rgb), 0.9)] * (len(faces) - len(edges))
    ax.computed_zorder = False
    _draw_floor(ax, view, window)
    if faces:
        ax.add_collection3d(
            Poly3DCollection(faces, facecolors=fills, edgecolors=edges, linewidths=0.4, zorder=2.0),
            autolim=False,
        )
    ego = polygons(clipped(view.body(view.scene.ego.outline, _pose(view)), window))
    for polygon in ego:
        ring = _lifted(np.asarray(polygon.exterior.coords), 0.0)
        ax.add_collection3d(
            Poly3DCollection([ring], facecolors=palette.EGO, edgecolors="none", zorder=1.5),
            autolim=False,
        )
    if maneuver is not None:
        for curve in curves_of(maneuver):
            seen = curve.times <= horizon * view.scene.dt + 1e-9
            for kind, rows in curve.parts:
                shown = seen[rows]
                line = view.points(curve.states[rows][shown])
                steps = curve.times[rows][shown] / view.scene.dt
                style = palette.LINES[kind]
                ax.add_collection3d(
                    Line3DCollection(
                        [np.column_stack([line, steps])],
                        colors=[style["color"]],
                        linewidths=style["linewidth"],
                        linestyles=[style["linestyle"]],
                        zorder=3.0,
                    ),
                    autolim=False,
                )
    _finish(ax, window, horizon)


def _pose(view: View) -> tuple[float, float, float]:
    state = view.scene.ego.state
    return state.x, state.y, state.heading


def _slices(horizon: int, count: int) -> list[int]:
    return sorted({round(k) for k in np.linspace(0, horizon, count)})


def _nearest(view: View, obstacles: tuple[PredictedObstacle, ...]) -> list[PredictedObstacle]:
    def distance(o: PredictedObstacle) -> float:
        state = o.obstacle.state
        x, y = view.points(np.array([[state.x, state.y]]))[0]
        return float(np.hypot(x, y)) if np.isfinite([x, y]).all() else np.inf

    return sorted(obstacles, key=lambda o: (distance(o), o.obstacle.id))[:MOST_OBSTACLES]


def _add(faces: list[Array], shape: shapely.Geometry, window: Window, z: float) -> None:
    for polygon in polygons(clipped(shape, window)):
        faces.append(_lifted(np.asarray(polygon.simplify(0.03).exterior.coords), z))


def _lifted(ring: Array, z: float) -> Array:
    return np.column_stack([ring[:, 0], ring[:, 1], np.full(len(ring), float(z))])


def _draw_floor(ax: Any, view: View, window: Window) -> None:
    """Lanelets on the ground plane."""
    import shapely
    from mpl_toolkits.mplot3d.art3d import Poly3DCollection

    current = set(view.scene.current.lanelets)
    faces: list[Array] = []
    fills: list[str] = []
    for lanelet in view.scene.lanelets:
        outline = view.points(lanelet.outline)
        if not touches(window, outline):
            continue
        for polygon in polygons(clipped(shapely.Polygon(outline), window)):
            faces.append(_lifted(np.asarray(polygon.exterior.coords), 0.0))
            fills.append(palette.CURRENT_LANE if lanelet.id in current else palette.LANE)
    if faces:
        ax.add_collection3d(
            Poly3DCollection(
                faces, facecolors=fills, edgecolors=palette.BORDER, linewidths=0.4, zorder=1.0
            ),
            autolim=False,
        )


def _finish(ax: Any, window: Window, horizon: int) -> None:
    from matplotlib.ticker import MaxNLocator

    wide, deep = window[1] - window[0], window[3] - window[2]
    ax.set_xlim(window[0], window[1])
    ax.set_ylim(window[2], window[3])
    ax.set_zlim(0, max(1, horizon))
    # Lengths on the ground stay true to each other; the height is for the eye.
    longest = max(wide, deep)
    ax.set_box_aspect((wide / longest, max(deep / longest, 0.25), 0.62), zoom=1.06)
    ax.view_init(elev=ELEVATION, azim=AZIMUTH)
    ax.set_proj_type("persp", focal_length=0.6)
    for axis, count, label, away in (
        (ax.xaxis, 6, "ahead [m]", -3.0),
        (ax.yaxis, 3, "left [m]", -6.0),
        (ax.zaxis, 5, "time step", -6.0),
    ):
        axis.set_major_locator(MaxNLocator(count, integer=True))
        axis.set_label_text(label, fontproperties=font(7.5), color=palette.FAINT_INK)
        axis.labelpad = away
        axis.set_pane_color((1.0, 1.0, 1.0, 0.0))
        axis.line.set_color(palette.BORDER)
        axis._axinfo["grid"].update({"color": palette.RULE, "linewidth": 0.4})
        axis._axinfo["tick"].update({"inward_factor": 0.0, "outward_factor": 0.1})
    ax.tick_params(labelsize=6.5, labelfontfamily=FAMILY, labelcolor=palette.FAINT_INK, pad=-2)
