"""Does the set-based prediction hold what was driven? Predicted from many steps of a recording."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import shapely
from numpy.typing import NDArray

from sandra.evaluation.conformance.measure import broken
from sandra.evaluation.conformance.recording import Recording
from sandra.prediction import predict
from sandra.scene.types import Region, Scene, State
from sandra.settings import Settings

Array = NDArray[np.float64]
Bools = NDArray[np.bool_]

SLACK = 0.02
"""Corners this far outside are inside [m]: borders of a map are chords, positions are rounded."""


@dataclass(frozen=True, slots=True)
class Coverage:
    """Vehicle steps after a prediction at which a vehicle still keeps all assumptions, and is
    within its predicted regions; those at which it is not: (vehicle, start, step)."""

    predictions: int
    steps: int
    covered: int
    missed: tuple[tuple[int, int, int], ...]

    def and_(self, other: Coverage) -> Coverage:
        """Both together."""
        return Coverage(
            self.predictions + other.predictions,
            self.steps + other.steps,
            self.covered + other.covered,
            self.missed + other.missed,
        )


NOTHING = Coverage(0, 0, 0, ())


def coverage(
    r: Recording, values: dict[str, Array], settings: Settings, horizon: int, every: int
) -> Coverage:
    """Predict from every `every`-th step, and look at each later step up to the horizon.

    The two assumptions on traffic law are left off: they are about an ego that need not be there.
    """
    a = replace(settings.assumptions, no_rear_end=False, legal_cut_in=False)
    settings = settings.replace(assumptions=a)
    breaks = np.asarray(np.any(list(broken(values, a).values()), axis=0))
    total = NOTHING
    others = np.array([True] * len(r.ids), dtype=bool)
    if r.has_ego:
        others[-1] = False
    n = r.there.shape[1]
    for start in range(0, n - 1, every):
        rows = np.flatnonzero(others & r.there[:, start])
        if len(rows):
            total = total.and_(_from(r, rows, start, min(horizon, n - 1 - start), breaks, settings))
    return total


def _from(
    r: Recording, rows: NDArray[np.int_], start: int, steps: int, breaks: Bools, settings: Settings
) -> Coverage:
    scene = _at(r, rows, start)
    sets = predict(scene, "set-based", steps, settings)
    looked, missed = 0, []
    for row, predicted in zip(rows.tolist(), sets.obstacles, strict=True):
        gone = (
            ~r.there[row, start + 1 : start + steps + 1]
            | breaks[row, start + 1 : start + steps + 1]
        )
        kept = int(np.argmax(gone)) if gone.any() else steps
        looked += kept
        for k in range(1, kept + 1):
            outline = predicted.obstacle.outline
            body = outline.placed(*r.states[row, start + k, :3].tolist())
            if not _within(body, predicted.at[k]):
                missed.append((r.ids[row], start * r.stride, (start + k) * r.stride))
    return Coverage(1, looked, looked - len(missed), tuple(missed))


def _at(r: Recording, rows: NDArray[np.int_], start: int) -> Scene:
    """The scene as it was at a step, without what is recorded later."""
    obstacles = {o.id: o for o in r.scene.obstacles}
    now = []
    for row in rows.tolist():
        x, y, heading, speed, acceleration = r.states[row, start].tolist()
        state = State(x, y, heading, speed, 0.0 if np.isnan(acceleration) else acceleration)
        now.append(replace(obstacles[r.ids[row]], state=state, states=None))
    return replace(r.scene, obstacles=tuple(now))


def _within(body: Region, regions: tuple[Region, ...]) -> bool:
    """Whether the corners of a body are in the union of regions."""
    points = shapely.points(body.vertices)
    apart = np.full(len(points), np.inf)
    for region in regions:
        hull = shapely.convex_hull(shapely.MultiPoint(region.vertices))
        apart = np.minimum(apart, shapely.distance(hull, points) - region.radius + body.radius)
        if (apart <= SLACK).all():
            return True
    return bool((apart <= SLACK).all())
