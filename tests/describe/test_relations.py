import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sandra.describe.facts import MOST, obstacle_facts, relevant
from sandra.describe.relations import inside
from sandra.scene.types import Region
from straight_road import WIDTH, Road

ANGLES = st.floats(-math.pi, math.pi)


@given(angle=ANGLES, place=st.sampled_from([-1, 0, 1]))
def test_left_is_left_whatever_the_direction_of_the_lane(angle: float, place: int) -> None:
    road = Road(angle, x=-70.0, y=12.0)
    scene = road.scene(road.obstacle(1, 15.0, place * WIDTH, 9.0), lanes=road.three_lanes())
    (facts,) = obstacle_facts(scene)
    assert facts.relation == {-1: "right", 0: "same", 1: "left"}[place]
    assert np.sign(facts.lateral_gap) == place
    assert facts.gap == pytest.approx(10.5, abs=1e-6)
    assert facts.heading == pytest.approx(0.0, abs=1e-6)


def test_oncoming_crossing_incoming_and_unrelated_traffic() -> None:
    road = Road(2.5)
    incoming = road.lane("incoming-right", -2)
    other = road.lane("other", 3)
    lanes = (*road.three_lanes(), road.lane("opposite", 2, reverse=True, side="left"))
    scene = road.scene(
        road.obstacle(1, 40.0, 2 * WIDTH, 9.0, math.pi),
        road.obstacle(2, 20.0, 0.0, 9.0, math.pi / 2),
        road.obstacle(3, 20.0, -2 * WIDTH, 9.0),
        road.obstacle(4, 20.0, 3 * WIDTH, 9.0),
        road.obstacle(5, 20.0, 30.0, 9.0),
        road.obstacle(6, 30.0, 0.0, 9.0, math.pi),
        lanes=(*lanes, incoming, other),
    )
    facts = {o.id: o for o in obstacle_facts(scene)}
    assert {i: o.relation for i, o in facts.items()} == {
        1: "opposite",
        2: "crossing",
        3: "incoming-right",
        4: "other",
        5: "off-lane",
        6: "same",
    }
    assert not facts[1].same_direction
    assert not facts[6].same_direction  # a wrong-way driver in the ego's own lane
    assert facts[2].in_ego_lane


def test_the_nearest_of_each_lane_is_told_however_dense_the_traffic_is() -> None:
    road = Road()
    crowd = [road.obstacle(i, 6.0 * i, 0.0, 20.0) for i in range(1, 16)]
    lone = road.obstacle(99, 95.0, WIDTH, 20.0)
    scene = road.scene(*crowd, lone, lanes=road.three_lanes())
    told = [o.id for o in relevant(obstacle_facts(scene))]
    assert len(told) == MOST
    assert 99 in told
    assert told[:3] == [1, 2, 3]


def test_every_near_vulnerable_user_is_told_beyond_the_limit() -> None:
    road = Road()
    crowd = [road.obstacle(i, 6.0 * i, 0.0, 20.0) for i in range(1, 13)]
    people = [
        road.obstacle(100 + i, 5.0 * i, -8.0, 1.0, kind="pedestrian", outline=Region.disc(0.3))
        for i in range(5)
    ]
    told = [o.id for o in relevant(obstacle_facts(road.scene(*crowd, *people)))]
    assert {100, 101, 102, 103, 104} <= set(told)
    assert len(told) == MOST + 5


def test_who_is_out_of_range_has_passed_or_is_absent_is_not_told() -> None:
    road = Road()
    lanes = (road.lane("current", 0), road.lane("opposite", 1, reverse=True, side="left"))
    scene = road.scene(
        road.obstacle(1, 150.0, 0.0, 9.0),
        road.obstacle(2, -80.0, 0.0, 9.0),
        road.obstacle(3, -20.0, WIDTH, 9.0, math.pi),
        road.obstacle(4, math.nan, 0.0, 9.0),
        road.obstacle(5, 30.0, 25.0, kind="parkedVehicle", is_static=True),
        road.obstacle(6, 30.0, 0.0, 9.0),
        road.obstacle(7, 30.0, 0.0, 9.0),  # a copy of the one before
        lanes=lanes,
    )
    assert [o.id for o in relevant(obstacle_facts(scene))] == [6]


def test_inside() -> None:
    square = np.array([[0.0, 0.0], [2.0, 0.0], [2.0, 2.0], [0.0, 2.0]])
    assert inside(square, np.array([1.0, 1.0]))
    assert not inside(square, np.array([3.0, 1.0]))
    assert not inside(square, np.array([1.0, 3.0]))


def test_who_is_not_there_yet_is_not_told() -> None:
    road = Road()
    later = np.full((3, 5), np.nan)
    later[2] = [20.0, 0.0, 0.0, 5.0, 0.0]
    there = np.tile([40.0, 0.0, 0.0, 5.0, 0.0], (3, 1))
    scene = road.scene(
        road.obstacle(1, 20.0, 0.0, states=later), road.obstacle(2, 40.0, 0.0, states=there)
    )
    assert [facts.id for facts in obstacle_facts(scene)] == [2]
