"""What is driven: a maneuver and how far it has been proven; trajectories and fail-safes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sandra.actions import ActionPair
from sandra.planning.single_track import SPEED, step


@dataclass(frozen=True, slots=True, eq=False)
class Maneuver:
    """What would be executed.

    `kind`: "certified", "reachable" or "fail-safe". `pair` is None for a fail-safe. `states` is
    (n, 5): x [m], y [m], heading [rad], speed [m/s], acceleration [m/s^2], one row per `dt`; the
    acceleration of a row is that applied until the next. `note` says in words what it is, and
    what has not been proven of it. `fail_safe` has the form of `states`, from the time
    `fail_safe_start` [s] on: what is driven if no new decision comes by then; None: there is none.
    `trajectory` is the same with inputs and fine steps; None: only the states were found.
    """

    kind: str
    pair: ActionPair | None
    states: NDArray[np.float64]
    dt: float
    note: str
    fail_safe: NDArray[np.float64] | None = None
    fail_safe_start: float = 0.0
    trajectory: Trajectory | None = None

    def to_dict(self) -> dict[str, str | None]:
        """The `executed` entry of the JSON contract; a fail-safe is no action pair."""
        return {
            "kind": self.kind,
            "longitudinal": self.pair.longitudinal.value if self.pair else None,
            "lateral": self.pair.lateral.value if self.pair else None,
        }


@dataclass(frozen=True, slots=True, eq=False)
class Trajectory:
    """A trajectory of the kinematic single-track model (see `single_track`).

    `states` (n + 1, 5): x, y of the body's centre [m], heading [rad], speed [m/s], steering angle
    [rad], at `start` + i `tau`; `inputs` (n, 2): acceleration [m/s^2] and steering rate [rad/s],
    constant in each step of `tau` seconds.
    """

    states: NDArray[np.float64]
    inputs: NDArray[np.float64]
    tau: float
    start: float = 0.0

    def every(self, dt: float) -> NDArray[np.float64]:
        """(m, 5) x, y, heading, speed, acceleration, one row per `dt`, the last state included.

        `dt` is a multiple of `tau`.
        """
        stride = max(1, round(dt / self.tau))
        index = np.unique(np.append(np.arange(0, len(self.states), stride), len(self.inputs)))
        inputs = np.vstack([self.inputs, self.inputs[-1:], np.zeros((1, 2))])  # if it only stands
        acceleration = inputs[index, 0]
        return np.column_stack([self.states[index, :4], acceleration])

    @property
    def end(self) -> float:
        """Time of the last state [s]."""
        return self.start + self.tau * len(self.inputs)

    def at(self, time: float, wheelbase: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """State (5,) and input (2,) at a time from `start` on [s]; after `end` it stands still.

        Between two states the model is driven on with the input of that step.

        Raises:
            ValueError: before `start`, or after an end at which the speed is not 0.
        """
        place = (time - self.start) / self.tau
        index = int(place + 1e-6)
        if not place > -1e-6:
            raise ValueError(f"the trajectory begins at {self.start:g} s, not at {time:g} s")
        if index >= len(self.inputs):
            last = self.states[-1]
            if time > self.end + 1e-6 and abs(last[SPEED]) > 1e-3:
                raise ValueError(f"the trajectory ends at {self.end:g} s with {last[SPEED]:g} m/s")
            return last, np.zeros(2)
        rest = max(place - index, 0.0) * self.tau
        return step(self.states[index], self.inputs[index], rest, wheelbase), self.inputs[index]


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
