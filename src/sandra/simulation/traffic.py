"""Vehicles of highway-env with other parameters: subclasses, so that the library stays as it is.

They are classes of this module because highway-env takes the class of the others as a dotted path
(`other_vehicles_type`).
"""

from __future__ import annotations

from typing import Any

from highway_env.vehicle.behavior import IDMVehicle
from highway_env.vehicle.controller import MDPVehicle


class StockTraffic(IDMVehicle):  # type: ignore[misc]
    """The library's IDM/MOBIL vehicle, unchanged."""


class PaperTraffic(IDMVehicle):  # type: ignore[misc]
    """The others as the paper has them: MOBIL is asked every 2 s (stock: every 1 s)."""

    LANE_CHANGE_DELAY = 2.0


class StockIntersectionTraffic(IDMVehicle):  # type: ignore[misc]
    """Unchanged, for intersections.

    highway-env's intersection writes three IDM parameters into the class that it is given. A class
    of its own keeps them out of all other environments of the process.
    """


class PaperIntersectionTraffic(PaperTraffic):
    """As `PaperTraffic`, for intersections (see `StockIntersectionTraffic`)."""


class MetaEgo(MDPVehicle):  # type: ignore[misc]
    """The library's ego, with one meta-action more: FAIL_SAFE, which is its SLOWER."""

    fail_safe_gain = float(MDPVehicle.KP_A)
    """Gain of the speed controller while FAIL_SAFE is the last action [1/s]."""

    def act(self, action: dict[str, Any] | str | None = None) -> None:
        """Perform a meta-action, or (None) go on with the last one."""
        if action is not None:
            # Of this object only: the class keeps the library's gain.
            self.KP_A = self.fail_safe_gain if action == "FAIL_SAFE" else MDPVehicle.KP_A
        super().act("SLOWER" if action == "FAIL_SAFE" else action)


class PaperEgo(MetaEgo):
    """The paper's ego: FAIL_SAFE is SLOWER with a time constant of 0.2 s instead of 0.6 s.

    The paper's text says that the fail-safe's intensity is increased; the gain is read off the
    authors' recorded run of seed 5838 (it decelerates by up to 25 m/s^2, more than a car can).
    """

    fail_safe_gain = 5.0
