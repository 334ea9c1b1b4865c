"""The rounds of a fail-safe search: in each, what is attempted together.

A round is a function of the task; what it gives is driven, and the mildest that holds is kept.
The next round is made only if none does. A round of one's own is one more function in `ROUNDS`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from sandra.planning import strategies
from sandra.planning.fail_safe_candidates import Array, Attempt, Task, lateral_paths
from sandra.planning.optimised_profiles import profiles
from sandra.planning.path_gaps import Track

LONGEST = 8.0
"""Fail-safe maneuvers last at most so long, unless full braking takes longer [s]."""
STANDING = 1e-6
"""Speeds up to this are a standstill [m/s]."""
MOST_DISTANCE = 150.0
"""Speeds are optimised over so much of a path at most [m]."""


@dataclass(frozen=True, slots=True, eq=False)
class Round:
    """Attempts, and why a strategy has nothing to attempt: (strategy, reason)."""

    attempts: tuple[Attempt, ...]
    missing: tuple[tuple[str, str], ...] = ()


def braking(task: Task) -> Round:
    """Constant decelerations in the lane, and completing or aborting a lane change."""
    if task.speed <= STANDING:
        return Round(())
    speeds = _braking_profiles(task)
    if not speeds:
        if not len(task.levels):
            text = "a_lon_min allows no braking"
        else:
            text = (
                f"full braking takes {task.speed / task.levels[-1]:.2f} s, the prediction ends "
                f"{task.most * task.tau:.2f} s after the decision"
            )
        return Round((), ((strategies.BRAKE, text),))
    aims = strategies.stopping_aims(task.scene, task.state, task.now)
    return Round((Attempt(aims, speeds),))


def evading(task: Task) -> Round:
    """The same decelerations, to either side within the lane."""
    if task.speed <= STANDING:
        return Round(())
    speeds = _braking_profiles(task)
    if not speeds:
        return Round(())
    distance = max(task.driven(p) for p in speeds)
    aims = strategies.evading_aims(task.scene.ego, task.state, task.now, distance)
    return Round((Attempt(aims, speeds),))


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
        if _in_reach(s - s0, half, task.speed * LONGEST):
            exits.append(float(s.max()) + half + 0.3 - s0)
    speeds: list[Array] = []
    for distance in sorted(exits)[:4]:
        speeds += strategies.leaving(
            task.speed, distance, task.tau, task.top, task.levels, task.most
        )
    if not speeds:
        text = "no way out of it in the time predicted"
        return Round((), ((strategies.LEAVE, text),) if exits else ())
    aims = strategies.stopping_aims(task.scene, task.state, task.now)
    picked = [a for a in aims if np.isnan(a.target)] + [a for a in aims if a.target == 0.0]
    renamed = [replace(a, strategy=strategies.LEAVE) for a in picked]
    return Round((Attempt(renamed, speeds),))


def optimising(task: Task) -> Round:
    """Speed profiles from an optimisation, on a few paths in the lane or across lanes."""
    if not len(task.levels):
        return Round(())
    distance = min(_farthest(task), MOST_DISTANCE)
    # To each goal one path, not too abrupt: the time is better spent on speeds.
    aims = strategies.stopping_aims(task.scene, task.state, task.now)
    length = strategies.lengths(task.speed)[:2][-1]
    picked = [aim for aim in aims if aim.length == length]
    attempts = []
    reasons: list[str] = []
    for mine, along in lateral_paths(task, picked, distance):
        if along is None:
            continue
        for row, aim in enumerate(mine):
            track = Track.of(task, along.only([row]))
            found, reason = ([], "the path is too short") if track is None else profiles(track)
            if found:
                renamed = replace(aim, strategy=strategies.OPTIMISE)
                attempts.append(Attempt([renamed], found, distance))
            else:
                reasons.append(reason)
    return Round(tuple(attempts), ((strategies.OPTIMISE, reasons[0]),) if reasons else ())


def _in_reach(area: Array, half: float, ahead: float) -> bool:
    """Whether the body, `half` to the front and the rear, is in an area or may come to it.

    `area`: places along the lane, from the body's centre on; `ahead`: so far it may drive [m].
    """
    return bool(area.max() > -half and area.min() < half + ahead)


def _farthest(task: Task) -> float:
    """How far the ego could drive at most until it stands when the prediction ends [m]."""
    time = task.tau * np.arange(task.most + 1)
    speeding = task.speed + max(task.limits.a_lon_max, 0.0) * time
    return task.driven(np.minimum(np.minimum(speeding, task.top), task.levels[-1] * time[::-1]))


def _braking_profiles(task: Task) -> list[Array]:
    return strategies.braking(task.speed, task.tau, task.levels, task.most)


Rounds = tuple[Callable[[Task], Round], ...]

SAMPLED: Rounds = (braking, evading, leaving)
"""The rounds without the optimisation, which takes about as long as these together."""
ROUNDS: Rounds = (*SAMPLED, optimising)
"""All, in the order in which they are tried."""
