"""What came of the rollouts of one certificate."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]


@dataclass(frozen=True, slots=True)
class Event:
    """Something that should not be: enough to play it again.

    `what`: "collision", or "after a cut-in" where the other had entered the ego's lane legally
    after the decision. `avoided`: for the latter, whether braking with `a_min` after `t_d` avoids
    it. `time` [s].
    """

    what: str
    rollout: int
    kind: str
    obstacle: int
    obstacle_kind: str
    time: float
    speed: float
    avoided: bool = False


@dataclass(frozen=True, slots=True, eq=False)
class Played:
    """All rollouts of one certificate.

    `kind` (B,) index into `KINDS`; `distance` (B,) smallest to any admissible other [m];
    `admissible` (B,) whether every other kept what is assumed of it; `events`; `breaches` which
    assumption was broken by how many vehicles; `rules` the rules that the ego broke; `shortfalls`
    rollouts in which R_G1 fell short because of what another did; `cut_ins` legal ones before the
    ego; `others` how many were played; `duration` [s]; `deviation` of the executed from the
    claimed motion [m].
    """

    kind: Ints
    distance: Array
    admissible: Bools
    events: tuple[Event, ...]
    breaches: dict[str, int]
    rules: tuple[str, ...]
    shortfalls: int
    cut_ins: int
    others: int
    duration: float
    deviation: float
