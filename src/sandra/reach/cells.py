"""The lattice's cells in the plane: their corners, how far they bulge, and which leave the road."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from sandra.reach.lattice import Lattice, Mask
from sandra.scene.types import Scene, areas

Array = NDArray[np.float64]

BLOCK = 8
"""Neighbouring cells of so many rows are taken for as large as the largest of them."""
ALIKE = 2.0
"""Cells whose sizes differ by no more than this factor count as equally large."""


def grid(scene: Scene, s: Array, d: Array) -> Array:
    """(len(s), len(d), 2) Cartesian points of a grid in the lane frame."""
    return _points(scene.frame.across(s), d)


def _points(lines: tuple[Array, Array], d: Array) -> Array:
    """(m, n, 2) points at d on m lines, each a foot point and a normal: (m, 2), (m, 2)."""
    foot, normal = lines
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
    begin, end = np.maximum(first - 1, 0), np.minimum(last + 1, len(bend))
    # Each begins before it ends; where there are no corners at all, it is the 0 that is appended.
    sharpest = np.maximum.reduceat(np.append(bend, 0.0), np.column_stack([begin, end]).ravel())[::2]
    widest = 1.0 + sharpest * float(np.abs(d).max())
    result: Array = lattice.ds * widest * turn / 4 + 1e-6
    return result


def off_road(scene: Scene, lattice: Lattice, bulges: Array) -> Mask:
    """Cells in which the inscribed disc crosses the border of the road, wherever its centre is.

    Args:
        bulges: (columns,) see `bulge` [m].
    """
    import shapely

    s, d = lattice.centers()
    foot, normal = scene.frame.across(s)
    borders = scene.frame.across(lattice.corners()[0])

    def slack_of(rows: NDArray[np.int_]) -> Array:
        return _slack(lattice, (foot, normal), borders, rows) + bulges[:, None]

    several = np.array(areas(scene.lanelets))
    # How far a cell reaches from its centre is convex along a column: most at the ends of a part.
    slack = slack_of(np.array([0, lattice.rows // 2, lattice.rows - 1]))
    farthest = float(slack.max())
    # What is farther from all centres than the road is shrunk or widened is no matter.
    around = scene.ego.width / 2 + farthest + 1.0
    sides = _points((foot, normal), d[[0, -1]]).reshape(-1, 2)
    box = shapely.box(*(sides.min(axis=0) - around), *(sides.max(axis=0) + around))
    near = several[np.sort(shapely.STRtree(several).query(box))]
    # Neighbouring lanelets may leave slits between them that are no border.
    road = shapely.union_all(near).buffer(0.1).buffer(-0.1)

    def surely_inside(slack: float, columns: slice | Mask) -> Mask:
        # From the cell's centre to the ego's: only sure crossings count.
        return _inside(road.buffer(slack - scene.ego.width / 2), foot[columns], normal[columns], d)

    if farthest <= ALIKE * slack.min():
        return ~surely_inside(farthest, slice(None))
    first = np.arange(0, lattice.rows, BLOCK)
    last = np.minimum(first + BLOCK, lattice.rows) - 1
    slack = np.maximum(slack_of(first), slack_of(last))
    inside = np.zeros((lattice.columns, lattice.rows), dtype=np.bool_)
    left = np.ones(slack.shape, dtype=np.bool_)
    while left.any():
        here = left & (slack <= ALIKE * slack[left].min())
        left &= ~here
        some = here.any(axis=1)
        cells = np.repeat(here[some], last - first + 1, axis=1)
        inside[some] |= cells & surely_inside(float(slack[here].max()), some)
    return ~inside


def _slack(
    lattice: Lattice,
    middles: tuple[Array, Array],
    borders: tuple[Array, Array],
    rows: NDArray[np.int_],
) -> Array:
    """(columns, len(rows)) how far the corners of cells of some rows are from their centres [m].

    Args:
        middles, borders: foot points and normals of the lines through the middles of columns and
            along their borders.
    """
    d = lattice.corners()[1]
    centers = _points(middles, lattice.centers()[1][rows])
    squared = np.zeros(centers.shape[:2])
    for side in (_points(borders, d[rows]), _points(borders, d[rows + 1])):
        for corner in (side[:-1], side[1:]):
            away = corner - centers
            np.maximum(squared, away[..., 0] ** 2 + away[..., 1] ** 2, out=squared)
    return np.asarray(np.sqrt(squared))


def _inside(area: Any, foot: Array, normal: Array, d: Array) -> Mask:
    """(m, n) which of the points foot[i] + d[j] normal[i] are in a shapely (multi)polygon.

    A point is inside if the border crosses its line an odd number of times before it.

    Args:
        foot, normal: (m, 2); d: (n,), ascending.
    """
    import shapely

    rings = shapely.get_rings(shapely.get_parts(area))
    corners, ring = shapely.get_coordinates(rings, return_index=True)
    origin = foot[0]
    corners, foot = corners - origin, foot - origin
    # On which side of each line each corner is: (corners, m).
    offset = normal[:, 1] * foot[:, 0] - normal[:, 0] * foot[:, 1]
    across = np.stack([-normal[:, 1], normal[:, 0], offset])
    side = np.column_stack([corners, np.ones(len(corners))]) @ across
    left = side > 0.0
    edge, line = np.divmod(np.flatnonzero(left[1:] != left[:-1]), len(foot))
    whole = ring[edge + 1] == ring[edge]  # and not from one ring to the next
    edge, line = edge[whole], line[whole]
    before, after = side[edge, line], side[edge + 1, line]
    share = (before / (before - after))[:, None]
    crossing = corners[edge] + share * (corners[edge + 1] - corners[edge]) - foot[line]
    at = (crossing * normal[line]).sum(axis=1) / (normal[line] ** 2).sum(axis=1)
    m, n = len(foot), len(d)
    number = line * (n + 1) + np.searchsorted(d, at)
    odd = np.bincount(number, minlength=m * (n + 1)).astype(np.uint8).reshape(m, n + 1)[:, :n] & 1
    return np.asarray(np.bitwise_xor.accumulate(odd, axis=1).astype(np.bool_))
