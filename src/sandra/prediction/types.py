"""What a prediction is: where each of the others may be, at each step and between steps."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sandra.scene.types import Obstacle, Region

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class PredictedObstacle:
    """One participant.

    `at[k]` are the regions whose union holds the whole body at time t_k, k = 0..h.
    `between[k]` are those for the whole interval [t_k, t_k+1], k = 0..h-1.
    `states` (h+1, 5) x, y, heading, speed, acceleration is the single most likely trajectory that
    rules such as R_G1 refer to; NaN rows where the participant is absent.
    `assumptions` names what was assumed; `dropped` what an observation had already violated.
    """

    obstacle: Obstacle
    at: tuple[tuple[Region, ...], ...]
    between: tuple[tuple[Region, ...], ...]
    states: Array
    assumptions: tuple[str, ...] = ()
    dropped: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True, eq=False)
class Prediction:
    """The prediction of all others over h steps of dt.

    `kind`: "recorded", "most-likely" or "set-based". `notes` says in words what had to be
    assumed, e.g. that a recording ends before the horizon.
    """

    kind: str
    dt: float
    horizon: int
    obstacles: tuple[PredictedObstacle, ...]
    notes: tuple[str, ...] = ()
