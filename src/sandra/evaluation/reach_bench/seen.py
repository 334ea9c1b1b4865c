"""Where trajectories of the model were seen to go: a floor under both sets, found by driving.

A set that leaves out what a trajectory reaches is not tight but wrong. So our area is also compared
with what the peer covers together with what trajectories visit on the same forbidden cells.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sandra.evaluation.reach_bench.hand_over import Rectangle
from sandra.reach import Ground, ReachableSet

Array = NDArray[np.float64]

TRAJECTORIES = 100_000
"""At most so many are alive after a step; each goes on in `CHILDREN` ways."""
CHILDREN = 4
FINE = 2
"""Visited area is counted in cells so many times smaller than ours, along and across."""
DIRECTIONS = 12
"""In each of our cells the trajectories that are farthest in so many directions go on."""
ROUNDING = 1e-6
"""Distance from a set up to which a position counts as inside [m]."""
LARGE = 1.0
"""Areas are compared from this size on [m^2]."""


@dataclass(frozen=True, slots=True)
class Seen:
    """What trajectories showed.

    Attributes:
        ratios: of each of our sets, its area over that which the peer covers or trajectories visit,
            the largest over the steps at which the peer's is at least `LARGE`; 1.0 where there is
            none.
        lost_by_us, lost_by_peer: shares of positions, over all steps, that are in no base set; the
            largest of our sets.
    """

    ratios: tuple[float, ...]
    lost_by_us: float
    lost_by_peer: float


def seen(
    base: Ground,
    sets: Sequence[ReachableSet],
    peers: Sequence[Sequence[Rectangle]],
    areas: Sequence[float],
    seed: int = 0,
) -> Seen:
    """Drive trajectories that avoid the forbidden cells of `base`, and see where they are.

    Args:
        sets: our free sets on these cells.
        peers: for each step rectangles (s_low, s_high, d_low, d_high) of the peer's, in our frame.
        areas: of their unions [m^2].
    """
    rng = np.random.default_rng(seed)
    states = _start(base, rng)
    ratios: list[list[float]] = [[] for _ in sets]
    asked, missing, missing_peer = 0, np.zeros(len(sets)), 0
    cell = base.lattice.ds * base.lattice.dd / FINE**2
    for k in range(base.horizon + 1):
        states = states[_free(base, states, k)]
        if not len(states):
            break
        lost = ~_inside(peers[k], states)
        asked += len(states)
        missing += [(~_inside(_rectangles(each, k), states)).sum() for each in sets]
        missing_peer += int(lost.sum())
        if areas[k] >= LARGE:
            # Only trajectories outside of the peer's set count, in cells whose centres are as well.
            visited = np.zeros(np.array(base.off_road.shape) * FINE, dtype=np.bool_)
            visited[_cells(base, states[lost], FINE)] = True
            visited &= ~_painted(base, peers[k])
            for each, of_set in zip(sets, ratios, strict=True):
                extra = visited & _painted(base, _rectangles(each, k))
                of_set.append(each.area(k) / (areas[k] + float(extra.sum()) * cell))
        if k < base.horizon:
            states = _advanced(base, _outermost(base, states, rng), rng)
    return Seen(
        tuple(max(of_set, default=1.0) for of_set in ratios),
        float(missing.max()) / max(asked, 1),
        missing_peer / max(asked, 1),
    )


def _rectangles(found: ReachableSet, k: int) -> list[Rectangle]:
    return [b.rectangle for b in found.steps[k]] if k < len(found.steps) else []


def _start(base: Ground, rng: np.random.Generator) -> Array:
    """(n, 4) states s, v_s, d, v_d of the initial set, its corners among them."""
    parts = []
    for polygon in (base.lon, base.lat):
        corners = np.array(polygon)
        weights = rng.dirichlet(np.full(len(corners), 0.1), TRAJECTORIES)
        parts.append(weights @ corners)
    return np.hstack(parts)


def _free(base: Ground, states: Array, k: int) -> NDArray[np.bool_]:
    """(n,) whether a state is within the speed bounds and in no forbidden cell."""
    settings, lattice = base.settings, base.lattice
    i, j = _cells(base, states, 1)
    alive = (states[:, 1] >= 0.0) & (states[:, 1] <= settings.v_max)
    alive &= np.abs(states[:, 3]) <= settings.v_lat_max
    alive &= (i >= 0) & (i < lattice.columns) & (j >= 0) & (j < lattice.rows)
    alive[alive] = ~base.forbidden[k][i[alive], j[alive]]
    return alive


def _cells(base: Ground, states: Array, finer: int) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    lattice = base.lattice
    i = np.floor((states[:, 0] - lattice.s0) / lattice.ds * finer).astype(np.intp)
    j = np.floor((states[:, 2] - lattice.d0) / lattice.dd * finer).astype(np.intp)
    return i, j


def _painted(base: Ground, boxes: Sequence[Rectangle]) -> NDArray[np.bool_]:
    """The fine cells whose centres are in one of the rectangles."""
    lattice = base.lattice
    mask = np.zeros((lattice.columns * FINE, lattice.rows * FINE), dtype=np.bool_)
    ds, dd = lattice.ds / FINE, lattice.dd / FINE
    for s_low, s_high, d_low, d_high in boxes:
        i0, i1 = np.ceil(np.array([s_low, s_high]) / ds - lattice.s0 / ds - 0.5).astype(int)
        j0, j1 = np.ceil(np.array([d_low, d_high]) / dd - lattice.d0 / dd - 0.5).astype(int)
        mask[max(0, i0) : max(0, i1), max(0, j0) : max(0, j1)] = True
    return mask


def _inside(boxes: Sequence[Rectangle], states: Array) -> NDArray[np.bool_]:
    order = np.argsort(states[:, 0])
    s, d = states[order, 0], states[order, 2]
    found = np.zeros(len(states), dtype=np.bool_)
    for s_low, s_high, d_low, d_high in boxes:
        first = np.searchsorted(s, s_low - ROUNDING)
        part = slice(first, np.searchsorted(s, s_high + ROUNDING, side="right"))
        found[part] |= (d[part] >= d_low - ROUNDING) & (d[part] <= d_high + ROUNDING)
    inside = np.zeros_like(found)
    inside[order] = found
    return inside


def _outermost(base: Ground, states: Array, rng: np.random.Generator) -> Array:
    """Of each of our cells those states that will be farthest in random directions."""
    i, j = _cells(base, states, 1)
    cell = i * base.lattice.rows + j
    kept = []
    for _ in range(DIRECTIONS):
        angle, time = rng.uniform(0.0, 2 * np.pi), 10.0 ** rng.uniform(-1.0, 0.5)
        ahead = states[:, [0, 2]] + time * states[:, [1, 3]]
        order = np.argsort(ahead @ [np.cos(angle), np.sin(angle)])
        farthest = np.full(base.lattice.columns * base.lattice.rows, -1)
        farthest[cell[order]] = order  # of several in a cell the last is kept
        kept.append(farthest[farthest >= 0])
    chosen = np.unique(np.concatenate(kept))
    if len(chosen) > TRAJECTORIES:
        chosen = rng.choice(chosen, TRAJECTORIES, replace=False)
    result: Array = states[chosen]
    return result


def _advanced(base: Ground, states: Array, rng: np.random.Generator) -> Array:
    """The states after a step, each for several inputs that switch once inside it."""
    settings, dt = base.settings, base.scene.dt
    states = np.repeat(states, CHILDREN, axis=0)
    result = np.empty_like(states)
    bounds = (
        (0, settings.a_lon_min, settings.a_lon_max, 0.0, settings.v_max),
        (2, -settings.a_lat_max, settings.a_lat_max, -settings.v_lat_max, settings.v_lat_max),
    )
    for axis, low, high, v_low, v_high in bounds:
        x, v = states[:, axis], states[:, axis + 1]
        kind = rng.random(len(x))
        change = np.where(kind < 0.4, low * dt, high * dt)
        change = np.where(kind > 0.8, rng.uniform(low * dt, high * dt, len(x)), change)
        change = np.clip(change, np.maximum(v_low - v, low * dt), np.minimum(v_high - v, high * dt))
        time = (change - low * dt) / (high - low)  # so long at `high`
        # At `high` first it gets ahead of constant acceleration, at `low` first behind.
        ahead = (high - low) * time * (dt - time) / 2
        sign = np.where(rng.random(len(x)) < 0.5, 1.0, -1.0)
        result[:, axis] = x + (v + change / 2) * dt + sign * ahead
        result[:, axis + 1] = v + change
    return result
