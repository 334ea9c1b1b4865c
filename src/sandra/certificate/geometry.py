"""Shapes in the plane, with shapely: the moving body, regions, lanelets, the reference line."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray

from sandra.certificate.motion import TOLERANCE
from sandra.certificate.types import Body, Pavement
from sandra.planning.types import Trajectory
from sandra.scene.types import Region

Array = NDArray[np.float64]
Shapes = NDArray[np.object_]
"""shapely geometries."""

SLIT = 0.05
"""Gaps of up to twice this between neighbouring lanelets are no border of the road [m]."""
BEYOND = 1000.0
"""The reference line goes straight on so far beyond both ends [m]."""


def corners(states: Array, body: Body) -> Array:
    """(n, 4, 2) corners of the body at states (n, >= 3) [m]."""
    ahead = np.column_stack([np.cos(states[:, 2]), np.sin(states[:, 2])]) * body.length / 2
    aside = np.column_stack([-np.sin(states[:, 2]), np.cos(states[:, 2])]) * body.width / 2
    offsets = np.stack([ahead + aside, aside - ahead, -ahead - aside, ahead - aside], axis=1)
    return np.asarray(states[:, None, :2] + offsets)


def bodies(states: Array, body: Body) -> Shapes:
    """(n,) the body's rectangles."""
    return hulls(corners(states, body))


def hulls(points: Array) -> Shapes:
    """(n,) convex hulls of n sets of m points (n, m, 2)."""
    # Lines through the points, and back to the first: one point alone makes no line.
    closed = np.concatenate([points, points[:, :1]], axis=1)
    return np.atleast_1d(shapely.convex_hull(shapely.linestrings(closed)))


@dataclass(frozen=True, slots=True, eq=False)
class Sweep:
    """What the body covers in each step: within `margins[i]` [m] of the convex set `hulls[i]`."""

    hulls: Shapes
    margins: Array


def sweep(t: Trajectory, body: Body) -> Sweep:
    """The area that the body covers between neighbouring grid points, from outside.

    A point of the body at r, |r| <= R = half the diagonal, moves as p(t) = c(t) + D(theta(t)) r.
    On a step of length tau it differs from linear interpolation between its ends by at most
    tau^2 / 8 max |p''| (interpolation error of the projection on any direction). The interpolant
    runs within the convex hull of the two rectangles, so the body stays within the hull widened by

        tau^2 / 8 (|c''| + R (|theta''| + theta'^2)).

    With c' = v (cos, sin)(theta + beta):  |c''| <= |a| + v (|theta'| + |beta'|);
    theta' = 2 v sin(beta) / l, so |theta''| <= 2 (|a| |sin beta| + v |beta'|) / l;
    beta = atan(tan(delta) / 2), so |beta'| = |w| 2 / (1 + 3 cos(delta)^2).
    v, |sin beta| and 1 / cos(delta) are largest at an end of the step, as v and delta are linear
    and |delta| < pi / 2. The tolerance of `motion` is added: a state may be that far from where
    the model leads.
    """
    edges = np.abs(t.states)
    v = np.maximum(edges[:-1, 3], edges[1:, 3])
    delta = np.maximum(edges[:-1, 4], edges[1:, 4])
    a, w = np.abs(t.inputs).T
    sine = np.sin(np.arctan(np.tan(delta) / 2))
    slipping = 2 * w / (1 + 3 * np.cos(delta) ** 2)
    turning = 2 * v * sine / body.wheelbase
    bending = 2 * (a * sine + v * slipping) / body.wheelbase
    radius = np.hypot(body.length, body.width) / 2
    centre = a + v * (turning + slipping)
    deviation = t.tau**2 / 8 * (centre + radius * (bending + turning**2))
    rounding = float(np.hypot(*TOLERANCE[:2])) + radius * float(TOLERANCE[2])
    ends = corners(t.states, body)
    return Sweep(hulls(np.concatenate([ends[:-1], ends[1:]], axis=1)), deviation + rounding)


