"""Bad input is refused before anything is predicted, with one line that says how to mend it."""

from __future__ import annotations

import math

import numpy as np

from sandra.errors import ScenarioError, SettingsError
from sandra.prediction.types import Prediction
from sandra.scene.types import Obstacle, Scene


def check_scene(scene: Scene) -> None:
    """Raises `ScenarioError` if the time step, the ego or an obstacle is not usable."""
    if not (math.isfinite(scene.dt) and scene.dt > 0):
        raise ScenarioError(f"{scene.name}: dt = {scene.dt} s must be a finite number > 0")
    ego = scene.ego.state
    if not all(math.isfinite(v) for v in (ego.x, ego.y, ego.heading, ego.speed)):
        raise ScenarioError(f"{scene.name}: the ego's state is NaN or infinite; correct it")
    for obstacle in scene.obstacles:
        check_obstacle(obstacle)


def check_obstacle(obstacle: Obstacle) -> None:
    """Raises `ScenarioError` if a state, a shape or a recording is not finite."""
    s = obstacle.state
    name = f"obstacle {obstacle.id}"
    values = [s.x, s.y, s.heading, *([s.speed] if obstacle.speed_is_known else [])]
    if not all(math.isfinite(v) for v in values):
        raise ScenarioError(f"{name}: its state is NaN or infinite; correct or remove it")
    if not np.isfinite(obstacle.outline.vertices).all() or not (
        0.0 <= obstacle.outline.radius < math.inf
    ):
        raise ScenarioError(f"{name}: its shape is NaN or infinite; correct or remove it")
    if obstacle.states is not None:
        rows = np.asarray(obstacle.states, dtype=float)
        if rows.ndim != 2 or rows.shape[1] != 5:
            raise ScenarioError(f"{name}: its recording has shape {rows.shape}, not (n, 5)")
        core = rows[:, :4]
        partly = np.isfinite(core).any(axis=1) & ~np.isfinite(core).all(axis=1)
        if partly.any() or np.isinf(rows).any():
            step = int((partly | np.isinf(rows).any(axis=1)).argmax())
            raise ScenarioError(
                f"{name}: its recording is NaN or infinite at step {step}; correct or remove it"
            )
    for k, regions in enumerate(obstacle.occupancies or ()):
        if not all(np.isfinite(r.vertices).all() and 0 <= r.radius < math.inf for r in regions):
            raise ScenarioError(f"{name}: its recorded occupancy at step {k} is not finite")


def check_prediction(prediction: object, scene: Scene, horizon: int) -> Prediction:
    """A prediction from outside, if it fits the scene and the horizon.

    Raises:
        SettingsError: if it is no `Prediction`, has another time step, too few steps, or
            obstacles whose lists of regions do not have h+1 and h entries.
    """
    if not isinstance(prediction, Prediction):
        raise SettingsError(
            f"the prediction is a {type(prediction).__name__}: give a sandra Prediction"
        )
    if not math.isclose(prediction.dt, scene.dt, rel_tol=1e-9):
        raise SettingsError(
            f"the prediction has dt = {prediction.dt} s, the scene {scene.dt} s: predict again"
        )
    if prediction.horizon != horizon:
        raise SettingsError(
            f"the prediction has {prediction.horizon} steps, {horizon} are asked for: "
            f"predict again, or use horizon = {prediction.horizon}"
        )
    for each in prediction.obstacles:
        shape = (len(each.at), len(each.between), np.shape(each.states))
        if shape != (horizon + 1, horizon, (horizon + 1, 5)):
            raise SettingsError(
                f"the prediction of obstacle {each.obstacle.id} has len(at), len(between), "
                f"states.shape = {shape}; they must be {(horizon + 1, horizon, (horizon + 1, 5))}"
            )
        for regions in (*each.at, *each.between):
            for region in regions:
                vertices = np.asarray(region.vertices)
                if (
                    vertices.ndim != 2
                    or vertices.shape[1:] != (2,)
                    or not len(vertices)
                    or not np.isfinite(vertices).all()
                    or not 0.0 <= region.radius < math.inf
                ):
                    raise SettingsError(
                        f"the prediction of obstacle {each.obstacle.id} holds a region that is "
                        "not finite, or has no vertices of shape (n, 2): correct it"
                    )
    return prediction
