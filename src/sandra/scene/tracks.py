"""Any recorded vehicle of a CommonRoad file as the ego, from any step on.

The paper (Sec. V): "a vehicle was randomly selected as the ego vehicle, a decision-making problem
was formulated based on its initial state, and the vehicle was subsequently removed". Where the
recording ends tells the route at forks, as a driver knows the way; nothing else of the future is
told.
"""

from __future__ import annotations

import math
import random
from collections.abc import Collection
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from sandra.errors import ScenarioError
from sandra.scene.commonroad import Start, network_of, obstacles_from, scene_from
from sandra.scene.file import Content, read
from sandra.scene.network import Network, lanelets_near
from sandra.scene.obstacles import number
from sandra.scene.types import Ego, Obstacle, Scene, State
from sandra.settings import Settings

Array = NDArray[np.float64]

KINDS = frozenset({"car", "truck", "bus", "taxi", "priorityVehicle", "motorcycle"})
"""Kinds of obstacles that can be the ego."""
_STILL = 0.5
"""Slower than this, a yaw rate tells no steering angle [m/s]."""
_KEPT = 64
"""Steps for which the obstacles of a file are kept."""


@dataclass(frozen=True, slots=True)
class Track:
    """A recorded vehicle: from time step `first` to `last` of the file."""

    id: int
    kind: str
    first: int
    last: int

    def windows(self, horizon: int, stride: int) -> range:
        """The steps from which on `horizon` more are recorded, every `stride`."""
        return range(self.first, self.last - horizon + 1, stride)


class Tracks:
    """A file that is read once, and seen by each of its vehicles.

    Args:
        path: a CommonRoad file. settings: give the share of the wheelbase in a vehicle's length.

    Raises:
        ScenarioError: one line that says why the file cannot be used.
    """

    def __init__(self, path: str | Path, settings: Settings | None = None) -> None:
        self.path = Path(path)
        self._settings = settings or Settings()
        self._content: Content = read(self.path)
        self._at: dict[int, tuple[Obstacle, ...]] = {}

    @property
    def dt(self) -> float:
        """Duration of a time step [s]."""
        return float(self._content.scenario.dt)

    @property
    def name(self) -> str:
        """Of the scenario."""
        id = self._content.scenario.scenario_id
        return self.path.stem if id is None else str(id)

    @cached_property
    def _network(self) -> Network:
        return network_of(self._content)

    @property
    def problem_step(self) -> int:
        """The initial time step of the first planning problem."""
        problem = next(iter(self._content.problems.values()))
        return math.floor(number(problem.initial_state.time_step))

    def all(self, kinds: Collection[str] = KINDS) -> tuple[Track, ...]:
        """The recorded vehicles of some kinds, by ascending id."""
        found = []
        for o in self._content.scenario.dynamic_obstacles:
            trajectory = getattr(o.prediction, "trajectory", None)
            kind = "unknown" if o.obstacle_type is None else str(o.obstacle_type.value)
            if trajectory is None or kind not in kinds:
                continue
            steps = [math.floor(number(x.time_step)) for x in trajectory.state_list]
            steps.append(math.floor(number(o.initial_state.time_step)))
            found.append(Track(o.obstacle_id, kind, min(steps), max(steps)))
        return tuple(sorted(found, key=lambda track: track.id))

    def choose(self, seed: int, horizon: int) -> Track:
        """One vehicle that is recorded for `horizon` steps and more, by a seed.

        The choice depends on the seed, the scenario's name, and who is recorded; on nothing else.

        Raises:
            ScenarioError: there is none.
        """
        enough = [track for track in self.all() if track.windows(horizon, 1)]
        if not enough:
            raise ScenarioError(
                f"{self.path}: no vehicle is recorded for {horizon} steps; choose a shorter horizon"
            )
        return random.Random(f"{seed} {self.name}").choice(enough)

    def scene(self, id: int, step: int) -> Scene:
        """The decision problem of a recorded vehicle at a time step of the file.

        The vehicle is taken out of the obstacles; `recorded_ego` is what it did from there on.

        Raises:
            ScenarioError: it is not recorded at that step, or is off the road there.
        """
        others = self._obstacles(step)
        chosen = next((o for o in others if o.id == id and o.states is not None), None)
        if chosen is None or chosen.states is None or np.isnan(chosen.states[0, 0]):
            known = ", ".join(f"{t.id} ({t.first}-{t.last})" for t in self.all()) or "none"
            raise ScenarioError(
                f"{self.path}: vehicle {id} is not recorded at step {step}; recorded are {known}"
            )
        states = chosen.states
        share = self._settings.ego_wheelbase / self._settings.ego_length
        wheelbase = share * chosen.length
        state = _state(states[0], self._heading(id, step - 1), self.dt, wheelbase)
        ego = Ego(id, state, chosen.length, chosen.width, wheelbase)
        seen = states[~np.isnan(states[:, 0])]
        goals = lanelets_near(self._network, float(seen[-1, 0]), float(seen[-1, 1]))
        start = Start(
            ego, step, tuple(o for o in others if o is not chosen), states, frozenset(goals)
        )
        try:
            return scene_from(self._content, self._network, start, self.path)
        except ScenarioError as error:
            raise ScenarioError(f"{self.path}: {error}") from None

    def _obstacles(self, step: int) -> tuple[Obstacle, ...]:
        """All obstacles from a step on; kept, since several vehicles are asked about at it."""
        if step not in self._at:
            if len(self._at) >= _KEPT:
                del self._at[next(iter(self._at))]
            self._at[step] = obstacles_from(self._content, step)
        return self._at[step]

    def _heading(self, id: int, step: int) -> float:
        """Of a vehicle at a step [rad]; NaN where it is not recorded."""
        vehicle = self._content.scenario.obstacle_by_id(id)
        state = vehicle.state_at_time(step)
        return number(getattr(state, "orientation", None))


def _state(row: Array, before: float, dt: float, wheelbase: float) -> State:
    """The row; the yaw rate from the heading a step before, the steering from that.

    Not from the heading a step later: the driver's next move must not be told. At the first step
    of a recording the yaw rate is not known, and 0.
    """
    x, y, heading, speed, acceleration = (float(v) for v in np.nan_to_num(row))
    turn = 0.0 if math.isnan(before) else heading - before
    yaw_rate = ((turn + math.pi) % (2 * math.pi) - math.pi) / dt
    moving = abs(speed) > _STILL
    steering = math.atan(wheelbase * yaw_rate / speed) if moving else 0.0
    return State(x, y, heading, max(speed, 0.0), acceleration, steering, yaw_rate)
