"""Traffic: vehicles that follow paths with the intelligent driver model (Treiber 2000).

Who is ahead is seen geometrically: anyone whose body reaches into the strip that a vehicle is
about to drive through. So merging, cut-ins and queues need no bookkeeping of lanes.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from scenariomaker.roads import Line

Array = NDArray[np.float64]

SIZES = {
    "car": (4.5, 1.8),
    "taxi": (4.6, 1.8),
    "truck": (12.0, 2.5),
    "bus": (12.0, 2.5),
    "van": (5.9, 2.2),
    "tractor": (5.5, 3.0),
    "motorcycle": (2.2, 0.8),
    "bicycle": (1.8, 0.6),
}
"""Length and width [m]."""


@dataclass(frozen=True)
class Shift:
    """A lane change: from time `start` on, `distance` to the left within `duration` (quintic)."""

    start: float
    duration: float
    distance: float

    def at(self, t: float) -> tuple[float, float]:
        """Offset [m] and its rate [m/s] at time t [s]."""
        u = min(max((t - self.start) / self.duration, 0.0), 1.0)
        offset = self.distance * u**3 * (10 - 15 * u + 6 * u**2)
        rate = self.distance * 30 * u**2 * (1 - u) ** 2 / self.duration
        return offset, rate


@dataclass(frozen=True)
class Driver:
    """One vehicle: where it starts, where it goes and how it drives.

    `s` is the position of its centre along `path` at t = 0 [m], `d` its constant offset [m],
    `speed` its speed at t = 0 and `wish` the one it would like to have [m/s]. `stop` is the s
    before which its front comes to rest [m], None to drive on.
    """

    kind: str
    path: Line
    s: float
    speed: float
    wish: float
    d: float = 0.0
    shift: Shift | None = None
    stop: float | None = None
    headway: float = 1.2
    acceleration: float = 1.5
    braking: float = 2.0
    standstill_gap: float = 2.0

    @property
    def length(self) -> float:
        """[m]"""
        return SIZES[self.kind][0]

    @property
    def width(self) -> float:
        """[m]"""
        return SIZES[self.kind][1]

    def offset(self, t: float) -> tuple[float, float]:
        """Offset from the path [m] and its rate [m/s] at time t [s]."""
        if self.shift is None:
            return self.d, 0.0
        offset, rate = self.shift.at(t)
        return self.d + offset, rate

    def final_offset(self, t: float) -> float:
        """The offset it is heading for [m], known to it two seconds ahead."""
        ahead = self.shift is not None and t >= self.shift.start - 2.0
        return self.d + (self.shift.distance if self.shift is not None and ahead else 0.0)


def simulate(drivers: Sequence[Driver], steps: int, dt: float) -> list[Array]:
    """Drive all for `steps` steps of dt [s].

    Returns one array (n, 5) per driver: x, y [m], heading [rad], speed [m/s], acceleration
    [m/s^2]; the acceleration of a row is the one held until the next row. n is steps + 1, or
    less for a driver who reaches the end of its path before: it leaves the map.
    """
    s = np.array([driver.s for driver in drivers])
    v = np.array([driver.speed for driver in drivers])
    ends = np.array([driver.path.s[-1] - driver.length / 2 - 1.0 for driver in drivers])
    rows: list[list[list[float]]] = [[] for _ in drivers]
    bends = [np.gradient(np.unwrap(driver.path.headings), driver.path.s) for driver in drivers]
    caps = [_speed_caps(driver, bend) for driver, bend in zip(drivers, bends, strict=True)]
    for k in range(steps + 1):
        t = k * dt
        present = [i for i in range(len(drivers)) if s[i] <= ends[i] and len(rows[i]) == k]
        poses = {i: _pose(drivers[i], s[i], v[i], t) for i in present}
        acceleration = {}
        for i in present:
            gap, leader_speed = _leader(i, drivers, poses, s, v, t)
            wish = float(np.interp(s[i], drivers[i].path.s, caps[i]))
            a = _idm(drivers[i], v[i], wish, gap, leader_speed)
            # A vehicle that would stop within the step holds its speed at zero from then on.
            acceleration[i] = max(a, -v[i] / dt)
            rows[i].append([*poses[i], float(v[i]), acceleration[i]])
        for i in present:
            d, rate = drivers[i].offset(t + dt / 2)
            way = v[i] * dt + acceleration[i] * dt**2 / 2
            forward = np.sqrt(max(way**2 - (rate * dt) ** 2, 0.0))
            bend = float(np.interp(s[i], drivers[i].path.s, bends[i]))
            s[i] += forward / (1 - bend * d)
            v[i] = max(v[i] + acceleration[i] * dt, 0.0)
    return [np.array(row) for row in rows]


def walk(
    x: float, y: float, heading: float, speed: float, start: float, steps: int, dt: float
) -> Array:
    """A pedestrian who waits until `start` [s] and then walks straight; as `simulate`."""
    rows = []
    for k in range(steps + 1):
        t = k * dt
        # Half a second to reach the walking speed.
        run = max(t - start, 0.0)
        pace = speed * min(run / 0.5, 1.0)
        way = speed * (run**2 if run < 0.5 else run - 0.25)
        rate = speed / 0.5 if 0.0 <= t - start < 0.5 else 0.0
        rows.append([x + way * np.cos(heading), y + way * np.sin(heading), heading, pace, rate])
    return np.array(rows)


def pose_on(path: Line, s: float, d: float = 0.0) -> tuple[float, float, float]:
    """(x, y, heading) at s along a path, d to its left [m, m, rad]."""
    heading = float(np.interp(s, path.s, np.unwrap(path.headings)))
    x = float(np.interp(s, path.s, path.points[:, 0])) - d * np.sin(heading)
    y = float(np.interp(s, path.s, path.points[:, 1])) + d * np.cos(heading)
    return float(x), float(y), heading


def _pose(driver: Driver, s: float, v: float, t: float) -> tuple[float, float, float]:
    d, rate = driver.offset(t)
    x, y, heading = pose_on(driver.path, s, d)
    return x, y, heading + float(np.arcsin(np.clip(rate / max(v, 1.0), -0.5, 0.5)))


def _leader(
    i: int,
    drivers: Sequence[Driver],
    poses: Mapping[int, tuple[float, float, float]],
    s: Array,
    v: Array,
    t: float,
) -> tuple[float, float]:
    """Gap [m] to whoever is ahead on the path of driver i, and that one's speed [m/s]."""
    me = drivers[i]
    gap, speed = np.inf, 0.0
    if me.stop is not None:
        gap = me.stop - s[i] - me.length / 2 + me.standstill_gap - 0.5
    mine = (me.offset(t)[0], me.final_offset(t))
    for j, pose in poses.items():
        if j == i or np.hypot(pose[0] - poses[i][0], pose[1] - poses[i][1]) > 120.0:
            continue
        other = drivers[j]
        along, across, turn = _project(me.path, pose)
        ahead = along - s[i]
        half_length = abs(np.cos(turn)) * other.length / 2 + abs(np.sin(turn)) * other.width / 2
        half_width = abs(np.cos(turn)) * other.width / 2 + abs(np.sin(turn)) * other.length / 2
        reach = half_width + me.width / 2 + 0.3
        if ahead <= 0.0 or min(abs(across - d) for d in mine) > reach:
            continue
        distance = ahead - half_length - me.length / 2
        if distance < gap:
            gap, speed = distance, float(v[j] * np.cos(turn))
    return gap, speed


