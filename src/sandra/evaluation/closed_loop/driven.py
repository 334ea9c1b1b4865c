"""What an episode that was driven with certificates is worth, and what the run itself asserts."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sandra.decider import Operation
from sandra.evaluation.closed_loop.blame import (
    STANDS,
    Lapse,
    before_collision,
    lapses,
    partner_of,
)
from sandra.evaluation.closed_loop.breaches import Breach
from sandra.evaluation.closed_loop.metrics import OURS, Convention, Metrics, Proofs, measure
from sandra.monitor import monitor
from sandra.monitor.monitor import RULES
from sandra.scene.types import Scene
from sandra.settings import Settings
from sandra.simulation.episode import Episode
from sandra.simulation.policies import NEAR, Run
from sandra.simulation.recording import Recording

Array = NDArray[np.float64]

UNVERIFIED = "unverified"
"""The operation of drivers without a verifier."""


def at_decisions(episode: Episode) -> Scene:
    """The recording with one row for each decision: row k is the state in which step k was decided.

    The accelerations are NaN, so that the monitor derives those that a step had on the whole.
    """
    return every(episode.recording.scene, episode.ticks_per_step)


def every(scene: Scene, stride: int) -> Scene:
    """Every so many rows of a recording, accelerations as in `at_decisions`."""
    obstacles = tuple(
        o if o.states is None else replace(o, states=o.states[::stride]) for o in scene.obstacles
    )
    assert scene.recorded_ego is not None, "a recording has an ego"
    ego = scene.recorded_ego[::stride].copy()
    ego[:, 4] = np.nan
    return replace(scene, dt=scene.dt * stride, obstacles=obstacles, recorded_ego=ego)


def run_of(episode: Episode, driver: str, seed: int, setting: int | None, profile: str) -> Run:
    """The episode by its decision steps, as the metrics take it."""
    scene = at_decisions(episode)
    ego = scene.recorded_ego
    assert ego is not None, "a recording has an ego"
    n = len(episode.steps)
    # A step that ended with a crash may have fewer ticks: its end is the last tick.
    stride = episode.ticks_per_step
    ticks = np.minimum(stride * np.arange(n + 1), len(episode.recording.ego) - 1)
    rows = episode.recording.ego[ticks]
    crash = episode.recording.ego_crash
    return Run(
        driver=driver,
        seed=seed,
        setting=setting,
        profile=profile,
        dt=scene.dt,
        x=_driven(scene, rows),
        speed=rows[:, 3],
        lane=_lanes(scene, rows),
        crashed=np.zeros(n + 1, dtype=bool) if crash is None else ticks >= crash,
        traffic_speed=_traffic(episode.recording.scene, rows, ticks),
        actions=tuple("fail-safe" if x.pair is None else str(x.pair) for x in episode.steps),
        fail_safe=np.array([x.fail_safe for x in episode.steps], dtype=bool),
    )


def _driven(scene: Scene, rows: Array) -> Array:
    """(n,) distance from the start [m]: along a straight road, else along the path driven."""
    if len(scene.frame.line) == 2:
        s = scene.frame.to_curvilinear(rows[:, :2])[:, 0]
        return np.asarray(s - s[0])
    way = np.linalg.norm(np.diff(rows[:, :2], axis=0), axis=1)
    return np.concatenate([[0.0], np.cumsum(way)])


def _lanes(scene: Scene, rows: Array) -> NDArray[np.int64]:
    """(n,) number of the lane, of those side by side, whose centre line is nearest."""
    beside = [x for x in scene.lanes if x.relation in ("current", "left", "right", "other")]
    across = [np.abs(x.frame.to_curvilinear(rows[:, :2])[:, 1]) for x in beside]
    return np.asarray(np.argmin(np.stack(across), axis=0), dtype=np.int64)


def _traffic(scene: Scene, rows: Array, ticks: NDArray[np.int64]) -> Array:
    """(n,) mean speed of the others near the ego [m/s]; NaN where there are none."""
    moving = [o.states for o in scene.obstacles if o.states is not None]
    if not moving:
        return np.full(len(rows), np.nan)
    states = np.stack([s[ticks] for s in moving], axis=1)
    away = np.linalg.norm(states[..., :2] - rows[:, None, :2], axis=2)
    near = away <= NEAR
    count = near.sum(axis=1)
    total = np.where(near, states[..., 3], 0.0).sum(axis=1)
    return np.where(count > 0, total / np.maximum(count, 1), np.nan)


@dataclass(frozen=True, slots=True)
class Collision:
    """The ego's collision: with whom, when, what was proven then, and who had broken what."""

    tick: int
    time: float
    """Since the start [s]."""
    partner: int | None
    """Id of the vehicle that the ego touched."""
    operation: str
    """By what the ego was driven."""
    speed: float
    """Of the ego, a tick before [m/s]: whoever stands has come to the end of a fail-safe."""
    since: int
    """The decision that the last proof rests on; 0 where there was none before."""
    at_fault: bool | None
    """Whether the partner had broken no assumption that the ego relied on since then; None where
    nothing was ever verified."""
    breaches: tuple[Breach, ...]
    """Of the partner, from that decision to the collision."""

    def __str__(self) -> str:
        who = "an obstacle" if self.partner is None else f"vehicle {self.partner}"
        told = f"collision at {self.time:.2f} s with {who}, driven by: {self.operation}, "
        told += f"at {self.speed:.1f} m/s; "
        if self.at_fault is None:
            return told + "nothing was verified"
        if self.at_fault:
            return told + "at fault: the other had broken nothing that was relied on"
        return told + "not at fault: " + "; ".join(map(str, self.breaches))


