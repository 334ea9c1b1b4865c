"""The body along a most likely trajectory: from one state per step to regions."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
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
    several = tuple(several)
    driving = {id(each): _driven(each) for each in several if _drives(each)}
    swept = iter(hulls([cloud for bodies in driving.values() for cloud in bodies.clouds]))
    found = []
    for likely in several:
        bodies = driving.get(id(likely))
        if bodies is not None:
            at, between = bodies.at, bodies.between(swept)
        else:
            at = _at(likely, dt)
            fixed = is_fixed(likely.obstacle)
            between = at[1:] if fixed else tuple(now + then for now, then in pairwise(at))
        found.append(
            PredictedObstacle(likely.obstacle, at, between, likely.states, likely.assumptions)
        )
    return tuple(found)


def _drives(likely: Likely) -> bool:
    """Whether the body moves along the states; else it is fixed, or recorded as sets."""
    return not is_fixed(likely.obstacle) and RECORDED_SETS not in likely.assumptions


@dataclass(frozen=True, slots=True, eq=False)
class _Driven:
    """A body along its states.

    `clouds` are the vertices at both ends of each step in which it is there at both; of the hull
    of a step's vertices corners bulge out by `margins` (h,) [m].
    """

    at: Regions
    clouds: list[Array]
    margins: list[float]

    def between(self, swept: Iterator[Array]) -> Regions:
        """The regions during each step; takes the hulls of the clouds."""
        return tuple(
            (Region(next(swept), margin),) if now and then else now or then
            for (now, then), margin in zip(pairwise(self.at), self.margins, strict=True)
        )


def _driven(likely: Likely) -> _Driven:
    outline, states = likely.obstacle.outline, likely.states
    there = np.isfinite(states[:, 0])
    vertices = outline.vertices_at(states[:, :3])
    at = tuple(
        (Region(body, outline.radius),) if present else ()
        for body, present in zip(vertices, there.tolist(), strict=True)
    )
    clouds = np.concatenate([vertices[:-1], vertices[1:]], axis=1)[there[:-1] & there[1:]]
    # Linear motion, turning at a constant rate: corners bulge out of the hull of both bodies
    # by the error of linear interpolation, r dtheta^2 / 8.
    turn = np.diff(states[:, 2])
    turn = (turn + math.pi) % (2 * math.pi) - math.pi
    margins = outline.radius + circumscribed(outline) * turn**2 / 8
    return _Driven(at, list(clouds), margins.tolist())


def _at(likely: Likely, dt: float) -> Regions:
    """The regions at each state of what is fixed, or recorded as sets."""
    obstacle, states = likely.obstacle, likely.states
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
