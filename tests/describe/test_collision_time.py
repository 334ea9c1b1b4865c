import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sandra.describe.collision_time import Box, signed_gap, time_to_collision
from sandra.describe.facts import obstacle_facts
from sandra.scene.types import Region
from straight_road import Road

ANGLES = st.floats(-math.pi, math.pi)
SPEEDS = st.integers(0, 3000).map(lambda v: v / 100)  # differ by 0.01 m/s at least


def box(s: float, d: float, v_s: float = 0.0, v_d: float = 0.0) -> Box:
    return Box(s - 2, s + 2, d - 1, d + 1, v_s, v_d)


@given(
    angle=ANGLES,
    gap=st.floats(0.5, 90.0),
    ego=SPEEDS,
    other=SPEEDS,
)
def test_a_leader_is_met_as_in_a_simulation_whatever_the_direction_of_the_lane(
    angle: float, gap: float, ego: float, other: float
) -> None:
    road = Road(angle, x=1000.0, y=-500.0)
    scene = road.scene(road.obstacle(7, gap + 4.5, 0.0, other), speed=ego)
    (facts,) = obstacle_facts(scene)
    assert facts.gap == pytest.approx(gap, abs=1e-6)

    time = facts.time_to_collision
    if ego <= other:
        assert time == math.inf
        return
    # Drive both bodies through the plane, to the time told and to half of it.
    direction = np.array([math.cos(angle), math.sin(angle)])

    def bumper_gap(moment: float) -> float:
        front = road.at(gap + 4.5, 0.0) + other * moment * direction
        return float((front - road.at(0.0, 0.0) - ego * moment * direction) @ direction) - 4.5

    assert bumper_gap(time) == pytest.approx(0.0, abs=1e-5)
    assert bumper_gap(time / 2) == pytest.approx(gap / 2, abs=1e-5)


@given(
    s=st.floats(-60, 60),
    d=st.floats(-20, 20),
    v=st.tuples(*[st.floats(-20, 20)] * 4),
)
def test_boxes_meet_exactly_when_a_fine_simulation_says_so(
    s: float, d: float, v: tuple[float, float, float, float]
) -> None:
    a, b = box(0, 0, v[0], v[1]), box(s, d, v[2], v[3])
    time = time_to_collision(a, b)
    moments = np.linspace(0.0, 20.0, 4001)
    apart_s = np.abs(s + (v[2] - v[0]) * moments) - 4.0
    apart_d = np.abs(d + (v[3] - v[1]) * moments) - 2.0
    distance = np.maximum(apart_s, apart_d)
    touching = np.flatnonzero(distance <= 0.0)
    if touching.size:
        first = moments[touching[0]]
        assert first - 0.006 <= time <= first + 1e-9
    elif time <= 20.0:  # met between two moments only
        at = max(abs(s + (v[2] - v[0]) * time) - 4.0, abs(d + (v[3] - v[1]) * time) - 2.0)
        assert at == pytest.approx(0.0, abs=1e-6)


def test_a_pedestrian_who_crosses_is_met_where_the_paths_meet() -> None:
    road = Road(0.7)
    walker = road.obstacle(3, 20.0, -5.0, 1.5, math.pi / 2, "pedestrian", Region.disc(0.3))
    (facts,) = obstacle_facts(road.scene(walker, speed=8.0))
    # Reaches the ego's side after (5 - 0.3 - 0.9) / 1.5 s; the ego is there from 2.18 to 2.82 s.
    assert facts.time_to_collision == pytest.approx((5 - 0.3 - 0.9) / 1.5, abs=1e-6)
    (facts,) = obstacle_facts(road.scene(walker, speed=15.0))
    assert facts.time_to_collision == math.inf  # the ego has passed before


def test_a_parked_car_at_the_edge_is_passed_and_one_in_the_way_is_met() -> None:
    road = Road(-2.0)
    aside = road.obstacle(1, 30.0, -2.2, kind="parkedVehicle", is_static=True)
    ahead = road.obstacle(2, 30.0, -1.5, kind="parkedVehicle", is_static=True)
    first, second = obstacle_facts(road.scene(aside, ahead))
    assert (first.time_to_collision, first.in_ego_lane) == (math.inf, True)
    assert second.time_to_collision == pytest.approx((30.0 - 4.5) / 10.0)


def test_unknown_speed_gives_an_unknown_time() -> None:
    road = Road()
    (facts,) = obstacle_facts(road.scene(road.obstacle(1, 30.0, 0.0, speed_is_known=False)))
    assert math.isnan(facts.speed)
    assert math.isnan(facts.time_to_collision)


@pytest.mark.parametrize(
    ("interval", "gap"), [((3.0, 4.0), 1.0), ((-9.0, -4.0), -4.0), ((1.0, 5.0), 0.0)]
)
def test_signed_gap(interval: tuple[float, float], gap: float) -> None:
    assert signed_gap(0.0, 2.0, *interval) == gap
