"""Conditions `predictions`, `witness-collision` and `set-based-collision`.

The body is checked with all it covers between grid points (`geometry.sweep`). A part of the
trajectory in [t_k, t_k+1] is checked against the regions of that interval; tau divides dt, so no
step belongs to two. An interval that is needed and not predicted is a violation.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray

from sandra.certificate.geometry import Sweep, convex, sweep
from sandra.certificate.report import Checked, Violation
from sandra.certificate.timing import decision_point, steps_per_dt
from sandra.certificate.types import Certificate, Occupancies
from sandra.scene.types import Region

Array = NDArray[np.float64]

NEAR = 2.0
"""Clearances up to this are exact, larger ones are bounds from below [m]."""


@dataclass(frozen=True, slots=True)
class Clearance:
    """The closest that a trajectory comes to the others."""

    distance: float
    """Lower bound [m]; inf if there are no others, <= 0 if a collision is possible."""
    step: int = 0
    obstacle: int = 0
    """Index; the first in time where `distance` <= 0."""


def predictions(c: Certificate) -> Checked | Violation:
    """Every interval that a trajectory needs is predicted, for every participant."""
    if c.set_based != "set-based":
        return Violation(
            "predictions",
            f"the fail-safe must be checked against a set-based prediction, not {c.set_based!r}",
        )
    n = steps_per_dt(c)
    needed = -(-(decision_point(c) + len(c.fail_safe.inputs)) // n)
    for obstacle in c.obstacles:
        for kind, have, want in (
            (c.prediction, len(obstacle.likely), c.horizon),
            (c.set_based, len(obstacle.possible), needed),
        ):
            if have < want:
                return Violation(
                    "predictions",
                    f"obstacle {obstacle.id}: the {kind} prediction has {have} intervals, "
                    f"{want} are needed",
                    step=have,
                    time=have * c.dt,
                    measured=float(have),
                    allowed=float(want),
                )
    return Checked(
        "predictions", f"{c.horizon} intervals {c.prediction}, {needed} intervals {c.set_based}"
    )


def witness_collision(c: Certificate) -> Checked | Violation:
    """The witness touches no region of the prediction that it was checked with."""
    found = clearance(sweep(c.witness, c.ego), 0, steps_per_dt(c), [o.likely for o in c.obstacles])
    if found.distance <= 0.0:
        return _hit(c, "witness-collision", "witness", found, 0.0, c.prediction)
    return _free("witness-collision", found, f"the {c.prediction} prediction")


def set_based_collision(c: Certificate) -> Checked | Violation:
    """The witness up to t_dec and the fail-safe touch no region of the set-based prediction."""
    possible = [o.possible for o in c.obstacles]
    n, begin = steps_per_dt(c), decision_point(c)
    driven = sweep(c.witness, c.ego)
    until = clearance(Sweep(driven.hulls[:begin], driven.margins[:begin]), 0, n, possible)
    if until.distance <= 0.0:
        return _hit(c, "set-based-collision", "witness", until, 0.0, c.set_based)
    after = clearance(sweep(c.fail_safe, c.ego), begin, n, possible)
    if after.distance <= 0.0:
        return _hit(c, "set-based-collision", "fail-safe", after, c.t_dec, c.set_based)
    closest = min(until, after, key=lambda x: x.distance)
    return _free("set-based-collision", closest, f"the {c.set_based} prediction")


def clearance(
    swept: Sweep, begin: int, steps_per_interval: int, others: list[Occupancies]
) -> Clearance:
    """How far a swept trajectory keeps from the others' regions, from below.

    Args:
        swept: of a trajectory that begins at grid point `begin`.
        steps_per_interval: grid points per interval of the prediction.
        others: each with regions for all intervals that the trajectory needs.
    """
    closest = Clearance(np.inf)
    steps = np.arange(len(swept.hulls))
    intervals = (begin + steps) // steps_per_interval
    for k in np.unique(intervals).tolist():
        found = [(i, region) for i, regions in enumerate(others) for region in regions[k]]
        if found:
            chosen = steps[intervals == k]
            here = _in_interval(swept, chosen, [x for _, x in found])
            if here[0] < closest.distance:
                closest = Clearance(here[0], here[1], found[here[2]][0])
        if closest.distance <= 0.0:
            break
    return closest


def _in_interval(
    swept: Sweep, steps: NDArray[np.int_], regions: list[Region]
) -> tuple[float, int, int]:
    """(clearance, step, index of the region) in one interval; the first step that collides."""
    widened = swept.margins[steps, None] + np.array([r.radius for r in regions])[None, :]
    gaps = _box_gaps(shapely.bounds(swept.hulls[steps]), _boxes(regions)) - widened
    near = gaps <= NEAR
    which = np.flatnonzero(near.any(axis=0))
    shapes, _ = convex(regions[j] for j in which)
    exact = shapely.distance(swept.hulls[steps, None], shapes[None, :]) - widened[:, which]
    gaps[:, which] = np.where(near[:, which], exact, gaps[:, which])
    # What is not a number is no clearance.
    gaps = np.where(np.isnan(gaps), -np.inf, gaps)
    touching = (gaps <= 0.0).any(axis=1)
    row = int(np.argmax(touching)) if touching.any() else int(np.argmin(gaps.min(axis=1)))
    column = int(np.argmin(gaps[row]))
    return float(gaps[row, column]), int(steps[row]), column


def _boxes(regions: list[Region]) -> Array:
    """(n, 4) lowest and highest x, y of each region's vertices."""
    starts = np.cumsum([0, *(len(r.vertices) for r in regions)])[:-1]
    points = np.concatenate([r.vertices for r in regions])
    low, high = np.minimum.reduceat(points, starts), np.maximum.reduceat(points, starts)
    return np.hstack([low, high])


def _box_gaps(a: Array, b: Array) -> Array:
    """(n, m) distances between boxes: lower bounds of those between what they hold."""
    apart = np.maximum(b[None, :, :2] - a[:, None, 2:], a[:, None, :2] - b[None, :, 2:])
    beside = np.maximum(apart, 0.0)
    return np.asarray(np.hypot(beside[..., 0], beside[..., 1]))


def _hit(
    c: Certificate, condition: str, name: str, found: Clearance, start: float, kind: str
) -> Violation:
    time = start + found.step * c.witness.tau
    obstacle = c.obstacles[found.obstacle]
    return Violation(
        condition,
        f"{name}, step {found.step} ({time:.2f} s): the body may touch obstacle {obstacle.id} "
        f"({obstacle.kind}, {kind} prediction), clearance {found.distance:.3f} m",
        found.step,
        time,
        found.distance,
        0.0,
    )


def _free(condition: str, found: Clearance, kind: str) -> Checked:
    if not np.isfinite(found.distance):
        return Checked(condition, f"nobody is near in {kind}", found.distance, "m")
    return Checked(
        condition, f"at least {found.distance:.2f} m from all in {kind}", found.distance, "m"
    )
