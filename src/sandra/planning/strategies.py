"""What a fail-safe maneuver may try: where to go across the lane, and how to brake.

An `Aim` is a lateral goal with the name of its strategy; a speed profile goes down to 0. Which
combination is safe, and which of those the mildest, is decided in `fail_safe_checks`.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import ceil, sqrt

import numpy as np
from numpy.typing import NDArray

from sandra.planning.bounds import within
from sandra.planning.single_track import HEADING, SPEED, STEERING
from sandra.scene.types import Ego, Lane, Scene
from sandra.settings import Settings

Array = NDArray[np.float64]

BRAKE = "brake in the lane"
COMPLETE = "complete the lane change"
ABORT = "abort the lane change"
EVADE = "evade within the lane"
LEAVE = "leave the conflict area"
OPTIMISE = "optimise the speed"

MILDEST = 2.0
"""The mildest deceleration that is tried [m/s^2]."""
LEVELS = 5
"""Number of decelerations from the mildest to full braking."""
INNER = 2e-3
"""Full braking stays this far within the bound [m/s^2]."""
DURATIONS = (1.0, 1.6, 2.4, 3.4)
"""A lateral offset is reached within so many seconds at the present speed [s]."""
SHORTEST = 4.0
"""... but over no less than this [m]."""
TO_EDGE = 0.1
"""Distance from the lane's edge when evading [m]."""
TOUCH = 0.05
"""A body that is so far over the edge of its lane is changing lanes [m]."""
SIDEWAYS = 0.3
"""A body that moves so fast across its lane is changing lanes [m/s]."""
SPEED_UP = (0.0, 1.5, 3.0)
"""Accelerations tried for leaving a conflict area [m/s^2]."""


@dataclass(frozen=True, slots=True, eq=False)
class Aim:
    """Come to offset `target` [m] from the centre of `lane` over `length` [m]; NaN: straighten."""

    strategy: str
    lane: Lane
    target: float
    length: float


@dataclass(frozen=True, slots=True)
class Situation:
    """Where the body is across the lanes: its own lane, and those that it is coming from or to."""

    home: Lane
    changing: tuple[Lane, ...]


def situation(scene: Scene, state: Array) -> Situation:
    """The lane that holds the body's centre, and neighbours it touches or moves towards.

    Args:
        state: (5,) single-track state.
    """
    lanes = [x for x in (scene.current, scene.left, scene.right) if x is not None]
    place = {id(lane): lane.frame.to_curvilinear(state[None, :2])[0] for lane in lanes}
    there = [x for x in lanes if within(place[id(x)][0], 0.0, x.frame.length)] or [scene.current]
    home = min(there, key=lambda x: abs(float(place[id(x)][1])))
    s, d = place[id(home)].tolist()
    right, left = edges(home, s, s)
    relative = state[HEADING] - float(home.frame.heading(np.array([s]))[0])
    course = relative + np.arctan(np.tan(state[STEERING]) / 2)
    sideways = state[SPEED] * np.sin(course)
    half = (abs(np.sin(relative)) * scene.ego.length + abs(np.cos(relative)) * scene.ego.width) / 2
    changing = []
    for lane in there:
        if lane is home:
            continue
        # Where that lane is, seen from this one.
        station = np.array([[place[id(lane)][0], 0.0]])
        offset = float(home.frame.to_curvilinear(lane.frame.to_cartesian(station))[0, 1])
        if _changes(d, half, sideways, (right, left), offset):
            changing.append(lane)
    return Situation(home, tuple(changing))


def _changes(
    d: float, half: float, sideways: float, borders: tuple[float, float], offset: float
) -> bool:
    """Whether a body is coming to the lane at an offset, or from there: over the edge, or about to.

    `borders`: of its own lane, right and left [m]. Only the next lane counts, not one two lanes on.
    """
    right, left = borders
    side = float(np.sign(offset))
    edge = max(side * left, side * right)
    over = side * d + half > edge + TOUCH or side * sideways > SIDEWAYS
    return over and abs(offset) <= 1.5 * (left - right)


