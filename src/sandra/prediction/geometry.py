"""Convex polygons in batches: clipping, Minkowski sums.

A batch is an array (N, V, 2): N convex polygons, counter-clockwise, each padded to V vertices by
repeating its last one. Degenerate polygons (a segment, a point) are polygons too.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

_EPS = 1e-9


def directions(count: int, first: float = 0.0) -> Array:
    """(count, 2) unit vectors at equal angles, the first one at angle `first` [rad]."""
    angle = first + 2 * np.pi * np.arange(count) / count
    return np.column_stack([np.cos(angle), np.sin(angle)])


def stack(polygons: list[Array]) -> Array:
    """Polygons (n_i, 2) -> one batch (N, V, 2)."""
    sizes = np.array([len(p) for p in polygons])
    column = np.minimum(np.arange(sizes.max()), sizes[:, None] - 1)
    stacked: Array = np.concatenate(polygons)[(np.cumsum(sizes) - sizes)[:, None] + column]
    return stacked


def _compact(points: Array, keep: Mask) -> Array:
    """Move the kept points of each row, one at least, to its front; pad with the last one."""
    count = keep.sum(axis=1)
    column = np.minimum(np.arange(int(count.max(initial=1))), count[:, None] - 1)
    compacted: Array = points[keep][(np.cumsum(count) - count)[:, None] + column]
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
    touched = alive & ~inside.all(axis=1)
    if not touched.any():
        return batch[alive], alive
    p, e, i = batch[touched], excess[touched], inside[touched]
    following = np.arange(1, p.shape[1] + 1) % p.shape[1]
    q, f, j = p[:, following], e[:, following], i[:, following]
    crossing = i != j
    share = np.where(crossing, e / np.where(crossing, e - f, 1.0), 0.0)
    cut = p + np.clip(share, 0.0, 1.0)[:, :, None] * (q - p)
    both = np.stack([p, cut], axis=2).reshape(len(p), -1, 2)
    # Of repeated vertices one is enough.
    i &= (p[..., 0] != q[..., 0]) | (p[..., 1] != q[..., 1])
    keep = np.stack([i, crossing], axis=2).reshape(len(p), -1)
    keep[:, 0] |= ~keep.any(axis=1)
    clipped = _compact(both, keep)
    width = max(clipped.shape[1], batch.shape[1])
    out = np.concatenate([batch, np.repeat(batch[:, -1:], width - batch.shape[1], axis=1)], axis=1)
    padding = np.repeat(clipped[:, -1:], width - clipped.shape[1], axis=1)
    out[touched] = np.concatenate([clipped, padding], axis=1)
    return out[alive], alive


def clip_all(batch: Array, normals: Array, offsets: Array) -> tuple[Array, NDArray[np.int64]]:
    """Cut each polygon by several half-planes: normals (J, 2), offsets (N, J).

    Returns the non-empty results and the indices (N',) of their rows.
    """
    rows = np.arange(len(batch))
    for j, normal in enumerate(normals):
        if not len(rows):
            break
        batch, alive = clip(batch, normal, offsets[rows, j])
        rows = rows[alive]
    return batch, rows


def polygons_from_support(normals: Array, offsets: Array) -> Array:
    """The batch of { p : normals . p <= offsets[k] } for offsets (K, J); bounded, none empty.

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
    edges = np.concatenate(
        [np.roll(batch, -1, axis=1) - batch, np.roll(other, -1, axis=1) - other], axis=1
    )
    angle = np.mod(np.arctan2(edges[..., 1], edges[..., 0]), 2 * np.pi)
    order = np.argsort(angle, axis=1, kind="stable")
    edges = np.take_along_axis(edges, order[:, :, None], axis=1)
    angle = np.take_along_axis(angle, order, axis=1)
    corners = np.cumsum(edges, axis=1)
    shift = batch.min(axis=1) + other.min(axis=1) - corners.min(axis=1)
    corners = corners + shift[:, None, :]
    # A corner between two parallel edges, or after an edge without length, is no corner.
    turn = np.roll(angle, -1, axis=1) - angle
    turn[:, -1] += 2 * np.pi
    keep = turn > 1e-7
    keep[:, 0] |= ~keep.any(axis=1)
    return _compact(corners, keep)


def unpadded(batch: Array) -> list[Array]:
    """The polygons (n_i, 2) of a batch, without repeated vertices."""
    moved = np.abs(batch - np.roll(batch, 1, axis=1)).max(axis=2) > _EPS
    moved[:, 0] |= ~moved.any(axis=1)
    corners = batch[moved]
    return [corners[a:b] for a, b in pairwise([0, *np.cumsum(moved.sum(axis=1)).tolist()])]
