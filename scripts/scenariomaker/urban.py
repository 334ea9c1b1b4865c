"""Scenarios in town: a signalised intersection and a street with parked cars."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from commonroad.common.common_lanelet import LaneletType, LineMarking
from commonroad.geometry.obstacle_shapes.circle_obstacle_shape import CircleObstacleShape
from commonroad.scenario.scenario import Tag

from scenariomaker.files import Draft, rectangle
from scenariomaker.roads import Line, Road, line
from scenariomaker.traffic import Driver, pose_on, walk

KMH_50 = 13.89
KMH_30 = 8.33

ARM, CORE = 90.0, 14.0
"""Length of an arm, and distance from its end to the centre of the intersection [m]."""


@dataclass(frozen=True)
class Crossing:
    """A four-arm intersection: two lanes in and two lanes out on each arm.

    Arms are counted counter-clockwise; arm 0 is the one the ego comes from. The lanes in lie at
    -1.75 m (left one) and -5.25 m (right one) of an arm's axis, which points to the centre.
    """

    x: float
    y: float
    heading: float

    def axis(self, arm: int, step: float = 5.0) -> Line:
        """The axis of an arm, driven inwards."""
        outward = self.heading + np.pi + arm * np.pi / 2
        reach = ARM + CORE
        start = self.x + reach * np.cos(outward), self.y + reach * np.sin(outward)
        return line(*start, outward + np.pi, [(ARM, 0.0)], step, marks=[ARM - 35.0])

    def inner(self, arm: int, d: float, turn: str, step: float = 2.0) -> Line:
        """The way of a lane's centre through the core: "straight", "left" or "right"."""
        x, y, heading = self.axis(arm).end()
        x, y = x - d * np.sin(heading), y + d * np.cos(heading)
        return line(x, y, heading, [self._piece(d, turn)], step)

    def path(self, arm: int, d: float, turn: str) -> Line:
        """The whole way of a driver: in along a lane at d, through the core, and out."""
        axis = self.axis(arm)
        x, y = axis.offset(d)[0]
        pieces = [(ARM, 0.0), self._piece(d, turn), (ARM, 0.0)]
        return line(float(x), float(y), float(axis.headings[0]), pieces, 0.5)

    @staticmethod
    def _piece(d: float, turn: str) -> tuple[float, float]:
        if turn == "straight":
            return 2 * CORE, 0.0
        radius = CORE - d if turn == "left" else CORE + d
        return radius * np.pi / 2, (1.0 if turn == "left" else -1.0) / radius


def intersection() -> Draft:
    """A signalised intersection like the paper's case study.

    The ego (7.7 m/s, braking with 2.1 m/s^2) comes up to a red light. Its own lane holds a queue
    that is still rolling, the right lane a bus that stops: "drive faster" is tempting and wrong.
    """
    crossing = Crossing(31.7, -12.4, 1.21)
    road = Road("DEU")
    arms = [_arm(road, crossing, arm) for arm in range(4)]
    _core(road, crossing, arms)
    road.build()

    left = crossing.path(0, -1.75, "straight")
    right = crossing.path(0, -5.25, "straight")
    ego_s = 54.0
    ego = Driver("car", left, ego_s, 7.7, KMH_50, stop=ARM)
    others = [
        # The queue in the ego's lane, and the bus in the lane to its right.
        Driver("van", left, ego_s + 12.7, 4.8, KMH_50, d=0.2, stop=ARM, braking=2.5),
        Driver("car", left, ego_s + 22.3, 3.0, KMH_50, stop=ARM, braking=2.5),
        Driver("bus", right, ego_s + 18.8, 2.2, 2.4, d=0.5, stop=ARM),
        Driver("car", left, ego_s - 17.0, 8.5, KMH_50, stop=ARM),
        Driver("car", right, ego_s - 12.5, 8.0, KMH_50, stop=ARM),
        # Those who have green: cross traffic, one of it turning towards the ego's arm.
        Driver("car", crossing.path(1, -1.75, "straight"), 62.0, 11.0, KMH_50),
        Driver("car", crossing.path(1, -1.75, "straight"), 30.0, 12.0, KMH_50),
        Driver("truck", crossing.path(1, -5.25, "straight"), 48.0, 10.0, 11.5),
        Driver("car", crossing.path(3, -1.75, "straight"), 84.0, 12.0, KMH_50),
        Driver("car", crossing.path(3, -1.75, "straight"), 41.0, 12.5, KMH_50),
        Driver("taxi", crossing.path(3, -5.25, "right"), 80.0, 6.0, KMH_50),
        Driver("bicycle", crossing.path(3, -5.25, "straight"), 30.0, 4.8, 5.0, d=-1.1),
        # Two cars that have turned before, now oncoming; and the queue at the red light opposite.
        Driver("car", crossing.path(1, -1.75, "left"), 128.0, 10.0, KMH_50, d=0.45),
        Driver("car", crossing.path(1, -1.75, "left"), 115.7, 6.5, KMH_50, d=0.45),
        Driver("car", crossing.path(2, -1.75, "straight"), 86.5, 0.0, KMH_50, stop=ARM),
        Driver("motorcycle", crossing.path(2, -5.25, "straight"), 70.0, 6.0, KMH_50, stop=ARM),
    ]
    draft = Draft(
        "DEU",
        "Intersection",
        0.1,
        70,
        road,
        (Tag.URBAN, Tag.INTERSECTION, Tag.MULTI_LANE, Tag.ONCOMING_TRAFFIC, Tag.SIMULATED),
        weather="clear",
        time_of_day="noon",
    )
    recording = draft.drive(ego, others)
    draft.plan([*recording[0, :3], 7.7, -2.1], goal_lanelets=[arms[2]["out_left"][0]])
    return draft


