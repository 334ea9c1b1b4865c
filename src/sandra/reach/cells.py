"""The lattice's cells in the plane: their corners, how far they bulge, and which leave the road."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from sandra.reach.lattice import Lattice, Mask
from sandra.scene.types import Scene, areas

Array = NDArray[np.float64]

BLOCK = 8
"""So many columns and rows of cells are compared with the road at once."""
ALIKE = 2.0
"""Cells whose sizes differ by no more than this factor count as equally large."""


def grid(scene: Scene, s: Array, d: Array) -> Array:
    """(len(s), len(d), 2) Cartesian points of a grid in the lane frame."""
    foot, normal = scene.frame.across(s)
    return np.asarray(foot[:, None] + d[:, None] * normal[:, None])


def bulge(scene: Scene, lattice: Lattice) -> Array:
    """(columns,) how far a cell's image can bulge beyond the hull of its corners [m].

    Lines of constant d are polylines with the corners of the reference line. One of length c that
    turns by phi leaves its chord by at most a quarter of c phi.
    """
    frame = scene.frame
    s, d = lattice.corners()
    course = np.diff(frame.line, axis=0)
    course = np.unwrap(np.arctan2(course[:, 1], course[:, 0]))
    turns = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(course)))])
    marks = frame.stations[1:-1]
    first = np.searchsorted(marks, s[:-1], side="left")
    last = np.searchsorted(marks, s[1:], side="right")
    turn = turns[last] - turns[first]
    # The reference line's curvature at its corners, where neighbouring segments are shortest.
    lengths = np.diff(frame.stations)
    shortest = np.minimum(lengths[:-1], lengths[1:])
    bend = np.abs(np.diff(course)) / shortest
    sharpest = np.array(
        [
            bend[max(0, a - 1) : b + 1].max(initial=0.0)
            for a, b in zip(first.tolist(), last.tolist(), strict=True)
        ]
    )
    widest = 1.0 + sharpest * float(np.abs(d).max())
    result: Array = lattice.ds * widest * turn / 4 + 1e-6
    return result


def off_road(scene: Scene, lattice: Lattice, corners: Array, bulges: Array) -> Mask:
    """Cells in which the inscribed disc crosses the border of the road, wherever its centre is.

    Args:
        corners: (columns + 1, rows + 1, 2) of the cells in the plane [m].
        bulges: (columns,) see `bulge` [m].
    """
    import shapely

    centers = grid(scene, *lattice.centers())
    # From the cell's centre to the ego's: only sure crossings count.
    slack = np.zeros(centers.shape[:2])
    for corner in (corners[:-1, :-1], corners[1:, :-1], corners[:-1, 1:], corners[1:, 1:]):
        away = corner - centers
        np.maximum(slack, away[..., 0] ** 2 + away[..., 1] ** 2, out=slack)
    slack = np.sqrt(slack) + bulges[:, None]
    several = np.array(areas(scene.lanelets))
    # What is farther from all centres than the road is shrunk or widened is no matter.
    around = scene.ego.width / 2 + float(slack.max()) + 1.0
    sides = centers[:, [0, -1]].reshape(-1, 2)
    (low_x, low_y), (high_x, high_y) = sides.min(axis=0) - around, sides.max(axis=0) + around
    x0, y0, x1, y1 = shapely.bounds(several).T
    near = (x0 <= high_x) & (x1 >= low_x) & (y0 <= high_y) & (y1 >= low_y)
    # Neighbouring lanelets may leave slits between them that are no border.
    road = shapely.union_all(several[near]).buffer(0.1).buffer(-0.1)
    inside = np.zeros(slack.shape, dtype=np.bool_)
    left = np.ones(slack.shape, dtype=np.bool_)
    boxes = _boxes(centers)
    while left.any():
        here = left & (slack <= ALIKE * slack[left].min())
        left &= ~here
        eroded = road.buffer(float(slack[here].max()) - scene.ego.width / 2)
        inside |= _contains(eroded, centers, boxes, here)
    return ~inside


def _boxes(points: Array) -> Any:
    """Shapely boxes around blocks of (m, n, 2) points, each points[i] on a straight line."""
    import shapely

    m, n = points.shape[:2]
    i, j = np.arange(0, m, BLOCK), np.arange(0, n, BLOCK)
    ends = points[:, j], points[:, np.minimum(j + BLOCK, n) - 1]
    low = np.minimum.reduceat(np.minimum(*ends), i, axis=0)
    high = np.maximum.reduceat(np.maximum(*ends), i, axis=0)
    return shapely.box(low[..., 0], low[..., 1], high[..., 0], high[..., 1])


def _contains(area: Any, points: Array, boxes: Any, asked: Mask) -> Mask:
    """(m, n) which of the points asked for are in a shapely geometry; whole blocks where possible.

    Args:
        points: (m, n, 2).
        boxes: of `_boxes`.
        asked: (m, n).
    """
    import shapely

    shapely.prepare(area)
    m, n = points.shape[:2]
    ways = np.arange(0, m, BLOCK), np.arange(0, n, BLOCK)
    some = np.logical_or.reduceat(np.logical_or.reduceat(asked, ways[0]), ways[1], axis=1)
    within, unclear = np.zeros_like(some), np.zeros_like(some)
    within[some] = shapely.contains_properly(area, boxes[some])
    left = some & ~within
    unclear[left] = shapely.intersects(area, boxes[left])
    found, rest = _spread(within, m, n) & asked, _spread(unclear, m, n) & asked
    found[rest] = shapely.contains_xy(area, points[rest])
    return np.asarray(found)


def _spread(blocks: Mask, m: int, n: int) -> Mask:
    """(m, n) what holds of the block that each cell is in."""
    return np.repeat(np.repeat(blocks, BLOCK, axis=0), BLOCK, axis=1)[:m, :n]
