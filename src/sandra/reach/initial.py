"""The ego's initial set, and the lattice over all that it can reach from there."""

from __future__ import annotations

from math import atan, cos, sin, tan

import numpy as np
from numpy.typing import NDArray

from sandra.reach.lattice import Lattice
from sandra.reach.polygon import Polygon, hull
from sandra.scene.types import Scene
from sandra.settings import Settings

Array = NDArray[np.float64]

LATERAL_REACH = 1.0
"""The lattice reaches so far beyond the outermost lane borders [m]."""


def initial_set(scene: Scene, settings: Settings) -> tuple[Polygon, Polygon]:
    """The initial state in the lane frame, widened by its measurement uncertainty.

    The centre of a body that steers moves along heading and slip (`planning.single_track`).
    """
    s, d, heading, _ = scene.ego_curvilinear
    course = heading + atan(tan(scene.ego.state.steering_angle) / 2)
    kappa = float(scene.frame.curvature(np.array([s]))[0])
    speed = scene.ego.state.speed
    v_s = speed * cos(course) / (1.0 - kappa * d)
    v_d = speed * sin(course)
    ds, dv = settings.s_uncertainty, settings.v_uncertainty
    return _box(s, v_s, ds, dv), _box(d, v_d, ds, dv)


def _box(x: float, v: float, dx: float, dv: float) -> Polygon:
    return hull([(x + i * dx, v + j * dv) for i in (-1, 1) for j in (-1, 1)])


def lattice_of(
    scene: Scene, horizon: int, lon: Polygon, lat: Polygon, settings: Settings
) -> Lattice:
    """Cells over all that the free set can touch, laterally as far as the road goes."""
    duration = horizon * scene.dt
    fastest = max(settings.v_max, *(v for _, v in lon))
    # Who can only brake is farthest before the end.
    push = max(settings.a_lon_max, 0.0)
    farthest = max(
        s + min(v * duration + push * duration**2 / 2, fastest * duration) for s, v in lon
    )
    # Within a step the speed may leave its bounds and come back: by the end of it, a quarter of
    # a dt^2 further at most.
    swing = horizon * max(abs(settings.a_lon_min), abs(settings.a_lon_max)) * scene.dt**2 / 4
    s_range = (min(s for s, _ in lon) - swing - 1.0, farthest + swing + 1.0)
    reach = [
        d + sign * (abs(v) * duration + settings.a_lat_max * duration**2 / 2)
        for d, v in lat
        for sign in (-1.0, 1.0)
    ]
    low, high = min(reach), max(reach)
    near = _borders_between(scene, s_range, max(abs(low), abs(high)))
    if near.size:
        low = max(low, min(float(near.min()), min(d for d, _ in lat)) - LATERAL_REACH)
        high = min(high, max(float(near.max()), max(d for d, _ in lat)) + LATERAL_REACH)
    return Lattice.around(s_range, (low, high), settings.cell_s, settings.cell_d)


def _borders_between(scene: Scene, s_range: tuple[float, float], reach: float) -> Array:
    """d of points of all lanelets' borders, no more than 1 m apart, within a range of s."""
    ego = np.array([scene.ego.state.x, scene.ego.state.y])
    farthest = s_range[1] - s_range[0] + 2 * reach + abs(scene.ego_curvilinear[1])
    lines = [line for lanelet in scene.lanelets for line in (lanelet.left, lanelet.right)]
    if not lines:
        return np.zeros(0)
    corners = np.concatenate(lines)
    edge = np.diff(corners, axis=0)
    lengths = np.hypot(edge[:, 0], edge[:, 1])
    # From the last corner of a line to the first of the next there is no edge.
    first = np.cumsum([0] + [len(line) for line in lines])
    lengths[first[1:-1] - 1] = 0.0
    stations = np.concatenate([[0.0], np.cumsum(lengths)])
    stations -= np.repeat(stations[first[:-1]], np.diff(first))
    away = np.hypot(*(corners - ego).T)
    near = np.flatnonzero(np.minimum(away[:-1], away[1:]) - lengths <= farthest)
    # Beside the corners the points at each metre.
    begin = stations[near]
    # Of an edge only what is near: a straight lane may be one edge of many kilometres.
    along = edge[near] / np.maximum(lengths[near], 1e-12)[:, None]
    foot = begin + ((ego - corners[near]) * along).sum(axis=1)
    low = np.maximum(begin, foot - farthest - 1.0)
    high = np.minimum(begin + lengths[near], foot + farthest + 1.0)
    counts = np.maximum(np.ceil(high) - np.floor(low) - 1, 0.0).astype(int)
    metre = np.arange(counts.sum()) - np.repeat(np.cumsum(counts) - counts, counts) + 1
    beyond = metre - np.repeat(begin - np.floor(low), counts)
    on_edge = np.repeat(near, counts)
    inner = corners[on_edge] + (beyond / lengths[on_edge])[:, None] * edge[on_edge]
    every = np.concatenate([corners, inner])
    points = scene.frame.to_curvilinear(every[np.hypot(*(every - ego).T) <= farthest])
    inside = (points[:, 0] >= s_range[0]) & (points[:, 0] <= s_range[1])
    return np.asarray(points[inside, 1])
