"""The lattice's cells in the plane: their corners, how far they bulge, and which leave the road."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from sandra.reach.lattice import Lattice, Mask
from sandra.scene.types import Scene

Array = NDArray[np.float64]

SLACK_STEP = 1.5
"""Cells whose extents differ by no more than this factor count as equally large."""


def grid(scene: Scene, s: Array, d: Array) -> Array:
    """(len(s), len(d), 2) Cartesian points of a grid in the lane frame."""
    mesh = np.stack(np.meshgrid(s, d, indexing="ij"), axis=-1)
    points: Array = scene.frame.to_cartesian(mesh.reshape(-1, 2)).reshape(mesh.shape)
    return points


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

    polygons = [lanelet.area() for lanelet in scene.lanelets]
    # Neighbouring lanelets may leave slits between them that are no border.
    road = shapely.union_all(polygons).buffer(0.1).buffer(-0.1)
    centers = grid(scene, *lattice.centers())
    away = [
        np.hypot(*np.moveaxis(corners[i : i - 1 or None, j : j - 1 or None] - centers, -1, 0))
        for i in (0, 1)
        for j in (0, 1)
    ]
    # From the cell's centre to the ego's: only sure crossings count.
    slack = np.maximum.reduce(away) + bulges[:, None]
    beyond = np.zeros(slack.shape, dtype=np.bool_)
    left = np.ones(slack.shape, dtype=np.bool_)
    while left.any():
        here = left & (slack <= SLACK_STEP * slack[left].min())
        left &= ~here
        eroded = road.buffer(float(slack[here].max()) - scene.ego.width / 2)
        shapely.prepare(eroded)
        beyond[here] = ~shapely.contains_xy(eroded, centers[here, 0], centers[here, 1])
    return beyond
