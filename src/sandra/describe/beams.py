"""Obstacles as a lidar would see them: the first that each beam hits (paper Sec. III-B).

Beams leave the ego's centre at equal angles, the first along its heading, as in CommonRoad-RL
(Wang et al. 2021, Fig. 2). Bodies are met exactly: each is a convex polygon widened by a disc, so
its border is made of segments and arcs. What no beam reaches first, since it is hidden or falls
between two beams, is not seen.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sandra.errors import SettingsError
from sandra.scene.types import Obstacle, Region, Scene

Array = NDArray[np.float64]
MOST_BEAMS = 3600


@dataclass(frozen=True, slots=True)
class Beams:
    """How many beams, evenly around the ego, and how far they reach [m]."""

    count: int = 720
    range: float = 100.0

    def __post_init__(self) -> None:
        if not 1 <= self.count <= MOST_BEAMS:
            raise SettingsError(f"beams: {self.count} must be from 1 to {MOST_BEAMS}")
        if not 0.0 < self.range < math.inf:
            raise SettingsError(f"beams: a range of {self.range} must be a finite number > 0 [m]")

    @staticmethod
    def named(text: str) -> Beams | None:
        """None for "lanes"; `beams`, `beams:N` or `beams:N,RANGE`.

        Raises:
            SettingsError: any other text.
        """
        kind, _, numbers = text.strip().partition(":")
        if kind == "lanes" and not numbers:
            return None
        count, _, reach = numbers.partition(",")
        try:
            if kind == "beams":
                return Beams(int(count or 720), float(reach or 100.0))
        except ValueError:
            pass
        raise SettingsError(f"obstacles '{text}': write lanes, beams, or beams:NUMBER,RANGE")

    def seen(self, scene: Scene, obstacles: Sequence[Obstacle]) -> frozenset[int]:
        """Ids of the obstacles that some beam hits first, at their present place."""
        state = scene.ego.state
        angles = state.heading + 2.0 * math.pi * np.arange(self.count) / self.count
        rays = np.column_stack([np.cos(angles), np.sin(angles)])
        here = np.array([state.x, state.y])
        bodies = [
            o.outline.placed(o.state.x - here[0], o.state.y - here[1], o.state.heading)
            for o in obstacles
        ]
        if not bodies:
            return frozenset()
        hits = np.array([distances(body, rays) for body in bodies])
        first = hits.argmin(axis=0)
        reached = hits[first, np.arange(self.count)] <= self.range
        return frozenset(obstacles[int(i)].id for i in np.unique(first[reached]))


def distances(body: Region, rays: Array) -> Array:
    """(m,) how far rays (m, 2) of length 1 from the origin go until they meet the body, else inf.

    0 where the origin lies within the body.
    """
    vertices, radius = body.vertices, body.radius
    ends = np.roll(vertices, -1, axis=0)
    along = ends - vertices
    length = np.hypot(along[:, 0], along[:, 1])
    edges = length > 0.0
    # The normal to the right of an edge points outwards: vertices are counter-clockwise.
    normal = np.column_stack([along[:, 1], -along[:, 0]])[edges] / length[edges, None]
    start = vertices[edges] + radius * normal
    found = _segments(rays, start, along[edges])
    if radius > 0.0:
        found = np.minimum(found, _circles(rays, vertices, radius))
    if _holds_origin(vertices, radius, normal, start):
        return np.zeros(len(rays))
    return found


def _holds_origin(vertices: Array, radius: float, normal: Array, start: Array) -> bool:
    from sandra.scene.convex import distance

    if radius > 0.0 or len(vertices) < 3:
        return bool(distance(np.zeros(2), vertices) <= radius)
    return bool(((normal * start).sum(axis=1) >= 0.0).all())


def _segments(rays: Array, start: Array, along: Array) -> Array:
    """(m,) the nearest of the segments from `start` (n, 2) along `along` (n, 2) on each ray."""
    if not len(start):
        return np.full(len(rays), np.inf)
    cross = rays[:, :1] * along[:, 1] - rays[:, 1:] * along[:, 0]
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        far = (start[:, 0] * along[:, 1] - start[:, 1] * along[:, 0]) / cross
        part = (start[:, 0] * rays[:, 1:] - start[:, 1] * rays[:, :1]) / cross
    met = (cross != 0.0) & (far >= 0.0) & (part >= 0.0) & (part <= 1.0)
    return np.asarray(np.where(met, far, np.inf).min(axis=1))


def _circles(rays: Array, centres: Array, radius: float) -> Array:
    """(m,) the nearest point of the circles around `centres` (n, 2) on each ray."""
    middle = rays @ centres.T
    inside = middle**2 - (centres**2).sum(axis=1) + radius**2
    far = middle - np.sqrt(np.maximum(inside, 0.0))
    return np.asarray(np.where((inside >= 0.0) & (far >= 0.0), far, np.inf).min(axis=1))
