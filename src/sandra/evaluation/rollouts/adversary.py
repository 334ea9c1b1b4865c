"""What adversaries want: plans of several kinds, and the commands that follow from them.

A plan only wishes; `traffic` and `walkers` turn wishes into motion within the bounds.
"""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

KINDS = ("random", "bang-bang", "brake", "greedy", "cut-in", "search")
"""Random inputs; extreme inputs with random switching; going on and then braking fully in the way
of the ego; meeting the ego on its future path, which is known; cutting in as early and as close
as the law allows, and braking; inputs with extreme values, improved from one batch to the next by
how near they came to the ego."""
RANDOM, BANG_BANG, BRAKE, GREEDY, CUT_IN, SEARCH = range(len(KINDS))

SEGMENTS = 5
"""Inputs are piecewise constant, with so many pieces."""


@dataclass(frozen=True, slots=True, eq=False)
class Plans:
    """Of N vehicles, one row each.

    `kind`, `route` (N,); `switch` (N, K) times at which the pieces end [s]; `push` (N, K) share of
    a_max, -1..1; `side` (N, K) where to between the right (-1) and left (1) edge; `slip` (N,) -1..1
    share of the largest slip angle; `lead` (N,) how far ahead the ego is awaited [s], inf: where
    it crosses; `speed` (N,) 0..1, used where the speed is unknown; `turn` (N,) heading of a body
    that may point anywhere, or course where the speed is unknown [rad].
    """

    kind: Ints
    route: Ints
    switch: Array
    push: Array
    side: Array
    slip: Array
    lead: Array
    speed: Array
    turn: Array

    def rows(self, index: Ints) -> Plans:
        """Some of them."""
        return Plans(*(getattr(self, f.name)[index] for f in fields(self)))

    def piece(self, time: float) -> tuple[Array, Array]:
        """(N,) push and side at a time."""
        index = np.minimum((self.switch <= time).sum(axis=1), SEGMENTS - 1)
        row = np.arange(len(index))
        return self.push[row, index], self.side[row, index]


def joined(parts: list[Plans]) -> Plans:
    """All rows of several."""
    return Plans(*(np.concatenate([getattr(p, f.name) for p in parts]) for f in fields(Plans)))


def plans(kinds: Ints, routes: list[Ints], duration: float, rng: np.random.Generator) -> Plans:
    """Draw plans.

    Args:
        kinds: (N,) index into `KINDS`.
        routes: of each vehicle those that it may take; empty where it follows none.
        duration: of the rollout [s].
    """
    n = len(kinds)
    extreme = (kinds != RANDOM) & (rng.random(n) < 0.9)
    push = rng.uniform(-1, 1, (n, SEGMENTS))
    side = rng.uniform(-1, 1, (n, SEGMENTS))
    push[extreme], side[extreme] = np.sign(push[extreme]), np.sign(side[extreme])
    # Some change only one of the two.
    steady = rng.random(n) < 0.3
    push[steady] = push[steady, :1]
    straight = rng.random(n) < 0.3
    side[straight] = side[straight, :1]
    lead = rng.uniform(0.2, 2.0, n)
    lead[rng.random(n) < 0.4] = np.inf
    return Plans(
        kind=kinds,
        route=np.array([rng.choice(r) if len(r) else 0 for r in routes], dtype=np.int64),
        switch=np.sort(rng.uniform(0, duration, (n, SEGMENTS)), axis=1),
        push=push,
        side=side,
        slip=rng.choice([-1.0, 0.0, 0.0, 1.0], n),
        lead=lead,
        speed=rng.random(n),
        turn=rng.uniform(-np.pi, np.pi, n),
    )


def improved(
    tried: Plans,
    nearest: Array,
    groups: Ints,
    count: int,
    duration: float,
    rng: np.random.Generator,
) -> Plans:
    """New plans close to those that came nearest (a small cross-entropy search).

    Args:
        nearest: (N,) smallest distance that each came to the ego [m].
        groups: (N,) vehicle of each; the search is per vehicle.
        count: of new plans per vehicle; ordered by vehicle, as `groups` is.
    """  # fmt: skip
    chosen = []
    for group in np.unique(groups).tolist():
        members = np.flatnonzero(groups == group)
        order = members[np.argsort(nearest[members], kind="stable")]
        best = order[: max(1, len(order) // 5)]
        chosen.append(rng.choice(best, count))
    parents = tried.rows(np.concatenate(chosen))
    n = len(parents.kind)
    push = np.clip(parents.push + rng.normal(0, 0.4, (n, SEGMENTS)), -1, 1)
    flip = rng.random((n, SEGMENTS)) < 0.1
    push = np.where(flip, -push, push)
    # Extremes matter most: half of the values go to the nearer one.
    push = np.where(rng.random((n, SEGMENTS)) < 0.5, np.sign(push), push)
    return Plans(
        kind=np.full(n, SEARCH),
        route=parents.route,
        switch=np.sort(
            np.clip(parents.switch + rng.normal(0, 0.08 * duration, (n, SEGMENTS)), 0, duration)
        ),
        push=push,
        side=np.clip(parents.side + rng.normal(0, 0.3, (n, SEGMENTS)), -1, 1),
        slip=parents.slip,
        lead=parents.lead,
        speed=np.clip(parents.speed + rng.normal(0, 0.1, n), 0, 1),
        turn=parents.turn + rng.normal(0, 0.2, n),
    )
