"""Paths across a lane that a single-track vehicle can take from its present state, exactly.

Of the single-track model the centre of the rear axle is the flat output: its path's tangent is
the heading theta, and its curvature kappa gives the steering angle, tan(delta) = wheelbase kappa.
So a path of the rear axle that starts at the state's position, heading and curvature needs no
tracking. Here it is d(u), a quintic polynomial over a smooth line along the lane's centre.

Speed is free: `drive` runs along the paths with given speed profiles and returns simulations of
the model, not approximations to the paths.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sandra.planning.bounds import within
from sandra.planning.limits import slip
from sandra.planning.single_track import HEADING, SPEED, STEERING, X, Y
from sandra.planning.spline import Spline
from sandra.scene.frame import Frame, smoothed

Array = NDArray[np.float64]

SPACING = 0.25
"""Distance of the points of a path [m]."""
MOST_TURNED = 1.2
"""Who heads further away from the lane's direction drives across it, or against it [rad]."""
FLATTEST = 0.1
"""The search for a foot point ends where its derivative is no more: the normals nearly meet."""
NARROWEST = 0.2
"""Paths on which 1 - kappa d falls below this are left out: the lane's normals nearly meet."""


@dataclass(frozen=True, slots=True, eq=False)
class Guide:
    """A smooth line along a lane, from a state on.

    Columns by u (U,) [m]: `points` (U, 2), `heading` (U,) [rad], `rate` |r'(u)|, `rate_change`
    its derivative, `curvature` [1/m] and `curvature_change` [1/m^2].
    `start` is (d, d', d'') of the state's rear axle with respect to u.
    """

    u: Array
    points: Array
    heading: Array
    rate: Array
    rate_change: Array
    curvature: Array
    curvature_change: Array
    start: tuple[float, float, float]


@dataclass(frozen=True, slots=True, eq=False)
class Paths:
    """M paths: heading and steering angle over the distance driven by the body's centre.

    `way` (M, U) [m], `steering` (M, U) [rad]; `valid` (M,).
    """

    way: Array
    steering: Array
    valid: NDArray[np.bool_]

    def only(self, rows: list[int]) -> Paths:
        """Some of them."""
        return Paths(self.way[rows], self.steering[rows], self.valid[rows])


def guide(frame: Frame, state: Array, wheelbase: float, distance: float) -> Guide | None:
    """The line along `frame` from abeam of the state (5,) over `distance` [m].

    None where the state points across or against the lane, or is too far off it.
    """
    rear = state[:2] - wheelbase / 2 * np.array([np.cos(state[HEADING]), np.sin(state[HEADING])])
    s = float(frame.to_curvilinear(rear[None])[0, 0])
    # Curvature noise in maps asks for steering rates that grow with the speed.
    step = float(np.clip(state[SPEED] / 8, 1.0, 3.0))
    ends = s - 10.0, s + distance + 10.0
    inner = frame.stations[within(frame.stations, *ends)]
    stations = np.concatenate([ends[:1], inner, ends[1:]])
    line = smoothed(
        frame.to_cartesian(np.column_stack([stations, np.zeros_like(stations)])),
        step=step,
        passes=4,
    )
    chord = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(line, axis=0).T))])
    curve = Spline.through(chord, line)
    u0 = _foot(curve, chord, line, rear)
    count = max(8, int(np.ceil(distance / SPACING)))
    u = u0 + np.linspace(0.0, distance, count + 1)
    first, second, third = curve(u, 1), curve(u, 2), curve(u, 3)
    rate = np.hypot(first[:, 0], first[:, 1])
    rate_change = (first * second).sum(axis=1) / rate
    cross = first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0]
    cross_change = first[:, 0] * third[:, 1] - first[:, 1] * third[:, 0]
    curvature = cross / rate**3
    curvature_change = cross_change / rate**3 - 3 * cross * rate_change / rate**4
    heading = np.unwrap(np.arctan2(first[:, 1], first[:, 0]))
    points = curve(u)
    normal = np.array([-first[0, 1], first[0, 0]]) / rate[0]
    d = float((rear - points[0]) @ normal)
    relative = float((state[HEADING] - heading[0] + np.pi) % (2 * np.pi) - np.pi)
    along = rate[0] * (1.0 - curvature[0] * d)
    if abs(relative) > MOST_TURNED or 1.0 - curvature[0] * d < NARROWEST:
        return None
    slope = along * np.tan(relative)
    along_change = rate_change[0] * (1.0 - curvature[0] * d) - rate[0] * (
        curvature_change[0] * d + curvature[0] * slope
    )
    square = along**2 + slope**2
    turn = np.tan(state[STEERING]) / wheelbase * np.sqrt(square) - rate[0] * curvature[0]
    bend = (turn * square + slope * along_change) / along
    return Guide(
        u - u0,
        points,
        heading,
        rate,
        rate_change,
        curvature,
        curvature_change,
        (d, float(slope), float(bend)),
    )


def _foot(curve: Spline, chord: Array, line: Array, point: Array) -> float:
    """The u at which `point` is abeam of the curve (Newton from the nearest point)."""
    u = float(chord[np.argmin(np.hypot(*(line - point).T))])
    for _ in range(8):
        r, first, second = (curve(u, k) for k in range(3))
        off = r - point
        slope = first @ first + off @ second
        if slope <= FLATTEST:
            break
        u = float(np.clip(u - (off @ first) / slope, chord[0], chord[-1]))
    return u


