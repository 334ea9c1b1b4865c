"""The body along a most likely trajectory: from one state per step to regions."""

from __future__ import annotations

import math
from collections.abc import Iterable
from itertools import pairwise

import numpy as np

from sandra.prediction.most_likely import RECORDED_SETS, Likely
from sandra.prediction.motion import circumscribed
from sandra.prediction.observed import is_fixed
from sandra.prediction.types import PredictedObstacle
from sandra.scene.convex import hulls
from sandra.scene.types import Region

Regions = tuple[tuple[Region, ...], ...]


def with_bodies(several: Iterable[Likely], dt: float) -> tuple[PredictedObstacle, ...]:
    """Each participant with its regions at and between its states (time step `dt` [s])."""
    return tuple(with_body(each, dt) for each in several)


def with_body(likely: Likely, dt: float) -> PredictedObstacle:
    """One participant; see `with_bodies`."""
    obstacle, states = likely.obstacle, likely.states
    if is_fixed(obstacle):
        s = obstacle.state
        at: Regions = ((obstacle.outline.placed(s.x, s.y, s.heading),),) * len(states)
        between = at[1:]
    elif RECORDED_SETS in likely.assumptions:
        at = _recorded_sets(likely, dt)
        between = tuple(now + then for now, then in pairwise(at))
    else:
        at, between = _along(likely)
    return PredictedObstacle(obstacle, at, between, states, likely.assumptions)


def _along(likely: Likely) -> tuple[Regions, Regions]:
    """The body at each state, and what it sweeps from one to the next."""
    outline, states = likely.obstacle.outline, likely.states
    at: Regions = tuple(
        (outline.placed(*row[:3].tolist()),) if math.isfinite(row[0]) else () for row in states
    )
    swept = iter(
        hulls(
            [
                np.concatenate([now[0].vertices, then[0].vertices])
                for now, then in pairwise(at)
                if now and then
            ]
        )
    )
    radius = circumscribed(outline)
    between: list[tuple[Region, ...]] = []
    for k, (now, then) in enumerate(pairwise(at)):
        if not now or not then:
            between.append(now or then)
            continue
        # Linear motion, turning at a constant rate: corners bulge out of the hull of both bodies
        # by the error of linear interpolation, r dtheta^2 / 8.
        turn = states[k + 1, 2] - states[k, 2]
        turn = (turn + math.pi) % (2 * math.pi) - math.pi
        between.append((Region(next(swept), outline.radius + radius * float(turn) ** 2 / 8),))
    return at, tuple(between)


def _recorded_sets(likely: Likely, dt: float) -> Regions:
    """Recorded occupancies; beyond their end they spread at the observed speed."""
    sets = likely.obstacle.occupancies or ()
    last = len(sets) - 1
    speed = abs(likely.obstacle.state.speed)
    at: list[tuple[Region, ...]] = []
    for k in range(len(likely.states)):
        growth = speed * dt * max(0, k - last)
        at.append(tuple(Region(r.vertices, r.radius + growth) for r in sets[min(k, last)]))
    return tuple(at)
