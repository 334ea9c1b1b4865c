"""Paths across the lane inside a driving corridor, driven with given speeds.

A path is a curve d(l) over the distance l driven, so it can be driven at any speed, down to a
standstill.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sandra.planning.limits import slip
from sandra.planning.tracking import Reference
from sandra.reach.polygon import range_x
from sandra.reach.sets import ReachableSet
from sandra.scene.types import Scene

Array = NDArray[np.float64]

STEEPEST = 0.8
"""|d'(l)|, the sine of the angle to the lane, up to which paths are considered."""
ASIDE = 0.4
"""Besides the centre of a lane, paths aim this far to both sides of it [m]."""
EDGE = 0.1
"""Targets keep this distance from the ends of an interval of the corridor, where it is wide [m]."""


@dataclass(frozen=True, slots=True, eq=False)
class Plans:
    """Q ways across the lane: to `first` [m] within `until` seconds, and then, from `begin` on
    within `lasting` seconds, by `second` further. All (Q,)."""

    first: Array
    until: Array
    second: Array
    begin: Array
    lasting: Array

    def __len__(self) -> int:
        return len(self.first)

    def rows(self, rows: NDArray[np.int_]) -> Plans:
        """Some of them, perhaps repeated."""
        return Plans(*(getattr(self, name)[rows] for name in self.__slots__))

    @property
    def duration(self) -> Array:
        """(Q,) until the path is parallel to the lane for good [s]."""
        moves = self.second != 0.0
        return np.where(moves, self.begin + self.lasting, self.until)


def intervals(corridor: ReachableSet, k: int) -> list[tuple[float, float]]:
    """The ranges of d at step k, disjoint, ascending [m]."""
    found: list[tuple[float, float]] = []
    for low, high in sorted(range_x(b.lat) for b in corridor.steps[k]):
        if found and low <= found[-1][1] + 1e-6:
            found[-1] = (found[-1][0], max(found[-1][1], high))
        else:
            found.append((low, high))
    return found


def targets(corridor: ReachableSet, k: int, wanted: tuple[float, ...], count: int) -> list[float]:
    """Offsets [m] inside the corridor's ranges at step k: the wanted ones, and evenly spread."""
    found: list[float] = []
    for low, high in intervals(corridor, k):
        edge = min(EDGE, (high - low) / 4)
        inside = sorted({x for x in wanted if low <= x <= high})
        spread = np.linspace(low + edge, high - edge, count).tolist()
        found += inside + [x for x in spread if all(abs(x - y) > 0.1 for y in inside)]
    return found


def simple_plans(corridor: ReachableSet, d0: float, wanted: tuple[float, ...], dt: float) -> Plans:
    """One move at once, of several durations; or one that begins later."""
    duration = corridor.horizon * dt
    near = tuple(x + offset for x in wanted for offset in (-ASIDE, ASIDE))
    between = tuple((x + d0) / 2 for x in wanted)
    ends = targets(corridor, corridor.horizon, (*wanted, d0, *between, *near), 5)
    rows = [
        (d, share * duration, 0.0, 0.0, 1.0) for d in ends for share in (0.5, 0.75, 1.0, 1.5, 2.0)
    ]
    rows += [
        (d0, 0.3 * duration, d - d0, begin * duration, share * duration)
        for d in ends
        if abs(d - d0) > 0.2
        for begin, share in ((0.2, 0.6), (0.4, 0.6), (0.5, 0.8))
    ]
    return _plans(rows)


def double_plans(corridor: ReachableSet, wanted: tuple[float, ...], dt: float) -> Plans:
    """Two moves: past something through the corridor's ranges at a step in between, and then on."""
    h = corridor.horizon
    duration = h * dt
    ends = targets(corridor, h, wanted, 3)
    rows = []
    for share in (0.3, 0.5, 0.7):
        for way in targets(corridor, max(1, round(share * h)), (), 4):
            rows += [
                (way, share * duration, end - way, begin * duration, (1.1 - begin) * duration)
                for end in ends
                for begin in (share, 0.7 * share)
            ]
    return _plans(rows)


def _plans(rows: list[tuple[float, float, float, float, float]]) -> Plans:
    columns = np.array(rows, dtype=float).reshape(-1, 5).T
    return Plans(*(column.copy() for column in columns))


@dataclass(frozen=True, slots=True, eq=False)
class Motion:
    """N samples at the same instants: all (N, m+1), `s`, `d` [m], `slope` d'(l), `bend` d''(l)
    [1/m], `speed` [m/s], `along` = ds/dt [m/s]."""

    s: Array
    d: Array
    slope: Array
    bend: Array
    speed: Array
    along: Array

    def rows(self, rows: NDArray[np.int_]) -> Motion:
        """Some of the samples."""
        return Motion(*(getattr(self, name)[rows] for name in self.__slots__))


