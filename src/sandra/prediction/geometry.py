"""Convex polygons in batches: clipping, Minkowski sums.

A batch is an array (N, V, 2): N convex polygons, counter-clockwise, each padded to V vertices by
repeating its last one. Degenerate polygons (a segment, a point) are polygons too.
"""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Points = NDArray[np.complex128]

_EPS = 1e-9


def directions(count: int, first: float = 0.0) -> Array:
    """(count, 2) unit vectors at equal angles, the first one at angle `first` [rad]."""
    angle = first + 2 * np.pi * np.arange(count) / count
    return np.column_stack([np.cos(angle), np.sin(angle)])


def stack(polygons: list[Array]) -> Array:
    """Polygons (n_i, 2) -> one batch (N, V, 2); V = 1 if there are none."""
    if not polygons:
        return np.empty((0, 1, 2))
    sizes = np.array([len(p) for p in polygons])
    column = np.minimum(np.arange(sizes.max()), sizes[:, None] - 1)
    stacked: Array = np.concatenate(polygons)[(np.cumsum(sizes) - sizes)[:, None] + column]
    return stacked


def extent(values: Array, axis: int = 1) -> tuple[Array, Array]:
    """Lowest and highest along a short axis: x and y (N, 2) of each polygon of a batch."""
    # One after another: reducing a short axis is many times slower.
    first, *others = np.moveaxis(values, axis, 0)
    low, high = first.copy(), first.copy()
    for each in others:
        np.minimum(low, each, out=low)
        np.maximum(high, each, out=high)
    return low, high


def _complex(batch: Array) -> Points:
    """(N, V) points x + iy of a batch: one operation moves both coordinates."""
    points: Points = np.ascontiguousarray(batch).view(np.complex128)[..., 0]
    return points


def _batch(points: Points) -> Array:
    """The reverse of `_complex`."""
    batch: Array = np.ascontiguousarray(points)[..., None].view(np.float64)
    return batch


def _following(row: NDArray[Any]) -> NDArray[Any]:
    """What follows on each entry of the rows, cyclically."""
    return np.concatenate([row[:, 1:], row[:, :1]], axis=1)


def _compact(points: Points, keep: Mask) -> Points:
    """Move the kept points of each row, one at least, to its front; pad with the last one."""
    count = keep.sum(axis=1)
    column = np.minimum(np.arange(int(count.max(initial=1))), count[:, None] - 1)
    compacted: Points = points[keep][(np.cumsum(count) - count)[:, None] + column]
    return compacted


def clip(batch: Array, normal: Array, offset: Array) -> tuple[Array, Mask]:
    """Cut each polygon by the half-plane normal . p <= offset.

    Args:
        batch: (N, V, 2).
        normal: (2,) or (N, 2), need not be unit vectors.
        offset: (N,).

    Returns:
        The batch of the N' non-empty results, and the mask (N,) of rows that are left.
    """
    normals = np.broadcast_to(normal, (len(batch), 2))
    excess = batch[..., 0] * normals[:, :1] + batch[..., 1] * normals[:, 1:] - offset[:, None]
    inside: Mask = np.asarray(excess <= _EPS)
    alive: Mask = np.asarray(inside.any(axis=1))
    touched = np.flatnonzero(alive & ~inside.all(axis=1))
    if not len(touched):
        return batch[alive], alive
    p, e, i = _complex(batch[touched]), excess[touched], inside[touched]
    q, f = _following(p), _following(e)
    crossing = i != _following(i)
    share = np.clip(e[crossing] / (e[crossing] - f[crossing]), 0.0, 1.0)
    # Each vertex, and after it the point at which the edge that begins there is cut.
    both = np.empty((*p.shape, 2), dtype=np.complex128)
    both[..., 0] = p
    both[crossing, 1] = p[crossing] + share * (q[crossing] - p[crossing])
    # Of repeated vertices one is enough; two crossings are left in any case.
    keep = np.stack([i & (p != q), crossing], axis=2)
    clipped = _compact(both.reshape(len(p), -1), keep.reshape(len(p), -1))
    width = max(clipped.shape[1], batch.shape[1])
    out = np.empty((len(batch), width), dtype=np.complex128)
    for rows, points in ((slice(None), _complex(batch)), (touched, clipped)):
        out[rows, : points.shape[1]] = points
        out[rows, points.shape[1] :] = points[:, -1:]
    return _batch(out[alive]), alive


