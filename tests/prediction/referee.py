"""An independent referee: does a trajectory keep the assumptions, and is it inside the sets?

Shares no code with the predictor: shapely for areas, finite differences for accelerations, the
lanelets' links for lanes.
"""

from __future__ import annotations

import numpy as np
import shapely

from sandra.prediction import PredictedObstacle
from sandra.scene.types import Lanelet, Region
from sandra.settings import Assumptions

TOLERANCE = 1e-6


def inside_union(points: np.ndarray, regions: tuple[Region, ...]) -> np.ndarray:
    """(m,) whether each point (m, 2) lies in one of the regions."""
    result = np.zeros(len(points), dtype=bool)
    for region in regions:
        a = region.vertices
        edge = np.roll(a, -1, axis=0) - a
        relative = points[:, None] - a[None]
        length = np.hypot(edge[:, 0], edge[:, 1])
        cross = edge[:, 0] * relative[..., 1] - edge[:, 1] * relative[..., 0]
        slack = region.radius + TOLERANCE
        if len(a) < 3 or region.radius > 0:
            share = np.clip((relative * edge).sum(-1) / np.maximum(length**2, 1e-12), 0.0, 1.0)
            near = np.linalg.norm(relative - share[..., None] * edge, axis=-1).min(axis=1)
            result |= near <= slack
        if len(a) >= 3:
            result |= (cross >= -TOLERANCE * np.maximum(length, 1e-9)).all(axis=1)
    return result


def body_points(outline: Region, x: float, y: float, heading: float) -> np.ndarray:
    """Corners, edge middles and centre of a placed body (m, 2)."""
    placed = outline.placed(x, y, heading)
    corners = placed.vertices
    centre = corners.mean(axis=0)
    if placed.radius > 0:
        angle = np.arange(8) * np.pi / 4
        ring = placed.radius * np.column_stack([np.cos(angle), np.sin(angle)])
        corners = (corners[:, None] + ring[None]).reshape(-1, 2)
    middles = (corners + np.roll(corners, -1, axis=0)) / 2
    return np.vstack([corners, middles, centre])


class Road:
    """The lanelets as shapely polygons and links."""

    def __init__(self, lanelets: tuple[Lanelet, ...]) -> None:
        self.lanelets = {lanelet.id: lanelet for lanelet in lanelets}
        self.polygons = {
            lanelet.id: shapely.make_valid(
                shapely.Polygon(np.vstack([lanelet.right, lanelet.left[::-1]]))
            )
            for lanelet in lanelets
        }
        self.shapes = np.array(list(self.polygons.values()))
        shapely.prepare(self.shapes)

    def around(self, x: float, y: float) -> set[int]:
        holds = shapely.intersects_xy(self.shapes, x, y)
        return {i for i, yes in zip(self.polygons, holds, strict=True) if yes}

    def direction(self, lanelet: int, x: float, y: float) -> float:
        line = self.lanelets[lanelet].center
        middle = (line[1:] + line[:-1]) / 2
        i = int(np.hypot(*(middle - (x, y)).T).argmin())
        return float(np.arctan2(*(line[i + 1] - line[i])[::-1]))

    def onward(self, lanelets: set[int]) -> set[int]:
        """One link further: successors and lanes of the same direction."""
        found = set(lanelets)
        for i in lanelets:
            lanelet = self.lanelets[i]
            found |= set(lanelet.successors)
            for other in (lanelet.adjacent_left, lanelet.adjacent_right):
                if other is not None and other[1]:
                    found.add(other[0])
        return found & set(self.lanelets)

    def carriageway(self, lanelets: set[int]) -> shapely.Geometry:
        """The area on which a body may be that started on these lanelets."""
        found = set(lanelets)
        while (more := self.onward(found)) != found:
            found = more
        for i in lanelets:
            found |= set(self.lanelets[i].predecessors) & set(self.lanelets)
        found |= self.onward(found)
        return shapely.union_all([self.polygons[i] for i in found])


def first_breach(
    states: np.ndarray, outline: Region, dt: float, road: Road, a: Assumptions, noise: float = 0.0
) -> tuple[int, str | None]:
    """The first step at which a recording (n, 5) breaks an assumption, and which; (n, None).

    Positions may disagree with the recorded velocities by `noise` [m] per step.
    """
    now = {
        i
        for i in road.around(*states[0, :2])
        if abs(_wrap(states[0, 2] - road.direction(i, *states[0, :2]))) <= np.pi / 3
    }
    if not now:
        return 0, "stay_on_carriageway"
    area = road.carriageway(now)

    shapely.prepare(area)
    corners = shapely.points(
        np.stack([outline.placed(*row[:3].tolist()).vertices for row in states])
    )
    away = np.zeros(corners.shape)
    out = ~shapely.covers(area, corners)
    away[out] = shapely.distance(area, corners[out])
    overhang = away.max(axis=1)
    allowed = max(a.max_overhang, float(overhang[0]))
    way = 0.0
    for k, row in enumerate(states):
        if k:
            before = states[k - 1]
            v0, v1 = (r[3] * np.array([np.cos(r[2]), np.sin(r[2])]) for r in (before, row))
            mean = (v1 - v0) / dt
            error = row[:2] - before[:2] - dt * (v0 + v1) / 2
            # mean +- 4 error / dt^2 in both halves of the step is a motion between both states.
            swing = 4 * max(float(np.hypot(*error)) - noise, 0.0) / dt**2
            if np.hypot(*mean) + swing > a.max_acceleration:
                return k, "max_acceleration"
            way += abs(before[3] + row[3]) / 2 * dt
            if abs(_wrap(row[2] - states[0, 2])) > way / a.min_turning_radius:
                return k, "bounded_heading"
            reach = road.onward(road.onward(now))
            now = road.around(*row[:2]) & reach
            if not now:
                return k, "stay_on_carriageway"
        if row[3] < 0.0:
            return k, "no_reversing"
        if abs(row[3]) > max(a.max_speed, states[0, 3]):
            return k, "max_speed"
        relative = [_wrap(row[2] - road.direction(i, *row[:2])) for i in now]
        if max(abs(r) for r in relative) > np.pi / 2:
            now = {i for i, r in zip(now, relative, strict=True) if abs(r) <= np.pi / 2}
            if not now:
                return k, "no_reversing"
        if max(abs(row[3] * np.sin(r)) for r in relative) > a.max_lateral_speed:
            return k, "max_lateral_speed"
        if overhang[k] > allowed:
            return k, "max_overhang"
    return len(states), None


def uncovered(
    prediction: PredictedObstacle, states: np.ndarray, outline: Region, steps: int
) -> list[tuple[int, str]]:
    """The steps < `steps` at which the body is not inside, as (k, "at" or "between")."""
    missing = []
    for k in range(steps):
        points = body_points(outline, *states[k, :3])
        if not inside_union(points, prediction.at[k]).all():
            missing.append((k, "at"))
        for j in (k - 1, k):
            if (
                0 <= j < min(len(prediction.between), steps - 1)
                and not inside_union(points, prediction.between[j]).all()
            ):
                missing.append((j, "between"))
    return missing


def _wrap(angle: float) -> float:
    return (angle + np.pi) % (2 * np.pi) - np.pi
