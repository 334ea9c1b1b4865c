"""One recording: how much of each assumption every vehicle needs, and where it is broken."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sandra.evaluation.conformance.law import law
from sandra.evaluation.conformance.motion import motion
from sandra.evaluation.conformance.recording import Recording
from sandra.evaluation.conformance.road import Map, on_road
from sandra.prediction.observed import BACKWARDS
from sandra.settings import Assumptions, Settings

Array = NDArray[np.float64]
Bools = NDArray[np.bool_]

TOLERANCE = 1e-6

SWITCHES = {
    "no_reversing": BACKWARDS,
    "stay_on_carriageway": 0.0,
    "follow_lanes": 0.0,
    "no_rear_end": 0.0,
    "legal_cut_in": 0.0,
}
"""Assumptions that hold or do not, and how much is allowed."""
UNITS = {
    "max_acceleration": "m/s^2",
    "max_braking": "m/s^2",
    "max_driving": "m/s^2",
    "max_speed": "m/s",
    "no_reversing": "m/s",
    "stay_on_carriageway": "m",
    "follow_lanes": "m",
    "max_lateral_speed": "m/s",
    "no_rear_end": "m/s",
    "legal_cut_in": "m",
    "max_overhang": "m",
    "min_turning_radius": "m",
    "max_slip_angle": "rad",
    "pedestrian_max_speed": "m/s",
    "pedestrian_max_acceleration": "m/s^2",
}
"""Everything that is measured, in the order of the report. `bounded_heading` is
`min_turning_radius` and `max_slip_angle` together."""
NEEDS = {
    "max_overhang": "stay_on_carriageway",
    "max_lateral_speed": "follow_lanes",
    "min_turning_radius": "bounded_heading",
    "max_slip_angle": "bounded_heading",
}
"""Bounds that count only where a switch is on."""


@dataclass(frozen=True, slots=True)
class Where:
    """The place of a worst value: `file`, vehicle, step."""

    file: str
    vehicle: int
    step: int

    def __str__(self) -> str:
        return f"{self.file}, vehicle {self.vehicle}, step {self.step}"


@dataclass(frozen=True, slots=True)
class Finding:
    """One assumption over one or more recordings.

    `worst` is the largest value that occurred, in `UNITS`; of `min_turning_radius` the smallest
    (inf: nobody turned), of switches how far it was broken. NaN where nothing was looked at.
    """

    name: str
    vehicles: int
    steps: int
    broken_vehicles: int
    broken_steps: int
    worst: float
    where: Where | None

    def and_(self, other: Finding) -> Finding:
        """Both together."""
        mine, theirs = (demand(x.name, x.worst) for x in (self, other))
        first = math.isnan(theirs) or mine >= theirs
        return Finding(
            self.name,
            self.vehicles + other.vehicles,
            self.steps + other.steps,
            self.broken_vehicles + other.broken_vehicles,
            self.broken_steps + other.broken_steps,
            self.worst if first else other.worst,
            self.where if first else other.where,
        )


def demand(name: str, value: float) -> float:
    """The value as something of which more is worse: a radius as its curvature."""
    if name != "min_turning_radius":
        return value
    return math.inf if value == 0.0 else 1.0 / value


def amounts(
    r: Recording, settings: Settings, towards: str, noise: float
) -> tuple[dict[str, Array], int]:
    """By name (m, n) how much is needed (a curvature for the radius), and who is off the lanes."""
    road = Map(r.scene.lanelets)
    driven, off = on_road(r, road, noise)
    return {**motion(r, noise), **driven, **law(r, road, settings, towards)}, off


def allowed(name: str, a: Assumptions) -> float:
    """Up to which amount an assumption is kept; inf where it is switched off."""
    if name in SWITCHES:
        return SWITCHES[name] if getattr(a, name) else math.inf
    switch = NEEDS.get(name)
    if switch is not None and not getattr(a, switch):
        return math.inf
    return demand(name, float(getattr(a, name)))


def broken(values: dict[str, Array], a: Assumptions) -> dict[str, Bools]:
    """By name (m, n) where an assumption is broken."""
    with np.errstate(invalid="ignore"):
        return {name: values[name] > allowed(name, a) + TOLERANCE for name in UNITS}


def findings(r: Recording, file: str, values: dict[str, Array], a: Assumptions) -> list[Finding]:
    """One finding for each assumption, in the order of `UNITS`."""
    found = []
    for name, mask in broken(values, a).items():
        here = values[name]
        told = np.isfinite(here) | (here == np.inf)
        worst, where = math.nan, None
        if told.any():
            row, step = np.unravel_index(int(np.nanargmax(here)), here.shape)
            worst = float(here[row, step])
            where = Where(file, r.ids[int(row)], int(step) * r.stride)
            if name == "min_turning_radius":
                worst = math.inf if worst == 0.0 else 1.0 / worst
        found.append(
            Finding(
                name,
                int(told.any(axis=1).sum()),
                int(told.sum()),
                int(mask.any(axis=1).sum()),
                int(mask.sum()),
                worst,
                where,
            )
        )
    return found
