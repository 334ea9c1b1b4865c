"""Which stretches of a path are free, step by step: what a speed profile has to fit into.

Positions on a path are distances driven by the body's centre [m]. A stretch is free in a step if
the body, swept along it, keeps away from all that others may occupy during the step.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import ceil

import numpy as np
from numpy.typing import NDArray

from sandra.planning.bounds import clear, overlap
from sandra.planning.fail_safe_candidates import Task
from sandra.planning.fail_safe_checks import CONFLICT_MARGIN
from sandra.planning.lane_paths import Paths, drive
from sandra.planning.limits import slip
from sandra.planning.single_track import STEERING
from sandra.planning.validity import CLEARANCE, corners

Array = NDArray[np.float64]
Bools = NDArray[np.bool_]
Stretch = tuple[float, float]

CELL = 0.25
"""Stretches begin and end at multiples of this [m]."""
BLOCK = 8
"""So many cells are looked at together first."""
SLACK = 0.03
"""Stretches keep this much more than the clearance that is asked for [m]: bodies leave the path
between grid points, and distances are bounded from below when a trajectory is checked."""
ROAD = 4
"""Whether the body is on the road is looked at after so many cells."""
NEAR = 2
"""A speed is bounded by the sharpest steering within so many cells."""
SHORTEST_STEP = 0.1
"""A step lasts at least so long [s] ..."""
MOST_STEPS = 80
"""... and so long that no more than so many are needed."""


@dataclass(frozen=True, slots=True, eq=False)
class Track:
    """A path as speed profiles see it.

    `distance` (n + 1,) grid [m]; `fastest` (n + 1,) speed that steering, grip and limits allow
    [m/s]; `places`: stretches in which the body may stand. `steps` of `step` seconds, each
    `intervals` intervals of the prediction, until it ends.
    """

    task: Task
    distance: Array
    fastest: Array
    places: tuple[Stretch, ...]
    length: float
    step: float
    intervals: int
    steps: int
    states: Array
    """(n + 1, 5) of the model at 1 m/s."""
    bodies: Array
    """(n + 1, 4, 2) corners of the body."""

    @staticmethod
    def of(task: Task, along: Paths) -> Track | None:
        """Lay out the only path of `along` from the task's state; None if it is too short."""
        ego, shared = task.scene.ego, task.shared
        n = int(along.way[0, -1] / CELL) // BLOCK * BLOCK
        if n == 0:
            return None
        # Where the model drives at 1 m/s; at other speeds it steers the same, but for rounding.
        states = drive(task.state, along, np.ones((1, n + 1)), CELL, ego.wheelbase)[0][0, 0]
        distance: Array = CELL * np.arange(n + 1.0)
        on_road = shared.road.contains(states[::ROAD, None], ego)
        length = float(distance[n if on_road.all() else max(int(np.argmin(on_road)) - 1, 0) * ROAD])
        away = clear(shared.from_conflicts(states), CONFLICT_MARGIN + SLACK)
        intervals = ceil(max(SHORTEST_STEP / task.scene.dt, task.steps / MOST_STEPS) - 1e-9)
        return Track(
            task,
            distance,
            _fastest(task, states[:, STEERING]),
            tuple(_stretches(away[:-1] & away[1:], length)),
            length,
            intervals * task.scene.dt,
            intervals,
            task.steps // intervals,
            states,
            corners(states, ego),
        )

    def free(self, step: int, low: float, high: float) -> list[Stretch]:
        """The stretches within about [low, high] that are free during a step, in order."""
        import shapely

        shared = self.task.shared
        occupied = shared.occupied
        begin = self.task.first + step * self.intervals
        rows = np.arange(occupied.first[begin], occupied.first[begin + self.intervals])
        wide = CLEARANCE + SLACK
        blocks = (len(self.bodies) - 1) // BLOCK
        i = min(max(int(low / CELL / BLOCK) - 1, 0), blocks - 1)
        j = min(ceil(high / CELL / BLOCK) + 1, blocks)
        bodies = self.bodies[i * BLOCK : j * BLOCK + 1]
        lowest, highest = bodies.min(axis=(0, 1)) - wide, bodies.max(axis=(0, 1)) + wide
        rows = rows[overlap(shared.low[rows], shared.high[rows], lowest, highest)]
        regions = shapely.convex_hull(shapely.multipoints(occupied.vertices[rows]))
        within = occupied.radius[rows] + wide
        hulls = _swept(bodies, BLOCK)
        shapely.prepare(hulls)
        meets = shapely.dwithin(hulls[:, None], regions, within)
        # Only where a taken block borders on a free one its cells are looked at.
        taken = np.pad(meets.any(axis=1), 1)
        edge = np.flatnonzero(taken[1:-1] & ~(taken[:-2] & taken[2:]))
        blocked = np.repeat(taken[1:-1], BLOCK)
        for block in edge.tolist():
            part = slice(block * BLOCK, (block + 1) * BLOCK)
            near = meets[block]
            cells = _swept(bodies[part.start : part.stop + 1], 1)
            hit = shapely.dwithin(cells[:, None], regions[near], within[near])
            blocked[part] = hit.any(axis=1)
        return _stretches(~blocked, self.length, i * BLOCK * CELL)

    def in_the_way(self, step: int, place: float) -> str:
        """In words, what ends the free stretch that `place` [m] is in during a step."""
        if place >= self.length - CELL * BLOCK:
            return "leaves the road"
        task = self.task
        time = task.t_dec + step * self.step
        occupied = task.shared.occupied
        k = task.first + step * self.intervals
        if occupied.first[k] == occupied.first[k + 1]:
            return f"may meet others {time:.2f} s from now"
        i = min(int(place / CELL), len(self.states) - 2)
        who = task.shared.nearest(self.states[i : i + 2], time)
        return f"may meet obstacle {who} {time:.2f} s from now"

    def speed_bound(self, low: float, high: float) -> tuple[float, float]:
        """(c, m): speeds up to c + m s are allowed everywhere in low <= s <= high."""
        part = slice(max(int(low / CELL), 0), ceil(high / CELL) + 1)
        s, speed = self.distance[part], self.fastest[part]
        if not len(s) or np.ptp(speed) == 0.0:
            return float(self.fastest[part].min(initial=self.fastest[-1])), 0.0
        # The line that is highest in the middle, of those below the bound.
        middle = (s[0] + s[-1]) / 2
        heights = (speed - _SLOPES[:, None] * (s - middle)).min(axis=1)
        best = int(np.argmax(heights))
        return float(heights[best] - _SLOPES[best] * middle), float(_SLOPES[best])


