"""The rounds of a fail-safe search: in each, what is attempted together.

A round is a function of the task; what it gives is driven, and the mildest that holds is kept.
The next round is made only if none does. A round of one's own is one more function in `ROUNDS`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from sandra.planning import strategies
from sandra.planning.fail_safe_candidates import Array, Attempt, Task

LONGEST = 8.0
"""Fail-safe maneuvers last at most so long, unless full braking takes longer [s]."""
STANDING = 1e-6
"""Speeds up to this are a standstill [m/s]."""


@dataclass(frozen=True, slots=True, eq=False)
class Round:
    """Attempts, and why a strategy has nothing to attempt: (strategy, reason)."""

    attempts: tuple[Attempt, ...]
    missing: tuple[tuple[str, str], ...] = ()


def braking(task: Task) -> Round:
    """Constant decelerations in the lane, and completing or aborting a lane change."""
    if task.speed <= STANDING:
        return Round(())
    profiles = _braking_profiles(task)
    if not profiles:
        if not len(task.levels):
            text = "a_lon_min allows no braking"
        else:
            text = (
                f"full braking takes {task.speed / task.levels[-1]:.2f} s, the prediction ends "
                f"{task.most * task.tau:.2f} s after the decision"
            )
        return Round((), ((strategies.BRAKE, text),))
    aims = strategies.stopping_aims(task.scene, task.state, task.now)
    return Round((Attempt(aims, profiles),))


def evading(task: Task) -> Round:
    """The same decelerations, to either side within the lane."""
    if task.speed <= STANDING:
        return Round(())
    profiles = _braking_profiles(task)
    if not profiles:
        return Round(())
    distance = max(task.driven(p) for p in profiles)
    aims = strategies.evading_aims(task.scene.ego, task.state, task.now, distance)
    return Round((Attempt(aims, profiles),))


def leaving(task: Task) -> Round:
    """Speed profiles that stop just after each conflict area that begins soon."""
    if task.shared.area is None:
        return Round(())
    frame = task.now.home.frame
    s0 = float(frame.to_curvilinear(task.state[None, :2])[0, 0])
    half = task.scene.ego.length / 2
    exits = []
    for area in task.shared.conflicts:
        s = frame.to_curvilinear(area)[:, 0]
        if s.max() > s0 - half and s.min() < s0 + half + task.speed * LONGEST:
            exits.append(float(s.max()) + half + 0.3 - s0)
    profiles: list[Array] = []
    for distance in sorted(exits)[:4]:
        profiles += strategies.leaving(
            task.speed, distance, task.tau, task.top, task.levels, task.most
        )
    if not profiles:
        text = "no way out of it in the time predicted"
        return Round((), ((strategies.LEAVE, text),) if exits else ())
    aims = strategies.stopping_aims(task.scene, task.state, task.now)
    picked = [a for a in aims if np.isnan(a.target)] + [a for a in aims if a.target == 0.0]
    renamed = [replace(a, strategy=strategies.LEAVE) for a in picked]
    return Round((Attempt(renamed, profiles),))


def _braking_profiles(task: Task) -> list[Array]:
    return strategies.braking(task.speed, task.tau, task.levels, task.most)


ROUNDS: tuple[Callable[[Task], Round], ...] = (braking, evading, leaving)
"""In the order in which they are tried."""