def _arm(road: Road, crossing: Crossing, arm: int) -> dict[str, tuple[int, int]]:
    """The lanelets of one arm: per lane (outer part, inner part)."""
    axis = crossing.axis(arm)
    halves = [axis.part(0.0, ARM - 35.0), axis.part(ARM - 35.0, ARM)]
    lanes: dict[str, list[int]] = {"in_left": [], "in_right": [], "out_left": [], "out_right": []}
    for part in halves:
        lanes["in_left"].append(road.lane(part, -1.75, LaneletType.URBAN))
        lanes["in_right"].append(road.lane(part, -5.25, LaneletType.URBAN))
        lanes["out_left"].append(road.reverse_lane(part, 1.75, LaneletType.URBAN))
        lanes["out_right"].append(road.reverse_lane(part, 5.25, LaneletType.URBAN))
        road.beside(lanes["in_left"][-1], lanes["in_right"][-1])
        road.beside(lanes["out_left"][-1], lanes["out_right"][-1])
        road.facing(lanes["in_left"][-1], lanes["out_left"][-1], LineMarking.SOLID)
    for name, (outer, inner) in lanes.items():
        road.follow(*((outer, inner) if name.startswith("in") else (inner, outer)))
    road.sign("MAX_SPEED", [*lanes["in_left"], *lanes["in_right"]], KMH_50)
    road.sign("MAX_SPEED", [*lanes["out_left"][::-1], *lanes["out_right"][::-1]], KMH_50)
    # dt = 0.1 s: 25 s red, 1 s red and yellow, 20 s green, 3 s yellow. Arms 0 and 2 are red
    # during the whole recording, arms 1 and 3 green.
    phases = [("red", 250), ("redYellow", 10), ("green", 200), ("yellow", 30)]
    if arm % 2 == 1:
        phases = [("green", 200), ("yellow", 30), ("red", 250), ("redYellow", 10)]
    road.light([lanes["in_left"][1], lanes["in_right"][1]], phases, 0)
    return {name: (parts[0], parts[1]) for name, parts in lanes.items()}


