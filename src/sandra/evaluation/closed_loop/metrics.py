"""The closed-loop metrics, defined here and nowhere else (paper: Sec. "Closed-Loop Evaluation").

The six of the paper's table, and beside them what shows when they are gamed: a driver that always
brakes has a success rate of 100 %. A metric of an episode is a field of `Metrics`, of many episodes
a field of `Summary`.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sandra.simulation.policies import Run

JUSTIFIED = ("R_G2",)
"""Rules that a fail-safe step may break: braking abruptly is justified there (paper, R_G2)."""


@dataclass(frozen=True, slots=True)
class Convention:
    """How long an episode is, and which of its steps must be free of collision."""

    steps: int = 30
    """Decision steps over which everything is counted."""
    decisive: int = 30
    """A collision in one of the first `decisive` steps is one; later ones do not count."""


OURS = Convention()
"""30 steps of 0.2 s, all of which must be free of collision."""
PAPER = Convention(decisive=29)
"""The authors' loop runs 31 steps; a crash in step 30 or 31 counts as success there, and the
distance is that after 6.0 s, which is 30 steps."""


@dataclass(frozen=True, slots=True)
class Metrics:
    """One episode."""

    success: bool
    """No collision for the full duration, which was reached."""
    collision_free_steps: int
    """Steps before the one in which the ego has crashed."""
    compliant_steps: dict[str, int]
    """By rule: steps in which it holds (fail-safe steps justify nothing here)."""
    success_steps: int
    """Steps free of collision and compliant with all rules (R_G2: or a fail-safe step)."""
    distance: float
    """From the start to the end, or to the collision [m]."""
    fail_safe_rate: float
    """Share of the driven steps that were a fail-safe."""
    relative_speed: float
    """Mean of the ego's speed less that of the others within 100 m [m/s]; NaN without others."""
    lane_changes: int
    """How often the lane under the ego's centre changed."""
    steps: int
    """Steps that were driven, the one of a collision included."""


def measure(
    run: Run,
    compliance: NDArray[np.bool_] | None = None,
    rules: Sequence[str] = (),
    convention: Convention = OURS,
) -> Metrics:
    """The metrics of one episode.

    Args:
        run: the episode; steps beyond those of the convention are not looked at.
        compliance: (at least as many steps as driven, len(rules)) whether a rule holds in a step.
        rules: their names, in the order of the columns.
    """
    n = min(run.steps, convention.steps)
    if compliance is None:
        compliance = np.zeros((n, 0), dtype=bool)
    if compliance.shape[1:] != (len(rules),) or len(compliance) < n:
        raise ValueError(
            f"compliance: shape {compliance.shape} does not fit {n} steps and {len(rules)} rules"
        )
    free = ~run.crashed[1 : n + 1]
    compliant = compliance[:n] & free[:, None]
    excused = compliant.copy()
    for column, rule in enumerate(rules):
        if rule in JUSTIFIED:
            excused[:, column] |= free & run.fail_safe[:n]
    crashed = bool(run.crashed[: min(n, convention.decisive) + 1].any())
    relative = (run.speed - run.traffic_speed)[: n + 1]
    return Metrics(
        success=not crashed and run.steps >= convention.steps,
        collision_free_steps=int(free.sum()),
        compliant_steps={rule: int(k) for rule, k in zip(rules, compliant.sum(0), strict=True)},
        success_steps=int((free & excused.all(axis=1)).sum()),
        distance=float(run.x[n] - run.x[0]),
        fail_safe_rate=float(run.fail_safe[:n].mean()) if n else 0.0,
        relative_speed=_mean(relative),
        lane_changes=int(np.count_nonzero(np.diff(run.lane[: n + 1]))),
        steps=n,
    )


@dataclass(frozen=True, slots=True)
class Proofs:
    """What an episode that was driven with certificates tells beside its metrics."""

    at_fault: bool | None
    """Of the collision; None without one."""
    uncovered: int
    """Steps after the first certificate without a fail-safe known to be clear of others."""
    unexplained: int
    """Those of them for which no broken assumption was found."""
    certified_start: bool
    """Whether the first step was certified."""
    operations: Mapping[str, int]
    """Number of steps by what the ego was driven by."""
    cpu: float
    """Mean CPU time of a decision [s]."""
    cpu_max: float


