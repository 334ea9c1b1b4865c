"""The lattice's cells in the plane: their corners, how far they bulge, and which leave the road."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from sandra.reach.lattice import Lattice, Mask
from sandra.scene.types import Scene

Array = NDArray[np.float64]


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


def off_road(scene: Scene, lattice: Lattice) -> Mask:
    """Cells in which the inscribed disc crosses the border of the road, wherever its centre is."""
    import shapely

    polygons = [lanelet.area() for lanelet in scene.lanelets]
    # Neighbouring lanelets may leave slits between them that are no border.
    road = shapely.union_all(polygons).buffer(0.1).buffer(-0.1)
    s, d = lattice.centers()
    centers = grid(scene, s, d)
    # Half a cell's diagonal, stretched by curvature, goes to the ego: only sure crossings count.
    stretch = 1.0 + float(np.abs(scene.frame.curvature(s)).max()) * float(np.abs(d).max())
    slack = np.hypot(lattice.ds * stretch, lattice.dd) / 2
    eroded = road.buffer(float(slack) - scene.ego.width / 2)
    shapely.prepare(eroded)
    return np.asarray(~shapely.contains_xy(eroded, centers[..., 0], centers[..., 1]))