def clip_all(batch: Array, normals: Array, offsets: Array) -> tuple[Array, NDArray[np.int64]]:
    """Cut each polygon by several half-planes: normals (J, 2) or (N, J, 2), offsets (N, J).

    Returns the non-empty results and the indices (N',) of their rows.
    """
    rows = np.arange(len(batch))
    normals = np.broadcast_to(normals, (len(batch), *normals.shape[-2:]))
    for j in range(normals.shape[1]):
        if not len(rows):
            break
        batch, alive = clip(batch, normals[rows, j], offsets[rows, j])
        rows = rows[alive]
    return batch, rows


def polygons_from_support(normals: Array, offsets: Array) -> Array:
    """The batch of { p : normals[k] . p <= offsets[k] } for offsets (K, J); bounded, none empty.

    The normals are (J, 2), the same for all, or (K, J, 2).

    Raises:
        ValueError: if the half-planes of a row have no point in common.
    """
    size = float(np.abs(offsets).max()) * 4 + 1.0
    box = np.array([[-size, -size], [size, -size], [size, size], [-size, size]])
    batch, rows = clip_all(np.tile(box, (len(offsets), 1, 1)), normals, offsets)
    if len(rows) < len(offsets):
        raise ValueError("the half-planes have no point in common")
    return batch


def polygons_around(normals: Array, support: Array) -> Array:
    """The same for the support (K, J) of convex sets: a batch (K, J, 2), without any clipping.

    As the sets touch all half-planes, the corners are where consecutive ones meet. The normals
    are at equal angles.
    """
    turn = 2 * np.pi / len(normals)
    tangents = np.column_stack([-normals[:, 1], normals[:, 0]])
    along = (np.roll(support, -1, axis=1) - support * np.cos(turn)) / np.sin(turn)
    corners: Array = support[..., None] * normals + along[..., None] * tangents
    return corners


def minkowski(batch: Array, other: Array) -> Array:
    """Minkowski sums of each polygon (N, V, 2) with a convex polygon of its own (N, W, 2).

    The edges of both, sorted by angle, are the edges of the sum; it is placed by its smallest x
    and y, which are the sums of the operands' smallest ones.
    """
    p, q = _complex(batch), _complex(other)
    edges = np.concatenate([_following(p) - p, _following(q) - q], axis=1)
    angle = np.arctan2(edges.imag, edges.real)
    order = np.argsort(angle, axis=1, kind="stable")
    order += (np.arange(len(order)) * order.shape[1])[:, None]
    edges, angle = edges.ravel()[order], angle.ravel()[order]
    corners = np.cumsum(edges, axis=1)
    corners += (_lowest(p) + _lowest(q) - _lowest(corners))[:, None]
    # A corner between two parallel edges, or after an edge without length, is no corner.
    turn = _following(angle) - angle
    turn[:, -1] += 2 * np.pi
    keep = turn > 1e-7
    keep[:, 0] |= ~keep.any(axis=1)
    return _batch(_compact(corners, keep))


def _lowest(points: Points) -> Points:
    """(N,) smallest x and smallest y of each row, as one complex number."""
    return _complex(extent(_batch(points))[0])


def trimmed(batch: Array) -> Array:
    """The same batch without columns that only repeat the last vertex of all rows."""
    points = _complex(batch)
    used = (points != points[:, -1:]).any(axis=0)
    return batch[:, : len(used) - int(used[::-1].argmax()) + 1 if used.any() else 1]


def unpadded(batch: Array) -> list[Array]:
    """The polygons (n_i, 2) of a batch, without repeated vertices."""
    points = _complex(batch)
    step = points - np.concatenate([points[:, -1:], points[:, :-1]], axis=1)
    moved = (np.abs(step.real) > _EPS) | (np.abs(step.imag) > _EPS)
    moved[:, 0] |= ~moved.any(axis=1)
    corners = _batch(points[moved])
    return [corners[a:b] for a, b in pairwise([0, *np.cumsum(moved.sum(axis=1)).tolist()])]
