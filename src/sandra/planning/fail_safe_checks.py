"""Which candidate of a fail-safe search holds, and why the others do not.

Every candidate passes the same checks, wherever its speed profile comes from: the limits of the
model, the place where it stands, the others' occupancies at every instant, and the road.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sandra.planning.bounds import clear
from sandra.planning.fail_safe_candidates import Candidates, Task
from sandra.planning.limits import within_limits
from sandra.planning.single_track import SPEED, lateral_acceleration
from sandra.planning.types import FailSafe, Margins, Trajectory

Array = NDArray[np.float64]
Ints = NDArray[np.int_]

CONFLICT_MARGIN = 0.02
"""Distance of the standing body from conflict areas [m]."""
BATCH = 3
"""So many trajectories are checked for collisions at once, mildest first."""
GAP = 5.0
"""Clearances are measured up to this distance [m]."""


@dataclass(frozen=True, slots=True)
class _Failure:
    """Why one candidate failed; `rank` says how near it came to success."""

    rank: tuple[float, ...]
    text: str


class Failures:
    """What came nearest to success, by strategy; looked for only if `wanted`."""

    def __init__(self, wanted: bool = True) -> None:
        self.wanted = wanted
        self._by_strategy: dict[str, _Failure] = {}

    def add(self, strategy: str, text: str, *rank: float) -> None:
        """Note a failure; of a strategy's failures the one of highest rank is kept."""
        known = self._by_strategy.get(strategy)
        if known is None or rank > known.rank:
            self._by_strategy[strategy] = _Failure(rank, text)

    def best(self, strategy: str) -> tuple[float, ...]:
        """Rank of what is kept of a strategy; () if nothing."""
        known = self._by_strategy.get(strategy)
        return () if known is None else known.rank

    def reasons(self) -> tuple[str, ...]:
        """One line for each strategy."""
        return tuple(f"{name}: {x.text}" for name, x in self._by_strategy.items())


def standing(task: Task, failures: Failures, strategy: str) -> FailSafe | None:
    """Standstill already: no motion at all, if it is outside the conflict areas."""
    away = float(task.shared.from_conflicts(task.state[None])[0])
    if not clear(away, CONFLICT_MARGIN):
        failures.add(strategy, _in_conflict(task.state), 0.0)
        return None
    trajectory = Trajectory(task.state[None].copy(), np.empty((0, 2)), task.tau, task.t_dec)
    return FailSafe(trajectory, strategy, 0.0, Margins(GAP, away, task.settings.a_lat_max))


def mildest_that_holds(task: Task, candidates: Candidates, failures: Failures) -> FailSafe | None:
    """The candidate that holds with the smallest peak of the total acceleration."""
    ego, shared = task.scene.ego, task.shared
    kept = within_limits(candidates.states, candidates.inputs, ego.wheelbase, task.limits)
    for name in sorted({candidates.strategy[i] for i in np.flatnonzero(~kept)}):
        failures.add(name, "no path within the limits of steering and grip", 0.0)
    last = candidates.states[:, -1]
    away = shared.from_conflicts(last)
    may_stand = clear(away, CONFLICT_MARGIN)
    for i in np.flatnonzero(kept & ~may_stand).tolist():
        text = _how(candidates, i) + _in_conflict(last[i])
        failures.add(candidates.strategy[i], text, 1.0, float(away[i]))
    kept &= may_stand
    if shared.cut_in:
        late = beyond_legal_cut_in(task, candidates.states)
        in_time = late <= 0.0
        for i in np.flatnonzero(kept & ~in_time).tolist():
            text = f"{_how(candidates, i)}stops {late[i]:.1f} m too late for who cuts in legally"
            failures.add(candidates.strategy[i], text, 1.5, -float(late[i]))
        kept &= in_time
    lateral = np.abs(lateral_acceleration(candidates.states, ego.wheelbase))[:, :-1]
    peak = np.hypot(candidates.inputs[..., 0], lateral).max(axis=1)
    rows = np.flatnonzero(kept)
    rows = rows[np.argsort(np.round(peak[rows], 1), kind="stable")]
    # Most that fail do so where they come to stand: a quick look there first.
    ends_free = np.zeros(len(kept), dtype=bool)
    ends_free[rows] = shared.ends_free(*candidates.part(rows), task.tau, task.t_dec)
    alive = rows[ends_free[rows]]
    for start in range(0, len(alive), BATCH):
        part = alive[start : start + BATCH]
        contacts = shared.first_contact(*candidates.part(part), task.tau, task.t_dec)
        for i, contact in zip(part.tolist(), contacts.tolist(), strict=True):
            if contact >= 0:
                _collides(task, candidates, i, contact, failures)
                continue
            n = int(candidates.count[i])
            states, inputs = candidates.states[i, : n + 1], candidates.inputs[i, :n]
            if not shared.road.holds(states[None], inputs[None], task.tau, ego)[0]:
                text = _how(candidates, i) + "leaves the road"
                failures.add(candidates.strategy[i], text, 3.0, 0.0)
                continue
            gaps = shared.gaps(states[None], inputs[None], task.tau, task.t_dec, GAP)
            return FailSafe(
                Trajectory(states, inputs, task.tau, task.t_dec),
                candidates.strategy[i],
                float(max(0.0, -inputs[:, 0].min())),
                Margins(
                    float(gaps.min()),
                    float(away[i]),
                    float(task.settings.a_lat_max - lateral[i].max()),
                ),
            )
    _blame(task, candidates, rows[~ends_free[rows]], failures)
    return None


