"""The lanes that a trajectory touches, found in the map: whole chains of lanelets.

A lane runs along the lanelets' successors, or against them where the body is on a lane of the
opposite direction. A lanelet that the body only crosses (more than 60 degrees) is no lane of its.
Where a lanelet forks, each branch is a lane.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray

from sandra.scene.frame import Frame
from sandra.scene.network import lane_frame, length, make_lane
from sandra.scene.types import Lanelet, areas

Array = NDArray[np.float64]
Bools = NDArray[np.bool_]
Network = Mapping[int, Lanelet]

AHEAD = 250.0
"""How far a lane is followed beyond the last lanelet that the body touches [m]; from 50 m/s the
safe distance to a standing vehicle is 228 m."""
ALONG = 0.5
"""Cosine of the angle between body and lanelet from which on the body is said to follow it."""
MOST = 64
"""Branches of the road ahead that are followed from one lanelet."""


@dataclass(frozen=True, slots=True, eq=False)
class DrivenLane:
    """One lane: its lanelets in the order in which the ego passes them, area, frame.

    `touched` (n,): the steps at which the ego's body touches it.
    """

    lanelets: tuple[int, ...]
    area: Any
    frame: Frame
    touched: Bools


def driven_lanes(lanelets: tuple[Lanelet, ...], bodies: Any, poses: Array) -> list[DrivenLane]:
    """The lanes that the bodies touch.

    Args:
        lanelets: the map. bodies: (n,) shapely polygons. poses: (n, 3) their x, y, heading.

    Raises:
        ScenarioError: a lanelet on the way whose centre line runs back on itself.
    """
    network = {lanelet.id: lanelet for lanelet in lanelets}
    grounds = dict(zip(network, areas(list(network.values())), strict=True))
    found: list[DrivenLane] = []
    touched = _touched(grounds, bodies)
    along, against = _by_direction(network, touched, poses)
    for there, backwards in ((along, False), (against, True)):
        for ids in _paths(network, there, backwards):
            lane = make_lane(network, "other", ids[::-1] if backwards else ids)
            frame = lane_frame(lane.center[::-1]) if backwards else lane.frame
            area = shapely.union_all([grounds[i] for i in ids])
            on = np.any([there[i] for i in ids if i in there], axis=0)
            found.append(DrivenLane(ids, area, frame, on))
    return found


def course(lanelet: Lanelet, points: Array) -> Array:
    """(n,) direction of the part of a lanelet's centre line that is nearest to each point [rad]."""
    line = lanelet.center
    line = line[np.append(True, np.any(np.diff(line, axis=0) != 0.0, axis=1))]
    middle, way = (line[1:] + line[:-1]) / 2, np.diff(line, axis=0)
    length = np.hypot(way[:, 0], way[:, 1])
    away = points[:, None] - middle
    # Beside a segment up to its ends, beyond them from there.
    along = np.clip((away * way).sum(axis=2) / length**2, -0.5, 0.5)
    apart = np.linalg.norm(away - along[..., None] * way, axis=2)
    nearest = np.argmin(apart, axis=1)
    return np.asarray(np.arctan2(way[nearest, 1], way[nearest, 0]))


def _touched(grounds: dict[int, Any], bodies: Any) -> dict[int, Bools]:
    """For each lanelet that is touched at all, the steps at which it is."""
    ids = list(grounds)
    tree = shapely.STRtree(list(grounds.values()))
    steps, rows = tree.query(bodies, predicate="intersects")
    found: dict[int, Bools] = {}
    for row in np.unique(rows):
        mask = np.zeros(len(bodies), dtype=bool)
        mask[steps[rows == row]] = True
        found[ids[row]] = mask
    return found


def _by_direction(
    network: Network, touched: dict[int, Bools], poses: Array
) -> tuple[dict[int, Bools], dict[int, Bools]]:
    along: dict[int, Bools] = {}
    against: dict[int, Bools] = {}
    for i, mask in touched.items():
        rows = np.flatnonzero(mask)
        cosine = np.cos(poses[rows, 2] - course(network[i], poses[rows, :2]))
        for found, there in ((along, cosine >= ALONG), (against, cosine <= -ALONG)):
            if there.any():
                found[i] = np.zeros(len(poses), dtype=bool)
                found[i][rows[there]] = True
    return along, against


def _paths(network: Network, nodes: dict[int, Bools], backwards: bool) -> list[tuple[int, ...]]:
    """Chains of lanelets that together hold all nodes, followed `AHEAD` beyond the last of them."""

    def following(i: int, back: bool) -> tuple[int, ...]:
        ids = network[i].predecessors if back else network[i].successors
        return tuple(j for j in ids if j in network)

    roots = [i for i in nodes if not any(j in nodes for j in following(i, not backwards))]
    paths: list[tuple[int, ...]] = []
    # On a closed ring no lanelet is the first.
    for root in (*roots, *(i for i in nodes if i not in roots)):
        if root in roots or not any(root in path for path in paths):
            every = _followed(root, nodes, lambda i: following(i, backwards), network)
            paths += [path for path, _ in zip(every, range(MOST), strict=False)]
    return paths


def _followed(
    root: int, nodes: dict[int, Bools], following: Any, network: Network
) -> Iterator[tuple[int, ...]]:
    # Nodes come first, so that branches left out for their number are such as nobody drove.
    stack: list[tuple[tuple[int, ...], float]] = [((root,), 0.0)]
    while stack:
        path, beyond = stack.pop()
        onward = [j for j in following(path[-1]) if j not in path]
        if not onward or beyond >= AHEAD:
            yield path
            continue
        for j in sorted(onward, key=lambda j: (j in nodes, -j)):
            further = 0.0 if j in nodes else beyond + length(network[j])
            stack.append(((*path, j), min(further, math.inf)))
