"""Drivers of recorded traffic: highway-env's own three kinds, each with a desired speed of its own.

Imported only where traffic is recorded: it needs highway-env.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from highway_env.vehicle.behavior import AggressiveVehicle, DefensiveVehicle, IDMVehicle

from sandra.simulation.highway import Environment


class Idm(IDMVehicle):  # type: ignore[misc]
    """The library's IDM/MOBIL vehicle."""


class Aggressive(AggressiveVehicle):  # type: ignore[misc]
    """The library's linear model with its aggressive parameters."""


class Defensive(DefensiveVehicle):  # type: ignore[misc]
    """The library's linear model with its defensive parameters."""


KINDS: dict[str, tuple[type, ...]] = {
    "idm": (Idm,),
    "aggressive": (Aggressive,),
    "defensive": (Defensive,),
    "mixed": (Idm, Aggressive, Defensive),
}
"""By name; of several classes, each vehicle gets one at random."""
SPREAD = (0.8, 1.25)
"""Desired speeds are those of the library times something between these."""
_OF_THE_ROAD = ("is_yielding", "yield_timer", "color")
"""What the rules of highway-env's intersection note on a vehicle."""


def seat(world: Environment, drivers: str, rng: np.random.Generator) -> None:
    """Give every vehicle that has none yet a driver of `KINDS`, the ego too.

    A vehicle keeps its place, state, route and timer; `rng` chooses its class, its desired speed
    and the exponent of its IDM.
    """
    for vehicle in list(world.env.road.vehicles):
        if not isinstance(vehicle, KINDS["mixed"]):
            _replace(world, vehicle, _driver(vehicle, drivers, rng))


def _driver(vehicle: Any, drivers: str, rng: np.random.Generator) -> Any:
    kinds = KINDS[drivers]
    kind: Any = kinds[int(rng.integers(len(kinds)))]
    new = kind.create_from(vehicle)
    new.target_speed = vehicle.target_speed * float(rng.uniform(*SPREAD))
    if kind is Idm:
        new.DELTA = float(rng.uniform(*Idm.DELTA_RANGE))
    else:
        new.collecting_data = False
    for name in _OF_THE_ROAD:
        if hasattr(vehicle, name):
            setattr(new, name, getattr(vehicle, name))
    return new


def _replace(world: Environment, old: Any, new: Any) -> None:
    if old is world.ego:
        world.replace_ego(new)
        return
    vehicles = world.env.road.vehicles
    vehicles[next(i for i, v in enumerate(vehicles) if v is old)] = new
