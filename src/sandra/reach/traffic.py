"""The bodies of predicted vehicles at all their steps at once: what they touch, where they end."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sandra.prediction.types import PredictedObstacle, Prediction
from sandra.scene.frame import Frame
from sandra.scene.types import placed

Array = NDArray[np.float64]
Ints = NDArray[np.int_]
Mask = NDArray[np.bool_]

NOT_IN_TRAFFIC = frozenset({"pedestrian", "trafficIsland", "building", "pillar", "median_strip"})
"""Kinds of obstacles that precede nobody in a lane; collisions with them are still checked."""


@dataclass(frozen=True, slots=True, eq=False)
class Traffic:
    """m bodies with n corners each: vehicles, one after another, at the steps they are there."""

    step: Ints
    """(m,)"""
    is_first: Mask
    """(m,) whether a vehicle begins here."""
    states: Array
    """(m, 5) most likely ones."""
    bodies: Array
    """(m, n, 2) [m]"""
    radius: Array
    """(m,) by which each body is wider [m]."""

    def touches(self, areas: Sequence[Any]) -> Mask:
        """(areas, m) which bodies touch which shapely geometries."""
        import shapely

        found = np.zeros((len(areas), len(self.bodies)), dtype=bool)
        low = self.bodies.min(axis=1) - self.radius[:, None]
        high = self.bodies.max(axis=1) + self.radius[:, None]
        for mine, area in zip(found, areas, strict=True):
            (x0, y0, x1, y1) = shapely.bounds(area).tolist()
            mine[:] = (high >= (x0, y0)).all(axis=1) & (low <= (x1, y1)).all(axis=1)
        rows = np.flatnonzero(found.any(axis=0))
        corners = self.bodies[rows]
        # The first corner twice: a line has two points at least.
        hulls = shapely.convex_hull(shapely.linestrings(np.hstack([corners, corners[:, :1]])))
        for mine, area in zip(found, areas, strict=True):
            shapely.prepare(area)
            near = mine[rows]
            mine[rows[near]] = _touch(area, hulls[near], self.radius[rows[near]])
        return found

    def measured(self, frame: Frame, rows: Mask) -> tuple[list[float], list[float]]:
        """Rear ends [m] and speeds along the lane [m/s] of the bodies in `rows`, 0 for others."""
        corners = frame.to_curvilinear(self.bodies[rows].reshape(-1, 2))
        s = corners[:, 0].reshape(-1, self.bodies.shape[1])
        heading = frame.heading(s.mean(axis=1))
        rear, speed = np.zeros(len(rows)), np.zeros(len(rows))
        rear[rows] = s.min(axis=1) - self.radius[rows]
        along = self.states[rows, 3] * np.cos(self.states[rows, 2] - heading)
        speed[rows] = np.maximum(along, 0.0)
        return rear.tolist(), speed.tolist()


def in_traffic(prediction: Prediction) -> Iterator[Traffic]:
    """All vehicles that may precede somebody, those with as many corners together."""
    groups: dict[int, list[PredictedObstacle]] = {}
    for predicted in prediction.obstacles:
        if predicted.obstacle.kind not in NOT_IN_TRAFFIC:
            count = len(predicted.obstacle.outline.vertices)
            groups.setdefault(count, []).append(predicted)
    for several in groups.values():
        outlines = [each.obstacle.outline for each in several]
        every = np.stack([each.states for each in several])
        owner, step = np.nonzero(np.isfinite(every[:, :, :4]).all(axis=2))
        states = every[owner, step]
        corners = np.stack([outline.vertices for outline in outlines])[owner]
        yield Traffic(
            step,
            np.diff(owner, prepend=-1) != 0,
            states,
            placed(corners, states[:, :3]),
            np.array([outline.radius for outline in outlines])[owner],
        )


def _touch(area: Any, hulls: Any, radius: Array) -> Mask:
    """Which geometries come as near to a prepared area as their radius."""
    import shapely

    found = np.asarray(shapely.intersects(area, hulls))
    wider = ~found & (radius > 0.0)
    found[wider] = shapely.dwithin(area, hulls[wider], radius[wider])
    return found
