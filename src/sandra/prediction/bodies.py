"""The body along a most likely trajectory: from one state per step to regions."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from sandra.prediction.most_likely import RECORDED_SETS, Likely
from sandra.prediction.motion import circumscribed
from sandra.prediction.observed import is_fixed
from sandra.prediction.types import PredictedObstacle
from sandra.scene.convex import hulls
from sandra.scene.types import Region

Array = NDArray[np.float64]
Regions = tuple[tuple[Region, ...], ...]


def with_bodies(several: Iterable[Likely], dt: float) -> tuple[PredictedObstacle, ...]:
    """Each participant with its regions at and between its states (time step `dt` [s])."""
    places = [(likely, _at(likely, dt)) for likely in several]
    pairs = [
        np.concatenate([now[0].vertices, then[0].vertices])
        for likely, at in places
        if _drives(likely)
        for now, then in pairwise(at)
        if now and then
    ]
    swept = iter(hulls(pairs))
    return tuple(
        PredictedObstacle(
            likely.obstacle, at, _between(likely, at, swept), likely.states, likely.assumptions
        )
        for likely, at in places
    )


def _drives(likely: Likely) -> bool:
    """Whether the body moves along the states; else it is fixed, or recorded as sets."""
    return not is_fixed(likely.obstacle) and RECORDED_SETS not in likely.assumptions


def _at(likely: Likely, dt: float) -> Regions:
    """The regions at each state."""
    obstacle, states = likely.obstacle, likely.states
    if _drives(likely):
        return tuple(
            (obstacle.outline.placed(*row[:3].tolist()),) if math.isfinite(row[0]) else ()
            for row in states
        )
    if is_fixed(obstacle):
        s = obstacle.state
        return ((obstacle.outline.placed(s.x, s.y, s.heading),),) * len(states)
    # Beyond the end of the recording the sets spread at the observed speed.
    sets = obstacle.occupancies or ()
    last, speed = len(sets) - 1, abs(obstacle.state.speed)
    return tuple(
        tuple(
            Region(r.vertices, r.radius + speed * dt * max(0, k - last)) for r in sets[min(k, last)]
        )
        for k in range(len(states))
    )


def _between(likely: Likely, at: Regions, swept: Iterator[Array]) -> Regions:
    """The regions during each step; takes the hulls of a driving body at both ends of `swept`."""
    if is_fixed(likely.obstacle):
        return at[1:]
    if not _drives(likely):
        return tuple(now + then for now, then in pairwise(at))
    outline, states = likely.obstacle.outline, likely.states
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
    return tuple(between)
