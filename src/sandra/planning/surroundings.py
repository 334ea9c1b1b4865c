"""What the searches for fail-safe trajectories of one decision share: others, road, conflicts."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sandra.planning.bounds import clear, overlap
from sandra.planning.conflict import conflict_areas
from sandra.planning.validity import CLEARANCE, Occupied, Road, corners, separation
from sandra.prediction.geometry import extent
from sandra.prediction.types import Prediction
from sandra.scene.types import Ego, Scene

Array = NDArray[np.float64]
Ints = NDArray[np.int_]

SLICES = 4
"""Collisions are searched for in so many parts of the time, one after another."""


@dataclass(frozen=True, slots=True, eq=False)
class Surroundings:
    """Occupancies of the others, the road, and the conflict areas.

    `step` (R,), `low` and `high` (R, 2): interval and bounding box of each region [m].
    """

    ego: Ego
    ids: tuple[int, ...]
    """Of the predicted obstacles, in their order."""
    occupied: Occupied
    step: Ints
    low: Array
    high: Array
    road: Road
    conflicts: tuple[Array, ...]
    area: Any
    """The union of the conflict areas (shapely), None where there are none."""
    cut_in: bool = False
    """Whether the prediction relies on somebody's cutting in only as the law allows."""

    @staticmethod
    def of(scene: Scene, set_based: Prediction, road: Road | None = None) -> Surroundings:
        """Prepare the searches of one decision, for `fail_safe`; `road`: `Road.of(scene)`."""
        import shapely

        areas = tuple(conflict_areas(scene))
        occupied = Occupied.of(set_based)
        low, high = extent(occupied.vertices)
        return Surroundings(
            scene.ego,
            tuple(each.obstacle.id for each in set_based.obstacles),
            occupied,
            np.repeat(np.arange(occupied.horizon), np.diff(occupied.first)),
            low - occupied.radius[:, None],
            high + occupied.radius[:, None],
            Road.of(scene) if road is None else road,
            areas,
            shapely.union_all([shapely.Polygon(x) for x in areas]) if areas else None,
            any("legal_cut_in" in each.assumptions for each in set_based.obstacles),
        )

    def gaps(self, states: Array, inputs: Array, tau: float, start: float, within: float) -> Array:
        """(N, n) lower bounds of the distances to the others, as `Occupied.gaps` [m]."""
        near = self._nearby(states, tau, start, within)
        return near.gaps(states, inputs, tau, self.ego, start, within)

    def first_contact(
        self, states: Array, inputs: Array, count: Ints, tau: float, start: float
    ) -> Ints:
        """(N,) the first step in which the body comes nearer to others than `CLEARANCE`, else -1.

        Args:
            count: (N,) only so many steps of each are looked at.
        """
        found = np.full(len(states), -1)
        rows = np.arange(len(states))
        n = int(count.max())
        ends = np.unique(np.linspace(0, n, SLICES + 1).round().astype(int))
        for i, j in zip(ends[:-1].tolist(), ends[1:].tolist(), strict=True):
            rows = rows[(found[rows] < 0) & (count[rows] > i)]
            if not len(rows):
                break
            gaps = self.gaps(
                states[rows, i : j + 1], inputs[rows, i:j], tau, start + i * tau, 2 * CLEARANCE
            )
            meets = ~clear(gaps, CLEARANCE) & (i + np.arange(j - i) < count[rows, None])
            found[rows] = np.where(meets.any(axis=1), i + meets.argmax(axis=1), -1)
        return found

    def ends_free(
        self, states: Array, inputs: Array, count: Ints, tau: float, start: float
    ) -> NDArray[np.bool_]:
        """(N,) whether the last of `count` (N,) steps keeps `CLEARANCE`: a quick look."""
        found = np.empty(len(states), dtype=bool)
        for n in np.unique(count).tolist():
            group = np.flatnonzero(count == n)
            gaps = self.gaps(
                states[group, n - 1 : n + 1],
                inputs[group, n - 1 : n],
                tau,
                start + (n - 1) * tau,
                2 * CLEARANCE,
            )
            found[group] = clear(gaps[:, 0], CLEARANCE)
        return found

    def nearest(self, states: Array, time: float) -> int:
        """Id of the obstacle nearest to the body during one step (2, 5) that begins at `time`."""
        k = int(time / self.occupied.dt + 1e-6)
        part = slice(int(self.occupied.first[k]), int(self.occupied.first[k + 1]))
        regions = self.occupied.vertices[part]
        hull = np.broadcast_to(corners(states, self.ego).reshape(8, 2), (len(regions), 8, 2))
        gaps = separation(hull, regions) - self.occupied.radius[part]
        return self.ids[int(self.occupied.owner[part][int(np.argmin(gaps))])]

    def from_conflicts(self, states: Array) -> Array:
        """(N,) distances of the bodies at states (N, 5) from the conflict areas [m]."""
        if self.area is None:
            return np.full(len(states), np.inf)
        import shapely

        return np.asarray(shapely.distance(shapely.polygons(corners(states, self.ego)), self.area))

    def _nearby(self, states: Array, tau: float, start: float, within: float) -> Occupied:
        """The occupancies that some of the bodies (N, n + 1, 5) may come near to in their step."""
        occupied = self.occupied
        reach = np.hypot(self.ego.length, self.ego.width) / 2 + within + 0.5
        low = states[..., :2].min(axis=0) - reach
        high = states[..., :2].max(axis=0) + reach
        n = states.shape[1] - 1
        steps = np.floor((start + tau * np.arange(n)) / occupied.dt + 1e-6).astype(int)
        lowest = np.full((occupied.horizon, 2), np.inf)
        highest = np.full((occupied.horizon, 2), -np.inf)
        for rows in (slice(0, n), slice(1, n + 1)):
            np.minimum.at(lowest, steps, low[rows])
            np.maximum.at(highest, steps, high[rows])
        near = overlap(self.low, self.high, lowest[self.step], highest[self.step])
        total = np.concatenate([[0], np.cumsum(near)])
        return replace(
            occupied,
            vertices=occupied.vertices[near],
            radius=occupied.radius[near],
            middle=occupied.middle[near],
            reach=occupied.reach[near],
            owner=occupied.owner[near],
            first=total[occupied.first],
        )
