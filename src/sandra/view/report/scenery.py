"""The road and the others of a scene, as the page draws them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import shapely
from numpy.typing import NDArray

from sandra.prediction.types import PredictedObstacle, Prediction
from sandra.scene.types import Lanelet, Region, Scene
from sandra.view.labels import light_style
from sandra.view.report.document import Lane, Map, Mark, Other
from sandra.view.report.packing import PER_METRE, PER_RADIAN, pack_frames, pack_rows
from sandra.view.shapes import View, Window, polygons

Array = NDArray[np.float64]

STATE = (PER_METRE, PER_METRE, PER_RADIAN, PER_METRE, PER_METRE)
"""Scales of x, y, heading, speed, acceleration."""
SMOOTH = 0.02
"""Outlines are drawn with corners left out that stand out by less [m]."""
SEEN = 400.0
"""Lanes farther from the ego are left out, and those who are farther away [m]."""
NEAR = 150.0
"""Where those may be who are farther away is not told [m]."""
_NO_CARS = frozenset({"sidewalk", "crosswalk", "bicycleLane", "parking", "border", "shoulder"})
_ROUND = 8
"""Straight pieces of a quarter of a circle."""


def map_of(view: View, scene: Scene) -> Map:
    """The lanelets around the ego, and the goal."""
    state = scene.ego.state
    here = view.points(np.array([[state.x, state.y]]))[0]
    window = (here[0] - SEEN, here[0] + SEEN, here[1] - SEEN, here[1] + SEEN)
    current = set(scene.current.lanelets)
    lanes = []
    for lanelet in scene.lanelets:
        borders = view.points(lanelet.left), view.points(lanelet.right)
        if _apart(np.vstack(borders), window):
            continue
        packed = pack_frames([[_thinned(line) for line in borders]])
        lanes.append(Lane(lanelet.id, _kind(lanelet, current), packed))
    goal = None if scene.goal is None else frames_of([view.region(scene.goal)])
    return Map(tuple(lanes), goal)


def marks_of(view: View) -> tuple[Mark, ...]:
    """Lights and signs on the ego's route ahead."""
    scene = view.scene
    front = scene.ego_curvilinear[0] + scene.ego.length / 2
    found = []
    for light in scene.lights:
        if np.isfinite(light.distance):
            x, y = view.lane_points(np.array([[front + light.distance, 0.0]]))[0].tolist()
            found.append(Mark(x, y, light_style(light)[1], light.state))
    for sign in scene.signs:
        if np.isfinite(sign.distance) and sign.distance > 0.0:
            x, y = view.lane_points(np.array([[front + sign.distance, -2.2]]))[0].tolist()
            found.append(Mark(x, y, " ".join((sign.name, *sign.values))))
    return tuple(found)


def others_of(view: View, prediction: Prediction) -> tuple[Other, ...]:
    """All others near enough, nearest first."""
    ego = view.scene.ego.state
    near = []
    for predicted in prediction.obstacles:
        state = predicted.obstacle.state
        away = float(np.hypot(state.x - ego.x, state.y - ego.y))
        if away <= SEEN:
            near.append((away, predicted.obstacle.id, predicted))
    near.sort(key=lambda x: x[:2])
    return tuple(_other(view, predicted, away <= NEAR) for away, _, predicted in near)


def _other(view: View, predicted: PredictedObstacle, near: bool) -> Other:
    obstacle = predicted.obstacle
    states = predicted.states
    if obstacle.is_static or not np.isfinite(states).any():
        state = obstacle.state
        states = np.array([[state.x, state.y, state.heading, state.speed, state.acceleration]])
    steps = predicted.at[:1] if obstacle.is_static else predicted.at
    return Other(
        id=obstacle.id,
        kind=obstacle.kind,
        outline=outline_of(obstacle.outline),
        still=obstacle.is_static,
        states=pack_states(view, states),
        occupancy=frames_of(_united(view, steps)) if near else None,
        dropped=predicted.dropped,
    )


def _united(view: View, steps: Sequence[Sequence[Region]]) -> list[shapely.Geometry]:
    """The union of the regions of each step; all regions are made at once."""
    regions = [region for step in steps for region in step]
    if not regions:
        return [shapely.Polygon() for _ in steps]
    owner = np.repeat(np.arange(len(regions)), [len(x.vertices) for x in regions])
    vertices = view.points(np.vstack([x.vertices for x in regions]))
    hulls = shapely.convex_hull(shapely.multipoints(vertices, indices=owner))
    radius = np.array([x.radius for x in regions])
    wide = radius > 0.0
    hulls[wide] = shapely.buffer(hulls[wide], radius[wide], quad_segs=_ROUND)
    ends = np.cumsum([len(step) for step in steps])
    return [shapely.union_all(part) for part in np.split(hulls, ends[:-1])]


def outline_of(region: Region) -> str:
    """FRAMES of a body about its own centre, to the right."""
    hull = shapely.MultiPoint(region.vertices).convex_hull
    shape = hull.buffer(region.radius, quad_segs=_ROUND) if region.radius > 0.0 else hull
    return frames_of([shape])


def pack_states(view: View, states: Array) -> str:
    """STATES of rows x, y, heading, speed, acceleration in the plane."""
    rows = np.array(np.atleast_2d(states)[:, :5], dtype=float)
    known = np.isfinite(rows[:, :3]).all(axis=1)
    rows[:, :2] = np.where(
        known[:, None], view.points(np.where(known[:, None], rows[:, :2], 0.0)), np.nan
    )
    # Unwrapped, so that a body between two rows does not turn the long way round.
    rows[known, 2] = np.unwrap(rows[known, 2] - view.angle)
    return pack_rows(rows, STATE)


def frames_of(shapes: Sequence[shapely.Geometry]) -> str:
    """FRAMES of the rings of shapes, holes among them: what is within an odd number is filled."""
    return pack_frames([_rings(shape) for shape in shapes])


def _rings(shape: shapely.Geometry) -> list[Array]:
    simple = shapely.simplify(shape, SMOOTH)
    rings = []
    for polygon in polygons(simple):
        for ring in (polygon.exterior, *polygon.interiors):
            rings.append(shapely.get_coordinates(ring)[:-1])
    return rings


def _kind(lanelet: Lanelet, current: set[int]) -> str:
    if not _NO_CARS.isdisjoint(lanelet.kinds):
        return "other"
    return "current" if lanelet.id in current else "lane"


def _apart(points: Array, window: Window) -> bool:
    low, high = points.min(axis=0), points.max(axis=0)
    return bool(
        low[0] > window[1] or high[0] < window[0] or low[1] > window[3] or high[1] < window[2]
    )


def _thinned(line: Array) -> Array:
    """Without points that lie on the straight line between others."""
    if len(line) < 3:
        return line
    found: Array = shapely.get_coordinates(shapely.simplify(shapely.LineString(line), SMOOTH))
    return found
