"""What bounded acceleration and speed allow: positions, arc lengths and headings.

A participant is a point with |a| <= a_max and |v| <= v_max in any direction (Koschi & Althoff
2020, acceleration-based occupancy), and a body around it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sandra.prediction.geometry import directions, polygons_around
from sandra.scene.types import Region, State

Array = NDArray[np.float64]

MARGIN = 0.01
"""Every body grows by this much, against rounding and hairline gaps in maps [m]."""
POSITION_DIRECTIONS = 16
BODY_DIRECTIONS = 8


@dataclass(frozen=True, slots=True)
class Bounds:
    """Bounds on one participant's motion [m/s^2, m/s, m, rad]; `speed` None where unknown."""

    a_max: float
    v_max: float
    speed: float | None
    turning_radius: float = 0.0
    slip: float = 0.0
    driving: float = math.inf
    """The speed grows no faster; inf: no faster than `a_max`."""

    def way(self, t: Array) -> Array:
        """The longest way that can be driven by each time [m]; `speed` must be known."""
        speed = np.array(abs(self.speed or 0.0))
        return travelled(speed, min(self.a_max, self.driving), self.v_max, t)


def travelled(speed: Array, a_max: float, v_max: float | Array, t: Array) -> Array:
    """Farthest way in t with v' = a_max from `speed` up to `v_max`, broadcast [m]."""
    speeding_up = np.minimum((v_max - speed) / a_max, t) if a_max > 0 else t
    ended: Array = speed * speeding_up + a_max / 2 * speeding_up**2 + v_max * (t - speeding_up)
    return ended


def position_offsets(state: State, bounds: Bounds, t: Array, normals: Array) -> Array:
    """Support of the positions reachable at each time, (K, J): normal . p <= offset.

    Exact for the worst input in each direction: v . n grows with a_max up to v_max.
    """
    centre = normals @ np.array([state.x, state.y])
    if bounds.speed is None:
        return np.asarray(centre[None, :] + bounds.v_max * t[:, None])
    velocity = bounds.speed * np.array([math.cos(state.heading), math.sin(state.heading)])
    along = normals @ velocity
    reached = travelled(along[None, :], bounds.a_max, bounds.v_max, t[:, None])
    if bounds.driving < bounds.a_max:
        reached = np.minimum(reached, bounds.way(t)[:, None])
    return np.asarray(centre[None, :] + reached)


def least_way(speed: float, braking: float, across: float, t: Array) -> Array:
    """Shortest way along its lane by each time (K,), braking all the time [m].

    Args:
        speed: at time 0 [m/s]. braking: the speed falls no faster [m/s^2].
        across: |speed across the lane| at most [m/s]; what is left goes along it.
    """
    across = max(across, 1e-6)
    if speed <= across or not math.isfinite(across + braking):
        return np.zeros_like(t)
    if braking <= 0.0:
        return np.asarray(math.sqrt(speed**2 - across**2) * t)
    v = np.maximum(speed - braking * t, across)

    def integral(v: Array) -> Array:
        """Of sqrt(v^2 - across^2)."""
        along = np.sqrt(np.maximum(v**2 - across**2, 0.0))
        return np.asarray((v * along - across**2 * np.log((v + along) / across)) / 2)

    way = (integral(np.array(speed)) - integral(v)) / braking
    return np.asarray(np.maximum.accumulate(np.maximum(way, 0.0)))


def heading_change(bounds: Bounds, t: Array) -> Array:
    """How far the body may have turned from its observed heading by each time, (K,) [rad].

    Two bounds hold: turning needs arc length (minimum turning radius); and the direction of the
    velocity leaves that of v_0 by at most asin(a t / v_0), the slip angle added.
    """
    if bounds.turning_radius <= 0.0:
        return np.where(t > 0, np.pi, 0.0)
    if bounds.speed is None:
        return np.minimum(bounds.v_max * t / bounds.turning_radius, np.pi)
    speed = abs(bounds.speed)
    by_arc = bounds.way(t) / bounds.turning_radius
    ratio = bounds.a_max * t / speed if speed > 0 else np.full_like(t, np.inf)
    by_velocity = np.where(ratio < 1, np.arcsin(np.minimum(ratio, 1.0)) + bounds.slip, np.pi)
    return np.asarray(np.minimum(np.minimum(by_arc, by_velocity), np.pi))


def bodies(outline: Region, heading: float, turned: Array) -> Array:
    """Convex polygons that hold the outline at every heading within +-turned of `heading`.

    Args:
        turned: (K,) [rad].

    Returns:
        A batch (K, 8, 2) around the origin; the radius of the outline included.
    """
    corner = outline.vertices
    reach = np.hypot(corner[:, 0], corner[:, 1])
    bearing = np.arctan2(corner[:, 1], corner[:, 0])
    angle = 2 * np.pi * np.arange(BODY_DIRECTIONS) / BODY_DIRECTIONS
    away = np.abs(np.mod(angle[:, None] - bearing[None, :] + np.pi, 2 * np.pi) - np.pi)
    world = directions(BODY_DIRECTIONS, heading)
    apart = np.maximum(away[None] - turned[:, None, None], 0.0)
    support = (reach * np.cos(apart)).max(axis=2)
    return polygons_around(world, support + outline.radius + MARGIN)


def circumscribed(outline: Region) -> float:
    """Radius around the reference point that holds the body at every heading [m]."""
    return float(np.hypot(*outline.vertices.T).max()) + outline.radius
