"""Draw a scene: the map, the others and where they may be, the ego."""

from __future__ import annotations

from typing import Any

import numpy as np

from sandra.prediction.types import PredictedObstacle, Prediction
from sandra.scene.types import Lanelet, Obstacle
from sandra.view import palette
from sandra.view.shapes import (
    Array,
    View,
    Window,
    bounds,
    path_of,
    polygons,
    touches,
)

ARROW_EVERY = 12.0
"""Distance of the arrows along a lane [m]."""
OCCUPANCY_STEPS = 6
"""So many steps of an occupancy are drawn, besides the first."""
_NO_CARS = frozenset({"sidewalk", "crosswalk", "bicycleLane", "parking", "border", "shoulder"})


def axes_in(ax: Any, window: Window, *, ticks: bool = True, size: float = 7.0) -> None:
    """Set extent, true lengths and ticks of map axes."""
    from matplotlib.ticker import MaxNLocator

    from sandra.view.lettering import FAMILY

    ax.set_xlim(window[0], window[1])
    ax.set_ylim(window[2], window[3])
    ax.set_aspect("equal", adjustable="box")
    ax.set_facecolor(palette.PAPER)
    for spine in ax.spines.values():
        spine.set_color(palette.BORDER)
        spine.set_linewidth(0.6)
    ax.xaxis.set_major_locator(MaxNLocator(8, integer=True, steps=[1, 2, 5, 10]))
    ax.yaxis.set_major_locator(MaxNLocator(5, integer=True, steps=[1, 2, 5, 10]))
    ax.tick_params(
        labelsize=size,
        labelfontfamily=FAMILY,
        labelcolor=palette.FAINT_INK,
        color=palette.BORDER,
        length=2,
        width=0.6,
        pad=2,
        labelbottom=ticks,
        labelleft=ticks,
    )


def draw_map(ax: Any, view: View, window: Window, *, arrows: bool = True) -> None:
    """Lanelets, the current lane, directions, and the goal region."""
    from matplotlib.collections import LineCollection, PolyCollection

    scene = view.scene
    current = set(scene.current.lanelets)
    order: dict[str, list[Array]] = {
        palette.NOT_FOR_CARS: [],
        palette.LANE: [],
        palette.CURRENT_LANE: [],
    }
    borders: list[Array] = []
    chevrons: list[Array] = []
    for lanelet in scene.lanelets:
        left, right = view.points(lanelet.left), view.points(lanelet.right)
        outline = np.vstack([right, left[::-1]])
        if not touches(window, outline):
            continue
        order[_fill(lanelet, current)].append(outline)
        borders += [left, right]
        if arrows and _NO_CARS.isdisjoint(lanelet.kinds):
            chevrons += _chevrons((left + right) / 2)
    for z, (colour, outlines) in enumerate(order.items()):
        ax.add_collection(
            PolyCollection(outlines, facecolors=colour, edgecolors="none", zorder=1 + z / 10),
            autolim=False,
        )
    if scene.goal is not None:
        goal = path_of(view.region(scene.goal))
        _patch(ax, goal, facecolor=palette.GOAL, edgecolor="none", alpha=0.55, zorder=1.4)
    ax.add_collection(
        LineCollection(borders, colors=palette.BORDER, linewidths=0.6, zorder=2.2), autolim=False
    )
    ax.add_collection(
        PolyCollection(chevrons, facecolors=palette.ARROW, edgecolors="none", zorder=2.1),
        autolim=False,
    )


def _fill(lanelet: Lanelet, current: set[int]) -> str:
    if not _NO_CARS.isdisjoint(lanelet.kinds):
        return palette.NOT_FOR_CARS
    return palette.CURRENT_LANE if lanelet.id in current else palette.LANE


def _chevrons(center: Array) -> list[Array]:
    """Small arrow heads along a line."""
    steps = np.hypot(*np.diff(center, axis=0).T)
    s = np.concatenate([[0.0], np.cumsum(steps)])
    if s[-1] < ARROW_EVERY / 2:
        return []
    count = max(1, round(s[-1] / ARROW_EVERY))
    found = []
    for at in (np.arange(count) + 0.5) * s[-1] / count:
        tip = np.array([np.interp(at + 0.7, s, center[:, i]) for i in (0, 1)])
        tail = np.array([np.interp(at - 0.7, s, center[:, i]) for i in (0, 1)])
        size = float(np.hypot(*(tip - tail)))
        if size < 0.5:
            continue
        along = (tip - tail) / size
        side = 0.45 * np.array([-along[1], along[0]])
        found.append(np.array([tip, tail + side, tail + 0.35 * along, tail - side]))
    return found


