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

    def follow(self, plan: Trajectory, target_lane: Any, target_speed: float) -> None:
        """Drive this from the next tick on, from its first state on.

        Args:
            target_lane: index of the lane that it leads to, told to the others.
            target_speed: the speed that it leads to [m/s], told to the others.
        """
        self.plan, self.time = plan, 0.0
        self.target_lane_index, self.target_speed = target_lane, target_speed

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
