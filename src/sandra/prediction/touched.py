"""Which cells and slices of the lanelets the acceleration-based sets touch, step by step."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sandra.prediction.lane_table import LaneTable
from sandra.prediction.observed import Observed, TowardsEgo
from sandra.scene.types import Region

Array = NDArray[np.float64]
Ints = NDArray[np.int_]
Mask = NDArray[np.bool_]

ROUNDING = 1e-9
"""Half-planes are this much wider than computed [m]."""
NEVER = 1 << 30
"""First cell where none is touched."""


@dataclass(frozen=True, slots=True, eq=False)
class Vehicle:
    """A participant that moves, and its acceleration-based sets over h steps.

    There are T = 2 h + 1 rows: one for each t_0..t_h, then one for each step in between.
    """

    seen: Observed
    law: TowardsEgo
    outline: Region
    start_body: Region
    normals: Array
    """(J, 2) unit vectors."""
    offsets: Array
    """(T, J) normal . p <= offset for all reachable positions p [m]; -inf beyond the horizon."""
    bodies: Array
    """(h + 1, W, 2) batch of bodies around the origin, growing with each step [m]."""
    skipped: int = 0
    """So many of the first intervals nobody asks for."""
    ways: Array | None = None
    """(h,) way along its lane that it drives at least in each step [m]; None: 0."""


def bodies_of(vehicles: Sequence[Vehicle], vehicle: Ints, row: Ints) -> Array:
    """(n, W, 2) the bodies of vehicles (by number) in some rows; during a step, that at its end."""
    bodies = np.stack([x.bodies for x in vehicles])
    steps = bodies.shape[1] - 1
    found: Array = bodies[vehicle, np.where(row > steps, row - steps, row)]
    return found


@dataclass(frozen=True, slots=True, eq=False)
class Touched:
    """What V vehicles touch of L lanelets with N cells and S slices in T rows.

    A segment is a lanelet as one vehicle may use it; there are G of them.
    """

    segments: tuple[dict[int, int], ...]
    """For each vehicle its segments, by the lanelet's id."""
    vehicle: Ints
    """(G,)"""
    first: Ints
    last: Ints
    """(T, G) first and last cell touched; first > last where there is none."""
    slices: Mask
    """(V, T, S)"""
    far_end: Array
    """(V, J, S) largest normal . p in each slice [m]."""
    around: Mask
    """(V, N) the cells that the body may come near to, at any time."""


def touch(table: LaneTable, vehicles: Sequence[Vehicle], radii: Array) -> Touched:
    """Look at all vehicles; `radii` (V,) are those of their bodies [m]."""
    of_cell = np.repeat(np.arange(len(table.strips)), np.diff(table.cell))
    segments: list[dict[int, int]] = []
    owners: list[int] = []
    firsts: list[Array] = []
    lasts: list[Array] = []
    slices, far_ends, around = [], [], []
    for v, (vehicle, radius) in enumerate(zip(vehicles, radii, strict=True)):
        nearest = table.nearest(vehicle.normals)
        widest = vehicle.offsets.max(axis=0)[:, None] + ROUNDING
        around.append(_all(nearest <= widest + (2 * radius + 1.0)))
        start = [p.lanelet for p in vehicle.seen.places]
        reachable = np.zeros(len(table.strips), dtype=bool)
        for i in table.map.reachable(start, vehicle.seen.reversing):
            reachable[table.number[i]] = True
        cells = np.flatnonzero(_all(nearest <= widest) & reachable[of_cell])
        numbers = cells.astype(np.int32)
        touched = _below(nearest[:, cells], vehicle.offsets)
        lanelets, parts = np.unique(of_cell[cells], return_index=True)
        mine = [table.strips[i].id for i in lanelets.tolist()]
        if mine:
            firsts.append(np.minimum.reduceat(np.where(touched, numbers, NEVER), parts, axis=1))
            lasts.append(np.maximum.reduceat(np.where(touched, numbers, -1), parts, axis=1))
        missing = [i for i in dict.fromkeys(start) if i not in mine]
        firsts.append(np.full((len(touched), len(missing)), NEVER))
        lasts.append(np.full((len(touched), len(missing)), -1))
        segments.append({i: len(owners) + n for n, i in enumerate(mine + missing)})
        owners += [v] * (len(mine) + len(missing))
        near_end, far_end = table.extent(vehicle.normals)
        slices.append(_below(near_end, vehicle.offsets))
        far_ends.append(far_end)
    return Touched(
        tuple(segments),
        np.array(owners),
        np.concatenate(firsts, axis=1),
        np.concatenate(lasts, axis=1),
        np.stack(slices),
        np.stack(far_ends),
        np.stack(around),
    )


def _all(rows: Mask) -> Mask:
    """rows.all(axis=0); NumPy takes the smallest of bytes many times faster."""
    return np.asarray(rows.view(np.uint8).min(axis=0).view(np.bool_))


def _below(nearest: Array, offsets: Array) -> Mask:
    """(T, n) whether each convex cell may meet each {p : normals . p <= offsets[t]}.

    `nearest` (J, n) is the smallest normal . p in each cell, `offsets` is (T, J).
    """
    steps = len(offsets) // 2
    result = np.ones((len(offsets), nearest.shape[1]), dtype=bool)
    at, during = result[: steps + 1], result[steps + 1 :]
    one = np.empty_like(at)
    for row, bound in zip(nearest, offsets[: steps + 1].T + ROUNDING, strict=True):
        np.less_equal(row, bound[:, None], out=one)
        at &= one
        # The offset of a step is the larger one of those at its ends.
        during &= one[:-1] | one[1:]
    during &= offsets[steps + 1 :, :1] > -np.inf
    return result
