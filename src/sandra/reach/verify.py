"""Verify action pairs: the paper's Sec. III-E.

A verdict does not depend on what was verified before it: pairs share the ground, which never
changes, and nothing else.
"""

from __future__ import annotations

import time
from collections.abc import Iterable, Sequence
from dataclasses import replace

from sandra.actions import ActionPair, parse_pairs
from sandra.logic import Specification, Vocabulary, specification
from sandra.prediction import PredictionSource, predict
from sandra.reach.explain import explain
from sandra.reach.ground import Ground, ground
from sandra.reach.lattice import Mask
from sandra.reach.moves import moves_of
from sandra.reach.problem import Problem
from sandra.reach.regions import answers_of
from sandra.reach.sets import ReachableSet
from sandra.reach.twin import reachable_set, reachable_sets
from sandra.reach.verdict import Status, Verdict, Verdicts
from sandra.scene.types import Scene
from sandra.settings import Settings


def verify(
    scene: Scene,
    pairs: str | Iterable[str | ActionPair] = "all",
    *,
    prediction: PredictionSource = "most-likely",
    rules: Sequence[str] = (),
    horizon: int | None = None,
    settings: Settings | None = None,
    vocabulary: Vocabulary | None = None,
    reasons: bool = True,
) -> Verdicts:
    """Verify action pairs of a scene.

    Args:
        pairs: "all", "accelerate,right-lane", or several pairs.
        prediction: "most-likely", "set-based", "recorded", or a prediction of your own.
        rules: names such as "R_G1", or formulas of your own.
        horizon: number of steps; default: that of the settings.
        reasons: whether to find out what emptied a set, by leaving each possible cause out.

    Raises:
        SandraError: for unknown pairs, rules, predictions, or a horizon below 1.
    """
    settings = settings or Settings()
    if horizon is not None:
        settings = settings.replace(horizon=horizon)
    asked = parse_pairs(pairs)
    predicted = predict(scene, prediction, settings.horizon, settings)
    base = ground(scene, predicted, settings)
    return verify_on(base, asked, rules, vocabulary=vocabulary, reasons=reasons)


def verify_on(
    base: Ground,
    pairs: Sequence[ActionPair],
    rules: Sequence[str] = (),
    *,
    vocabulary: Vocabulary | None = None,
    reasons: bool = True,
) -> Verdicts:
    """Verify pairs on a ground that is already there; see `verify`.

    Pairs that differ only in what they ask at the last step share the steps before it: each
    verdict's `duration_s` is its share of them, without the search for reasons.
    """
    found: list[Verdict] = []
    begin = time.perf_counter()
    specs = [
        specification(pair, rules, settings=base.settings, vocabulary=vocabulary, dt=base.scene.dt)
        for pair in pairs
    ]
    sets = reachable_sets([problem_of(base, spec) for spec in specs])
    duration = (time.perf_counter() - begin) / max(1, len(specs))
    for spec, reachable in zip(specs, sets, strict=True):
        status = Status.REACHABLE if reachable.first_empty_step is None else Status.UNSAFE
        verdict = Verdict(spec.pair, status, spec, reachable, None, duration)
        found.append(explained(base, verdict) if reasons else verdict)
    return Verdicts(tuple(found), base, tuple(rules))


def explained(base: Ground, verdict: Verdict) -> Verdict:
    """The verdict with what emptied its set, if it is UNSAFE."""
    if verdict.status is not Status.UNSAFE:
        return verdict
    reason = explain(base, verdict.specification, verdict.reachable_set, compute)
    return replace(verdict, reason=reason)


def verify_pair(
    base: Ground,
    pair: ActionPair,
    rules: Sequence[str] = (),
    vocabulary: Vocabulary | None = None,
    reasons: bool = True,
) -> Verdict:
    """The verdict of one pair."""
    return verify_on(base, (pair,), rules, vocabulary=vocabulary, reasons=reasons)[0]


def compute(
    base: Ground, spec: Specification, forbidden: Sequence[Mask] | None = None
) -> ReachableSet:
    """The reachable set of a specification; `forbidden` replaces the ground's own cells."""
    return reachable_set(problem_of(base, spec, forbidden))


def problem_of(
    base: Ground, spec: Specification, forbidden: Sequence[Mask] | None = None
) -> Problem:
    """What the kernel is given for a specification; see `compute`."""
    settings = base.settings
    inputs = (settings.a_lon_min, settings.a_lon_max)
    return Problem(
        dt=base.scene.dt,
        horizon=base.horizon,
        lon=base.lon,
        lat=base.lat,
        a_lat=(-settings.a_lat_max, settings.a_lat_max),
        v_lon=(0.0, settings.v_max),
        v_lat=(-settings.v_lat_max, settings.v_lat_max),
        lattice=base.lattice,
        forbidden=base.forbidden if forbidden is None else forbidden,
        moves=moves_of(spec.dfa, inputs, base.horizon),
        answers=answers_of(base, spec.dfa.atoms),
        tight=settings.precision == "tight",
    )