def paths(
    line: Guide,
    targets: Array,
    lengths: Array,
    wheelbase: float,
    within: tuple[float, float] = (-np.inf, np.inf),
) -> Paths:
    """Paths that end parallel to the line.

    Args:
        targets: (M,) offsets at the end [m]; NaN: wherever the path comes to lie when it
            straightens without coming back (about half way along its present direction), but
            no further out of `within` than it starts.
        lengths: (M,) over which the offset is reached [m].
    """
    d0, d1, d2 = line.start
    straight = d0 + d1 * lengths / 2 + d2 * lengths**2 / 12
    straight = np.clip(straight, min(within[0], d0), max(within[1], d0))
    ends = np.where(np.isnan(targets), straight, targets)
    d, slope, bend = _quintic((d0, d1, d2), ends, lengths, line.u)
    along = line.rate * (1.0 - line.curvature * d)
    along_change = line.rate_change * (1.0 - line.curvature * d) - line.rate * (
        line.curvature_change * d + line.curvature * slope
    )
    square = along**2 + slope**2
    turning = line.rate * line.curvature + (along * bend - slope * along_change) / square
    steering = np.arctan(wheelbase * turning / np.sqrt(square))
    # The rear axle drives at v cos(beta), the centre at v.
    pace = np.sqrt(square) / np.cos(slip(steering))
    gaps = np.diff(line.u) * (pace[:, 1:] + pace[:, :-1]) / 2
    way = np.concatenate([np.zeros((len(d), 1)), np.cumsum(gaps, axis=1)], axis=1)
    valid = np.asarray((along > NARROWEST * line.rate).all(axis=1))
    return Paths(way, steering, valid)


def _quintic(
    start: tuple[float, float, float], ends: Array, lengths: Array, u: Array
) -> tuple[Array, Array, Array]:
    """d, d', d'' (M, U) of the quintics from `start` to (end, 0, 0), then constant."""
    t = np.minimum(u / lengths[:, None], 1.0)
    size = lengths[:, None]
    p0, p1, p2 = start[0], start[1] * lengths, start[2] * lengths**2
    gap = ends - p0
    c3 = (10 * gap - 6 * p1 - 1.5 * p2)[:, None]
    c4 = (-15 * gap + 8 * p1 + 1.5 * p2)[:, None]
    c5 = (6 * gap - 3 * p1 - 0.5 * p2)[:, None]
    p1, p2 = p1[:, None], p2[:, None]
    d = p0 + t * (p1 + t * (p2 / 2 + t * (c3 + t * (c4 + t * c5))))
    slope = (p1 + t * (p2 + t * (3 * c3 + t * (4 * c4 + t * 5 * c5)))) / size
    bend = (p2 + t * (6 * c3 + t * (12 * c4 + t * 20 * c5))) / size**2
    return d, slope, bend


def drive(
    state: Array, along: Paths, speeds: Array, tau: float, wheelbase: float
) -> tuple[Array, Array]:
    """Simulations of the single-track model: each path with each speed profile.

    Args:
        state: (5,) at the start. speeds: (N, n + 1) at the grid points, linear between them
            [m/s]; the first is that of the state.

    Returns:
        states (M, N, n + 1, 5) and inputs (M, N, n, 2). Accelerations and steering rates are
        constant in each step; limits are not enforced.
    """
    driven = np.concatenate(
        [
            np.zeros((len(speeds), 1)),
            np.cumsum(tau * (speeds[:, 1:] + speeds[:, :-1]) / 2, axis=1),
        ],
        axis=1,
    )
    steering = np.stack(
        [
            np.interp(driven, way, angle)
            for way, angle in zip(along.way, along.steering, strict=True)
        ]
    )
    steering[..., 0] = state[STEERING]
    states = np.empty((*steering.shape, 5))
    states[..., SPEED] = speeds
    states[..., STEERING] = steering
    # Speed and angle are known functions of time, linear in each step: heading and position are
    # quadratures (Simpson's rule, at quarters of a step for the heading, halves for the place).
    part = np.linspace(0.0, 1.0, 5)
    v = speeds[:, :-1, None] + np.diff(speeds, axis=1)[..., None] * part
    beta = slip(steering[..., :-1, None] + np.diff(steering, axis=-1)[..., None] * part)
    turn = 2 * v * np.sin(beta) / wheelbase
    half = tau / 12 * (turn[..., 0:3:2] + 4 * turn[..., 1:4:2] + turn[..., 2:5:2])
    heading = np.zeros_like(steering)
    heading[..., 1:] = np.cumsum(half.sum(axis=-1), axis=-1)
    heading += state[HEADING]
    states[..., HEADING] = heading
    turned = np.stack([np.zeros_like(half[..., 0]), half[..., 0], half.sum(axis=-1)], axis=-1)
    course = heading[..., :-1, None] + turned + beta[..., 0:5:2]
    weight = tau / 6 * np.array([1.0, 4.0, 1.0]) * v[..., 0:5:2]
    for column, shape in ((X, np.cos), (Y, np.sin)):
        states[..., 0, column] = state[column]
        moved = (weight * shape(course)).sum(axis=-1)
        states[..., 1:, column] = state[column] + np.cumsum(moved, axis=-1)
    inputs = np.empty((*steering.shape[:-1], steering.shape[-1] - 1, 2))
    inputs[..., 0] = np.diff(speeds, axis=1) / tau
    inputs[..., 1] = np.diff(steering, axis=-1) / tau
    return states, inputs
