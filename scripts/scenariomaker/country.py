"""Scenarios out of town: a two-way road, and roadworks."""

from __future__ import annotations

import numpy as np
from commonroad.common.common_lanelet import LaneletType
from commonroad.geometry.obstacle_shapes.circle_obstacle_shape import CircleObstacleShape
from commonroad.geometry.obstacle_shapes.polygon_obstacle_shape import PolygonObstacleShape
from commonroad.geometry.occupancy.circle_occupancy import CircleOccupancy
from commonroad.scenario.scenario import Tag
from shapely import Point

from scenariomaker.files import Draft, rectangle
from scenariomaker.motorway import carriageway
from scenariomaker.roads import LANE_WIDTH, Line, Road, line
from scenariomaker.traffic import Driver, Shift, pose_on, walk

KMH_100 = 27.78
KMH_60 = 16.67
NARROW = 2.75
"""Width of a lane of a small country road [m]."""


def rural_oncoming() -> Draft:
    """A winding two-way road: a tractor ahead, a car coming up just where one would overtake."""
    pieces = [(120.0, 1 / 400), (140.0, -1 / 450), (140.0, 1 / 420)]
    start, length = (-9.7, 33.1, 0.918), 400.0
    road = Road("DEU")
    axis = line(*start, pieces, marks=[200.0])
    ahead, back = [], []
    for part in (axis.part(0.0, 200.0), axis.part(200.0, length)):
        ahead.append(road.lane(part, -NARROW / 2, LaneletType.COUNTRY, width=NARROW))
        back.append(road.reverse_lane(part, NARROW / 2, LaneletType.COUNTRY, width=NARROW))
        road.facing(ahead[-1], back[-1])
    road.follow(*ahead)
    road.follow(*back[::-1])
    road.sign("MAX_SPEED", ahead, KMH_100)
    road.sign("MAX_SPEED", back[::-1], KMH_100)
    road.build()

    middle = line(*start, pieces, 0.5)
    x, y, heading = pose_on(middle, length)
    other_way = line(x, y, heading + np.pi, [(run, -curve) for run, curve in pieces[::-1]], 0.5)
    ego_s = 70.0
    ego = Driver("car", middle, ego_s, 20.0, 25.0, d=-NARROW / 2)
    others = [
        Driver("tractor", middle, ego_s + 36.0, 5.0, 5.2, d=-NARROW / 2 - 0.2),
        Driver("car", other_way, length - (ego_s + 97.0), 25.0, 25.0, d=-NARROW / 2),
        Driver("car", other_way, length - (ego_s + 195.0), 24.0, 26.0, d=-NARROW / 2),
        Driver("car", middle, ego_s - 32.0, 20.0, 26.0, d=-NARROW / 2),
    ]
    draft = Draft(
        "DEU",
        "RuralOncoming",
        0.1,
        70,
        road,
        (Tag.RURAL, Tag.TWO_LANE, Tag.ONCOMING_TRAFFIC, Tag.SIMULATED),
        weather="clear",
        time_of_day="sunset",
    )
    recording = draft.drive(ego, others)
    draft.plan([*recording[0, :3], 20.0, 0.0], goal_lanelets=[ahead[1]])
    return draft


def roadworks() -> Draft:
    """Roadworks at night in the rain: every kind and shape of obstacle, one given as a set."""
    start, pieces = (20.6, 5.9, -1.187), [(150.0, 0.0), (150.0, -1 / 600)]
    road = Road("DEU")
    cuts = [0.0, 100.0, 300.0]
    axis = line(*start, pieces, marks=cuts)
    sections = carriageway(road, axis, 2, cuts, LaneletType.COUNTRY)
    for section in sections:
        road.sign("MAX_SPEED", section, KMH_60)
    road.sign("WARNING_CONSTRUCTION_SITE", sections[0])
    road.build()

    middle = line(*start, pieces, 0.5)
    ego_s = 62.0
    ego = Driver("car", middle, ego_s, 13.0, KMH_60, d=-LANE_WIDTH, stop=ego_s + 50.0)
    others = [
        # The truck leaves the closed lane in good time; the ego is next.
        Driver(
            "truck",
            middle,
            ego_s + 24.0,
            11.0,
            13.0,
            d=-LANE_WIDTH,
            shift=Shift(0.5, 4.0, LANE_WIDTH),
        ),
        Driver("bus", middle, ego_s - 26.0, 12.5, 14.0),
        Driver("motorcycle", middle, ego_s - 22.0, 13.0, 15.0, d=-LANE_WIDTH),
        Driver("car", middle, ego_s + 55.0, 13.0, 15.0),
    ]
    draft = Draft(
        "DEU",
        "Roadworks",
        0.1,
        70,
        road,
        (Tag.RURAL, Tag.MULTI_LANE, Tag.MERGING_LANES, Tag.SPEED_LIMIT, Tag.SIMULATED),
        weather="light_rain",
        time_of_day="night",
    )
    recording = draft.drive(ego, others)
    _site(draft, middle, ego_s + 62.0)
    draft.plan([*recording[0, :3], 13.0, 0.0], goal_lanelets=[sections[1][0]])
    return draft


def _site(draft: Draft, path: Line, s: float) -> None:
    """What stands and walks around the closed right lane from s on."""
    # A closed area with a slanted front, as the beacons stand: a polygon in the lane's frame.
    outline = ((-16.0, -1.7), (20.0, -1.7), (20.0, 1.3), (-8.0, 1.3))
    draft.place(
        "constructionZone", PolygonObstacleShape(outline), *pose_on(path, s + 16.0, -LANE_WIDTH)
    )
    draft.place("unknown", CircleObstacleShape(0.4), *pose_on(path, s - 6.0, -LANE_WIDTH - 1.2))
    draft.place("roadBoundary", rectangle(30.0, 0.4), *pose_on(path, s + 10.0, 2.2))
    draft.place("building", rectangle(6.0, 2.4), *pose_on(path, s + 12.0, -8.5))
    # One worker walks along the site; of another only a growing set is known.
    x, y, heading = pose_on(path, s - 14.0, -6.2)
    states = walk(x, y, heading, 1.2, 0.0, draft.steps, draft.dt)
    draft.record("pedestrian", CircleObstacleShape(0.35), states)
    x, y, heading = pose_on(path, s + 2.0, -8.6)
    centre = Point(round(x, 3), round(y, 3))
    sets = [
        CircleOccupancy(radius=round(0.35 + 0.4 * draft.dt * (k + 1), 3), circle_center=centre)
        for k in range(draft.steps)
    ]
    state = np.array([x, y, heading, 0.4, 0.0])
    draft.record_set("pedestrian", CircleObstacleShape(0.35), state, sets)