def _project(path: Line, pose: tuple[float, float, float]) -> tuple[float, float, float]:
    """s, d and relative heading of a pose along a finely sampled path."""
    x, y, heading = pose
    nearest = int(np.argmin(np.hypot(path.points[:, 0] - x, path.points[:, 1] - y)))
    base = path.headings[nearest]
    dx, dy = x - path.points[nearest, 0], y - path.points[nearest, 1]
    along = path.s[nearest] + dx * np.cos(base) + dy * np.sin(base)
    return float(along), float(-dx * np.sin(base) + dy * np.cos(base)), float(heading - base)


def _idm(driver: Driver, v: float, wish: float, gap: float, leader_speed: float) -> float:
    wish = max(wish, 0.1)
    free = (v / wish) ** 4
    closing = v * (v - leader_speed) / (2 * np.sqrt(driver.acceleration * driver.braking))
    desired = driver.standstill_gap + max(0.0, v * driver.headway + closing)
    interaction = (desired / max(gap, 0.1)) ** 2 if np.isfinite(gap) else 0.0
    return float(np.clip(driver.acceleration * (1 - free - interaction), -5.0, driver.acceleration))


def _speed_caps(driver: Driver, bends: Array) -> Array:
    """The wished speed along the path: at most 2 m/s^2 across in curves, slowed down to ahead."""
    path = driver.path
    caps = np.minimum(driver.wish, np.sqrt(2.0 / np.maximum(np.abs(bends), 1e-9)))
    for i in range(len(caps) - 2, -1, -1):
        reachable = np.sqrt(caps[i + 1] ** 2 + 2 * 1.5 * (path.s[i + 1] - path.s[i]))
        caps[i] = min(caps[i], reachable)
    return np.asarray(caps)
