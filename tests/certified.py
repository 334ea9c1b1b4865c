"""Certificates made by hand: keep the lane at 10 m/s, and brake to a standstill as fail-safe."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from reach_scenes import Course
from sandra.actions import ActionPair
from sandra.certificate import Certificate, certificate
from sandra.logic import specification
from sandra.planning.single_track import step
from sandra.planning.types import Trajectory
from sandra.prediction import predict
from sandra.scene.types import Scene
from sandra.settings import Settings

TAU = 0.05
DT = 0.1
HORIZON = 15
RULES = ("R_G1", "R_G2", "R_G3")
WHEELBASE = 2.6


def steady(kappa: float) -> tuple[float, float]:
    """Slip and steering angle of a steady turn of curvature `kappa` [rad]."""
    beta = math.asin(kappa * WHEELBASE / 2)
    return beta, math.atan(2 * math.tan(beta))


def turning_scene(
    kappa: float = 0.0, others: bool = True, leader: float = 40.0, **options: Any
) -> Scene:
    """The ego at 10 m/s on a lane of curvature kappa, one lane to its left, two cars."""
    course = Course(kappa, step=0.5 if kappa else 5.0)
    cars = [course.car(7, leader, 0.0, 10.0), course.car(8, 20.0, 3.5, 10.0)] if others else []
    lanes = course.lanes(left=1, right=0)
    beta, delta = steady(kappa)
    scene = course.scene(lanes, cars, speed=10.0, angle=-beta, **options)
    state = replace(scene.ego.state, steering_angle=delta)
    return replace(scene, ego=replace(scene.ego, state=state))


def drive(start: Sequence[float], inputs: np.ndarray, begin: float = 0.0) -> Trajectory:
    """The model driven with inputs (n, 2) from a state."""
    states = [np.array(start, dtype=float)]
    for row in inputs:
        states.append(step(states[-1], row, TAU, WHEELBASE))
    return Trajectory(np.array(states), inputs, TAU, begin)


def constant(acceleration: float, steps: int, rate: float = 0.0) -> np.ndarray:
    """(steps, 2) constant inputs."""
    return np.tile([acceleration, rate], (steps, 1))


def initial(scene: Scene) -> list[float]:
    s = scene.ego.state
    return [s.x, s.y, s.heading, s.speed, s.steering_angle]


def made(
    scene: Scene | None = None,
    pair: str = "keep,follow-lane",
    rules: tuple[str, ...] = RULES,
    settings: Settings | None = None,
    prediction: str = "most-likely",
    inputs: np.ndarray | None = None,
    stop: np.ndarray | None = None,
    **options: Any,
) -> Certificate:
    """A certificate; the default one is accepted."""
    scene = turning_scene() if scene is None else scene
    settings = Settings() if settings is None else settings
    inputs = constant(0.0, 2 * HORIZON) if inputs is None else inputs
    witness = drive(initial(scene), inputs)
    if stop is None:
        stop = constant(-5.0, round(witness.states[2, 3] / 5.0 / TAU))
    fail_safe = drive(witness.states[2], stop, DT)
    likely = predict(scene, prediction, HORIZON, settings)
    steps = math.ceil(fail_safe.end / DT - 1e-6)
    possible = predict(scene, "set-based", max(1, steps), settings)
    spec = specification(ActionPair.parse(pair), rules, settings, dt=DT)
    return certificate(
        scene, spec, rules, likely, possible, witness, DT, fail_safe, settings, **options
    )
