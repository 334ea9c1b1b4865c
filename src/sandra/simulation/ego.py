"""The ego of a simulation that drives a planned trajectory, at every tick.

The trajectory is one of the kinematic single-track model (`sandra.planning.Trajectory`), that of
the certificate; between its grid points the same model is integrated, so what is driven is what was
certified. To the other traffic the ego is a car like any other: it has a target lane and a target
speed, which their lane-change model asks for.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from highway_env.vehicle.controller import ControlledVehicle
from highway_env.vehicle.kinematics import Vehicle
from numpy.typing import NDArray

from sandra.planning import Trajectory

Array = NDArray[np.float64]

LOOK_AHEAD = 1.0
"""The speed that a plan has after so long is told to the others as the ego's target [s]."""


class PlannedVehicle(ControlledVehicle):  # type: ignore[misc]
    """A vehicle of highway-env that follows a `Trajectory`; without one it keeps its state.

    Positions of the trajectory are those of `sandra.scene` (y to the left), the vehicle's own those
    of highway-env (y to the right).
    """

    crashed: bool
    impact: Any
    plan: Trajectory | None = None
    time = 0.0
    """Since the trajectory began [s]."""

    @classmethod
    def create_from(cls, vehicle: Any) -> PlannedVehicle:
        """Another vehicle in the same state, which has not been steered yet."""
        new: PlannedVehicle = super().create_from(vehicle)
        new.action = {"steering": 0.0, "acceleration": 0.0}
        return new

    def follow(self, plan: Trajectory) -> None:
        """Drive this from the next tick on, from its first state on.

        The lane that it leads to and the speed that it aims at are the vehicle's targets, as the
        others may know them.
        """
        self.plan, self.time = plan, 0.0
        x, y, heading = plan.states[-1, :3].tolist()
        network = self.road.network
        self.target_lane_index = network.get_closest_lane_index(np.array([x, -y]), -heading)
        index = min(round(LOOK_AHEAD / plan.tau), len(plan.states) - 1)
        self.target_speed = float(plan.states[index, 3])

    @property
    def deviation(self) -> float:
        """Distance between where it is and where its plan has it now [m]; 0 without a plan."""
        if self.plan is None:
            return 0.0
        state, _ = self.plan.at(self.plan.start + self.time, self.LENGTH)
        return float(np.hypot(self.position[0] - state[0], -self.position[1] - state[1]))

    def act(self, action: Any = None) -> None:
        """Nothing: what is driven is the plan."""

    def step(self, dt: float) -> None:
        """One tick along the plan; a crashed vehicle slides on as every one of highway-env does."""
        if self.crashed or self.plan is None:
            Vehicle.step(self, dt)
            return
        self.time += dt
        state, inputs = self.plan.at(self.plan.start + self.time, self.LENGTH)
        x, y, heading, speed, steering = state.tolist()
        self.position = np.array([x, -y])
        self.heading, self.speed = -heading, speed
        self.action = {"steering": -steering, "acceleration": float(inputs[0])}
        if self.impact is not None:
            self.position = self.position + self.impact
            self.crashed, self.impact = True, None
        self.on_state_update()
