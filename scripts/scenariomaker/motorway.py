"""Scenarios on roads without crossings, in one direction."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from commonroad.common.common_lanelet import LaneletType
from commonroad.geometry.occupancy.rect_occupancy import RectOccupancy
from commonroad.scenario.scenario import Tag
from shapely import Point

from scenariomaker.files import Draft, rectangle
from scenariomaker.roads import LANE_WIDTH, Line, Road, line
from scenariomaker.traffic import Driver, Shift, pose_on

KMH_120 = 33.33
INTERSTATE = (LaneletType.INTERSTATE, LaneletType.MAIN_CARRIAGE_WAY)


def carriageway(
    road: Road, axis: Line, count: int, cuts: list[float], *kinds: LaneletType
) -> list[list[int]]:
    """Lanes beside each other, the leftmost along the axis, cut into sections.

    Returns per section the ids from the left to the right.
    """
    sections: list[list[int]] = []
    for start, end in pairwise(cuts):
        part = axis.part(start, end)
        sections.append([road.lane(part, -i * LANE_WIDTH, *kinds) for i in range(count)])
        road.beside(*sections[-1])
    for lanes in zip(*sections, strict=True):
        road.follow(*lanes)
    return sections


def highway_dense() -> Draft:
    """Four lanes full of traffic: trucks to the right, the fastest to the left."""
    start, pieces = (12.9, 40.7, 0.437), [(210.0, 0.0), (290.0, 1 / 1500)]
    road = Road("DEU")
    cuts = [0.0, 250.0, 500.0]
    sections = carriageway(road, line(*start, pieces, marks=cuts), 4, cuts, *INTERSTATE)
    for section in sections:
        road.sign("MAX_SPEED", section, KMH_120)
    road.build()

    axis = line(*start, pieces, 1.0)
    # Per lane from the left: number of vehicles, speed [m/s], headway [s], first position [m].
    plan = [(5, 31.0, 0.8, 66.0), (6, 29.0, 0.8, 40.0), (6, 26.0, 0.9, 55.0), (6, 22.0, 1.1, 30.0)]
    ego: Driver | None = None
    others = []
    for lane, (count, pace, headway, s) in enumerate(plan):
        for i in range(count):
            spread = (0.618 * (7 * lane + i)) % 1.0 - 0.5
            kind = "truck" if lane == 3 and i % 3 != 2 else "car"
            speed = 22.0 + 0.6 * spread if kind == "truck" else pace + 1.6 * spread
            driver = Driver(
                kind, axis, s, speed, 1.2 * speed, d=-lane * LANE_WIDTH, headway=headway
            )
            if (lane, i) == (2, 2):
                ego = driver
            else:
                others.append(driver)
            s += driver.length + 1.25 * (2.0 + speed * headway) + 4.0 * spread
    assert ego is not None
    draft = Draft(
        "DEU",
        "HighwayDense",
        0.1,
        60,
        road,
        (
            Tag.INTERSTATE,
            Tag.MULTI_LANE,
            Tag.PARALLEL_LANES,
            Tag.NO_ONCOMING_TRAFFIC,
            Tag.SIMULATED,
        ),
        weather="clear",
        time_of_day="morning",
    )
    recording = draft.drive(ego, others)
    draft.plan(recording[0], goal_lanelets=sections[1])
    return draft


def merge() -> Draft:
    """An on-ramp: a truck comes in ahead of the ego while the left lane is taken."""
    x, y, heading = -30.2, 8.6, 2.174
    cuts = [0.0, 150.0, 350.0, 520.0]
    pieces = [(cuts[-1], 1 / 2500)]
    road = Road("DEU")
    axis = line(x, y, heading, pieces, marks=cuts)
    sections = carriageway(road, axis, 2, cuts, *INTERSTATE)
    extra = road.lane(axis.part(150.0, 350.0), -2 * LANE_WIDTH, LaneletType.ACCESS_RAMP)
    road.beside(sections[1][1], extra)
    # The ramp, laid backwards from the place where it becomes the lane for accelerating.
    gate = pose_on(axis, 150.0, -2 * LANE_WIDTH)
    ramp_pieces = [(40.0, 0.0), (70.0, 1 / 90)]
    ramp_line = line(gate[0], gate[1], gate[2] + np.pi, ramp_pieces)
    ramp = road.reverse_lane(ramp_line, 0.0, LaneletType.ACCESS_RAMP)
    road.follow(ramp, extra)
    for section in sections:
        road.sign("MAX_SPEED", section, KMH_120)
    road.sign("YIELD", [ramp])
    road.sign("MAX_SPEED", [ramp], 22.22)
    road.build()

    main = line(x, y, heading, pieces, 1.0)
    on_extra = line(*pose_on(main, 150.0, -2 * LANE_WIDTH), [(350.0, 1 / 2507)], 1.0)
    bx, by, back = ramp_line.end()
    on_ramp = line(bx, by, back + np.pi, [(70.0, -1 / 90), (40.0, 0.0), (195.0, 1 / 2507)], 0.5)
    ego_s = 172.0
    ego = Driver("car", main, ego_s, 25.0, 29.0, d=-LANE_WIDTH)
    cut_in = Shift(1.0, 4.0, LANE_WIDTH)
    others = [
        Driver("truck", on_extra, ego_s + 27.0 - 150.0, 20.5, 22.2, shift=cut_in),
        Driver("car", main, ego_s + 75.0, 27.0, 29.0, d=-LANE_WIDTH),
        Driver("car", main, ego_s - 45.0, 26.0, 29.0, d=-LANE_WIDTH),
        Driver("car", main, ego_s - 13.0, 29.5, 33.0),
        Driver("car", main, ego_s + 34.0, 30.0, 33.0),
        Driver("car", main, ego_s - 58.0, 31.0, 34.0),
        Driver("car", main, ego_s + 92.0, 31.0, 34.0),
        Driver("car", on_ramp, 78.0, 15.0, 24.0),
    ]
    draft = Draft(
        "DEU",
        "Merge",
        0.1,
        60,
        road,
        (Tag.INTERSTATE, Tag.MERGING_LANES, Tag.SLIP_ROAD, Tag.TWO_LANE, Tag.SIMULATED),
        weather="cloudy",
        time_of_day="afternoon",
    )
    recording = draft.drive(ego, others)
    draft.plan([*recording[0, :4], 0.0], goal_lanelets=[sections[2][1]])
    return draft


def nothing_safe() -> Draft:
    """A truck lies across both lanes, 20 m ahead of a car at 25 m/s: nothing can be verified."""
    start, pieces = (4.4, -71.5, -2.61), [(280.0, 0.0)]
    road = Road("ZAM")
    sections = carriageway(road, line(*start, pieces), 2, [0.0, 280.0], LaneletType.HIGHWAY)
    road.sign("MAX_SPEED", sections[0], 27.78)
    road.build()

    axis = line(*start, pieces, 1.0)
    ego_s = 130.0
    ego = Driver("car", axis, ego_s, 25.0, 25.0, d=-LANE_WIDTH)
    others = [
        Driver("car", axis, ego_s - 75.0, 24.0, 27.0, d=-LANE_WIDTH, stop=ego_s + 14.0),
        Driver("car", axis, ego_s - 88.0, 25.0, 27.0, stop=ego_s + 17.0),
    ]
    draft = Draft(
        "ZAM",
        "NothingSafe",
        0.1,
        60,
        road,
        (Tag.HIGHWAY, Tag.CRITICAL, Tag.EMERGENCY_BRAKING, Tag.TWO_LANE, Tag.SIMULATED),
    )
    recording = draft.drive(ego, others)
    x, y, heading = pose_on(axis, ego_s + 2.25 + 20.0 + 1.25, -1.75)
    draft.place("truck", rectangle(14.0, 2.5), x, y, heading + np.pi / 2)
    draft.plan([*recording[0, :3], 25.0, 0.0], goal_lanelets=sections[0])
    return draft


def recorded_ego() -> Draft:
    """The ego is itself among the recorded vehicles, and overtakes a truck; dt = 0.2 s."""
    start, pieces = (66.1, 23.8, 1.733), [(300.0, 1 / 2000), (300.0, -1 / 2000)]
    road = Road("ZAM")
    cuts = [0.0, 300.0, 600.0]
    sections = carriageway(road, line(*start, pieces, marks=cuts), 3, cuts, *INTERSTATE)
    for section in sections:
        road.sign("MAX_SPEED", section, KMH_120)
    road.build()

    axis = line(*start, pieces, 1.0)
    ego_s = 80.0
    ego = Driver(
        "car", axis, ego_s, 26.0, 30.0, d=-2 * LANE_WIDTH, shift=Shift(1.0, 4.6, LANE_WIDTH)
    )
    others = [
        Driver("truck", axis, ego_s + 62.0, 22.0, 22.2, d=-2 * LANE_WIDTH),
        Driver("car", axis, ego_s - 50.0, 25.0, 27.0, d=-2 * LANE_WIDTH),
        Driver("car", axis, ego_s + 70.0, 28.0, 29.0, d=-LANE_WIDTH),
        Driver("car", axis, ego_s - 62.0, 27.0, 29.0, d=-LANE_WIDTH),
        Driver("car", axis, ego_s + 12.0, 31.0, 33.0),
        Driver("motorcycle", axis, ego_s - 28.0, 32.0, 34.0),
    ]
    draft = Draft(
        "ZAM",
        "RecordedEgo",
        0.2,
        60,
        road,
        (Tag.INTERSTATE, Tag.LANE_CHANGE, Tag.MULTI_LANE, Tag.SIMULATED),
    )
    recording = draft.drive(ego, others, record_ego=True)
    x, y, heading, _, _ = recording[-1]
    goal = RectOccupancy(
        rect_center=Point(round(x, 3), round(y, 3)),
        width=3.0,
        length=40.0,
        orientation=round(float(heading), 4),
    )
    draft.plan(recording[0], goal_shape=goal)
    return draft
