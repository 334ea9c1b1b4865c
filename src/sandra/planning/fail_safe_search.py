"""The fail-safe trajectory: from the state at the next decision to a standstill that is safe.

Safe against the set-based prediction, so against everything the others may do under their stated
assumptions: the full body meets no occupancy at any instant until it stands, stays on the road,
and stands outside the conflict areas of intersections. From then on nothing is checked: that
others do not drive into a standing car is the assumption that makes a standstill the end.

Strategies in two rounds, then a third if a conflict area is in the way; in each round the mildest
maneuver that holds is kept (smallest peak of the total acceleration):

1. brake in the lane (straighten, or go to its centre), complete or abort a lane change;
2. evade within the lane, to either side;
3. leave the conflict area ahead or underneath before braking.

Method 6 (fail-safe); after Magdici & Althoff, "Fail-safe motion planning of autonomous vehicles",
2016, with samples in place of optimisation.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from sandra.errors import SettingsError
from sandra.planning import strategies
from sandra.planning.lane_paths import Paths, drive, guide, paths
from sandra.planning.limits import Limits, within_limits
from sandra.planning.single_track import SPEED, lateral_acceleration
from sandra.planning.strategies import Aim
from sandra.planning.surroundings import Surroundings
from sandra.planning.tracking import fine_step
from sandra.planning.types import Trajectory
from sandra.prediction.types import Prediction
from sandra.scene.types import Scene
from sandra.settings import Settings

if TYPE_CHECKING:
    from collections.abc import Sequence

Array = NDArray[np.float64]
Ints = NDArray[np.int_]

LONGEST = 8.0
"""Fail-safe maneuvers last at most so long, unless full braking takes longer [s]."""
STANDING = 1e-6
"""Speeds up to this are a standstill [m/s]."""
CONFLICT_MARGIN = 0.02
"""Distance of the standing body from conflict areas [m]."""
BATCH = 3
"""So many trajectories are checked for collisions at once, mildest first."""
GAP = 5.0
"""Clearances are measured up to this distance [m]."""


@dataclass(frozen=True, slots=True)
class Margins:
    """How far a fail-safe stays from its bounds: lower bounds, along the whole trajectory.

    `clearance` to the others' occupancies, at most 5 m; `conflict` from the standing body to the
    next conflict area (inf where there is none) [m]; `lateral_acceleration` [m/s^2].
    """

    clearance: float
    conflict: float
    lateral_acceleration: float


@dataclass(frozen=True, slots=True, eq=False)
class FailSafe:
    """A trajectory from t_dec to a standstill, with the strategy that found it.

    `deceleration`: the strongest on it, >= 0 [m/s^2].
    """

    trajectory: Trajectory
    strategy: str
    deceleration: float
    margins: Margins


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
) -> FailSafe | Miss:
    """The mildest fail-safe trajectory that was found, or why none was.

    Args:
        state: (5,) single-track state at `t_dec`.
        t_dec: a multiple of `scene.dt` [s].
        set_based: the set-based prediction, made at time 0. Maneuvers that last longer than it
            are not tried (`fail_safe_horizon`).
        shared: `Surroundings.of(scene, set_based)`, where more than one search is made.

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
    search = _Search(scene, state, t_dec, first, set_based, settings, shared)
    return search.run()


def _first_step(scene: Scene, t_dec: float, prediction: Prediction) -> int:
    if prediction.kind != "set-based":
        raise SettingsError(
            f"a fail-safe maneuver needs a set-based prediction, this one is {prediction.kind}"
        )
    if abs(prediction.dt - scene.dt) > 1e-9:
        raise SettingsError(
            f"the prediction has dt = {prediction.dt} s, the scene {scene.dt} s: predict again"
        )
    first = round(t_dec / scene.dt)
    if first < 0 or abs(first * scene.dt - t_dec) > 1e-6:
        raise SettingsError(f"t_dec = {t_dec} s must be a multiple of dt = {scene.dt} s, >= 0")
    return first


@dataclass(frozen=True, slots=True, eq=False)
class _Candidates:
    """C simulated trajectories, padded with standstill: `count` (C,) steps until they stand."""

    strategy: tuple[str, ...]
    states: Array
    inputs: Array
    count: Ints


@dataclass(frozen=True, slots=True)
class _Failure:
    """Why one candidate failed; `rank` says how near it came to success."""

    rank: tuple[float, ...]
    text: str


