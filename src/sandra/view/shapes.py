"""Geometry of the pictures: the plane seen along the ego's lane, regions and sets as polygons."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from sandra.prediction.types import PredictedObstacle
from sandra.reach import ReachableSet
from sandra.scene.types import Region, Scene

if TYPE_CHECKING:
    import shapely

Array = NDArray[np.float64]
Window = tuple[float, float, float, float]
"""(x_low, x_high, y_low, y_high) in view coordinates [m]."""

THINNEST = 0.12
"""Sets thinner than this are drawn this thick, else a point would not be seen [m]."""
_STEP_ON_CURVES = 1.0
"""Edges along s are followed in pieces of this length [m]."""


@dataclass(frozen=True, slots=True, eq=False)
class View:
    """View coordinates: the ego's centre at the origin, its lane to the right (a rigid motion).

    Roads then run along the page whatever their direction is in the file, and lengths stay true.
    """

    scene: Scene
    origin: Array
    rotation: Array

    @staticmethod
    def of(scene: Scene) -> View:
        """The view of a scene."""
        state = scene.ego.state
        return View.at(scene, (state.x, state.y), scene.ego_curvilinear[3])

    @staticmethod
    def at(scene: Scene, origin: tuple[float, float], angle: float) -> View:
        """The view from a place [m], with a direction [rad] to the right."""
        c, s = np.cos(angle), np.sin(angle)
        return View(scene, np.array(origin), np.array([[c, -s], [s, c]]))

    @property
    def angle(self) -> float:
        """The direction that is to the right [rad]."""
        return float(np.arctan2(self.rotation[1, 0], self.rotation[0, 0]))

    def points(self, xy: Array) -> Array:
        """(n, 2) points in the plane -> (n, 2) points in view coordinates."""
        seen: Array = (np.asarray(xy, dtype=float)[:, :2] - self.origin) @ self.rotation
        return seen

    def lane_points(self, sd: Array) -> Array:
        """(n, 2) points (s, d) -> (n, 2) points in view coordinates."""
        return self.points(self.scene.frame.to_cartesian(np.asarray(sd)))

    def region(self, region: Region) -> shapely.Geometry:
        """A region as a polygon in view coordinates."""
        import shapely

        vertices = self.points(region.vertices)
        if not np.isfinite(vertices).all():
            return shapely.Polygon()
        hull = shapely.MultiPoint(vertices).convex_hull
        return hull.buffer(region.radius, quad_segs=8) if region.radius > 0.0 else hull

    def body(self, outline: Region, pose: Sequence[float]) -> shapely.Geometry:
        """A body at the pose (x, y, heading, ...) in view coordinates; empty for NaN."""
        import shapely

        if not np.isfinite(np.asarray(pose[:3], dtype=float)).all():
            return shapely.Polygon()
        return self.region(outline.placed(pose[0], pose[1], pose[2]))

    def occupancy(self, obstacle: PredictedObstacle, k: int) -> shapely.Geometry:
        """Where a predicted obstacle may be at step k."""
        import shapely

        return shapely.union_all([self.region(region) for region in obstacle.at[k]])

    def positions(self, reachable: ReachableSet) -> list[shapely.Geometry]:
        """For each step, the union of the set's positions (of the ego's centre)."""
        return [self._union([base.rectangle for base in step]) for step in reachable.steps]

    def contested(self, reachable: ReachableSet) -> shapely.Geometry:
        """Where the set would have been at its first empty step; empty if that is not known."""
        import shapely

        from sandra.reach.lattice import boxes

        if reachable.contested is None:
            return shapely.Polygon()
        return self._union([reachable.lattice.bounds(box) for box in boxes(reachable.contested)])

    def _union(self, rectangles: list[tuple[float, float, float, float]]) -> shapely.Geometry:
        import shapely

        if not rectangles:
            return shapely.Polygon()
        s_low, s_high, d_low, d_high = np.array(rectangles).T
        grow_s = np.maximum(THINNEST - (s_high - s_low), 0.002) / 2
        grow_d = np.maximum(THINNEST - (d_high - d_low), 0.002) / 2
        boxes = shapely.box(s_low - grow_s, d_low - grow_d, s_high + grow_s, d_high + grow_d)
        union = shapely.segmentize(shapely.union_all(boxes), _STEP_ON_CURVES)
        return shapely.transform(union, self.lane_points)


def polygons(geometry: shapely.Geometry) -> list[shapely.Polygon]:
    """The non-empty polygons of a geometry; points and lines are left out."""
    import shapely

    parts = shapely.get_parts(geometry).tolist()
    nested = [p for part in parts for p in (polygons(part) if hasattr(part, "geoms") else [part])]
    return [p for p in nested if p.geom_type == "Polygon" and not p.is_empty]


def clipped(geometry: shapely.Geometry, window: Window) -> shapely.Geometry:
    """The part of a geometry within the window."""
    import shapely

    x_low, x_high, y_low, y_high = window
    return shapely.intersection(
        shapely.make_valid(geometry), shapely.box(x_low, y_low, x_high, y_high)
    )


def path_of(geometry: shapely.Geometry) -> Any:
    """All polygons as one compound matplotlib path, holes left open."""
    from matplotlib.path import Path
    from shapely.geometry.polygon import orient

    rings = []
    for polygon in polygons(geometry):
        turned = orient(polygon)
        rings += [np.asarray(r.coords) for r in (turned.exterior, *turned.interiors)]
    if not rings:
        return Path(np.zeros((0, 2)))
    return Path.make_compound_path(*[Path(ring, closed=True) for ring in rings])


def bounds(geometries: Iterable[shapely.Geometry]) -> Window | None:
    """The window around all geometries; None if all are empty."""
    import shapely

    found = shapely.bounds(np.array([g for g in geometries if not g.is_empty], dtype=object))
    if not len(found):
        return None
    low, high = found[:, :2].min(axis=0), found[:, 2:].max(axis=0)
    return float(low[0]), float(high[0]), float(low[1]), float(high[1])


def grown(window: Window, along: float, across: float) -> Window:
    """The window with a margin at both ends and at both sides [m]."""
    return window[0] - along, window[1] + along, window[2] - across, window[3] + across


def with_aspect(window: Window, aspect: float) -> Window:
    """The smallest window around this one, with the same centre, whose width is aspect x height."""
    x_low, x_high, y_low, y_high = window
    width, height = x_high - x_low, y_high - y_low
    more_x = max(0.0, aspect * height - width) / 2
    more_y = max(0.0, width / aspect - height) / 2
    return x_low - more_x, x_high + more_x, y_low - more_y, y_high + more_y


def touches(window: Window, points: Array) -> bool:
    """Whether the bounding box of the points meets the window."""
    if not np.isfinite(points).all():
        return False
    low, high = points.min(axis=0), points.max(axis=0)
    return bool(
        low[0] <= window[1]
        and high[0] >= window[0]
        and low[1] <= window[3]
        and high[1] >= window[2]
    )
