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
from sandra.planning.bounds import moves
from sandra.planning.types import Maneuver
from sandra.reach import BaseSet, Polygon, ReachableSet
from sandra.reach.polygon import area, half_planes, intersection, propagate
from sandra.scene.types import Scene
from sandra.settings import Settings

Array = NDArray[np.float64]

MOST_SETS = 3000
"""So many base sets are looked at in search of a chain."""


def in_corridor(
    scene: Scene, pair: ActionPair, corridor: ReachableSet, settings: Settings
) -> Maneuver | None:
    """The smoothest trajectory in the first chain of base sets that holds one.

    None where none of the chains tried holds one: the set over-approximates.
    """
    if corridor.first_empty_step is not None:
        return None
    for chain in _chains(scene, corridor, settings):
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


def _chains(scene: Scene, corridor: ReachableSet, settings: Settings) -> Iterator[list[BaseSet]]:
    """Chains of base sets that hold trajectories, large sets first, depth first.

    Along one chain nothing is merged, so what is propagated there is reached by some inputs.
    """
    children = [_children(corridor, k) for k in range(len(corridor.steps))]
    limit = settings.a_lat_max
    stack: list[tuple[tuple[int, ...], Polygon, Polygon]] = [
        ((i,), b.lon, b.lat) for i, b in reversed(list(enumerate(corridor.steps[0])))
    ]
    looked = 0
    while stack and looked < MOST_SETS:
        looked += 1
        picked, lon, lat = stack.pop()
        k = len(picked) - 1
        chain = [corridor.steps[j][i] for j, i in enumerate(picked)]
        if k == corridor.horizon:
            yield chain
            continue
        next_lon = propagate(lon, *chain[-1].inputs, scene.dt)
        next_lat = propagate(lat, -limit, limit, scene.dt)
        found = []
        for i in children[k][picked[-1]]:
            child = corridor.steps[k + 1][i]
            part_lon = intersection(next_lon, child.lon)
            part_lat = intersection(next_lat, child.lat) if part_lon else []
            if part_lat:
                size = area(part_lon) * area(part_lat)
                found.append((size, (*picked, i), part_lon, part_lat))
        found.sort(key=lambda entry: entry[0])
        stack.extend((path, part_lon, part_lat) for _, path, part_lon, part_lat in found)


def _children(corridor: ReachableSet, k: int) -> list[list[int]]:
    children: list[list[int]] = [[] for _ in corridor.steps[k]]
    if k + 1 < len(corridor.steps):
        for i, child in enumerate(corridor.steps[k + 1]):
            for parent in child.parents:
                children[parent].append(i)
    return children


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
        for a, b, c in half_planes(polygon):
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


def _states(scene: Scene, lon: Array, lat: Array) -> Array:
    """States in the plane: x, y, heading, speed, acceleration."""
    s, d = lon[:, 0], lat[:, 0]
    points = scene.frame.to_cartesian(np.column_stack([s, d]))
    kappa = scene.frame.curvature(s)
    along = np.maximum(lon[:, 1], 0.0) * np.maximum(1.0 - kappa * d, 0.0)
    moving = moves(np.hypot(along, lat[:, 1]))
    relative = np.where(moving, np.arctan2(lat[:, 1], along), 0.0)
    heading = scene.frame.heading(s) + relative
    states = np.column_stack([points, heading, np.hypot(along, lat[:, 1]), lon[:, 2]])
    start = scene.ego.state
    states[0, :4] = start.x, start.y, start.heading, start.speed
    return states