def _core(road: Road, crossing: Crossing, arms: list[dict[str, tuple[int, int]]]) -> None:
    """The lanelets inside the intersection, and its description."""
    kinds = (LaneletType.URBAN, LaneletType.INTERSECTION)
    straight_left: list[int] = []
    groups = []
    for arm, lanes in enumerate(arms):
        to_right, opposite, to_left = (arms[(arm + i) % 4] for i in (1, 2, 3))
        ways = {
            "straight_left": ("in_left", -1.75, "straight", opposite["out_left"][1]),
            "straight_right": ("in_right", -5.25, "straight", opposite["out_right"][1]),
            "left": ("in_left", -1.75, "left", to_left["out_left"][1]),
            "right": ("in_right", -5.25, "right", to_right["out_right"][1]),
        }
        ids = {}
        for name, (source, d, turn, target) in ways.items():
            ids[name] = road.lane(crossing.inner(arm, d, turn), 0.0, *kinds)
            road.follow(lanes[source][1], ids[name], target)
        road.beside(ids["straight_left"], ids["straight_right"])
        road.sign("MAX_SPEED", list(ids.values()), KMH_50)
        straight_left.append(ids["straight_left"])
        incoming = {lanes["in_left"][1], lanes["in_right"][1]}
        straight = {ids["straight_left"], ids["straight_right"]}
        groups.append((incoming, {ids["right"]}, straight, {ids["left"]}))
    road.facing(straight_left[0], straight_left[2])
    road.facing(straight_left[1], straight_left[3])
    road.intersection(groups)


def urban_parked() -> Draft:
    """A street with parked cars: a cyclist ahead, and a pedestrian who steps onto the road."""
    pieces = [(70.0, 0.0), (50.0, 1 / 180), (90.0, 0.0)]
    start = (-48.2, 17.3, -0.83)
    length = sum(piece[0] for piece in pieces)
    road = Road("DEU")
    axis = line(*start, pieces, marks=[100.0])
    ahead, back = [], []
    for part in (axis.part(0.0, 100.0), axis.part(100.0, length)):
        ahead.append(road.lane(part, -1.75, LaneletType.URBAN))
        back.append(road.reverse_lane(part, 1.75, LaneletType.URBAN))
        road.facing(ahead[-1], back[-1])
    road.follow(*ahead)
    road.follow(*back[::-1])
    road.sign("MAX_SPEED", ahead, KMH_30)
    road.sign("MAX_SPEED", back[::-1], KMH_30)
    road.build()

    middle = line(*start, pieces, 0.5)
    lane = line(*pose_on(middle, 0.0, -1.75), _beside(pieces, -1.75), 0.5)
    other_start = pose_on(middle, length, 1.75)
    oncoming_pieces = [(run, -curve) for run, curve in _beside(pieces, 1.75)[::-1]]
    oncoming = line(*other_start[:2], other_start[2] + np.pi, oncoming_pieces, 0.5)

    ego_s = 30.0
    ego = Driver("car", lane, ego_s, 8.0, KMH_30)
    others = [
        Driver("bicycle", lane, ego_s + 12.5, 4.2, 4.5, d=-1.0),
        Driver("car", lane, ego_s - 16.0, 8.0, KMH_30),
        Driver("car", oncoming, 124.0, 7.5, KMH_30),
        Driver("car", oncoming, 78.0, 7.8, KMH_30),
    ]
    draft = Draft(
        "DEU",
        "UrbanParked",
        0.1,
        70,
        road,
        (Tag.URBAN, Tag.TWO_LANE, Tag.ONCOMING_TRAFFIC, Tag.SIMULATED),
        weather="cloudy",
        time_of_day="afternoon",
    )
    recording = draft.drive(ego, others)
    # Between two of the parked cars the pedestrian steps out, 20 m ahead of the ego.
    x, y, heading = pose_on(middle, ego_s + 20.5, -4.9)
    pedestrian = walk(x, y, heading + np.pi / 2, 1.4, 1.3, draft.steps, draft.dt)
    draft.record("pedestrian", CircleObstacleShape(0.3), pedestrian)
    for s in (9.0, 15.5, 22.0, 28.5, 35.0, 41.0, 46.5, 54.5, 60.5, 66.5, 73.0, 92.0, 98.5):
        draft.place("parkedVehicle", rectangle(4.5, 1.8), *pose_on(middle, s, -4.55))
    for s in (20.0, 26.5, 38.0, 62.0, 81.0, 87.5):
        x, y, heading = pose_on(middle, s, 4.55)
        draft.place("parkedVehicle", rectangle(4.5, 1.8), x, y, heading + np.pi)
    draft.plan([*recording[0, :3], 8.0, 0.0], goal_lanelets=[ahead[1]])
    return draft


def _beside(pieces: list[tuple[float, float]], d: float) -> list[tuple[float, float]]:
    """The pieces of the parallel line at d to the left."""
    return [(run * (1 - curve * d), curve / (1 - curve * d)) for run, curve in pieces]
