"""What is driven when nothing can be proven: the emergency layer, apart from all certificates.

An episode may begin so close to others that no maneuver is safe against everything that they may
do. Then the same search as for a fail-safe is made with limits of its own; if that fails too, of
all that it tried the maneuver that stays clear of the others' occupancies longest is driven.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from sandra.planning.fail_safe_candidates import Candidates, Task, simulate
from sandra.planning.fail_safe_rounds import SAMPLED, Rounds, braking, evading
from sandra.planning.fail_safe_search import fail_safe
from sandra.planning.limits import within_limits
from sandra.planning.surroundings import Surroundings
from sandra.planning.types import FailSafe, Trajectory
from sandra.prediction.types import Prediction
from sandra.scene.types import Scene
from sandra.settings import Settings

Array = NDArray[np.float64]

TRIED: Rounds = (braking, evading)
"""Of these rounds the best is taken where nothing holds."""


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
    found = fail_safe(scene, state, 0.0, set_based, settings, shared, SAMPLED)
    if isinstance(found, FailSafe):
        how = f"{found.strategy}, at most {found.deceleration:.1f} m/s^2, clear of the prediction"
        return found.trajectory, how
    task = Task.of(scene, state, 0.0, 0, set_based.horizon, settings, shared)
    best: tuple[float, float, Trajectory, str] | None = None
    for make in TRIED:
        candidates, _ = simulate(task, make(task).attempts)
        for rank in () if candidates is None else _ranked(task, candidates):
            if best is None or rank[:2] > best[:2]:
                best = rank
    if best is None:
        return None
    clear, braked, trajectory, strategy = best
    return trajectory, f"{strategy}, at most {braked:.1f} m/s^2, clear of others for {clear:.2f} s"


def _ranked(task: Task, candidates: Candidates) -> list[tuple[float, float, Trajectory, str]]:
    """Each within the limits: how long it is clear [s], its braking [m/s^2], itself, its name."""
    wheelbase = task.scene.ego.wheelbase
    kept = np.flatnonzero(
        within_limits(candidates.states, candidates.inputs, wheelbase, task.limits)
    )
    if not len(kept):
        return []
    contacts = task.shared.first_contact(*candidates.part(kept), task.tau, 0.0)
    found = []
    for i, contact in zip(kept.tolist(), contacts.tolist(), strict=True):
        n = int(candidates.count[i])
        inputs = candidates.inputs[i, :n]
        clear = task.tau * (contact if contact >= 0 else n)
        trajectory = Trajectory(candidates.states[i, : n + 1], inputs, task.tau, 0.0)
        braked = float(max(0.0, -inputs[:, 0].min())) if n else 0.0
        found.append((clear, braked, trajectory, candidates.strategy[i]))
    return found