@dataclass(frozen=True, slots=True)
class Summary:
    """Many episodes: a row of the table. Means over episodes, unless said otherwise."""

    episodes: int
    seeds: int
    """Different seeds among them: repeats of one seed are no new evidence."""
    successes: int
    success_rate: float
    """Share of successful episodes."""
    success_interval: tuple[float, float]
    """Wilson's 95 % interval, with as many trials as there are different seeds."""
    collision_free_steps: float
    compliant_steps: dict[str, float]
    success_steps: float
    distance: float
    """Over successful episodes only, as in the paper [m]; NaN if there are none."""
    distance_all: float
    """Over all episodes, to the collision where there was one [m]."""
    fail_safe_rate: float
    """Share of all driven steps."""
    relative_speed: float
    """[m/s]"""
    lane_changes: float
    at_fault: int | None = None
    """Collisions before which the other had broken no assumption; None: nothing was verified."""
    not_at_fault: int | None = None
    """Collisions before which it had."""
    uncovered: int | None = None
    """Steps after a first certificate without a fail-safe known to be clear, over all episodes."""
    unexplained: int | None = None
    """Those of them for which no broken assumption was found."""
    certified_starts: int | None = None
    """Episodes whose first step was certified."""
    operations: Mapping[str, float] = field(default_factory=dict)
    """Share of all steps by what the ego was driven by."""
    cpu: float = math.nan
    """Mean CPU time of a decision [s]; NaN where it was not measured."""
    cpu_max: float = math.nan


def summarise(episodes: Iterable[tuple[int, Metrics]], proofs: Sequence[Proofs] = ()) -> Summary:
    """The row of (seed, metrics) of episodes in one kind of traffic; `proofs` in the same order."""
    pairs = list(episodes)
    if not pairs:
        raise ValueError("no episodes")
    every = [metrics for _, metrics in pairs]
    seeds = len({seed for seed, _ in pairs})
    successes = sum(m.success for m in every)
    rate = successes / len(every)
    steps = sum(m.steps for m in every)
    return Summary(
        episodes=len(every),
        seeds=seeds,
        successes=successes,
        success_rate=rate,
        success_interval=wilson(rate * seeds, seeds),
        collision_free_steps=_mean([m.collision_free_steps for m in every]),
        compliant_steps={
            rule: _mean([m.compliant_steps[rule] for m in every])
            for rule in every[0].compliant_steps
        },
        success_steps=_mean([m.success_steps for m in every]),
        distance=_mean([m.distance for m in every if m.success]),
        distance_all=_mean([m.distance for m in every]),
        fail_safe_rate=sum(m.fail_safe_rate * m.steps for m in every) / max(steps, 1),
        relative_speed=_mean([m.relative_speed for m in every]),
        lane_changes=_mean([m.lane_changes for m in every]),
        **(_together(proofs) if proofs else {}),
    )


def _together(proofs: Sequence[Proofs]) -> dict[str, Any]:
    operations: Counter[str] = Counter()
    for p in proofs:
        operations.update(p.operations)
    steps = max(sum(operations.values()), 1)
    return {
        "at_fault": sum(p.at_fault is True for p in proofs),
        "not_at_fault": sum(p.at_fault is False for p in proofs),
        "uncovered": sum(p.uncovered for p in proofs),
        "unexplained": sum(p.unexplained for p in proofs),
        "certified_starts": sum(p.certified_start for p in proofs),
        "operations": {name: n / steps for name, n in operations.items()},
        "cpu": _mean([p.cpu for p in proofs]),
        "cpu_max": max(p.cpu_max for p in proofs),
    }


def wilson(successes: float, trials: int, z: float = 1.959964) -> tuple[float, float]:
    """Wilson's score interval of a rate; z = 1.96 for 95 %.

    `successes` may be a fraction where repeats of a seed are averaged.
    """
    if trials <= 0 or not 0 <= successes <= trials:
        raise ValueError(f"{successes} of {trials} is no rate")
    p, n = successes / trials, trials
    centre = (p + z**2 / (2 * n)) / (1 + z**2 / n)
    half = z / (1 + z**2 / n) * math.sqrt(p * (1 - p) / n + z**2 / (4 * n**2))
    low = 0.0 if successes == 0 else centre - half
    high = 1.0 if successes == trials else centre + half
    return low, high


def _mean(values: Collection[float] | NDArray[np.float64]) -> float:
    """The mean of what is not NaN; NaN if nothing is left."""
    array = np.asarray(list(values), dtype=float)
    array = array[~np.isnan(array)]
    return float(array.mean()) if array.size else math.nan
