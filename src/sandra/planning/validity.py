"""Whether the full body is free of collisions and on the road, at and between the grid points.

Between two grid points the body stays within the convex hull of its two rectangles there, widened
by `deviation`: a point whose acceleration is at most c leaves its chord by at most c tau^2 / 8.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sandra.planning.bounds import clear
from sandra.planning.bounds import within as is_within
from sandra.planning.limits import slip
from sandra.planning.prepared import Prepared
from sandra.planning.single_track import HEADING, SPEED, STEERING
from sandra.prediction.geometry import extent, stack
from sandra.prediction.types import Prediction
from sandra.scene.types import Ego, Region, Scene

Array = NDArray[np.float64]
Bools = NDArray[np.bool_]

CLEARANCE = 0.02
"""Distance that planned bodies keep from others, beyond what is needed [m]."""
ROAD_MARGIN = 0.01
"""Distance that planned bodies keep from the border of the road, beyond what is needed [m]."""
ROUGH = 0.3
"""Samples may leave the road by this much [m]: what is driven then may yet stay on it."""
SHORTEST_AXIS = 1e-9
"""Differences of two points that are no longer than this tell no direction [m]."""
SLIT = 0.05
"""Gaps of up to twice this between neighbouring lanelets are no border of the road [m]."""


BATCH = 512
"""Distances of so many bodies are measured at once: they stay in the cache."""


def corners(states: Array, ego: Ego) -> Array:
    """(..., 4, 2) corners of the body, counter-clockwise, for states (..., 5)."""
    cosine, sine = np.cos(states[..., HEADING]), np.sin(states[..., HEADING])
    a, b = ego.length / 2, ego.width / 2
    along = np.stack([cosine, sine], axis=-1)[..., None, :] * np.array([[-a], [a], [a], [-a]])
    across = np.stack([-sine, cosine], axis=-1)[..., None, :] * np.array([[-b], [-b], [b], [b]])
    return np.asarray(states[..., None, :2] + along + across)


def deviation(states: Array, inputs: Array, tau: float, ego: Ego) -> Array:
    """(N, n) how far the body leaves the hull of its rectangles at both ends of each step [m].

    A body point at distance r from the centre is accelerated by at most
    |a| + v (|theta'| + |beta'|) + r (|theta''| + theta'^2).
    """
    speed = np.maximum(np.abs(states[:, :-1, SPEED]), np.abs(states[:, 1:, SPEED]))
    steering = np.maximum(np.abs(states[:, :-1, STEERING]), np.abs(states[:, 1:, STEERING]))
    radius = np.hypot(ego.length, ego.width) / 2
    squared = np.tan(steering) ** 2
    beta_rate = 2 * (1 + squared) / (4 + squared) * np.abs(inputs[..., 1])
    sine = np.sin(slip(steering))
    turn = 2 * speed * sine / ego.wheelbase
    turn_rate = 2 * (np.abs(inputs[..., 0]) * sine + speed * beta_rate) / ego.wheelbase
    acceleration = np.abs(inputs[..., 0]) + speed * (turn + beta_rate)
    return np.asarray((acceleration + radius * (turn_rate + turn**2)) * tau**2 / 8)


@dataclass(frozen=True, slots=True, eq=False)
class Occupied:
    """A prediction's regions between its steps, prepared for batches of trajectories.

    Region m is the convex hull of `vertices[m]` (V corners, the last one repeated) widened by
    `radius[m]`, in the interval [t_k, t_k+1] for `first[k]` <= m < `first[k+1]`.
    """

    dt: float
    vertices: Array
    radius: Array
    middle: Array
    reach: Array
    """Radius of a circle about `middle` that holds the region [m]."""
    first: NDArray[np.int_]
    owner: NDArray[np.int_]
    """Index of the predicted obstacle that each region belongs to."""

    @staticmethod
    def of(prediction: Prediction) -> Occupied:
        """Prepare a prediction."""
        every: list[Region] = []
        counts: list[int] = []
        for k in range(prediction.horizon):
            for obstacle in prediction.obstacles:
                every += obstacle.between[k]
                counts.append(len(obstacle.between[k]))
        number = len(prediction.obstacles)
        owner = np.repeat(
            np.tile(np.arange(number), prediction.horizon), np.array(counts, dtype=int)
        )
        vertices = stack([region.vertices for region in every])
        radius = np.array([region.radius for region in every], dtype=float)
        low, high = extent(vertices)
        middle = (low + high) / 2
        reach = radius.copy()
        for column in range(vertices.shape[1]):
            away = vertices[:, column] - middle
            np.maximum(reach, np.sqrt(away[:, 0] ** 2 + away[:, 1] ** 2) + radius, out=reach)
        per_step = np.reshape(np.array(counts, dtype=int), (prediction.horizon, number))
        first = np.append(0, np.cumsum(per_step.sum(axis=1)))
        return Occupied(prediction.dt, vertices, radius, middle, reach, first, owner)

    @property
    def horizon(self) -> int:
        """Number of intervals."""
        return len(self.first) - 1

    def free(
        self,
        states: Array,
        inputs: Array,
        tau: float,
        ego: Ego,
        start: float = 0.0,
        clearance: float = CLEARANCE,
    ) -> Bools:
        """(N,) whether trajectories keep `clearance` from every region at every instant.

        Args:
            states: (N, n+1, 5); inputs: (N, n, 2); as in `Trajectory`.
            start: time of the first state [s], counted from step 0 of the prediction; intervals
                of the prediction begin and end at grid points.

        Raises:
            ValueError: if the trajectories last longer than the prediction.
        """
        gaps = self.gaps(states, inputs, tau, ego, start, clearance + 0.5)
        return np.asarray(clear(gaps, clearance).all(axis=1))

    def gaps(
        self,
        states: Array,
        inputs: Array,
        tau: float,
        ego: Ego,
        start: float = 0.0,
        within: float = 5.0,
    ) -> Array:
        """(N, n) lower bounds of the distance to the others in each step [m], at most `within`.

        0 or less where bodies may overlap. Raises as `free`.
        """
        found = np.full(inputs.shape[:2], within)
        row, step, _, distance = self._pairs(states, inputs, tau, ego, start, within)
        np.minimum.at(found, (row, step), distance)
        return found

    def nearest(
        self, states: Array, inputs: Array, tau: float, ego: Ego, start: float = 0.0
    ) -> tuple[int, float] | None:
        """The index of the obstacle that trajectories come nearest to, and when [s].

        None if they come near to none. Raises as `free`.
        """
        _, step, region, distance = self._pairs(states, inputs, tau, ego, start, 5.0)
        if distance.size == 0:
            return None
        worst = int(np.argmin(distance))
        return int(self.owner[region[worst]]), start + tau * float(step[worst])

    def _pairs(
        self, states: Array, inputs: Array, tau: float, ego: Ego, start: float, within: float
    ) -> tuple[NDArray[np.int_], NDArray[np.int_], NDArray[np.int_], Array]:
        """(M,) trajectory, fine step, region and distance of whatever may come near."""
        n = inputs.shape[1]
        # The small shift puts a grid point that coincides with t_k into the interval after it.
        interval = np.floor((start + tau * np.arange(n)) / self.dt + 1e-6).astype(int)
        if n and (interval[0] < 0 or interval[-1] >= self.horizon):
            raise ValueError("the trajectories last longer than the prediction")
        slack = deviation(states, inputs, tau, ego)
        centre = (states[:, :-1, :2] + states[:, 1:, :2]) / 2
        travel = np.linalg.norm(np.diff(states[..., :2], axis=1), axis=2) / 2
        around = travel + np.hypot(ego.length, ego.width) / 2 + slack + within
        near = [(np.zeros(0, dtype=int),) * 3]
        for k in np.unique(interval).tolist():
            steps = np.flatnonzero(interval == k)
            part = np.arange(self.first[k], self.first[k + 1])
            here, wide = centre[:, steps], around[:, steps]
            # First those that are near to a box around all the bodies.
            reach = (self.reach[part] + wide.max(initial=0.0))[:, None]
            low = here.reshape(-1, 2).min(axis=0, initial=np.inf)
            high = here.reshape(-1, 2).max(axis=0, initial=-np.inf)
            part = part[is_within(self.middle[part], low, high, reach).all(axis=1)]
            x, y = (here[..., None, i] - self.middle[part, i] for i in (0, 1))
            close = x**2 + y**2 < (wide[..., None] + self.reach[part]) ** 2
            row, step, region = np.nonzero(close)
            near.append((row, steps[step], part[region]))
        row, step, region = (np.concatenate(x) for x in zip(*near, strict=True))
        body = corners(states, ego)
        hull = np.concatenate([body[row, step], body[row, step + 1]], axis=1)
        distance = separation(hull, self.vertices[region]) - self.radius[region]
        return row, step, region, distance - slack[row, step]


def separation(hulls: Array, polygons: Array) -> Array:
    """(M,) lower bounds of the distances between convex hulls [m]; 0 or less if not separated.

    Args:
        hulls: (M, 8, 2) corners of two rectangles, each counter-clockwise.
        polygons: (M, V, 2) corners in order; repeated ones are allowed.

    Along each of several directions (separating axes) the gap between the two projections is a
    lower bound of the distance: the normals of both rectangles, of the lines between corresponding
    corners, of the polygon's edges, and the directions from the nearest point of each rectangle.
    """
    found = np.empty(len(hulls))
    for begin in range(0, len(hulls), BATCH):
        part = slice(begin, begin + BATCH)
        found[part] = _separation(hulls[part], polygons[part])
    return found


def _separation(hulls: Array, polygons: Array) -> Array:
    """`separation` of so few that all fits into the cache."""
    front, back = hulls[:, 0:4], hulls[:, 4:8]
    edges = np.concatenate(
        [
            front[:, 1:3] - front[:, 0:2],
            back[:, 1:3] - back[:, 0:2],
            back - front,
            np.roll(polygons, -1, axis=1) - polygons,
        ],
        axis=1,
    )
    normals = np.stack([-edges[..., 1], edges[..., 0]], axis=-1)
    low, high = extent(polygons)
    middle = (low + high) / 2
    axes = np.concatenate(
        [
            normals,
            (middle - _nearest(front, middle))[:, None],
            (middle - _nearest(back, middle))[:, None],
        ],
        axis=1,
    )
    size = np.sqrt(axes[..., 0] ** 2 + axes[..., 1] ** 2)
    axes = axes / np.maximum(size, SHORTEST_AXIS)[..., None]
    ours = extent(axes @ np.swapaxes(hulls, 1, 2), axis=2)
    theirs = extent(axes @ np.swapaxes(polygons, 1, 2), axis=2)
    gap = np.maximum(theirs[0] - ours[1], ours[0] - theirs[1])
    # Without length it is no direction, and separates nothing.
    return np.asarray(np.where(size > SHORTEST_AXIS, gap, -np.inf).max(axis=1))


def _nearest(rectangles: Array, points: Array) -> Array:
    """(M, 2) the point of each rectangle (M, 4, 2) that is nearest to a point (M, 2)."""
    origin = rectangles[:, 0]
    found = origin.copy()
    for axis in (rectangles[:, 1] - origin, rectangles[:, 3] - origin):
        share = ((points - origin) * axis).sum(axis=1) / (axis**2).sum(axis=1)
        found += np.clip(share, 0.0, 1.0)[:, None] * axis
    return found


@dataclass(frozen=True, slots=True, eq=False)
class Road:
    """The union of all lanelets near the ego, prepared for containment tests."""

    area: Prepared
    """Eroded by `ROAD_MARGIN` and the largest deviation that is allowed."""
    allowed: float
    """Bodies may deviate by this much between grid points [m]."""
    rough: Prepared
    """The same, grown by `ROUGH` instead."""

    @staticmethod
    def of(scene: Scene, reach: float = 200.0, allowed: float = 0.01) -> Road:
        """The road within `reach` of the ego [m]."""
        import shapely

        polygons = [lanelet.area() for lanelet in scene.lanelets]
        x, y = scene.ego.state.x, scene.ego.state.y
        window = shapely.box(x - reach, y - reach, x + reach, y + reach)
        near = [polygon.intersection(window) for polygon in polygons if polygon.intersects(window)]
        # Slits are closed, but nothing is added outside: mitred corners come back as they were.
        union = shapely.union_all(near)
        closed = union.buffer(SLIT, join_style="mitre").buffer(-SLIT, join_style="mitre")
        area = closed.buffer(-(ROAD_MARGIN + allowed), join_style="mitre")
        rough = closed.buffer(ROUGH, join_style="mitre")
        return Road(Prepared(area), allowed, Prepared(rough))

    def may_hold(self, states: Array, ego: Ego) -> Bools:
        """(N,) whether bodies (N, n+1) are on the road or nearly so, by their corners alone."""
        return self._corners(self.rough, states, ego)

    def contains(self, states: Array, ego: Ego) -> Bools:
        """(N,) whether all corners of bodies (N, n+1) are on the road: needed, not enough."""
        return self._corners(self.area, states, ego)

    def _corners(self, area: Prepared, states: Array, ego: Ego) -> Bools:
        body = corners(states, ego)
        return np.asarray(area.contains_xy(body[..., 0], body[..., 1]).all(axis=(1, 2)))

    def holds(self, states: Array, inputs: Array, tau: float, ego: Ego) -> Bools:
        """(N,) whether the bodies of trajectories (N, n+1, 5) are on the road at every instant."""
        import shapely

        inside = self._corners(self.area, states, ego)
        inside &= (deviation(states, inputs, tau, ego) <= self.allowed).all(axis=1)
        for row in np.flatnonzero(inside):
            body = corners(states[row], ego)
            points = np.concatenate([body[:-1], body[1:]], axis=1)
            hulls = shapely.convex_hull(shapely.multipoints(points))
            inside[row] = bool(self.area.covers(hulls).all())
        return inside