def draw_occupancies(
    ax: Any, view: View, window: Window, obstacles: tuple[PredictedObstacle, ...]
) -> None:
    """Where the others may be over time: later steps are fainter, the last one has an outline.

    Shapes of the same step are united over all obstacles, so that overlaps do not pile up.
    """
    import shapely

    horizon = max((len(o.at) - 1 for o in obstacles), default=0)
    if not obstacles or horizon == 0:
        return
    steps = sorted({round(k) for k in np.linspace(0, horizon, OCCUPANCY_STEPS + 1)[1:]})
    for k in reversed(steps):
        shape = shapely.union_all([view.occupancy(o, k) for o in obstacles if k < len(o.at)])
        colour = palette.faded(palette.OCCUPANCY, 0.42 + 0.46 * k / horizon)
        path = path_of(shape)
        _patch(ax, path, facecolor=colour, edgecolor="none", zorder=2 - k / (100 * horizon))
        if k == horizon:
            # Above the reachable set, which may cover the places before the others get there.
            _patch(
                ax,
                path,
                facecolor="none",
                edgecolor=palette.OCCUPANCY,
                linewidth=0.7,
                linestyle=(0, (3, 2)),
                zorder=3.7,
            )


def draw_bodies(
    ax: Any,
    view: View,
    window: Window,
    *,
    highlighted: frozenset[int] = frozenset(),
) -> list[tuple[Obstacle, Window]]:
    """The others and the ego at step 0; returns the obstacles drawn and their windows."""
    drawn: list[tuple[Obstacle, Window]] = []
    for obstacle in view.scene.obstacles:
        state = obstacle.state
        if obstacle.states is not None and not np.isfinite(obstacle.states[:1, :3]).all():
            # Recorded only later: the state is that of its first appearance.
            continue
        body = view.body(obstacle.outline, (state.x, state.y, state.heading))
        around = bounds([body])
        if around is None or not touches(window, np.array([around[::2], around[1::2]])):
            continue
        drawn.append((obstacle, around))
        marked = obstacle.id in highlighted
        _patch(
            ax,
            path_of(body),
            facecolor=palette.BLOCKING if marked else palette.OTHER,
            edgecolor=palette.PAPER if marked else palette.INK,
            linewidth=0.5,
            zorder=4.0,
        )
        if not obstacle.is_static and obstacle.speed_is_known and abs(state.speed) > 0.3:
            nose = _nose(view, obstacle.length, (state.x, state.y, state.heading))
            ax.plot(nose[:, 0], nose[:, 1], color=palette.INK, linewidth=0.8, zorder=4.1)
    draw_ego(ax, view)
    return drawn


def draw_ego(ax: Any, view: View) -> None:
    """The ego at step 0, with a bar at its front."""
    ego = view.scene.ego
    pose = (ego.state.x, ego.state.y, ego.state.heading)
    _patch(
        ax,
        path_of(view.body(ego.outline, pose)),
        facecolor=palette.EGO,
        edgecolor=palette.PAPER,
        linewidth=0.7,
        zorder=5.0,
    )
    nose = _nose(view, ego.length, pose)
    ax.plot(nose[:, 0], nose[:, 1], color=palette.PAPER, linewidth=1.0, zorder=5.1)


def _nose(view: View, length: float, pose: tuple[float, float, float]) -> Array:
    """A short line from the middle of a body towards its front."""
    x, y, heading = pose
    along = np.array([np.cos(heading), np.sin(heading)])
    return view.points(np.array([x, y]) + np.outer([0.08 * length, 0.38 * length], along))


def shows_goal(view: View, window: Window) -> bool:
    """Whether the goal region lies within the window, in part at least."""
    goal = view.scene.goal
    around = None if goal is None else bounds([view.region(goal)])
    return around is not None and touches(window, np.array([around[::2], around[1::2]]))


def near(view: View, window: Window, prediction: Prediction) -> tuple[PredictedObstacle, ...]:
    """The predicted obstacles that the window shows at some step of the horizon."""
    found = []
    for obstacle in prediction.obstacles:
        vertices = [r.vertices for k in obstacle.at[:: max(1, len(obstacle.at) // 6)] for r in k]
        if vertices and touches(window, view.points(np.vstack(vertices))):
            found.append(obstacle)
    return tuple(found)


def _patch(ax: Any, path: Any, **options: Any) -> None:
    from matplotlib.patches import PathPatch

    if len(path.vertices):
        ax.add_artist(PathPatch(path, **options))


def draw_path(ax: Any, path: Array, kind: str, zorder: float) -> None:
    """A path (n, 2) in view coordinates; `kind` is a key of `palette.LINES`."""
    from matplotlib.patheffects import Normal, withStroke

    ax.plot(
        path[:, 0],
        path[:, 1],
        zorder=zorder,
        path_effects=[withStroke(linewidth=2.8, foreground=palette.PAPER), Normal()],
        **palette.LINES[kind],
    )


def patch(ax: Any, geometry: Any, **options: Any) -> None:
    """A geometry in view coordinates as a patch, if it has any area."""
    if polygons(geometry):
        _patch(ax, path_of(geometry), **options)
