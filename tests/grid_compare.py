"""Verdicts and certificates beside an exhaustive grid search, on random scenes.

`compare` takes one scene. An UNSAFE verdict is confirmed if the search, for a body that can do more
than ours, finds nothing. For every other pair it is found out how far one gets: trajectory of the
grid, witness, fail-safe, certificate.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, replace
from enum import Enum

import numpy as np

from grid_check import fault
from grid_search import Found, Search, grids
from grid_world import Body, World
from random_scenes import Drawn, draw
from sandra.actions import ALL_PAIRS
from sandra.certify import Basis, certify
from sandra.logic import Specification
from sandra.planning.types import Trajectory
from sandra.planning.witness import Miss, witness
from sandra.prediction import predict
from sandra.reach import Status, Verdict, ground, verify_on
from sandra.settings import Settings

RULES = ("R_G1", "R_G2", "R_G3")
TRIES = 12
"""So many of the trajectories of a grid are shown to the exact check."""


class Reached(Enum):
    """How far a pair that is not UNSAFE got."""

    NOTHING = "no trajectory on the grid, not even of the inscribed disc"
    DISC = "on the grid the inscribed disc gets through, the full body does not"
    STEPS = "on the grid the full body is free at the steps, but not between them"
    STEERING = "a trajectory on the grid; a witness only if the steering may turn at any rate"
    POINT_MASS = "a trajectory of the full body on the grid, but no witness was found"
    WITNESS = "a witness, but no fail-safe continues it"
    CERTIFIED = "a certificate"


@dataclass(frozen=True)
class Outcome:
    """One pair: the verdict, and what the grid search found of it."""

    seed: int
    prediction: str
    rules: tuple[str, ...]
    pair: str
    status: Status
    grid: Body | None
    """The strictest body for which a trajectory was found."""
    reached: Reached | None = None
    """None for UNSAFE pairs."""
    trivial: bool = False
    """UNSAFE at step 0 already, or because the road has no such lane."""
    detail: str = ""


def scene_of(seed: int) -> tuple[str, tuple[str, ...], int]:
    """Prediction, rules and horizon of a seed: all four combinations in turn."""
    horizon = int(np.random.default_rng([seed, 1]).integers(6, 11))
    return ("most-likely", "set-based")[seed % 2], ((), RULES)[seed // 2 % 2], horizon


def compare(
    seed: int, certificates: bool = True, asked: tuple[str, ...] | None = None
) -> list[Outcome]:
    """All twelve pairs of the scene of a seed; without `certificates` only UNSAFE ones.

    `asked` are other rules than those of the seed.
    """
    drawn = draw(seed)
    prediction, rules, horizon = scene_of(seed)
    rules = rules if asked is None else asked
    settings = Settings(horizon=horizon)
    predicted = predict(drawn.scene, prediction, horizon, settings)
    base = ground(drawn.scene, predicted, settings)
    basis = Basis.of(base) if certificates else None
    outcomes = []
    for verdict in verify_on(base, ALL_PAIRS, rules, reasons=False):
        worlds = {body: World(drawn, predicted, settings, body) for body in Body}
        head = (seed, prediction, rules, str(verdict.pair))
        if verdict.status is Status.UNSAFE:
            found = search(worlds[Body.DISC], verdict.specification, seed)
            grid = None if found is None else Body.DISC
            trivial = is_trivial(verdict, drawn)
            detail = "" if found is None else repr(found)
            outcomes.append(Outcome(*head, Status.UNSAFE, grid, None, trivial, detail))
        elif basis is not None:
            outcomes.append(_not_unsafe(head, verdict, basis, worlds))
    return outcomes


def is_trivial(verdict: Verdict, drawn: Drawn) -> bool:
    """Whether an UNSAFE verdict needs no reachable set."""
    lane = verdict.pair.lateral.value.removesuffix("-lane")
    missing = lane in ("left", "right") and lane not in {x.relation for x in drawn.scene.lanes}
    return missing or verdict.first_empty_step == 0


def _not_unsafe(
    head: tuple[int, str, tuple[str, ...], str],
    verdict: Verdict,
    basis: Basis,
    worlds: dict[Body, World],
) -> Outcome:
    grid = next((b for b in Body if search(worlds[b], verdict.specification, head[0])), None)
    driven = witness(basis.of_witness, verdict.specification, verdict.reachable_set)
    detail = "" if isinstance(driven, Trajectory) else driven.reason
    status = verdict.status
    if isinstance(driven, Trajectory):
        final = certify(basis, verdict, head[2])
        status, detail = final.status, final.reason or ""
        reached = Reached.CERTIFIED if status is Status.CERTIFIED else Reached.WITNESS
    elif grid is None:
        reached = Reached.NOTHING
    elif grid is Body.FULL:
        quick = isinstance(with_quick_steering(basis, verdict), Trajectory)
        reached = Reached.STEERING if quick else Reached.POINT_MASS
    else:
        reached = Reached.STEPS if grid is Body.AT_STEPS else Reached.DISC
    return Outcome(*head, status, grid, reached, detail=detail)


def with_quick_steering(basis: Basis, verdict: Verdict) -> Trajectory | Miss:
    """The search for a witness of a car whose steering angle may change at any rate."""
    base = basis.ground
    quick = replace(base, settings=base.settings.replace(steering_rate_max=100.0))
    around = replace(basis.of_witness, ground=quick)
    return witness(around, verdict.specification, verdict.reachable_set)


def search(world: World, spec: Specification, seed: int) -> Found | None:
    """A trajectory that the exact check confirms, from coarse to fine grids; None if there is none.

    An unconfirmed one counts for nothing.
    """
    rng = np.random.default_rng(seed)
    # For an UNSAFE verdict the coarse grids are of no use: the fine ones hold them.
    for fine in (True,) if world.body is Body.DISC else (False, True):
        for along, across in grids(world, spec.formula, fine):
            for found in Search(world, spec, along, across).trajectories(TRIES, rng):
                if fault(world, spec, found) is None:
                    return found
    return None


def timed(seed: int) -> tuple[list[Outcome], float]:
    """`compare` and its process time [s]."""
    begin = time.process_time()
    return compare(seed), time.process_time() - begin
