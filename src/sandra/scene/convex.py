"""Convex polygons in the plane: hulls and distances."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def hull(points: Array) -> Array:
    """Vertices of the convex hull of (n, 2) points, counter-clockwise, without collinear ones.

    Andrew's monotone chain. One or two distinct points are returned as they are.
    """
    rows = sorted(set(map(tuple, np.asarray(points, dtype=float)[:, :2].tolist())))
    if len(rows) < 3:
        return np.array(rows).reshape(-1, 2)
    return np.array(_chain(rows) + _chain(rows[::-1]))


def _chain(points: list[tuple[float, ...]]) -> list[tuple[float, ...]]:
    """Half a hull of sorted points, without its last one."""
    chain: list[tuple[float, ...]] = []
    for p in points:
        while len(chain) > 1:
            (ax, ay), (bx, by) = chain[-2], chain[-1]
            if (bx - ax) * (p[1] - ay) - (by - ay) * (p[0] - ax) > 0.0:
                break
            chain.pop()
        chain.append(p)
    return chain[:-1]


def hulls(clouds: Sequence[Array]) -> list[Array]:
    """The same for many sets of points (n_i, 2), two at least in each."""
    import shapely

    if not clouds:
        return []
    owner = np.repeat(np.arange(len(clouds)), [len(x) for x in clouds])
    shapes = shapely.convex_hull(shapely.linestrings(np.concatenate(clouds), indices=owner))
    corners, owner = shapely.get_coordinates(shapes, return_index=True)
    # A ring's last corner is its first.
    rings = shapely.get_type_id(shapes) == shapely.GeometryType.POLYGON
    kept = ~(rings[owner] & (np.diff(owner, append=-1) != 0))
    corners, owner = corners[kept], owner[kept]
    x, y = (corners - corners[np.searchsorted(owner, owner)]).T
    following = np.where(np.diff(owner, append=-1) == 0, np.arange(len(owner)) + 1, 0)
    area = np.bincount(owner, x * y[following] - y * x[following])
    ends = np.searchsorted(owner, np.arange(len(clouds) + 1)).tolist()
    parts = [corners[a:b] for a, b in pairwise(ends)]
    return [
        part[::-1] if turn < 0.0 else part for part, turn in zip(parts, area.tolist(), strict=True)
    ]


def distance(points: Array, polygons: Array) -> Array:
    """Distances of points (..., 2) to convex polygons (..., n, 2), 0 inside [m].

    The leading dimensions are broadcast. Polygons may turn either way, repeat vertices, and be
    segments or single points.
    """
    x, y = polygons[..., 0], polygons[..., 1]
    edge_x, edge_y = np.roll(x, -1, axis=-1) - x, np.roll(y, -1, axis=-1) - y
    squared = np.maximum(edge_x**2 + edge_y**2, 1e-18)
    away_x, away_y = points[..., None, 0] - x, points[..., None, 1] - y
    along = np.clip((away_x * edge_x + away_y * edge_y) / squared, 0.0, 1.0)
    gap_x, gap_y = away_x - along * edge_x, away_y - along * edge_y
    shortest = np.sqrt((gap_x**2 + gap_y**2).min(axis=-1))
    # Twice the area: what has none has no inside.
    area = ((x - x[..., :1]) * edge_y - (y - y[..., :1]) * edge_x).sum(axis=-1)
    turned = (edge_x * away_y - edge_y * away_x) * np.sign(area)[..., None]
    inside = (turned >= 0.0).all(axis=-1) & (np.abs(area) > 1e-12)
    return np.asarray(np.where(inside, 0.0, shortest))
