"""Do two moving bodies meet? Separating axes for all moments, exact distances where it is close.

Shares no code with the planner or the checker.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray

from sandra.evaluation.rollouts.actors import Actor
from sandra.evaluation.rollouts.ego import Drive, placed
from sandra.evaluation.rollouts.traffic import Motion

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

BETWEEN = 8
"""Moments that are looked at between two fine steps where bodies are close."""


@dataclass(frozen=True, slots=True, eq=False)
class Nearest:
    """Per motion (N,): the smallest distance to the ego [m], 0 in a contact; the fine step at
    which that is, the first one of a contact; whether there is a contact.

    Who only follows the ego as closely as it may comes near to no purpose: such moments count for
    contacts, not for distances.
    """

    distance: Array
    step: Ints
    contact: NDArray[np.bool_]


def nearest(drive: Drive, actor: Actor, motion: Motion, rows: Ints) -> Nearest:
    """Compare the motions `rows` of one actor with the ego's, while both are there."""
    steps = len(drive.states)
    p, psi = motion.position[:, rows], motion.heading[:, rows]
    k = np.arange(steps)[:, None]
    there = (k >= actor.appears) & (k < motion.until[rows])
    apart = np.linalg.norm(p - drive.states[:, None, :2], axis=2)
    apart = np.where(there, apart, np.inf)
    half = np.hypot(*(drive.corners[0, 2] - drive.corners[0, 0])) / 2
    # No farther than the centres; no nearer than the circles around both.
    least = apart - half - actor.radius
    step, row = np.nonzero(there & (least <= apart.min(axis=0)))
    gaps = _gaps(drive, actor, p, psi, step, row)
    # Between two fine steps, where the bodies could have met.
    v = np.hypot(*np.moveaxis(motion.velocity[:, rows], -1, 0))
    travel = drive.step * (drive.states[step, 3] + v[step, row]) + 0.01
    close = np.flatnonzero((gaps <= travel) & (step < steps - 1))
    close = close[there[step[close] + 1, row[close]]]
    for share in np.arange(1, BETWEEN) / BETWEEN:
        more = _gaps(drive, actor, p, psi, step[close], row[close], share)
        gaps[close] = np.minimum(gaps[close], more)
    distance, at = np.full(len(rows), np.inf), np.zeros(len(rows), dtype=np.int64)
    contact = np.zeros(len(rows), dtype=bool)
    order = np.lexsort((step, gaps, row))
    order = order[~motion.yielding[step[order], rows[row[order]]]]
    _, first = np.unique(row[order], return_index=True)
    best = order[first]
    distance[row[best]], at[row[best]] = gaps[best], step[best]
    far = best[gaps[best] > 0.5]
    distance[row[far]] = _exact(drive, actor, p, psi, step[far], row[far])
    touching = np.flatnonzero(gaps <= 0.0)
    order = touching[np.lexsort((step[touching], row[touching]))]
    hit, first = np.unique(row[order], return_index=True)
    contact[hit], at[hit] = True, step[order[first]]
    distance = np.where(contact, 0.0, distance)
    return Nearest(distance, at, contact)


def _gaps(
    drive: Drive, actor: Actor, p: Array, psi: Array, step: Ints, row: Ints, share: float = 0.0
) -> Array:
    """(M,) distances, from below where they are over 0.5 m; 0 or less exactly in a contact.

    `share` of the way from each step to the next one, by linear interpolation.
    """
    if not len(step):
        return np.zeros(0)
    centre, heading, mine = p[step, row], psi[step, row], drive.corners[step]
    if share:
        turn = psi[step + 1, row] - heading
        turn = (turn + np.pi) % (2 * np.pi) - np.pi
        centre = centre + share * (p[step + 1, row] - centre)
        heading = heading + share * turn
        mine = mine + share * (drive.corners[step + 1] - mine)
    theirs = placed(actor.outline.vertices, centre, heading)
    gaps = separation(mine, theirs) - actor.outline.radius
    exact = np.flatnonzero((gaps <= 0.5) & ((gaps > 0.0) | (actor.outline.radius > 0.0)))
    if len(exact):
        bodies = shapely.convex_hull(shapely.multipoints(theirs[exact]))
        measured = shapely.distance(shapely.polygons(mine[exact]), bodies)
        gaps[exact] = np.maximum(measured - actor.outline.radius, gaps[exact])
    return gaps


def _exact(drive: Drive, actor: Actor, p: Array, psi: Array, step: Ints, row: Ints) -> Array:
    theirs = placed(actor.outline.vertices, p[step, row], psi[step, row])
    bodies = shapely.convex_hull(shapely.multipoints(theirs))
    found = shapely.distance(shapely.polygons(drive.corners[step]), bodies)
    return np.asarray(found - actor.outline.radius)


def separation(a: Array, b: Array) -> Array:
    """(M,) largest gap between convex polygons (M, m, 2), (M, n, 2) along any edge's normal [m].

    A lower bound of the distance; for polygons with area it is negative exactly if they overlap.
    """
    best = np.full(len(a), -np.inf)
    for corners in (a, b):
        if corners.shape[1] < 2:
            continue
        edge = np.roll(corners, -1, axis=1) - corners
        normal = np.stack([edge[..., 1], -edge[..., 0]], axis=-1)
        size = np.linalg.norm(normal, axis=-1, keepdims=True)
        normal = np.where(size > 1e-9, normal / np.maximum(size, 1e-9), 0.0)
        one, other = normal @ np.swapaxes(a, 1, 2), normal @ np.swapaxes(b, 1, 2)
        gap = np.maximum(other.min(axis=2) - one.max(axis=2), one.min(axis=2) - other.max(axis=2))
        best = np.maximum(best, np.where(size[..., 0] > 1e-9, gap, -np.inf).max(axis=1))
    return np.asarray(best)