def beyond_legal_cut_in(task: Task, states: Array) -> Array:
    """(N,) how much farther trajectories (N, n+1, 5) go than the law keeps free for them [m].

    Who cuts in legally at some time leaves d_safe = v^2 / (2 |a_min|) - v_o^2 / (2 |a_obs_min|) +
    v t_d, and may then brake with a_obs_min: it stands v^2 / (2 |a_min|) + v t_d ahead of where the
    ego's front was at that time. From every time on the ego must come to stand within that. Before
    t_dec, where only the state now is known, the larger way and the smaller speed count.
    """
    s = task.settings
    v = np.maximum(states[..., SPEED], 0.0)
    way = np.cumsum((v[:, :-1] + v[:, 1:]) / 2 * task.tau, axis=1)
    rest = way[:, -1:] - np.concatenate([np.zeros((len(v), 1)), way], axis=1)

    def kept_free(speed: Array) -> Array:
        return np.asarray(speed**2 / (2 * abs(s.a_min)) + speed * s.t_d)

    now = max(task.scene.ego.state.speed, 0.0)
    before = np.maximum(v[:, 0], now) * task.t_dec + rest[:, 0]
    late = before - kept_free(np.minimum(v[:, 0], now))
    return np.asarray(np.maximum(late, (rest - kept_free(v)).max(axis=1)))


def _blame(task: Task, candidates: Candidates, rows: Ints, failures: Failures) -> None:
    """Say for each strategy when its hardest braking among `rows` collides."""
    if not failures.wanted:
        return
    hardest: dict[str, int] = {}
    for i in rows.tolist():
        name = candidates.strategy[i]
        if candidates.count[i] <= candidates.count[hardest.get(name, i)]:
            hardest[name] = i
    picked = np.array(list(hardest.values()), dtype=np.int_)
    if len(picked):
        contacts = task.shared.first_contact(*candidates.part(picked), task.tau, task.t_dec)
        for i, contact in zip(picked.tolist(), contacts.tolist(), strict=True):
            _collides(task, candidates, i, contact, failures)


def _collides(task: Task, candidates: Candidates, i: int, step: int, failures: Failures) -> None:
    time = task.t_dec + step * task.tau
    if failures.wanted and failures.best(candidates.strategy[i]) < (2.0, time):
        who = task.shared.nearest(candidates.states[i, step : step + 2], time)
        text = f"{_how(candidates, i)}may meet obstacle {who} {time:.2f} s from now"
        failures.add(candidates.strategy[i], text, 2.0, time)


def _how(candidates: Candidates, i: int) -> str:
    strongest = max(0.0, -float(candidates.inputs[i, :, 0].min()))
    return f"braking with {strongest:.1f} m/s^2 it "


def _in_conflict(state: Array) -> str:
    return f"would stand in a conflict area at ({state[0]:.1f}, {state[1]:.1f})"
