"""The ego's own rules over the part that is driven under them: from 0 to `t_dec`.

A second reading of R_G1, R_G2 and R_G3, of the executed motion. R_G1 is asked against the others'
most likely motion, as it was certified, and once more against what they really do: what falls
short then, and only then, was brought about by the other.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray

from sandra.certificate import Certificate
from sandra.evaluation.rollouts.ego import Drive, placed
from sandra.evaluation.rollouts.road import Road

Array = NDArray[np.float64]
Bools = NDArray[np.bool_]

STANDING_THINGS = frozenset({"pedestrian", "trafficIsland", "building", "pillar", "median_strip"})
"""Kinds that are no traffic: R_G1 asks nothing about them."""
SLACK = 1e-6


@dataclass(frozen=True, slots=True, eq=False)
class Others:
    """Bodies at one moment: outline (m, 2), radius, and rows of x, y, heading, speed (N, 4)."""

    vertices: Array
    radius: float
    rows: Array
    there: Bools


def letters(drive: Drive) -> list[int]:
    """Fine steps at which the rules are asked: each t_k up to `t_dec`."""
    return list(range(0, drive.decision + 1, drive.per_dt))


def broken(c: Certificate, drive: Drive, road: Road) -> list[str]:
    """The names of the certificate's rules that the executed motion breaks; mostly none."""
    found = []
    if "R_G2" in c.rules and (drive.acceleration[: drive.decision] < c.settings.a_abrupt).any():
        found.append("R_G2")
    if "R_G3" in c.rules:
        s = c.settings
        most = min(s.v_fov, s.v_braking, s.v_type)
        for k in letters(drive):
            limit = min(most, _signed(c, road, drive.states[k, :2]))
            if drive.states[k, 3] > limit + SLACK:
                found.append("R_G3")
                break
    if "R_G1" in c.rules:
        for k in letters(drive):
            row = k // drive.per_dt
            others = [
                Others(
                    o.outline.vertices,
                    o.outline.radius,
                    np.nan_to_num(o.states[row : row + 1, :4]),
                    np.isfinite(o.states[row : row + 1, 0]),
                )
                for o in c.obstacles
                if o.kind not in STANDING_THINGS
            ]
            if (safe_distance_left(c, drive, road, k, others) <= -SLACK).any():
                found.append("R_G1")
                break
    return found


def _signed(c: Certificate, road: Road, point: Array) -> float:
    """The strictest sign where the centre is, of the ego's own lanes if it is on any [m/s]."""
    own = {i for x in c.lanes if x.relation in ("current", "left", "right") for i in x.lanelets}
    here = shapely.points(point)
    held = [x for x in c.lanelets if shapely.dwithin(road.areas[x.id], here, 0.0)]
    held = held or [x for x in c.lanelets if shapely.dwithin(road.areas[x.id], here, 0.1)]
    chosen = [x for x in held if x.id in own] or held
    return min((x.speed_limit for x in chosen if x.speed_limit is not None), default=np.inf)


def safe_distance_left(
    c: Certificate, drive: Drive, road: Road, k: int, others: list[Others]
) -> Array:
    """(N,) what is left of R_G1's safe distance at fine step k [m], for N rows of others."""
    count = max((len(o.rows) for o in others), default=1)
    left = np.full(count, np.inf)
    if road.reference is None:
        return left
    line = shapely.LineString(road.reference)
    x, y, speed = drive.states[k, [0, 1, 3]]
    front = shapely.line_locate_point(line, shapely.Point(x, y)) + c.ego.length / 2
    body = shapely.polygons(drive.corners[k])
    bodies = [_placed(o) for o in others]
    rears = [_rear(line, o) for o in others]
    for lane in c.lanes:
        area: Any = shapely.union_all([road.areas[i] for i in lane.lanelets])
        if not shapely.intersects(area, body):
            continue
        shapely.prepare(area)
        rear, leading = np.full(count, np.inf), np.zeros(count)
        for o, shapes, (its_rear, its_speed) in zip(others, bodies, rears, strict=True):
            inside = shapely.intersects(area, shapes) & ~shapely.touches(area, shapes)
            counts = inside & o.there & (its_rear >= front) & (its_rear < rear)
            rear, leading = np.where(counts, its_rear, rear), np.where(counts, its_speed, leading)
        s = c.settings
        needed = speed**2 / (2 * abs(s.a_min)) - leading**2 / (2 * abs(s.a_obs_min))
        left = np.minimum(left, rear - front - needed - speed * s.t_d)
    return np.asarray(left)


def _placed(o: Others) -> NDArray[np.object_]:
    corners = placed(o.vertices, o.rows[:, :2], o.rows[:, 2])
    shapes = shapely.convex_hull(shapely.multipoints(corners))
    return np.asarray(shapely.buffer(shapes, o.radius) if o.radius else shapes)


def _rear(line: Any, o: Others) -> tuple[Array, Array]:
    """(N,) s of the rear ends, and speeds along the line, at least 0."""
    corners = placed(o.vertices, o.rows[:, :2], o.rows[:, 2])
    along = shapely.line_locate_point(line, shapely.points(corners)).min(axis=1) - o.radius
    s = shapely.line_locate_point(line, shapely.points(o.rows[:, :2]))
    before = shapely.get_coordinates(shapely.line_interpolate_point(line, np.maximum(s - 0.25, 0)))
    after = shapely.get_coordinates(shapely.line_interpolate_point(line, s + 0.25))
    course = np.arctan2(*(after - before)[:, ::-1].T)
    return along, np.maximum(o.rows[:, 3] * np.cos(o.rows[:, 2] - course), 0.0)
