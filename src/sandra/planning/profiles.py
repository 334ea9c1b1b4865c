"""Acceleration profiles inside a driving corridor.

A profile is constant in each step dt of the prediction, so the `a` of a letter is one number.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from sandra.planning.bounds import stands, within
from sandra.planning.limits import MARGIN, ROUNDING, Limits
from sandra.reach.sets import ReachableSet

Array = NDArray[np.float64]


def profiles(corridor: ReachableSet, v0: float, s0: float, dt: float, limits: Limits) -> Array:
    """(P, h) accelerations whose inputs the corridor admits at each step, without duplicates.

    Constant ones; ones that change once; brakings to a standstill; and those that hit states
    (s, v_s) of the corridor's last step. What drives backwards, or leaves by far the corridor's
    ranges of s or v_s, is left out.
    """
    h = corridor.horizon
    low = np.array([min(b.inputs[0] for b in step) for step in corridor.steps[:h]]) + MARGIN
    high = np.array([max(b.inputs[1] for b in step) for step in corridor.steps[:h]]) - MARGIN
    low, high = np.maximum(low, limits.a_lon_min), np.minimum(high, limits.a_lon_max)
    if (low > high).any():
        return np.empty((0, h))
    found = [*_constant(low, high), *_changing(low, high), *_stopping(v0, h, dt)]
    found += _to_targets(corridor, v0, s0, h, dt)
    raw = np.array(found).reshape(-1, h)
    # No driving backwards: what would brake further stays at a standstill.
    speed = np.zeros((len(raw), h + 1))
    speed[:, 0] = v0
    for k in range(h):
        speed[:, k + 1] = np.maximum(speed[:, k] + raw[:, k] * dt, 0.0)
    tiny = stands(speed)
    tiny[:, 0] = False
    speed[tiny] = 0.0
    accelerations = np.diff(speed, axis=1) / dt
    kept = within(accelerations, low, high, ROUNDING).all(axis=1)
    kept &= (speed <= limits.v_max).all(axis=1)
    driven = s0 + np.cumsum((speed[:, 1:] + speed[:, :-1]) / 2 * dt, axis=1)
    for k in range(1, h + 1):
        corners = np.array([point for b in corridor.steps[k] for point in b.lon])
        (s_low, v_low), (s_high, v_high) = corners.min(axis=0), corners.max(axis=0)
        # Along a bend, or across the lane, s advances differently from the distance driven.
        room = 0.5 + 0.1 * (driven[:, k - 1] - s0)
        slow = 0.5 + 0.1 * speed[:, k]
        kept &= within(driven[:, k - 1], s_low, s_high, room)
        kept &= within(speed[:, k], v_low, v_high, slow)
    _, first = np.unique(np.round(accelerations[kept], 3), axis=0, return_index=True)
    return np.asarray(accelerations[kept][np.sort(first)])


def _levels(low: float, high: float) -> list[float]:
    """Accelerations between two bounds: both, the mildest, and some in between."""
    mild = min(max(0.0, low), high)
    inner = [low + (high - low) * share for share in (0.25, 0.5, 0.75)]
    gentle = [x for x in (-2.0, -1.0, 1.0) if within(x, low, high)]
    return sorted({round(x, 6) for x in (low, mild, high, *inner, *gentle)})


def _constant(low: Array, high: Array) -> list[Array]:
    bottom, top = float(low.max()), float(high.min())
    return [np.full(len(low), a) for a in _levels(bottom, top)] if bottom <= top else []


def _changing(low: Array, high: Array) -> list[Array]:
    h, found = len(low), []
    for share in (0.3, 0.6):
        k = max(1, min(h - 1, round(share * h)))
        if k >= h:
            continue
        first = float(low[:k].max()), float(high[:k].min())
        second = float(low[k:].max()), float(high[k:].min())
        if first[0] > first[1] or second[0] > second[1]:
            continue
        for a in _levels(*first)[::2]:
            for b in _levels(*second)[::2]:
                if a != b:
                    found.append(np.concatenate([np.full(k, a), np.full(h - k, b)]))
    return found


def _stopping(v0: float, h: int, dt: float) -> list[Array]:
    """Brakings that stand still from some step on: at once, or after keeping the speed."""
    found = []
    for begin in (0.0, 0.15, 0.3):
        for end in (0.4, 0.55, 0.7, 0.85, 1.0):
            k0, k1 = round(begin * h), round(end * h)
            if k1 > k0:
                profile = np.zeros(h)
                profile[k0:k1] = -v0 / ((k1 - k0) * dt)
                found.append(profile)
    return found


def _to_targets(corridor: ReachableSet, v0: float, s0: float, h: int, dt: float) -> list[Array]:
    """Two constant accelerations that lead to states of the largest sets of the last step."""
    if h < 2:
        return []
    sets = sorted(
        corridor.steps[h], key=lambda b: float(np.ptp(np.array(b.lon), axis=0).sum()), reverse=True
    )
    found = []
    for base in sets[:6]:
        polygon = np.array(base.lon)
        middle = polygon.mean(axis=0)
        spread = polygon[:: max(1, len(polygon) // 4)]
        for s, v in (
            middle,
            *(middle + 0.8 * (spread - middle)),
            *(middle + 0.4 * (spread - middle)),
        ):
            for k in {h // 2, h // 3} - {0}:
                t1, t2 = k * dt, (h - k) * dt
                # v = v0 + a t1 + b t2, s = s0 + v0 (t1 + t2) + a t1 (t1/2 + t2) + b t2^2/2
                matrix = np.array([[t1, t2], [t1 * (t1 / 2 + t2), t2 * t2 / 2]])
                a, b = np.linalg.solve(matrix, [v - v0, s - s0 - v0 * (t1 + t2)])
                found.append(np.concatenate([np.full(k, a), np.full(h - k, b)]))
    return found
