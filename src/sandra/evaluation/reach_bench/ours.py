"""Our side: what is computed, and how long it takes. The only place that calls the kernel."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TypeVar

from sandra.actions import ALL_PAIRS, ActionPair
from sandra.logic import Specification
from sandra.prediction import predict
from sandra.reach import Ground, ReachableSet, compute, ground, verify_on
from sandra.reach.ground import forbidden_cells
from sandra.scene.types import Scene
from sandra.settings import Settings

KIND = "most-likely"
T = TypeVar("T")


def prepare(scene: Scene, settings: Settings) -> Ground:
    """The ground of a scene under its most likely prediction."""
    return ground(scene, predict(scene, KIND, settings.horizon, settings), settings)


def free_set(base: Ground) -> ReachableSet:
    """The reachable set under no specification at all."""
    return compute(base, Specification(ALL_PAIRS[0], ()))


def tightened(base: Ground) -> Ground:
    """The same ground, on which sets are computed with the precision "tight"."""
    return replace(base, settings=base.settings.replace(precision="tight"))


@dataclass(frozen=True, slots=True)
class OurTimes:
    """One run of ours, process CPU [s]."""

    predict: float
    ground: float
    """All that the sets need of scene and prediction."""
    forbidden: float
    """The part of it that the peer's collision checker stands for: cells off the road, and those
    that the others forbid."""
    free: float
    pair: float
    every: float
    """All twelve pairs."""
    tight_free: float
    tight_every: float
    """The same with the precision "tight"."""


def time_ours(scene: Scene, pair: ActionPair, settings: Settings) -> OurTimes:
    """Prediction, ground, the free set, one pair with its formula, all twelve pairs; then tight."""
    prediction, predicting = _timed(lambda: predict(scene, KIND, settings.horizon, settings))
    base, preparing = _timed(lambda: ground(scene, prediction, settings))
    _, forbidding = _timed(lambda: forbidden_cells(scene, prediction, base.lattice))
    _, free = _timed(lambda: free_set(base))
    _, one = _timed(lambda: verify_on(base, (pair,), reasons=False))
    _, every = _timed(lambda: verify_on(base, ALL_PAIRS, reasons=False))
    close = tightened(base)
    _, tight_free = _timed(lambda: free_set(close))
    verify_on(close, (pair,), reasons=False)
    _, tight_every = _timed(lambda: verify_on(close, ALL_PAIRS, reasons=False))
    return OurTimes(predicting, preparing, forbidding, free, one, every, tight_free, tight_every)


def _timed(work: Callable[[], T]) -> tuple[T, float]:
    begin = time.process_time()
    found = work()
    return found, time.process_time() - begin