_SLOPES = np.concatenate([-np.geomspace(0.02, 4.0, 12), [0.0], np.geomspace(0.02, 4.0, 12)])


def _swept(bodies: Array, cells: int) -> NDArray[np.object_]:
    """Hulls of bodies (n + 1, 4, 2) over so many cells each."""
    import shapely

    n = (len(bodies) - 1) // cells
    parts = [bodies[i : i + (n - 1) * cells + 1 : cells] for i in range(cells + 1)]
    return np.asarray(shapely.convex_hull(shapely.multipoints(np.concatenate(parts, axis=1))))


def _stretches(free: Bools, length: float, start: float = 0.0) -> list[Stretch]:
    """The runs of free cells from `start` on, up to `length` [m]."""
    bounds = np.flatnonzero(np.diff(np.pad(free, 1).astype(int)))
    ends = (start + CELL * bounds).reshape(-1, 2).tolist()
    return [(low, min(high, length)) for low, high in ends if low < length]


def _fastest(task: Task, steering: Array) -> Array:
    """(n + 1,) speed that lateral acceleration, steering rate and limits allow [m/s]."""
    limits = task.limits
    sine = np.sin(np.abs(slip(steering)))
    rate = np.abs(np.diff(steering, append=steering[-1:])) / CELL
    sine, rate = _highest_around(sine), _highest_around(rate)
    grip = np.sqrt(limits.a_lat_max * task.scene.ego.wheelbase / (2 * np.maximum(sine, 1e-9)))
    turn = limits.steering_rate_max / np.maximum(rate, 1e-9)
    found: Array = np.minimum(np.minimum(grip, turn), task.top)
    return found


def _highest_around(values: Array) -> Array:
    """(n,) the highest within `NEAR` places."""
    padded = np.pad(values, NEAR, mode="edge")
    return np.asarray(np.max([padded[k : k + len(values)] for k in range(2 * NEAR + 1)], axis=0))