@dataclass(frozen=True, slots=True)
class Start:
    """The initial state in the lane frame: s, d [m], d'(l), d''(l) [1/m], speed [m/s]."""

    s: float
    d: float
    slope: float
    bend: float
    speed: float

    @staticmethod
    def of(scene: Scene) -> Start:
        """With the course and its change that the steering angle gives."""
        state, ego = scene.ego.state, scene.ego
        s, d, relative, _ = scene.ego_curvilinear
        beta = float(slip(np.asarray(state.steering_angle)))
        kappa = float(scene.frame.curvature(np.array([s]))[0])
        course = relative + beta
        along = np.cos(course) / (1.0 - kappa * d)
        turn = 2 * np.sin(beta) / ego.wheelbase - kappa * along
        return Start(s, d, float(np.sin(course)), float(np.cos(course) * turn), state.speed)


def motions(scene: Scene, start: Start, speed: Array, tau: float, plans: Plans) -> Motion:
    """Samples of speeds (N, m+1) every `tau` along N plans."""
    moved = np.cumsum((speed[:, 1:] + speed[:, :-1]) / 2 * tau, axis=1)
    driven = np.concatenate([np.zeros((len(speed), 1)), moved], axis=1)
    d, slope, bend = _across(start, driven, tau, plans)
    slope = np.clip(slope, -0.99, 0.99)
    rate = speed * np.sqrt(1.0 - slope**2)
    s = start.s + driven
    for _ in range(2):
        along = rate / np.maximum(1.0 - scene.frame.curvature(s) * d, 0.1)
        gained = np.cumsum((along[:, 1:] + along[:, :-1]) / 2 * tau, axis=1)
        s = start.s + np.concatenate([np.zeros((len(s), 1)), gained], axis=1)
    return Motion(s, d, slope, bend, speed, along)


def _across(start: Start, driven: Array, tau: float, plans: Plans) -> tuple[Array, Array, Array]:
    """d, d'(l), d''(l), each (N, m+1): a quintic from the start, and a second one on top."""
    first = np.maximum(_distance(driven, tau, plans.until), 1.0)[:, None]
    c1, c2 = start.slope * first, start.bend * first**2 / 2
    gap = plans.first[:, None] - start.d - c1 - c2
    end1, end2 = -(c1 + 2 * c2), -2 * c2
    c3 = 10 * gap - 4 * end1 + end2 / 2
    c4 = -15 * gap + 7 * end1 - end2
    c5 = 6 * gap - 3 * end1 + end2 / 2
    x = np.minimum(driven / first, 1.0)
    d = start.d + x * (c1 + x * (c2 + x * (c3 + x * (c4 + x * c5))))
    slope = (c1 + x * (2 * c2 + x * (3 * c3 + x * (4 * c4 + x * 5 * c5)))) / first
    bend = (2 * c2 + x * (6 * c3 + x * (12 * c4 + x * 20 * c5))) / first**2
    if plans.second.any():
        begin = _distance(driven, tau, plans.begin)
        last = _distance(driven, tau, plans.begin + plans.lasting)
        size = np.maximum(last - begin, 1.0)[:, None]
        y = np.clip((driven - begin[:, None]) / size, 0.0, 1.0)
        further = plans.second[:, None]
        d = d + further * y**3 * (10 + y * (-15 + 6 * y))
        slope = slope + further * y**2 * (30 + y * (-60 + 30 * y)) / size
        bend = bend + further * y * (60 + y * (-180 + 120 * y)) / size**2
    return d, slope, bend


def _distance(driven: Array, tau: float, times: Array) -> Array:
    """(N,) distance driven at a time of its own; beyond the end at the mean speed."""
    last = driven.shape[1] - 1
    place = times / tau
    low = np.clip(place.astype(int), 0, last - 1)
    rows = np.arange(len(driven))
    part = np.clip(place - low, 0.0, 1.0)
    inside = driven[rows, low] + part * (driven[rows, low + 1] - driven[rows, low])
    return np.asarray(inside * np.maximum(place / last, 1.0))


def reference(scene: Scene, motion: Motion, acceleration: Array) -> Reference:
    """The samples in the plane, with their accelerations (N, m)."""
    shape = motion.s.shape
    places = np.column_stack([motion.s.ravel(), motion.d.ravel()])
    points = scene.frame.to_cartesian(places).reshape(*shape, 2)
    course = scene.frame.heading(motion.s.ravel()).reshape(shape) + np.arcsin(motion.slope)
    return Reference(points, course, acceleration)