def edges(lane: Lane, s0: float, s1: float) -> tuple[float, float]:
    """The offsets of the right and the left border, the narrowest within [s0, s1] [m]."""
    found = []
    for border, pick in ((lane.right, np.max), (lane.left, np.min)):
        points = lane.frame.to_curvilinear(border)
        points = points[np.argsort(points[:, 0])]
        at_ends = np.interp([s0, s1], points[:, 0], points[:, 1])
        inside = points[within(points[:, 0], s0, s1), 1]
        found.append(float(pick(np.concatenate([at_ends, inside]))))
    return found[0], found[1]


def room(lane: Lane, state: Array, distance: float, ego: Ego) -> tuple[float, float]:
    """Lowest and highest offset at which the body fits into the lane over a distance ahead [m]."""
    s = float(lane.frame.to_curvilinear(state[None, :2])[0, 0])
    right, left = edges(lane, s, s + distance)
    return right + ego.width / 2 + TO_EDGE, left - ego.width / 2 - TO_EDGE


def lengths(speed: float) -> tuple[float, ...]:
    """Lengths over which a lateral offset is reached [m]."""
    return tuple(dict.fromkeys(max(SHORTEST, speed * t) for t in DURATIONS))


def stopping_aims(scene: Scene, state: Array, now: Situation) -> list[Aim]:
    """Straighten, go to the centre of the lane, complete or abort a lane change."""
    aims = []
    for length in lengths(float(state[SPEED])):
        aims.append(Aim(BRAKE, now.home, np.nan, length))
        to_centre = BRAKE
        if now.changing:
            # On the centre of its own lane: that of the current lane it never left, or arrived.
            to_centre = ABORT if now.home is scene.current else COMPLETE
        aims.append(Aim(to_centre, now.home, 0.0, length))
        for lane in now.changing:
            # Back into the current lane only while the body is still in part of it: traffic
            # behind may have closed up where the ego has left (`no_rear_end`).
            aims.append(Aim(ABORT if lane is scene.current else COMPLETE, lane, 0.0, length))
    return aims


def evading_aims(ego: Ego, state: Array, now: Situation, distance: float) -> list[Aim]:
    """To either edge of the own lane, and half way, over the stopping distance [m]."""
    right, left = room(now.home, state, distance, ego)
    return [
        Aim(EVADE, now.home, target, length)
        for edge in (right, left)
        for target in (edge, edge / 2)
        if abs(target) > TO_EDGE and right <= left
        for length in lengths(float(state[SPEED]))
    ]


def decelerations(settings: Settings) -> Array:
    """From the mildest to full braking, (n,), all > 0 [m/s^2]; empty if the ego cannot brake."""
    full = -settings.a_lon_min - INNER
    if full <= 0.0:
        return np.empty(0)
    return np.linspace(MILDEST, full, LEVELS) if full > MILDEST else np.array([full])


def braking(speed: float, tau: float, levels: Array, most: int) -> list[Array]:
    """Speeds at the grid points, constant deceleration to exactly 0, at most `most` steps."""
    return [
        profile for level in levels.tolist() if len(profile := _down(speed, level, tau)) - 1 <= most
    ]


def leaving(
    speed: float, distance: float, tau: float, top: float, levels: Array, most: int
) -> list[Array]:
    """Speeds with which the ego stands no earlier than after `distance` [m].

    It keeps its speed or accelerates, up to `top` [m/s], and then brakes.
    """
    found = []
    for level in levels[-1:].tolist() + levels[-3:-2].tolist():
        for push in SPEED_UP:
            square, linear = push / 2 * (1 + push / level), speed * (1 + push / level)
            missing = distance - speed**2 / (2 * level)
            if missing <= 0.0 or (square == 0.0 and linear == 0.0):
                continue
            if square > 0.0:
                root = sqrt(linear**2 + 4 * square * missing)
                duration = (root - linear) / (2 * square)
            else:
                duration = missing / linear
            steps = ceil(duration / tau)
            if speed + push * steps * tau > top or steps > most:
                continue
            rise = speed + push * tau * np.arange(steps)
            profile = np.concatenate([rise, _down(speed + push * steps * tau, level, tau)])
            if len(profile) - 1 <= most:
                found.append(profile)
    return found


def _down(speed: float, level: float, tau: float) -> Array:
    steps = ceil(speed / (level * tau) - 1e-9)
    profile: Array = np.maximum(speed - level * tau * np.arange(steps + 1), 0.0)
    profile[-1] = 0.0
    return profile
