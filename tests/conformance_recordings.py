"""Recordings that break exactly one assumption each."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from monitor_roads import car, rows
from reach_scenes import Course
from sandra.evaluation.conformance import Conformance, conformance
from sandra.scene.types import Obstacle, Scene
from sandra.settings import Assumptions, Settings

ROAD = Course()
DT = 0.2
N = 16
T = DT * np.arange(N)


def recorded(*others: Obstacle, ego: np.ndarray | None = None) -> Scene:
    """Three lanes of one direction, from right to left 99, 100, 101; the ego in the middle one."""
    scene = ROAD.scene(ROAD.lanes(1, 1, end=400.0), others, dt=DT)
    right, middle, left = (next(x for x in scene.lanelets if x.id == i) for i in (99, 100, 101))
    lanelets = (
        replace(middle, adjacent_left=(101, True), adjacent_right=(99, True)),
        replace(left, adjacent_right=(100, True)),
        replace(right, adjacent_left=(100, True)),
    )
    return replace(scene, lanelets=lanelets, recorded_ego=ego)


def calm(number: int = 7, s: float = 0.0, d: float = 0.0, v: float = 10.0) -> Obstacle:
    """A car that goes straight on."""
    return car(ROAD, number, rows(ROAD, s + v * T, d, v))


def changing(acceleration: float = 0.0, start: float = 10.0) -> np.ndarray:
    """Positions and speeds under a constant acceleration, exactly."""
    return rows(ROAD, start * T + acceleration * T**2 / 2, 0.0, start + acceleration * T)


def sideways(speed: float) -> np.ndarray:
    """From the middle of the lane to that of the left one at a constant lateral speed."""
    d = np.minimum(speed * T, 3.5)
    moving = np.append(np.diff(d) > 0, False)
    turn = np.where(moving, math.asin(speed / 20.0), 0.0)
    return rows(ROAD, 20.0 * T, d, 20.0, turn)


def turning(step: float) -> np.ndarray:
    """The body turns by `step` [rad] once and back, while it drives on."""
    turn = np.where(np.arange(N) == 5, step, 0.0)
    return rows(ROAD, 2.0 * T, 0.0, 2.0, turn)


def behind(speed: float) -> tuple[Obstacle, ...]:
    """One that drives into a standing one: its front reaches the other's rear at s = 4.5."""
    return calm(8, 9.0, v=0.0), car(ROAD, 7, rows(ROAD, speed * T - 1.0, 0.0, speed))


def entering(gap: float, v: float = 10.0) -> tuple[Obstacle, ...]:
    """One that enters the lane of another, `gap` before it, within its lateral bound."""
    d = np.clip(3.5 - 2.0 * (T - 0.4), 0.0, 3.5)
    turn = np.append(np.where(np.diff(d) < 0.0, -math.asin(2.0 / v), 0.0), 0.0)
    return calm(8, v=v), car(ROAD, 7, rows(ROAD, gap + 4.5 + v * T, d, v, turn))


CORNER = 2.25 * math.cos(math.asin(0.2)) + 0.9 * 0.2 - 2.25
"""The rear corner of a car that is turned by asin(0.2) is so much nearer [m]."""
LOOSE = Assumptions(max_slip_angle=1.0, max_acceleration=1000.0, max_braking=5.0, max_driving=3.0)
"""Bounds of which a recording breaks what it is to break, and nothing else."""

BREAKS: dict[str, tuple[Callable[[], tuple[Obstacle, ...]], Assumptions, float]] = {
    # assumption: (who, under which assumptions, worst value)
    "max_acceleration": (
        lambda: (car(ROAD, 7, changing(2.0)),),
        Assumptions(max_acceleration=1.9),
        2.0,
    ),
    "max_braking": (
        lambda: (car(ROAD, 7, changing(-3.0, 15.0)),),
        Assumptions(max_braking=2.9),
        3.0,
    ),
    "max_driving": (lambda: (car(ROAD, 7, changing(3.0)),), Assumptions(max_driving=2.9), 3.0),
    "max_speed": (lambda: (calm(v=50.5),), Assumptions(), 50.5),
    "no_reversing": (lambda: (calm(s=30.0, v=-1.0),), Assumptions(), 1.0),
    "stay_on_carriageway": (
        lambda: (car(ROAD, 7, rows(ROAD, 10.0 * T, 5.0 + 0.1 * np.arange(N), 10.0, 0.05)),),
        replace(LOOSE, max_overhang=10.0, follow_lanes=False),
        1.25,
    ),
    "max_lateral_speed": (lambda: (car(ROAD, 7, sideways(4.1)),), LOOSE, 4.1),
    "no_rear_end": (lambda: behind(5.0), Assumptions(), 5.0),
    "legal_cut_in": (lambda: entering(6.0), LOOSE, 8.0 + 1.0 / 6.0 - 6.0 + CORNER),
    "max_overhang": (lambda: (calm(d=4.75),), Assumptions(), 0.4),
    "min_turning_radius": (lambda: (car(ROAD, 7, turning(0.15)),), LOOSE, 0.4 / 0.149),
    "max_slip_angle": (
        lambda: (
            car(ROAD, 7, rows(ROAD, 10.0 * T, 0.0, 10.0, np.where(np.arange(N) < 8, 0.0, 0.15))),
        ),
        Assumptions(max_acceleration=1000.0),
        0.15,
    ),
}


def judged(
    *others: Obstacle, assumptions: Assumptions | None = None, **options: Any
) -> Conformance:
    chosen = Settings(assumptions=assumptions or Assumptions())
    return conformance([recorded(*others)], chosen, **options)
