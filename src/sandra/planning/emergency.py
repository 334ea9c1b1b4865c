"""What is driven when nothing can be proven: the emergency layer, apart from all certificates.

An episode may begin so close to others that no maneuver is safe against everything that they may
do. Then the maneuvers of a fail-safe search are made with limits of their own, and the one that
stays clear of the others' occupancies longest is driven; of those the one that stands outside of
conflict areas, and brakes hardest: the sooner the distance is there again, the sooner something
can be certified.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sandra.planning.bounds import clear as clear_of
from sandra.planning.fail_safe_candidates import Candidates, Task, simulate
from sandra.planning.fail_safe_checks import CONFLICT_MARGIN
from sandra.planning.fail_safe_rounds import Rounds, braking, evading
from sandra.planning.limits import within_limits
from sandra.planning.surroundings import Surroundings
from sandra.planning.types import Trajectory
from sandra.prediction.types import Prediction
from sandra.scene.types import Scene
from sandra.settings import Settings

Array = NDArray[np.float64]

TRIED: Rounds = (braking, evading)
"""Maneuvers of these rounds are tried."""


def emergency(
    scene: Scene, state: Array, set_based: Prediction, settings: Settings, shared: Surroundings
) -> tuple[Trajectory, str] | None:
    """A trajectory from now to a standstill, and in words what it is; None if there is none.

    Args:
        state: (5,) single-track state now.
        set_based: the set-based prediction, made now.
        settings: with the emergency layer's own limits.
        shared: `Surroundings.of(scene, set_based)`.
    """
    task = Task.of(scene, state, 0.0, 0, set_based.horizon, settings, shared)
    found: list[_Option] = []
    for make in TRIED:
        candidates, _ = simulate(task, make(task).attempts)
        found += [] if candidates is None else _options(task, candidates)
    if not found:
        return None
    best = max(found, key=lambda option: option.rank)
    clear, _, braked = best.rank
    how = f"{best.strategy}, at most {braked:.1f} m/s^2, clear of others for {clear:.2f} s"
    return best.trajectory, how


@dataclass(frozen=True, slots=True, eq=False)
class _Option:
    """A maneuver; `rank`: how long it is clear [s], whether it may stand there, braking [m/s^2]."""

    rank: tuple[float, bool, float]
    trajectory: Trajectory
    strategy: str


def _options(task: Task, candidates: Candidates) -> list[_Option]:
    """Those within the limits."""
    wheelbase = task.scene.ego.wheelbase
    kept = np.flatnonzero(
        within_limits(candidates.states, candidates.inputs, wheelbase, task.limits)
    )
    if not len(kept):
        return []
    contacts = task.shared.first_contact(*candidates.part(kept), task.tau, 0.0)
    away = task.shared.from_conflicts(candidates.states[kept, -1])
    stands = clear_of(away, CONFLICT_MARGIN)
    # Being clear longer than the longest maneuver lasts is not better.
    longest = int(candidates.count.max())
    found = []
    for i, contact, stand in zip(kept.tolist(), contacts.tolist(), stands.tolist(), strict=True):
        n = int(candidates.count[i])
        inputs = candidates.inputs[i, :n]
        clear = task.tau * (contact if contact >= 0 else longest)
        trajectory = Trajectory(candidates.states[i, : n + 1], inputs, task.tau, 0.0)
        braked = float(max(0.0, -inputs[:, 0].min())) if n else 0.0
        found.append(_Option((clear, stand, braked), trajectory, candidates.strategy[i]))
    return found