class _Search:
    """One search; what has failed so far is kept by strategy."""

    def __init__(
        self,
        scene: Scene,
        state: Array,
        t_dec: float,
        first: int,
        prediction: Prediction,
        settings: Settings,
        shared: Surroundings,
    ) -> None:
        self.scene, self.state, self.t_dec = scene, state, t_dec
        self.settings, self.shared = settings, shared
        self.tau, per_step = fine_step(scene.dt)
        self.speed = max(float(state[SPEED]), 0.0)
        self.most = (prediction.horizon - first) * per_step
        self.levels = strategies.decelerations(settings)
        limits = Limits.of(settings)
        # A vehicle that is too fast already may brake.
        self.limits = replace(limits, v_max=max(limits.v_max, self.speed))
        self.now = strategies.situation(scene, state)
        self.failures: dict[str, _Failure] = {}

    def run(self) -> FailSafe | Miss:
        if self.speed <= STANDING:
            found = self._standing()
            profiles: list[Array] = []
        else:
            found = None
            profiles = strategies.braking(self.speed, self.tau, self.levels, self.most)
            if not profiles:
                self._too_short()
        if found is None and profiles:
            found = self._try(strategies.stopping_aims(self.scene, self.state, self.now), profiles)
        if found is None and profiles:
            distance = max(self._driven(p) for p in profiles)
            found = self._try(
                strategies.evading_aims(self.scene.ego, self.state, self.now, distance), profiles
            )
        if found is None and self.shared.area is not None:
            leaving = self._leaving()
            aims = strategies.stopping_aims(self.scene, self.state, self.now)
            if leaving:
                found = self._try(
                    [replace(a, strategy=strategies.LEAVE) for a in aims if np.isnan(a.target)]
                    + [replace(a, strategy=strategies.LEAVE) for a in aims if a.target == 0.0],
                    leaving,
                )
        if found is not None:
            return found
        return Miss(tuple(f"{name}: {x.text}" for name, x in self.failures.items()))

    def _driven(self, profile: Array) -> float:
        return float(self.tau * (profile[1:] + profile[:-1]).sum() / 2)

    def _standing(self) -> FailSafe | None:
        """Standstill already: no motion at all, if it is outside the conflict areas."""
        away = float(self.shared.from_conflicts(self.state[None])[0])
        if away <= CONFLICT_MARGIN:
            self._failed(strategies.BRAKE, _Failure((0.0,), _in_conflict(self.state)))
            return None
        inputs = np.empty((0, 2))
        trajectory = Trajectory(self.state[None].copy(), inputs, self.tau, self.t_dec)
        margins = Margins(GAP, away, self.settings.a_lat_max)
        return FailSafe(trajectory, strategies.BRAKE, 0.0, margins)

    def _too_short(self) -> None:
        if not len(self.levels):
            text = "a_lon_min allows no braking"
        else:
            text = (
                f"full braking takes {self.speed / self.levels[-1]:.2f} s, the prediction ends "
                f"{self.most * self.tau:.2f} s after the decision"
            )
        self._failed(strategies.BRAKE, _Failure((0.0,), text))

    def _leaving(self) -> list[Array]:
        """Speed profiles that stop just after each conflict area that begins soon."""
        frame = self.now.home.frame
        s0 = float(frame.to_curvilinear(self.state[None, :2])[0, 0])
        half = self.scene.ego.length / 2
        limit = self.scene.speed_limit_at(np.array([s0]))[0]
        top = min(self.limits.v_max, limit if limit is not None else np.inf)
        exits = []
        for area in self.shared.conflicts:
            s = frame.to_curvilinear(area)[:, 0]
            if s.max() > s0 - half and s.min() < s0 + half + self.speed * LONGEST:
                exits.append(float(s.max()) + half + 0.3 - s0)
        profiles = []
        for distance in sorted(exits)[:4]:
            profiles += strategies.leaving(
                self.speed, distance, self.tau, max(top, self.speed), self.levels, self.most
            )
        if not profiles and exits:
            text = "no way out of it in the time predicted"
            self._failed(strategies.LEAVE, _Failure((0.0,), text))
        return profiles

    def _try(self, aims: Sequence[Aim], profiles: Sequence[Array]) -> FailSafe | None:
        """The mildest that holds of all aims with all speed profiles."""
        candidates = self._candidates(aims, profiles)
        if candidates is None:
            return None
        ego = self.scene.ego
        kept = within_limits(candidates.states, candidates.inputs, ego.wheelbase, self.limits)
        for name in sorted({candidates.strategy[i] for i in np.flatnonzero(~kept)}):
            self._failed(name, _Failure((0.0,), "no path within the limits of steering and grip"))
        last = candidates.states[:, -1]
        away = self.shared.from_conflicts(last)
        for i in np.flatnonzero(kept & (away <= CONFLICT_MARGIN)).tolist():
            self._failed(
                candidates.strategy[i],
                _Failure((1.0, float(away[i])), self._how(candidates, i) + _in_conflict(last[i])),
            )
        kept &= away > CONFLICT_MARGIN
        lateral = np.abs(lateral_acceleration(candidates.states, ego.wheelbase))[:, :-1]
        peak = np.hypot(candidates.inputs[..., 0], lateral).max(axis=1)
        rows = np.flatnonzero(kept)
        rows = rows[np.argsort(np.round(peak[rows], 1), kind="stable")]
        # Most that fail do so where they come to stand: a quick look there first.
        ends_free = np.zeros(len(kept), dtype=bool)
        ends_free[rows] = self.shared.ends_free(*self._driven_by(candidates, rows))
        alive = rows[ends_free[rows]]
        for start in range(0, len(alive), BATCH):
            part = alive[start : start + BATCH]
            contacts = self.shared.first_contact(*self._driven_by(candidates, part))
            for i, contact in zip(part.tolist(), contacts.tolist(), strict=True):
                if contact >= 0:
                    self._collides(candidates, i, contact)
                    continue
                n = int(candidates.count[i])
                states, inputs = candidates.states[i, : n + 1], candidates.inputs[i, :n]
                if not self.shared.road.holds(states[None], inputs[None], self.tau, ego)[0]:
                    text = self._how(candidates, i) + "leaves the road"
                    self._failed(candidates.strategy[i], _Failure((3.0, 0.0), text))
                    continue
                gaps = self.shared.gaps(states[None], inputs[None], self.tau, self.t_dec, GAP)
                return FailSafe(
                    Trajectory(states, inputs, self.tau, self.t_dec),
                    candidates.strategy[i],
                    float(max(0.0, -inputs[:, 0].min())),
                    Margins(
                        float(gaps.min()),
                        float(away[i]),
                        float(self.settings.a_lat_max - lateral[i].max()),
                    ),
                )
        self._blame(candidates, rows[~ends_free[rows]])
        return None

    def _driven_by(
        self, candidates: _Candidates, rows: Ints
    ) -> tuple[Array, Array, Ints, float, float]:
        counts = candidates.count[rows]
        n = int(counts.max(initial=1))
        states, inputs = candidates.states[rows, : n + 1], candidates.inputs[rows, :n]
        return states, inputs, counts, self.tau, self.t_dec

    def _blame(self, candidates: _Candidates, rows: Ints) -> None:
        """Say for each strategy when its hardest braking among `rows` collides."""
        hardest: dict[str, int] = {}
        for i in rows.tolist():
            name = candidates.strategy[i]
            if candidates.count[i] <= candidates.count[hardest.get(name, i)]:
                hardest[name] = i
        picked = np.array(list(hardest.values()), dtype=np.int_)
        if len(picked):
            contacts = self.shared.first_contact(*self._driven_by(candidates, picked))
            for i, contact in zip(picked.tolist(), contacts.tolist(), strict=True):
                self._collides(candidates, i, contact)

    def _candidates(self, aims: Sequence[Aim], profiles: Sequence[Array]) -> _Candidates | None:
        most = max(len(p) for p in profiles)
        speeds = np.stack([np.pad(p, (0, most - len(p))) for p in profiles])
        speeds[:, 0] = self.speed
        distance = max(self._driven(p) for p in speeds) + 2.0
        ego = self.scene.ego
        names: list[str] = []
        states, inputs = [], []
        for lane in {id(aim.lane): aim.lane for aim in aims}.values():
            line = guide(lane.frame, self.state, ego.wheelbase, distance)
            mine = [aim for aim in aims if aim.lane is lane]
            if line is not None:
                along = paths(
                    line,
                    np.array([aim.target for aim in mine]),
                    np.array([aim.length for aim in mine]),
                    ego.wheelbase,
                    strategies.room(lane, self.state, distance, ego),
                )
                picked = _distinct(along)
                mine = [mine[i] for i in picked]
                along = replace(along, way=along.way[picked], steering=along.steering[picked])
            if line is None or not mine:
                text = "the lane is too crooked, or not the ego's direction"
                self._failed(aims[0].strategy, _Failure((0.0,), text))
                continue
            x, u = drive(self.state, along, speeds, self.tau, ego.wheelbase)
            states.append(x.reshape(-1, *x.shape[2:]))
            inputs.append(u.reshape(-1, *u.shape[2:]))
            names += [aim.strategy for aim in mine for _ in profiles]
        if not states:
            return None
        count = np.array([len(p) - 1 for p in profiles])
        all_states = np.concatenate(states)
        return _Candidates(
            tuple(names),
            all_states,
            np.concatenate(inputs),
            np.tile(count, len(all_states) // len(count)),
        )

    def _how(self, candidates: _Candidates, i: int) -> str:
        strongest = max(0.0, -float(candidates.inputs[i, :, 0].min()))
        return f"braking with {strongest:.1f} m/s^2 it "

    def _collides(self, candidates: _Candidates, i: int, step: int) -> None:
        time = self.t_dec + step * self.tau
        rank = (2.0, time)
        known = self.failures.get(candidates.strategy[i])
        if known is None or known.rank < rank:
            who = self.shared.nearest(candidates.states[i, step : step + 2], time)
            text = f"{self._how(candidates, i)}may meet obstacle {who} {time:.2f} s from now"
            self._failed(candidates.strategy[i], _Failure(rank, text))

    def _failed(self, strategy: str, failure: _Failure) -> None:
        known = self.failures.get(strategy)
        if known is None or failure.rank > known.rank:
            self.failures[strategy] = failure


def _distinct(along: Paths) -> list[int]:
    """The valid paths, each but once: the first of those that steer alike."""
    known: dict[bytes, int] = {}
    for i in np.flatnonzero(along.valid).tolist():
        known.setdefault(np.round(along.steering[i], 4).tobytes(), i)
    return list(known.values())


def _in_conflict(state: Array) -> str:
    return f"would stand in a conflict area at ({state[0]:.1f}, {state[1]:.1f})"
