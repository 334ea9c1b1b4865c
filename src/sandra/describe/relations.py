"""Where an obstacle is, seen from the ego's lane: its relation, and whether it reaches into it."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from sandra.scene.types import Lane, Obstacle, Scene

Array = NDArray[np.float64]

VULNERABLE = frozenset({"pedestrian", "bicycle", "motorcycle"})
"""Road users without a body shell around them (kinds in lower case)."""
ALIGNED = 0.5
"""Cosine of the largest angle to a lane (60 degrees) at which a vehicle still drives along it."""

_ORDER = ("current", "left", "right", "opposite", "incoming-left", "incoming-right")


def follows_lanes(obstacle: Obstacle) -> bool:
    """A moving or waiting vehicle, whose heading says which lane it follows."""
    return not obstacle.is_static and obstacle.kind.lower() != "pedestrian"


def relation(scene: Scene, obstacle: Obstacle, heading: float) -> str:
    """The relation of the obstacle's centre to the ego, as in `ObstacleFacts.relation`.

    Lanes overlap at intersections: a vehicle belongs to the first lane that holds its centre and
    that it drives along, in the order current, left, right, opposite, incoming. One that drives
    along none of them is "crossing" where its `heading` (relative to the ego's lane [rad]) is
    across it. Whatever does not follow lanes belongs to the first lane that holds its centre.
    """
    point = np.array([obstacle.state.x, obstacle.state.y])
    lanes = sorted(
        (lane for lane in scene.lanes if lane.relation in _ORDER and inside(lane.polygon, point)),
        key=lambda lane: _ORDER.index(lane.relation),
    )
    if follows_lanes(obstacle):
        along = [lane for lane in lanes if _direction(lane, obstacle) > ALIGNED]
        if along:
            return _name(along[0])
        if abs(math.cos(heading)) <= ALIGNED:
            return "crossing"
    if lanes:
        return _name(lanes[0])
    if any(inside(lanelet.outline, point) for lanelet in scene.lanelets):
        return "other"
    return "off-lane"


def touches(lane: Lane, obstacle: Obstacle) -> bool:
    """Whether the centre, a corner or the widest reach of the body lies in the lane."""
    state = obstacle.state
    body = obstacle.outline.placed(state.x, state.y, state.heading)
    compass = np.array([[1.0, 0.0], [0.0, 1.0], [-1.0, 0.0], [0.0, -1.0]]) * body.radius
    around = compass if body.radius > 0.0 else compass[:1]
    points = np.vstack([[[state.x, state.y]], *(body.vertices + offset for offset in around)])
    return bool(_inside(lane.polygon, points).any())


def inside(polygon: Array, point: Array) -> bool:
    """Whether a point (2,) lies in a simple polygon (n, 2), by the even-odd rule."""
    return bool(_inside(polygon, point[None])[0])


def _inside(polygon: Array, points: Array) -> NDArray[np.bool_]:
    """(m,) the same for several points (m, 2)."""
    x0, y0 = polygon.T
    x1, y1 = (np.concatenate([line[1:], line[:1]]) for line in (x0, y0))
    above = y0 > points[:, 1:]
    point, edge = np.nonzero(above != np.concatenate([above[:, 1:], above[:, :1]], axis=1))
    rise = (points[point, 1] - y0[edge]) / (y1[edge] - y0[edge])
    beyond = x0[edge] + rise * (x1[edge] - x0[edge]) > points[point, 0]
    return np.asarray(np.bincount(point[beyond], minlength=len(points)) % 2 == 1)


def _direction(lane: Lane, obstacle: Obstacle) -> float:
    """Cosine of the angle between the obstacle's heading and the lane at its place."""
    point = np.array([[obstacle.state.x, obstacle.state.y]])
    s = lane.frame.to_curvilinear(point)[:, 0]
    return math.cos(obstacle.state.heading - float(lane.frame.heading(s)[0]))


def _name(lane: Lane) -> str:
    return "same" if lane.relation == "current" else lane.relation