@dataclass(frozen=True, slots=True)
class Outcome:
    """All that is reported of one episode.

    `uncovered`: steps after the first certificate at which no fail-safe was known that was clear
    of all that others may do; `lapses` says for each who had broken which assumption, `unexplained`
    are those for which nobody is found. `outside`: steps that left the plan.
    """

    metrics: Metrics
    operations: dict[str, int]
    pairs: dict[str, int]
    first_certificate: int | None
    uncovered: tuple[int, ...]
    lapses: tuple[Lapse, ...]
    unexplained: tuple[int, ...]
    outside: int
    collision: Collision | None
    ended: str | None
    decision_cpu: tuple[float, float]
    """Mean and largest CPU time of a decision cycle [s]."""

    def to_dict(self) -> dict[str, Any]:
        """For JSON."""
        return asdict(self)

    def proofs(self) -> Proofs:
        """What a row of the table tells of it beside the metrics."""
        return Proofs(
            at_fault=None if self.collision is None else self.collision.at_fault,
            standing=self.collision is not None and self.collision.speed <= STANDS,
            uncovered=len(self.uncovered),
            unexplained=len(self.unexplained),
            certified_start=self.first_certificate == 0,
            operations=self.operations,
            cpu=self.decision_cpu[0],
            cpu_max=self.decision_cpu[1],
        )

    def told(self) -> list[str]:
        """The collision and the lost fail-safes, in a sentence each."""
        lines = [] if self.collision is None else [str(self.collision)]
        return lines + [str(lapse) for lapse in self.lapses if lapse.step == lapse.at]


def outcome(
    episode: Episode,
    run: Run,
    settings: Settings,
    rules: Sequence[str] = RULES,
    convention: Convention = OURS,
) -> Outcome:
    """Measure an episode."""
    cpu = [step.cpu for step in episode.steps]
    lost = lapses(episode, settings)
    return Outcome(
        metrics=measure(run, compliance(episode, run, settings, rules), rules, convention),
        operations=dict(Counter(step.operation.value for step in episode.steps)),
        pairs=dict(Counter(run.actions)),
        first_certificate=episode.first_certificate,
        uncovered=tuple(lapse.step for lapse in lost),
        lapses=lost,
        unexplained=tuple(lapse.step for lapse in lost if not lapse.explained),
        outside=episode.breaches,
        collision=_collision(episode, settings),
        ended=episode.ended,
        decision_cpu=(float(np.mean(cpu)), float(np.max(cpu))) if cpu else (0.0, 0.0),
    )


def unverified(
    recording: Recording,
    run: Run,
    stride: int,
    settings: Settings,
    rules: Sequence[str] = RULES,
    convention: Convention = OURS,
) -> tuple[Episode, Outcome]:
    """Measure what a driver without a verifier drove."""
    crash = recording.ego_crash
    ended = None if crash is None else f"step {run.steps - 1}: the ego has crashed"
    episode = Episode(recording, (), stride, run.steps, ended)
    collision = None
    if crash is not None:
        time = crash * recording.scene.dt
        partner = partner_of(episode, crash)
        speed = _speed_before(recording, crash)
        collision = Collision(crash, time, partner, UNVERIFIED, speed, 0, None, ())
    return episode, Outcome(
        metrics=measure(run, compliance(episode, run, settings, rules), rules, convention),
        operations={UNVERIFIED: run.steps},
        pairs=dict(Counter(run.actions)),
        first_certificate=None,
        uncovered=(),
        lapses=(),
        unexplained=(),
        outside=0,
        collision=collision,
        ended=ended,
        decision_cpu=(math.nan, math.nan),
    )


def compliance(
    episode: Episode, run: Run, settings: Settings, rules: Sequence[str]
) -> NDArray[np.bool_]:
    """(steps, len(rules)) whether a rule is kept at a step, by the monitor on the recording."""
    n = run.steps
    found = np.zeros((n, len(rules)), dtype=bool)
    if n:
        robustness = monitor(at_decisions(episode), tuple(rules), settings)
        for column, rule in enumerate(rules):
            kept = robustness[rule].kept[:n]
            found[: len(kept), column] = kept
    return found


def _collision(episode: Episode, settings: Settings) -> Collision | None:
    recording = episode.recording
    tick = recording.ego_crash
    if tick is None:
        return None
    partner = partner_of(episode, tick)
    since, found = before_collision(episode, tick, partner, settings)
    step = min(max(tick - 1, 0) // episode.ticks_per_step, len(episode.steps) - 1)
    operation = episode.steps[step].operation if episode.steps else Operation.EMERGENCY
    time = tick * recording.scene.dt
    speed = _speed_before(recording, tick)
    return Collision(tick, time, partner, operation.value, speed, since, not found, found)


def _speed_before(recording: Recording, tick: int) -> float:
    return float(recording.ego[max(tick - 1, 0), 3])
