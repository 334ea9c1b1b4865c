"""A trajectory that somebody else planned: driven with the single-track model, and judged in words.

The states that are given are a wish. What they become is a simulation of the model that follows
them (`tracking.follow`), and all that is checked, and later certified, is that simulation. So that
it is still the trajectory that was meant, it may not be further than `APART` from it anywhere.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sandra.errors import SettingsError
from sandra.logic import Specification
from sandra.planning.bounds import clear, whole_steps, within
from sandra.planning.limits import Limits, within_limits
from sandra.planning.trace import satisfies, steps_of
from sandra.planning.tracking import Reference, fine_step, follow
from sandra.planning.types import Trajectory
from sandra.planning.validity import CLEARANCE
from sandra.planning.witness import INSIDE, Miss, Surroundings, start_state
from sandra.reach.sets import ReachableSet

Array = NDArray[np.float64]

APART = 0.1
"""What is driven stays so near to what was given [m, rad, m/s]."""
AT_START = 0.05
"""The first state that is given is the ego's up to this [m, rad, m/s]."""
FAR = 1e5
"""Nobody comes so far within a horizon [m]."""
CREEPING = 1.0
"""Below this speed the direction of motion is taken from the heading [m/s]."""

_NAMES = ("x", "y", "heading", "speed")
_UNITS = ("m", "m", "rad", "m/s")


def driven(
    around: Surroundings,
    specification: Specification,
    found: ReachableSet,
    states: ArrayLike,
    step: float | None = None,
) -> Trajectory | Miss:
    """The trajectory of the model that follows given states; or in words what is wrong with it.

    Args:
        around: `Surroundings.of(ground)`.
        specification, found: of one verdict.
        states: (n + 1, 4 or more) x, y of the body's centre [m], heading [rad], speed [m/s], from
            now on, at least to the horizon; what comes after it is not looked at, nor are further
            columns.
        step: seconds between two states, `scene.dt` or an integer part of it; default `scene.dt`.

    Raises:
        SettingsError: for a step that does not divide `scene.dt`.
        FormulaError: if the formula names a predicate that cannot be evaluated on a trajectory.
    """
    if found.first_empty_step is not None:
        return Miss(f"the reachable set is empty at step {found.first_empty_step}")
    times = _times(around.ground.scene.dt, found.horizon, step)
    given = _table(states)
    wrong = _unusable(around, times, given)
    if wrong is not None:
        return Miss(wrong)
    given = given[: len(times)]
    track, heading, speed = _reference(around, times, given)
    limits = Limits.of(around.ground.settings, 0.0)
    tau, per_step = fine_step(around.ground.scene.dt)
    wrong = _beyond(track, speed, tau, limits)
    if wrong is not None:
        return Miss(wrong)
    ego = around.ground.scene.ego
    # The bounds that are enforced keep the planner's margin, those that are checked do not.
    enforced = Limits.of(around.ground.settings)
    start = start_state(around.ground)
    followed, inputs = follow(start, track, tau, ego.wheelbase, enforced)
    wrong = _away(followed[0], track, heading, speed, tau)
    if wrong is not None:
        return Miss(wrong)
    if not within_limits(followed, inputs, ego.wheelbase, limits)[0]:
        return Miss("the single-track model breaks a limit when it follows it")
    faults = list(_faults(around, specification, found.corridor(), followed, inputs))
    if faults:
        return Miss("; ".join(faults))
    assert len(inputs[0]) == per_step * found.horizon
    return Trajectory(followed[0], inputs[0], tau)


def _times(dt: float, horizon: int, step: float | None) -> Array:
    """The times of the states that are needed."""
    step = dt if step is None else step
    count = whole_steps(dt, step, 1e-9) if step > 0.0 else None
    if not count:
        raise SettingsError(
            f"step = {step!r} s must be the scene's dt = {dt:g} s or an integer part of it"
        )
    return np.asarray(step * np.arange(horizon * count + 1), dtype=np.float64)


def _table(states: ArrayLike) -> Array:
    """The states as a table; without rows if they are none."""
    try:
        table = np.array(states, dtype=np.float64)
    except (TypeError, ValueError):
        return np.empty((0, 0))
    return table if table.ndim == 2 else np.empty((0, 0))


def _unusable(around: Surroundings, times: Array, given: Array) -> str | None:
    """What is wrong with the states before anything is made of them."""
    if given.shape[1] < 4:
        return "the states are no table (n + 1, 4) of x, y, heading, speed"
    if len(given) < len(times):
        return (
            f"it is too short: {len(given)} states where {len(times)} reach the horizon of "
            f"{times[-1]:g} s"
        )
    finite = np.isfinite(given[: len(times), :4]).all(axis=1)
    if not finite.all():
        row = int(np.argmin(finite))
        return f"its state at {times[row]:.2f} s is not finite: {given[row, :4].tolist()}"
    away = given[0, :4] - start_state(around.ground)[:4]
    away[2] = _turned(away[2])
    worst = int(np.argmax(np.abs(away)))
    if abs(away[worst]) > AT_START:
        return (
            f"it starts elsewhere: its {_NAMES[worst]} is {abs(away[worst]):.2f} {_UNITS[worst]} "
            "from the ego's"
        )
    far = np.abs(given[: len(times), :2] - given[0, :2]).max(axis=1) > FAR
    if far.any():
        return f"its place at {times[int(np.argmax(far))]:.2f} s is out of this world"
    speed = given[: len(times), 3]
    if speed.min() < 0.0:
        row = int(np.argmin(speed))
        return f"it drives backwards: {speed[row]:.2f} m/s at {times[row]:.2f} s"
    return None


