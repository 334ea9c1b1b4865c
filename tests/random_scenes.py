"""Small random traffic scenes on a straight road, of one to three lanes and at most three others.

The road may lie anywhere in the plane: `Drawn.road.at(s, d)` is a point of it. The same seed gives
the same scene.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from sandra.scene.types import Lane, Lanelet, Obstacle, Region, Scene
from straight_road import CAR, WIDTH, Road

LIMITS = (None, 8.33, 13.89, 27.78)
"""Signed speed limits to choose from [m/s]."""
TRUCK = Region.rectangle(9.0, 2.4)
PEDESTRIAN = Region.disc(0.4)


@dataclass(frozen=True)
class Drawn:
    """A scene, and the road that it was drawn on."""

    road: Road
    scene: Scene
    limit: float | None
    """Of all lanes [m/s]."""


def draw(seed: int, most: int = 3, dt: float | None = None) -> Drawn:
    """The scene of a seed, with at most so many others; `dt` [s] is drawn if it is not given."""
    rng = np.random.default_rng(seed)
    road = Road(rng.uniform(-np.pi, np.pi), *rng.uniform(-100.0, 100.0, 2))
    right, left = ((0, 0), (1, 0), (0, 1), (1, 1), (0, 2))[rng.integers(5)]
    oncoming = bool(rng.random() < 0.25)
    places = list(range(-right, left + 1))
    limit = LIMITS[rng.integers(len(LIMITS))]
    lanes, lanelets = _lanes(road, places, oncoming, limit)
    speed = float(
        rng.choice([0.0, rng.uniform(0.5, 6.0), rng.uniform(5.0, 20.0)], p=[0.1, 0.4, 0.5])
    )
    d, heading = rng.uniform(-0.6, 0.6), rng.uniform(-0.08, 0.08) / max(1.0, speed / 6.0)
    scene = road.scene(
        speed=speed,
        lanes=lanes,
        d=d,
        heading=heading,
        dt=float(rng.choice([0.2, 0.3, 0.4])) if dt is None else dt,
        name=f"TST_Random-{seed}_1_T-1",
    )
    count = int(rng.integers(most + 1))
    found: list[Obstacle] = []
    while len(found) < count:
        other = obstacle(
            road, 10 + len(found), rng, [*places, *([left + 1] if oncoming else [])], left
        )
        s, across = _place(road, other)
        if (
            abs(s) > (4.5 + other.length) / 2 + 0.2
            or abs(across - d) > (1.8 + other.width) / 2 + 0.4
        ):
            found.append(other)
    return Drawn(road, replace(scene, lanelets=lanelets, obstacles=tuple(found)), limit)


def obstacle(
    road: Road, number: int, rng: np.random.Generator, places: list[int], leftmost: int
) -> Obstacle:
    """A random participant on one of the lanes; lanes beyond `leftmost` are oncoming."""
    place = int(rng.choice(places))
    backwards = place > leftmost
    s = float(rng.uniform(5.0, 70.0) if backwards else rng.uniform(-22.0, 42.0))
    d = place * WIDTH + rng.uniform(-0.7, 0.7)
    angle = float(rng.uniform(-0.05, 0.05)) + (np.pi if backwards else 0.0)
    moving = float(rng.uniform(1.0, 18.0))
    kind = str(
        rng.choice(["car", "truck", "parkedVehicle", "pedestrian"], p=[0.6, 0.15, 0.15, 0.1])
    )
    if kind == "parkedVehicle":
        return road.obstacle(number, s, d, 0.0, angle, kind, CAR, is_static=True)
    if kind == "pedestrian":
        angle = float(rng.uniform(-np.pi, np.pi))
        return road.obstacle(number, s, d, float(rng.uniform(0.0, 2.0)), angle, kind, PEDESTRIAN)
    return road.obstacle(number, s, d, moving, angle, kind, TRUCK if kind == "truck" else CAR)


def _place(road: Road, other: Obstacle) -> tuple[float, float]:
    return road.along(other.state.x, other.state.y)


def _lanes(
    road: Road, places: list[int], oncoming: bool, limit: float | None
) -> tuple[tuple[Lane, ...], tuple[Lanelet, ...]]:
    names = {-1: "right", 0: "current", 1: "left"}
    lanes = [road.lane(names.get(p, "other"), p, speed_limits=(limit,)) for p in places]
    lanelets = [
        Lanelet(x.lanelets[0], x.left, x.right, ("urban",), (), (), None, None, limit)
        for x in lanes
    ]
    for i, (low, high) in enumerate(pairwise(lanelets)):
        lanelets[i] = replace(low, adjacent_left=(high.id, True))
        lanelets[i + 1] = replace(high, adjacent_right=(low.id, True))
    if oncoming:
        lane = road.lane(
            "opposite", places[-1] + 1, reverse=True, speed_limits=(limit,), side="left"
        )
        lanes.append(lane)
        number, left = lane.lanelets[0], lanelets[-1]
        lanelets[-1] = replace(left, adjacent_left=(number, False))
        lanelets.append(
            Lanelet(
                number, lane.left, lane.right, ("urban",), (), (), (left.id, False), None, limit
            )
        )
    order = {"current": 0, "left": 1, "right": 2, "other": 3, "opposite": 4}
    return tuple(sorted(lanes, key=lambda x: order[x.relation])), tuple(lanelets)
