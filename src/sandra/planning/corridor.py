"""A trajectory of the point-mass model in a driving corridor.

A chain of base sets from the first step to the last bounds (s, v_s) and (d, v_d) at every step by
convex polygons. Within it the smoothest inputs are two linear programs, one along and one across
the lane. The result is a reference for the reader's eye and for a planner: the model's body is a
point mass, so it is no certificate.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from sandra.actions import ActionPair
from sandra.planning.types import Maneuver
from sandra.reach import BaseSet, Polygon, ReachableSet
from sandra.scene.types import Scene
from sandra.settings import Settings

Array = NDArray[np.float64]

MOST_CHAINS = 20
"""So many chains of base sets are tried."""


def in_corridor(
    scene: Scene, pair: ActionPair, corridor: ReachableSet, settings: Settings
) -> Maneuver | None:
    """The smoothest trajectory in the first chain of base sets that holds one.

    None where none of the chains tried holds one: the set over-approximates.
    """
    if corridor.first_empty_step is not None:
        return None
    for chain in _chains(corridor):
        inputs = np.array([b.inputs for b in chain[:-1]])
        lon = _smoothest([b.lon for b in chain], inputs, scene.dt)
        if lon is None:
            continue
        across = np.tile([-settings.a_lat_max, settings.a_lat_max], (len(inputs), 1))
        lat = _smoothest([b.lat for b in chain], across, scene.dt)
        if lat is not None:
            note = (
                "a trajectory of the point-mass model in the driving corridor; "
                "not certified (no body, no curvature, no fail-safe continuation)"
            )
            return Maneuver("reachable", pair, _states(scene, lon, lat), scene.dt, note)
    return None


def _chains(corridor: ReachableSet) -> Iterator[list[BaseSet]]:
    """Chains from the last step back to the first, large sets first, depth first."""
    tried = 0
    last = len(corridor.steps) - 1
    stack = [(last, (i,)) for i in _by_size(corridor, last, range(len(corridor.steps[last])))]
    stack.reverse()
    while stack and tried < MOST_CHAINS:
        k, picked = stack.pop()
        if k == 0:
            tried += 1
            yield [corridor.steps[j][i] for j, i in enumerate(picked)]
            continue
        parents = _by_size(corridor, k - 1, corridor.steps[k][picked[0]].parents)
        stack.extend((k - 1, (p, *picked)) for p in reversed(parents))


def _by_size(corridor: ReachableSet, k: int, indices: range | tuple[int, ...]) -> list[int]:
    def area(i: int) -> float:
        s_low, s_high, d_low, d_high = corridor.steps[k][i].rectangle
        return (s_high - s_low) * (d_high - d_low)

    return sorted(indices, key=lambda i: -area(i))


def _smoothest(polygons: list[Polygon], inputs: Array, dt: float) -> Array | None:
    """(h+1, 3) position, velocity and input that keep to the polygons; None if there are none.

    Minimises the sum of |u_k - u_k-1| and a little of |u_k|, for inputs constant in each step.
    """
    from scipy.optimize import linprog

    h = len(inputs)
    x0, v0 = np.mean(np.array(polygons[0]), axis=0)
    k = np.arange(1, h + 1)
    lag = k[:, None] - 1 - np.arange(h)[None, :]
    done = lag >= 0
    to_v = np.where(done, dt, 0.0)
    to_x = np.where(done, dt * dt * (lag + 0.5), 0.0)
    rows, bounds = [], []
    for step, polygon in enumerate(polygons[1:]):
        for a, b, c in _half_planes(polygon):
            rows.append(a * to_x[step] + b * to_v[step])
            bounds.append(c - a * (x0 + v0 * (step + 1) * dt) - b * v0)
    # Variables: u (h), changes (h - 1), magnitudes (h).
    change = np.diff(np.eye(h), axis=0)
    n = max(h - 1, 0)
    a_ub = np.vstack(
        [
            np.hstack([np.array(rows).reshape(-1, h), np.zeros((len(rows), n + h))]),
            np.hstack([change, -np.eye(n), np.zeros((n, h))]),
            np.hstack([-change, -np.eye(n), np.zeros((n, h))]),
            np.hstack([np.eye(h), np.zeros((h, n)), -np.eye(h)]),
            np.hstack([-np.eye(h), np.zeros((h, n)), -np.eye(h)]),
        ]
    )
    b_ub = np.concatenate([np.array(bounds) + 1e-7, np.zeros(2 * n + 2 * h)])
    cost = np.concatenate([np.zeros(h), np.ones(n), np.full(h, 0.05)])
    limits = [tuple(pair) for pair in inputs] + [(0.0, None)] * (n + h)
    answer = linprog(cost, A_ub=a_ub, b_ub=b_ub, bounds=limits, method="highs")
    if answer.status != 0:
        return None
    u = answer.x[:h]
    x = x0 + v0 * dt * np.arange(h + 1) + np.concatenate([[0.0], to_x @ u])
    v = v0 + np.concatenate([[0.0], to_v @ u])
    return np.column_stack([x, v, np.append(u, u[-1])])


def _half_planes(polygon: Polygon) -> Iterator[tuple[float, float, float]]:
    """(a, b, c) with a x + b v <= c for each edge; the bounding box for points and segments."""
    n = len(polygon)
    if n < 3:
        xs, vs = [p[0] for p in polygon], [p[1] for p in polygon]
        yield from ((1.0, 0.0, max(xs)), (-1.0, 0.0, -min(xs)))
        yield from ((0.0, 1.0, max(vs)), (0.0, -1.0, -min(vs)))
    for i in range(n):
        (x, v), (y, w) = polygon[i - 1], polygon[i]
        a, b = w - v, x - y
        size = float(np.hypot(a, b))
        if size > 1e-12:
            yield a / size, b / size, (a * x + b * v) / size


def _states(scene: Scene, lon: Array, lat: Array) -> Array:
    """States in the plane: x, y, heading, speed, acceleration."""
    s, d = lon[:, 0], lat[:, 0]
    points = scene.frame.to_cartesian(np.column_stack([s, d]))
    kappa = scene.frame.curvature(s)
    along = np.maximum(lon[:, 1], 0.0) * np.maximum(1.0 - kappa * d, 0.0)
    moving = np.hypot(along, lat[:, 1]) > 0.1
    relative = np.where(moving, np.arctan2(lat[:, 1], along), 0.0)
    heading = scene.frame.heading(s) + relative
    heading[0] = scene.ego.state.heading
    return np.column_stack([points, heading, np.hypot(along, lat[:, 1]), lon[:, 2]])
