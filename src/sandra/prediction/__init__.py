"""Where the others may be: recorded, most likely, or every behaviour that assumptions allow.

`predict` is the way in (paper Sec. III-E).
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from sandra.errors import SettingsError
from sandra.prediction.bodies import with_bodies
from sandra.prediction.checks import check_prediction, check_scene
from sandra.prediction.most_likely import trajectories
from sandra.prediction.set_based import predict_sets
from sandra.prediction.types import PredictedObstacle, Prediction
from sandra.scene.types import Scene
from sandra.settings import Settings

__all__ = ["KINDS", "PredictedObstacle", "Prediction", "PredictionSource", "Predictor", "predict"]

Array = NDArray[np.float64]

KINDS = ("recorded", "most-likely", "constant-velocity", "set-based")

Predictor = Callable[[Scene, int, Settings], Prediction]
"""A prediction of the user's own: (scene, horizon, settings) -> Prediction."""

PredictionSource = str | Prediction | Predictor
"""Whatever `predict` makes a prediction of: a kind, a finished one, or a predictor."""


def predict(
    scene: Scene,
    kind: PredictionSource = "most-likely",
    horizon: int = 25,
    settings: Settings | None = None,
    *,
    instants: bool = True,
    near: Array | None = None,
) -> Prediction:
    """Predict all other participants over `horizon` steps of `scene.dt`.

    Args:
        scene: the scene; its time step 0 is now.
        kind: "recorded" (what the file holds), "most-likely" (recorded where the file has a
            recording, else constant velocity along the lane), "constant-velocity" (along the
            lane), "set-based" (every behaviour under `settings.assumptions`), a `Prediction`
            made elsewhere, or a callable that makes one.
        horizon: number of steps h >= 1.
        settings: the assumptions of the set-based prediction; default `Settings()`.
        instants: False where only regions between the steps are asked for: set-based regions at
            the steps are then those of the step before, and cost nothing.
        near: (h,) distances from the ego's present position [m], ascending. The set-based region
            of whoever cannot come as near in a step is only a disc, which holds whatever it may
            do; needs `instants` False.

    Returns:
        The prediction; `notes` says in words what had to be assumed.

    Raises:
        SettingsError: unknown kind, horizon < 1, or a prediction that does not fit.
        ScenarioError: NaN or infinite values in the scene.
    """
    settings = settings if settings is not None else Settings()
    if isinstance(horizon, bool) or not isinstance(horizon, int) or horizon < 1:
        raise SettingsError(f"horizon = {horizon!r} must be an integer >= 1")
    check_scene(scene)
    if isinstance(kind, Prediction):
        return check_prediction(kind, scene, horizon)
    if callable(kind):
        return check_prediction(kind(scene, horizon, settings), scene, horizon)
    if near is not None and (instants or np.shape(near) != (horizon,)):
        raise SettingsError(f"near needs one distance for each of {horizon} steps, and no instants")
    if kind not in KINDS:
        raise SettingsError(f"unknown prediction {kind!r}: choose from {', '.join(KINDS)}")
    likely, notes = trajectories(scene, horizon, use_recordings=kind != "constant-velocity")
    if kind == "set-based":
        notes = tuple(f"most likely trajectories: {note}" for note in notes)
        obstacles, more = predict_sets(scene, likely, horizon, settings, instants, near)
        return Prediction(kind, scene.dt, horizon, obstacles, notes + more)
    return Prediction(kind, scene.dt, horizon, with_bodies(likely, scene.dt), notes)
