"""The fail-safe trajectory: from the state at the next decision to a standstill that is safe.

Safe against the set-based prediction, so against everything the others may do under their stated
assumptions: the full body meets no occupancy at any instant until it stands, stays on the road,
and stands outside the conflict areas of intersections. From then on nothing is checked: that
others do not drive into a standing car is the assumption that makes a standstill the end.

Strategies in rounds (`fail_safe_rounds`); in each the mildest maneuver that holds is kept (smallest
peak of the total acceleration), and the next is made only if none does:

1. brake in the lane (straighten, or go to its centre), complete or abort a lane change;
2. evade within the lane, to either side;
3. leave the conflict area ahead or underneath before braking;
4. on the paths of the first round, speeds from an optimisation (`optimised_profiles`).

Method 6 (fail-safe); after Magdici & Althoff, "Fail-safe motion planning of autonomous vehicles",
2016, with samples before the optimisation.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sandra.errors import SettingsError
from sandra.planning import strategies
from sandra.planning.bounds import whole_steps, within
from sandra.planning.fail_safe_candidates import Task, simulate
from sandra.planning.fail_safe_checks import Failures, mildest_that_holds, standing
from sandra.planning.fail_safe_rounds import LONGEST, ROUNDS, STANDING, Rounds
from sandra.planning.single_track import SPEED
from sandra.planning.surroundings import Surroundings
from sandra.planning.types import FailSafe, Margins
from sandra.prediction.types import Prediction
from sandra.scene.types import Scene
from sandra.settings import Settings

__all__ = ["FailSafe", "Margins", "Miss", "fail_safe", "fail_safe_horizon"]

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Miss:
    """No fail-safe trajectory was found; `reasons` says for each strategy tried what failed."""

    reasons: tuple[str, ...]

    def __str__(self) -> str:
        return "no fail-safe trajectory found: " + "; ".join(self.reasons)


def fail_safe_horizon(
    scene: Scene,
    settings: Settings,
    t_dec: float | None = None,
    mildest: float = strategies.MILDEST,
) -> int:
    """Steps of `scene.dt` that a prediction needs so that `fail_safe` can try all its braking.

    Args:
        t_dec: time of the next decision [s]; default one step.
        mildest: braking milder than this is not needed [m/s^2]; a shorter prediction is cheaper.

    The ego may accelerate with `a_lon_max` until t_dec. At most 8 s, and never less than what
    full braking takes.
    """
    t_dec = scene.dt if t_dec is None else t_dec
    speed = scene.ego.state.speed + max(settings.a_lon_max, 0.0) * t_dec
    full = max(-settings.a_lon_min - strategies.INNER, 1e-3)
    duration = max(min(speed / min(mildest, full), LONGEST), speed / full)
    return max(1, int(np.ceil((t_dec + duration) / scene.dt - 1e-9)) + 1)


def fail_safe(
    scene: Scene,
    state: Array,
    t_dec: float,
    set_based: Prediction,
    settings: Settings,
    shared: Surroundings | None = None,
    rounds: Rounds = ROUNDS,
    why: bool = True,
) -> FailSafe | Miss:
    """The mildest fail-safe trajectory that was found, or why none was.

    Args:
        state: (5,) single-track state at `t_dec`.
        t_dec: a multiple of `scene.dt` [s].
        set_based: the set-based prediction, made at time 0. Maneuvers that last longer than it
            are not tried (`fail_safe_horizon`).
        shared: `Surroundings.of(scene, set_based)`, where more than one search is made.
        rounds: what is tried, in this order; default all `ROUNDS`.
        why: False where nobody asks for the reasons of a miss: whom it would meet, and when.

    Raises:
        SettingsError: if the prediction is not set-based or has another time step than the scene,
            or t_dec is no multiple of it.
        ValueError: if the state is not finite or drives backwards.
    """
    first = _first_step(scene, t_dec, set_based)
    state = np.asarray(state, dtype=float)
    if state.shape != (5,) or not np.isfinite(state).all() or state[SPEED] < -STANDING:
        raise ValueError(f"the state {state} must be five finite numbers with speed >= 0")
    shared = Surroundings.of(scene, set_based) if shared is None else shared
    steps = set_based.horizon - first
    task = Task.of(scene, state, t_dec, first, steps, settings, shared)
    failures = Failures(why)
    if task.speed <= STANDING:
        found = standing(task, failures, strategies.BRAKE)
        if found is not None:
            return found
    for make in rounds:
        attempts = make(task)
        for strategy, reason in attempts.missing:
            failures.add(strategy, reason, 0.0)
        candidates, pathless = simulate(task, attempts.attempts)
        for strategy in sorted(pathless):
            failures.add(strategy, "the lane is too crooked, or not the ego's direction", 0.0)
        found = None if candidates is None else mildest_that_holds(task, candidates, failures)
        if found is not None:
            return found
    return Miss(failures.reasons())


def _first_step(scene: Scene, t_dec: float, prediction: Prediction) -> int:
    if prediction.kind != "set-based":
        raise SettingsError(
            f"a fail-safe maneuver needs a set-based prediction, this one is {prediction.kind}"
        )
    if not within(prediction.dt - scene.dt, -1e-9, 1e-9):
        raise SettingsError(
            f"the prediction has dt = {prediction.dt} s, the scene {scene.dt} s: predict again"
        )
    first = whole_steps(t_dec, scene.dt, 1e-6)
    if first is None or first < 0:
        raise SettingsError(f"t_dec = {t_dec} s must be a multiple of dt = {scene.dt} s, >= 0")
    return first
