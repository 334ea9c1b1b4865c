"""How time and memory of a verification grow with the horizon, the traffic and the road.

Straight roads with made-up traffic, so that one quantity grows while the others stay. Each point is
measured in a process of its own, all twelve pairs under the most likely prediction.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, dataclass
from math import log
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np

from sandra.actions import ALL_PAIRS
from sandra.prediction import predict
from sandra.reach import ground, verify_on
from sandra.scene.frame import Frame
from sandra.scene.types import Ego, Lane, Lanelet, Obstacle, Region, Scene, State
from sandra.settings import Settings

AXES: dict[str, tuple[int, ...]] = {
    "horizon": (10, 25, 50, 75, 100, 150, 200),
    "obstacles": (1, 50, 100, 200, 300, 400, 500),
    "lanes": (1, 2, 3, 4, 6, 8, 10, 12),
}
BASE = {"horizon": 25, "obstacles": 60, "lanes": 3}
"""What the others are while one grows."""
WIDTH = 3.5
"""Of a lane [m]."""
SPEED = 15.0
"""Of the ego [m/s]."""
GAP = 12.0
"""Least distance between the centres of two cars in a lane [m]."""


@dataclass(frozen=True, slots=True)
class Point:
    """One measured size: process CPU times [s], memory [MB], and how many base sets there were."""

    axis: str
    value: int
    predict: float
    ground: float
    verify: float
    """All twelve pairs."""
    memory: float
    """By which the process grew at most."""
    base_sets: int


@dataclass(frozen=True, slots=True)
class Growth:
    """All points, in order."""

    points: tuple[Point, ...]

    def along(self, axis: str) -> tuple[Point, ...]:
        """The points of one axis."""
        return tuple(point for point in self.points if point.axis == axis)

    def exponent(self, axis: str) -> float:
        """The slope of log(time) over log(value) between the middle and the last value.

        1 is linear growth, 2 is quadratic.
        """
        points = self.along(axis)
        a, b = points[(len(points) - 1) // 2], points[-1]
        return log(_total(b) / _total(a)) / log(b.value / a.value)

    def to_dict(self) -> dict[str, Any]:
        """For `sandra bench growth --json`."""
        axes = dict.fromkeys(point.axis for point in self.points)
        return {
            "points": [asdict(point) for point in self.points],
            "exponents": {axis: self.exponent(axis) for axis in axes},
        }

    def __str__(self) -> str:
        lines = ["process CPU [ms]       predict    ground  12 pairs   memory   base sets"]
        for p in self.points:
            times = "".join(f"{1e3 * x:10.1f}" for x in (p.predict, p.ground, p.verify))
            lines.append(
                f"{p.axis:>9} {p.value:>5}    {times} {p.memory:5.0f} MB  {p.base_sets:10d}"
            )
        for axis in dict.fromkeys(point.axis for point in self.points):
            lines.append(f"time grows with {axis} to the power of {self.exponent(axis):.2f}")
        return "\n".join(lines)


def measure_growth(
    axes: Sequence[str] = tuple(AXES),
    *,
    runs: int = 5,
    progress: Callable[[str], None] = lambda text: None,
) -> Growth:
    """Measure every point of some axes, the median of `runs` runs after one that is not counted.

    Raises:
        KeyError: for an unknown axis.
    """
    found = []
    for axis in axes:
        for value in AXES[axis]:
            progress(f"{axis} {value}")
            with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as pool:
                found.append(pool.submit(_point, axis, value, runs).result())
    return Growth(tuple(found))


def _total(point: Point) -> float:
    return point.predict + point.ground + point.verify


def _point(axis: str, value: int, runs: int) -> Point:
    sizes = {**BASE, axis: value}
    settings = Settings().replace(horizon=sizes["horizon"])
    scene = road(sizes["lanes"], sizes["obstacles"])
    before, rows, count = _memory(), [], 0
    for _ in range(runs + 1):
        marks = [time.process_time()]
        predicted = predict(scene, "most-likely", settings.horizon, settings)
        marks.append(time.process_time())
        base = ground(scene, predicted, settings)
        marks.append(time.process_time())
        verdicts = verify_on(base, ALL_PAIRS, reasons=False)
        marks.append(time.process_time())
        rows.append(np.diff(marks))
        count = sum(sum(v.reachable_set.sizes) for v in verdicts)
    predicting, preparing, verifying = np.median(rows[1:], axis=0).tolist()
    return Point(axis, value, predicting, preparing, verifying, _memory() - before, count)


def _memory() -> float:
    """The largest size of this process so far [MB]; NaN where the system does not tell."""
    try:
        status = Path("/proc/self/status").read_text()
    except OSError:  # Linux alone tells it of a process and not of who started it
        return float("nan")
    return next(int(x.split()[1]) for x in status.splitlines() if x.startswith("VmHWM")) * 1024e-6


def road(lanes: int, obstacles: int, seed: int = 0) -> Scene:
    """A straight road with the ego in its middle lane and cars in all lanes, a kilometre at least.

    Cars keep `GAP` [m] between their centres, and drive 8 to 18 m/s; the same seed gives the same.
    """
    rng = np.random.default_rng(seed)
    each = -(-obstacles // lanes)
    length = max(1000.0, 1.5 * GAP * (each + 2))
    mine = (lanes - 1) // 2
    names = {0: "current", 1: "left", -1: "right"}
    made = [
        _lane(names.get(i - mine, "other"), i + 1, (i - mine) * WIDTH, length) for i in range(lanes)
    ]
    cars: list[Obstacle] = []
    for i in range(obstacles):
        lane, place = i % lanes, i // lanes
        # Ahead of the ego and behind it in turn, in its own lane not beside it.
        away = (place // 2 + 1) * length / (each + 2) + rng.uniform(0.0, 0.2 * GAP)
        x = length / 2 + (away if place % 2 == 0 else -away)
        state = State(
            x, (lane - mine) * WIDTH + rng.uniform(-0.3, 0.3), 0.0, rng.uniform(8.0, 18.0)
        )
        cars.append(Obstacle(100 + i, "car", Region.rectangle(4.5, 1.8), state))
    ego = Ego(99, State(length / 2, 0.0, 0.0, SPEED), 4.5, 1.8, 2.6)
    lanelets = tuple(
        Lanelet(
            number,
            lane.left,
            lane.right,
            ("highway",),
            (),
            (),
            (number + 1, True) if number < lanes else None,
            (number - 1, True) if number > 1 else None,
            30.0,
        )
        for number, lane in enumerate(made, start=1)
    )
    order = {"current": 0, "left": 1, "right": 2, "other": 3}
    around = tuple(sorted(made, key=lambda lane: order[lane.relation]))
    name = f"ZAM_Growth-{lanes}_{obstacles}_T-1"
    return Scene(name, 0.1, ego, around, tuple(cars), lanelets, "highway")


def _lane(relation: str, number: int, middle: float, length: float) -> Lane:
    x = np.linspace(0.0, length, round(length / 10.0) + 1)
    left, right, center = (
        np.column_stack([x, np.full_like(x, middle + side)]) for side in (WIDTH / 2, -WIDTH / 2, 0)
    )
    return Lane(relation, (number,), left, right, center, (30.0,), Frame(center))
