"""The signed speed limit under the ego's centre, from the map."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import shapely
from numpy.typing import NDArray

from sandra.monitor.lanes import ALONG, course
from sandra.scene.types import Lanelet, Scene, areas

Array = NDArray[np.float64]
Bools = NDArray[np.bool_]
Ints = NDArray[np.int_]

NEIGHBOURHOOD = 0.1
"""A point between lanelets belongs to those this close [m]: maps leave slits."""


def signed_limits(scene: Scene, poses: Array) -> tuple[Array, Bools]:
    """(n,) the signed limit at each centre [m/s], NaN where none is known; (n,) who is on no lane.

    The strictest of the lanelets that hold the centre: of those that the ego follows, else of any.

    Args:
        poses: (n, 3) x, y, heading.
    """
    by_id = {x.id: x for x in scene.lanelets}
    ids = list(by_id)
    tree = shapely.STRtree(areas(list(by_id.values())))
    points = shapely.points(poses[:, :2])
    step, row = tree.query(points, predicate="dwithin", distance=NEIGHBOURHOOD)
    apart = shapely.distance(points[step], tree.geometries[row]) > 0.0
    signed = np.array(
        [x.speed_limit if x.speed_limit is not None else np.inf for x in by_id.values()]
    )
    wrong = ~_same_way(by_id, ids, step, row, poses)
    # Lower is better: holds the point and goes its way, holds it, is near it.
    rank = 2 * apart.astype(int) + wrong.astype(int)
    best = np.full(len(poses), 4)
    np.minimum.at(best, step, rank)
    chosen = rank == best[step]
    limits = np.full(len(poses), np.inf)
    np.minimum.at(limits, step[chosen], signed[row[chosen]])
    return np.where(np.isfinite(limits), limits, np.nan), best == 4


def _same_way(
    by_id: Mapping[int, Lanelet], ids: list[int], step: Ints, row: Ints, poses: Array
) -> Bools:
    found = np.zeros(len(step), dtype=bool)
    for r in np.unique(row):
        here = row == r
        at = poses[step[here]]
        found[here] = np.cos(at[:, 2] - course(by_id[ids[r]], at[:, :2])) >= ALONG
    return found