def _reference(around: Surroundings, times: Array, given: Array) -> tuple[Reference, Array, Array]:
    """The states on the fine grid: what is followed, and (n+1,) headings and speeds there."""
    from scipy.interpolate import CubicSpline

    tau, per_step = fine_step(around.ground.scene.dt)
    fine = tau * np.arange(per_step * around.ground.horizon + 1)
    curve = CubicSpline(times, given[:, :2])
    points, velocity = curve(fine), curve(fine, 1)
    speed = np.interp(fine, times, given[:, 3])
    speed[0] = around.ground.scene.ego.state.speed
    heading = np.interp(fine, times, np.unwrap(given[:, 2]))
    course = np.where(speed > CREEPING, np.arctan2(velocity[:, 1], velocity[:, 0]), heading)
    track = Reference(points[None], course[None], np.diff(speed)[None] / tau)
    return track, heading, speed


def _beyond(track: Reference, speed: Array, tau: float, limits: Limits) -> str | None:
    """Which bound on speed or acceleration is broken first."""
    acceleration = track.acceleration[0]
    for what, unit, values, low, high in (
        ("speed", "m/s", speed, 0.0, limits.v_max),
        ("acceleration", "m/s^2", acceleration, limits.a_lon_min, limits.a_lon_max),
    ):
        beyond = ~within(values, low, high, 1e-6)
        if beyond.any():
            i = int(np.argmax(beyond))
            bound = low if values[i] < low else high
            return (
                f"it breaks a limit: {what} {values[i]:.3g} {unit} at {i * tau:.2f} s, allowed "
                f"is {bound:g}"
            )
    return None


def _away(
    followed: Array, track: Reference, heading: Array, speed: Array, tau: float
) -> str | None:
    """How far the model is from what was given, where that is too far."""
    distance = np.linalg.norm(followed[:, :2] - track.points[0], axis=1)
    i = int(np.argmax(distance))
    if not distance[i] <= APART:
        return (
            "the single-track model cannot follow it within its limits: it is up to "
            f"{distance[i]:.2f} m away, at {i * tau:.2f} s"
        )
    for what, unit, gap in (
        ("heading", "rad", np.abs(_turned(followed[:, 2] - heading))),
        ("speed", "m/s", np.abs(followed[:, 3] - speed)),
    ):
        i = int(np.argmax(gap))
        if not gap[i] <= APART:
            return (
                f"the single-track model, where it follows it, has another {what}: {gap[i]:.2f} "
                f"{unit} off at {i * tau:.2f} s"
            )
    return None


def _faults(
    around: Surroundings,
    specification: Specification,
    corridor: ReachableSet,
    states: Array,
    inputs: Array,
) -> Iterator[str]:
    """All that is wrong with what is driven (1, n+1, 5), one sentence each."""
    scene = around.ground.scene
    tau, per_step = fine_step(scene.dt)
    steps = steps_of(around.ground, states[0], inputs[0], per_step)
    outside = np.array(
        [_outside(corridor, k, *p) for k, p in enumerate(steps.position[0].tolist())]
    )
    left = ~within(outside, 0.0, INSIDE)
    if left.any():
        first = int(np.argmax(left))
        yield f"it leaves the corridor from {first * scene.dt:.2f} s on, by up to {_m(outside)}"
    gaps = around.occupied.gaps(states, inputs, tau, scene.ego)[0]
    meets = ~clear(gaps, CLEARANCE)
    if meets.any():
        i = int(np.argmax(meets))
        near = around.occupied.nearest(states[:, : i + 2], inputs[:, : i + 1], tau, scene.ego)
        assert near is not None, "a gap has somebody at its other side"
        obstacle = around.ground.prediction.obstacles[near[0]].obstacle
        yield (
            f"its body collides with {obstacle.kind} {obstacle.id}, or nearly so, from "
            f"{i * tau:.2f} s on"
        )
    off = [
        i
        for i in range(len(inputs[0]))
        if not around.road.holds(states[:, i : i + 2], inputs[:, i : i + 1], tau, scene.ego)[0]
    ]
    if off:
        yield f"a part of its body leaves the road from {off[0] * tau:.2f} s on"
    if not satisfies(around.ground, around.lanes, specification, steps)[0]:
        broken = [
            f"'{part.name}' [{part.text}]" if part.name != part.text else f"'{part.text}'"
            for part in specification.parts
            if not satisfies(
                around.ground, around.lanes, Specification(specification.pair, (part,)), steps
            )[0]
        ]
        yield f"its trace does not satisfy {' and '.join(broken) or 'the formula'}"


def _outside(corridor: ReachableSet, k: int, s: float, d: float) -> float:
    """Distance of a position from the corridor's rectangles at step k [m]."""
    return min(
        float(np.hypot(max(a - s, s - b, 0.0), max(c - d, d - e, 0.0)))
        for a, b, c, e in (base.rectangle for base in corridor.steps[k])
    )


def _m(values: Array) -> str:
    return f"{float(values.max()):.2f} m"


def _turned(angle: Array) -> Array:
    """The same angles between -pi and pi [rad]."""
    return np.asarray((angle + np.pi) % (2 * np.pi) - np.pi)
