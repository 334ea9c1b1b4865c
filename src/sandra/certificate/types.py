"""The certificate: everything needed to check one decision, as plain data.

It can be checked on another machine, later, without the scenario, by somebody who distrusts
whoever made it. What it cannot show is that its picture of the world was true: where the others
are, where the road runs, and what others are assumed to do is taken from it as given.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from sandra.actions import ActionPair
from sandra.planning.types import Trajectory
from sandra.scene.types import Region
from sandra.settings import Settings

Array = NDArray[np.float64]
Occupancies = tuple[tuple[Region, ...], ...]
"""Entry k: the regions whose union holds the whole body during [t_k, t_k+1]."""

UNLIMITED = ("max_braking", "max_driving")
"""Assumptions that are infinite where nothing is assumed; files may leave them out."""
FORMAT = "sandra-certificate/1"
"""Name and version of the format; a reader refuses any other."""

RELATIONS = ("current", "left", "right", "opposite")
"""Lanes of which formulas can speak, by their relation to the ego."""


@dataclass(frozen=True, slots=True)
class Body:
    """The ego: its rectangle and its wheelbase [m]; the reference point is the centre."""

    id: int
    length: float
    width: float
    wheelbase: float


@dataclass(frozen=True, slots=True, eq=False)
class Pavement:
    """One lanelet: borders (n, 2), (m, 2) [m] in its direction, signed limit [m/s] or None."""

    id: int
    left: Array
    right: Array
    speed_limit: float | None


@dataclass(frozen=True, slots=True)
class LaneOf:
    """A lane by its relation to the ego (see `RELATIONS`): ids of its lanelets in order."""

    relation: str
    lanelets: tuple[int, ...]


@dataclass(frozen=True, slots=True, eq=False)
class Participant:
    """One of the others, with both predictions.

    `states` (h+1, 5): the most likely x, y, heading, speed, acceleration; NaN rows while absent.
    `likely` holds its regions in the prediction that the witness was checked with, `possible`
    those of the set-based prediction, up to the end of the fail-safe trajectory. `assumptions`
    names what the latter assumes, `dropped` what an observation had already violated, `basis`
    what the former rests on.
    """

    id: int
    kind: str
    outline: Region
    is_static: bool
    states: Array
    likely: Occupancies
    possible: Occupancies
    assumptions: tuple[str, ...] = ()
    dropped: tuple[str, ...] = ()
    basis: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True, eq=False)
class Certificate:
    """The claim: the witness satisfies `formula`, and a fail-safe follows from `t_dec` on.

    Seconds count from the decision, step k is at k `dt`. Lengths in m, angles in rad.
    """

    scenario: str
    dt: float
    horizon: int
    ego: Body
    initial: Array
    """(5,) x, y, heading, speed, steering angle at time 0."""
    pair: ActionPair
    rules: tuple[str, ...]
    """Names of rules, or formulas, as they were asked for."""
    formula: str
    """With numbers in place of parameters; `sandra.logic.parse` reads it."""
    parts: tuple[tuple[str, str], ...]
    """(name, formula as the user reads it) of each conjunct."""
    lanes: tuple[LaneOf, ...]
    lanelets: tuple[Pavement, ...]
    """The road near both trajectories, and all lanelets of `lanes`."""
    reference: Array
    """(n, 2) centre line of the current lane: s along it, d to the left of it."""
    conflicts: tuple[Pavement, ...]
    """Lanelets of lanes that cross or lead into the ego's route."""
    obstacles: tuple[Participant, ...]
    prediction: str
    """Kind of the prediction that the witness was checked with."""
    set_based: str
    """Kind of the other prediction; "set-based"."""
    notes: tuple[str, ...]
    """What both predictions had to assume, in words."""
    witness: Trajectory
    t_dec: float
    """When the next decision is due, and the fail-safe would begin [s]."""
    fail_safe: Trajectory
    settings: Settings
    """Bounds, parameters of the rules, and the assumptions on others."""
    vocabulary: Mapping[str, Mapping[str, str]] | None = None
    """Texts of actions, rules and predicates where they are the user's own, else None."""
    note: str = ""
    versions: Mapping[str, str] = field(default_factory=lambda: MappingProxyType({}))
    """Of the packages that made it."""
    format: str = FORMAT
