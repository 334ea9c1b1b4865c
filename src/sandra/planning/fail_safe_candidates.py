"""The candidates of a fail-safe search: lateral aims with speed profiles, driven with the model."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from sandra.planning import strategies
from sandra.planning.lane_paths import Paths, drive, guide, paths
from sandra.planning.limits import Limits
from sandra.planning.single_track import SPEED
from sandra.planning.strategies import Aim, Situation
from sandra.planning.surroundings import Surroundings
from sandra.planning.tracking import fine_step
from sandra.scene.types import Scene
from sandra.settings import Settings

if TYPE_CHECKING:
    from collections.abc import Sequence

Array = NDArray[np.float64]
Ints = NDArray[np.int_]


@dataclass(frozen=True, slots=True, eq=False)
class Task:
    """What one search is given: from `state` (5,) at `t_dec` [s] to a standstill.

    `first`: the interval of the prediction that begins at t_dec; `steps`: so many intervals are
    predicted from there on. Each is `per_step` fine steps of `tau` [s]. `levels` (n,) are the
    decelerations to try [m/s^2].
    """

    scene: Scene
    state: Array
    t_dec: float
    first: int
    steps: int
    settings: Settings
    shared: Surroundings
    tau: float
    per_step: int
    speed: float
    limits: Limits
    levels: Array
    now: Situation

    @staticmethod
    def of(
        scene: Scene,
        state: Array,
        t_dec: float,
        first: int,
        steps: int,
        settings: Settings,
        shared: Surroundings,
    ) -> Task:
        """Prepare a search."""
        tau, per_step = fine_step(scene.dt)
        speed = max(float(state[SPEED]), 0.0)
        limits = Limits.of(settings)
        return Task(
            scene,
            state,
            t_dec,
            first,
            steps,
            settings,
            shared,
            tau,
            per_step,
            speed,
            # A vehicle that is too fast already may brake.
            replace(limits, v_max=max(limits.v_max, speed)),
            strategies.decelerations(settings),
            strategies.situation(scene, state),
        )

    @property
    def most(self) -> int:
        """Fine steps until the prediction ends."""
        return self.steps * self.per_step

    @property
    def top(self) -> float:
        """No maneuver becomes faster than this: the limit where the ego is, or its speed [m/s]."""
        frame = self.now.home.frame
        s = frame.to_curvilinear(self.state[None, :2])[:1, 0]
        limit = self.scene.speed_limit_at(s)[0]
        return max(min(self.limits.v_max, limit if limit is not None else np.inf), self.speed)

    def driven(self, profile: Array) -> float:
        """Distance that a speed profile (n + 1,) drives [m]."""
        return float(self.tau * (profile[1:] + profile[:-1]).sum() / 2)


@dataclass(frozen=True, slots=True, eq=False)
class Attempt:
    """Each of these aims with each of these speed profiles.

    `profiles`: speeds at the fine grid points from t_dec on, the last one 0 [m/s]. `distance`:
    paths are laid out over so much [m]; default what the profiles need.
    """

    aims: Sequence[Aim]
    profiles: Sequence[Array]
    distance: float | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Candidates:
    """C simulated trajectories, padded with standstill: `count` (C,) steps until they stand.

    `states` (C, n + 1, 5), `inputs` (C, n, 2).
    """

    strategy: tuple[str, ...]
    states: Array
    inputs: Array
    count: Ints

    def __len__(self) -> int:
        return len(self.strategy)

    def part(self, rows: Ints) -> tuple[Array, Array, Ints]:
        """States, inputs and counts of some, no longer than the longest of them."""
        counts = self.count[rows]
        n = int(counts.max(initial=1))
        return self.states[rows, : n + 1], self.inputs[rows, :n], counts


def lateral_paths(
    task: Task, aims: Sequence[Aim], distance: float
) -> list[tuple[list[Aim], Paths | None]]:
    """For each lane, the aims there that lead to different paths, and these (`distance` [m]).

    None where the lane is too crooked, or leads elsewhere than the ego.
    """
    ego = task.scene.ego
    found: list[tuple[list[Aim], Paths | None]] = []
    for lane in {id(aim.lane): aim.lane for aim in aims}.values():
        mine = [aim for aim in aims if aim.lane is lane]
        line = guide(lane.frame, task.state, ego.wheelbase, distance)
        if line is None:
            found.append((mine, None))
            continue
        along = paths(
            line,
            np.array([aim.target for aim in mine]),
            np.array([aim.length for aim in mine]),
            ego.wheelbase,
            strategies.room(lane, task.state, distance, ego),
        )
        picked = _distinct(along)
        if not picked:
            found.append((mine, None))
            continue
        found.append(([mine[i] for i in picked], along.only(picked)))
    return found


def _distinct(along: Paths) -> list[int]:
    """The valid paths, each but once: the first of those that steer alike."""
    known: dict[bytes, int] = {}
    for i in np.flatnonzero(along.valid).tolist():
        known.setdefault(np.round(along.steering[i], 4).tobytes(), i)
    return list(known.values())


def simulate(task: Task, attempts: Sequence[Attempt]) -> tuple[Candidates | None, set[str]]:
    """All that is attempted, driven; and the strategies that found no path in some lane.

    None if there is nothing to drive.
    """
    attempts = [each for each in attempts if each.aims and each.profiles]
    most = max((len(p) for each in attempts for p in each.profiles), default=0)
    names: list[str] = []
    states, inputs, counts = [], [], []
    pathless = set()
    for attempt in attempts:
        speeds = np.stack([np.pad(p, (0, most - len(p))) for p in attempt.profiles])
        speeds[:, 0] = task.speed
        distance = attempt.distance
        if distance is None:
            distance = max(task.driven(p) for p in speeds) + 2.0
        for mine, along in lateral_paths(task, attempt.aims, distance):
            if along is None:
                pathless.add(attempt.aims[0].strategy)
                continue
            x, u = drive(task.state, along, speeds, task.tau, task.scene.ego.wheelbase)
            states.append(x.reshape(-1, *x.shape[2:]))
            inputs.append(u.reshape(-1, *u.shape[2:]))
            names += [aim.strategy for aim in mine for _ in attempt.profiles]
            counts += [len(p) - 1 for _ in mine for p in attempt.profiles]
    if not states:
        return None, pathless
    return Candidates(
        tuple(names), np.concatenate(states), np.concatenate(inputs), np.array(counts)
    ), pathless