def convex(regions: Iterable[Region]) -> tuple[Shapes, Array]:
    """Convex hulls of the regions' vertices, and their radii [m]."""
    several = tuple(regions)
    if not several:
        return np.empty(0, dtype=object), np.empty(0)
    sizes = np.array([len(r.vertices) for r in several])
    corners = np.concatenate([r.vertices for r in several])
    # Lines through the vertices, and back to the first: one vertex alone makes no line.
    begins = np.cumsum(sizes) - sizes
    closed = np.insert(corners, begins + sizes, corners[begins], axis=0)
    lines = shapely.linestrings(closed, indices=np.repeat(np.arange(len(several)), sizes + 1))
    return shapely.convex_hull(lines), np.array([r.radius for r in several], dtype=float)


def outline(lanelet: Pavement) -> Any:
    """The area between a lanelet's borders; where they cross, both parts."""
    return outlines([lanelet])[0]


def outlines(lanelets: Sequence[Pavement]) -> Shapes:
    """(n,) the same for many."""
    if not lanelets:
        return np.empty(0, dtype=object)
    rings = [np.vstack([x.right, x.left[::-1]]) for x in lanelets]
    owner = np.repeat(np.arange(len(rings)), [len(x) for x in rings])
    areas = shapely.polygons(shapely.linearrings(np.concatenate(rings), indices=owner))
    for i in np.flatnonzero(~shapely.is_valid(areas)).tolist():
        parts = shapely.get_parts(shapely.make_valid(areas[i]))
        kept = [x for x in parts if x.geom_type in ("Polygon", "MultiPolygon")]
        areas[i] = shapely.union_all(kept)
    return np.asarray(areas)


def by_id(lanelets: Sequence[Pavement]) -> dict[int, Any]:
    """The outline of each lanelet by its id."""
    return dict(zip((x.id for x in lanelets), outlines(lanelets), strict=True))


def pavement(lanelets: Sequence[Pavement]) -> Any:
    """The union of lanelets, slits between neighbours closed; outer borders stay in place."""
    union = shapely.union_all(outlines(lanelets))
    widened = shapely.buffer(union, SLIT, join_style="mitre")
    return shapely.buffer(widened, -SLIT, join_style="mitre")


@dataclass(frozen=True, slots=True, eq=False)
class Reference:
    """The line along which s is measured; straight on beyond its ends."""

    line: Any

    @staticmethod
    def of(points: Array) -> Reference:
        """From (n, 2) points, two of them distinct [m]."""
        apart = np.concatenate([[True], (np.diff(points, axis=0) != 0.0).any(axis=1)])
        line = points[apart]
        first, last = line[1] - line[0], line[-1] - line[-2]
        start = line[0] - BEYOND * first / np.hypot(*first)
        end = line[-1] + BEYOND * last / np.hypot(*last)
        return Reference(shapely.linestrings(np.vstack([start, line, end])))

    def along(self, points: Array) -> Array:
        """(m,) s of the nearest points of the line, for points (m, 2) [m]."""
        return np.asarray(
            shapely.line_locate_point(self.line, shapely.points(points)) - BEYOND, dtype=float
        )

    def across(self, points: Array) -> Array:
        """(m,) d, the distance to the line, positive to its left [m]."""
        s = self.along(points)
        foot = self._at(s)
        direction = self.direction(s)
        offset = points - foot
        left = direction[:, 0] * offset[:, 1] - direction[:, 1] * offset[:, 0]
        return np.asarray(np.copysign(np.hypot(offset[:, 0], offset[:, 1]), left))

    def direction(self, s: Array) -> Array:
        """(m, 2) unit vectors along the line at s, over half a metre."""
        chord = self._at(s + 0.25) - self._at(s - 0.25)
        # A line that turns back within half a metre has no direction there: any will do.
        length = np.maximum(np.hypot(chord[:, 0], chord[:, 1]), 1e-9)
        return np.asarray(chord / length[:, None])

    def _at(self, s: Array) -> Array:
        return np.asarray(shapely.get_coordinates(self._points(s)))

    def _points(self, s: Array) -> Shapes:
        return np.atleast_1d(shapely.line_interpolate_point(self.line, s + BEYOND))
