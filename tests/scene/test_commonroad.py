"""The ego, and real scenarios."""

import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from sandra.scene import Scene, load
from sandra.settings import Settings
from scene_xml import ROAD, state

Write = Callable[..., Path]


def test_the_ego_from_the_planning_problem(write: Write) -> None:
    full = state(
        "initialState", 0, 1.0, 0.5, orientation=0.1, velocity=8.0, yawRate=0.2, acceleration=-1.0
    )
    ego = load(write(initial=full)).ego
    assert (ego.id, ego.length, ego.width, ego.wheelbase) == (900, 4.508, 1.610, 2.578)
    assert (ego.state.x, ego.state.y, ego.state.heading) == (1.0, 0.5, 0.1)
    assert (ego.state.speed, ego.state.acceleration, ego.state.yaw_rate) == (8.0, -1.0, 0.2)
    assert ego.state.steering_angle == pytest.approx(math.atan(2.578 * 0.2 / 8.0))
    # commonroad-io loses the yaw rate where the acceleration is absent.
    part = state("initialState", 0, 1.0, 0.5, orientation=0.1, velocity=8.0, yawRate=0.2)
    assert load(write(initial=part)).ego.state.yaw_rate == 0.2
    steered = state("initialState", 0, 0, 0, orientation=0, velocity=8.0, steeringAngle=0.05)
    assert load(write(initial=steered)).ego.state.steering_angle == 0.05
    standing = state("initialState", 0, 0, 0, orientation=0, velocity=0.0, yawRate=0.1)
    assert load(write(initial=standing)).ego.state.steering_angle == 0.0


def test_the_size_comes_from_the_settings(write: Write) -> None:
    settings = Settings(ego_length=6.0, ego_width=2.2, ego_wheelbase=4.0)
    ego = load(write(), settings=settings).ego
    assert (ego.length, ego.width, ego.wheelbase) == (6.0, 2.2, 4.0)


def test_intervals_of_the_ego_count_by_their_centre(write: Write) -> None:
    speed = "<intervalStart>8</intervalStart><intervalEnd>12</intervalEnd>"
    initial = state("initialState", 0, 0.0, 0.0, orientation=0.0, velocity=speed)
    assert load(write(initial=initial)).ego.state.speed == 10.0


def test_the_planning_problem_with_the_lowest_id_unless_told(write: Write) -> None:
    goal = (
        "<goalState><time><intervalStart>0</intervalStart><intervalEnd>20</intervalEnd></time>"
        "</goalState>"
    )
    problems = tuple(
        f'<planningProblem id="{i}">'
        + state("initialState", 0, x, 0.0, orientation=0.0, velocity=1.0)
        + f"{goal}</planningProblem>"
        for i, x in ((902, 20.0), (901, 10.0))
    )
    path = write(problems=problems)
    assert load(path).ego.id == 901
    assert load(path, planning_problem=902).ego.state.x == 20.0


def test_weather_and_time_of_day(write: Write) -> None:
    header = (
        "<location><geoNameId>1</geoNameId><gpsLatitude>1</gpsLatitude>"
        "<gpsLongitude>1</gpsLongitude><environment><time>12:00:00</time>"
        "<timeOfDay>night</timeOfDay><weather>heavy_rain</weather><underground>wet</underground>"
        "</environment></location><scenarioTags/>"
    )
    scene = load(write(header=header))
    assert (scene.weather, scene.time_of_day) == ("heavy_rain", "night")
    assert load(write(lanelets=ROAD)).weather is None


def test_a_goal_position_becomes_a_region(write: Write) -> None:
    goal = (
        "<goalState><time><intervalStart>0</intervalStart><intervalEnd>20</intervalEnd></time>"
        "<position><circle><radius>2</radius><center><x>90</x><y>4</y></center></circle>"
        "</position></goalState>"
    )
    scene = load(write(goal=goal))
    assert scene.goal is not None
    assert scene.goal.vertices.tolist() == [[90.0, 4.0]]
    assert scene.goal.radius == 2.0


@pytest.fixture(scope="module")
def scenarios(shared: Path) -> dict[str, Scene]:
    files = sorted((shared / "data" / "scenarios").glob("*.xml"))
    return {path.stem: load(path) for path in files}


def test_real_scenarios_are_read(scenarios: dict[str, Scene]) -> None:
    recorded = {
        "DEU_AachenBendplatz-1_80_T-19": 20,
        "DEU_AachenHeckstrasse-1_30520_T-539": 20,
        "DEU_Gar-1_1_T-1": None,
        "DEU_Goeppingen-37_1_T-4": None,
        "DEU_Goeppingen-37_1_T-5": None,
        "DEU_LocationALower-11_10_T-1": 21,
        "DEU_MONAEast-2_4316_T-4341": 26,
        "ZAM_Sandra-5838_1_T-1001-DiLu": 10,
        "ZAM_Sandra-5838_1_T-1001-set-no-rule": 32,
    }
    assert set(scenarios) >= set(recorded)
    for name, steps in recorded.items():
        scene = scenarios[name]
        found = scene.recorded_ego
        assert (None if found is None else len(found)) == steps, name
        s, d, heading, _ = scene.ego_curvilinear
        assert 0 < s < scene.frame.length, name
        assert abs(d) < 2.5, name
        assert abs(heading) < 0.2, name


def test_lanes_of_real_scenarios_hold_together(scenarios: dict[str, Scene]) -> None:
    for name, scene in scenarios.items():
        for lane in scene.lanes:
            assert lane.left.shape == lane.right.shape == lane.center.shape, name
            assert len(lane.speed_limits) == len(lane.lanelets), name
            assert len(set(lane.lanelets)) == len(lane.lanelets), name
            # The left border lies to the left of the right one, all along the frame.
            left = lane.frame.to_curvilinear(lane.left)[:, 1]
            right = lane.frame.to_curvilinear(lane.right)[:, 1]
            assert (left > right).all(), (name, lane.lanelets)
            steps = np.diff(lane.frame.to_curvilinear(lane.center)[:, 0])
            assert (steps > -0.1).all(), (name, lane.lanelets)
        for side, sign in ((scene.left, 1), (scene.right, -1)):
            if side is not None:
                at = scene.frame.to_curvilinear(side.center)
                near = np.abs(at[:, 0] - scene.ego_curvilinear[0]) < 40
                assert (sign * at[near, 1] > 1.5).all(), name


def test_the_case_study(scenarios: dict[str, Scene]) -> None:
    """1162 leads to an intersection with a light; 1163 is right of it, 1161 comes towards it."""
    scene = scenarios["DEU_Goeppingen-37_1_T-4"]
    assert scene.current.lanelets[0] == 1162
    assert scene.right is not None
    assert scene.right.lanelets[0] == 1163
    assert scene.left is None
    assert [(lane.side, lane.lanelets[-1]) for lane in scene.opposite] == [("left", 1161)]
    assert scene.road_type == "intersection"
    assert [light.id for light in scene.lights] == [4927]
    assert 40 < scene.lights[0].distance < 60
    assert (len(scene.obstacles), scene.recorded_steps, scene.dt) == (36, 100, 0.1)
    without = scenarios["DEU_Goeppingen-37_1_T-5"]
    assert all(obstacle.states is None for obstacle in without.obstacles)


def test_road_types_and_limits_of_real_scenarios(scenarios: dict[str, Scene]) -> None:
    assert scenarios["ZAM_Sandra-5838_1_T-1001-DiLu"].road_type == "highway"
    assert scenarios["ZAM_Sandra-5838_1_T-1001-DiLu"].country is None
    assert scenarios["DEU_LocationALower-11_10_T-1"].road_type == "highway"
    assert scenarios["DEU_LocationALower-11_10_T-1"].speed_limit == 33.33
    assert scenarios["DEU_Gar-1_1_T-1"].road_type == "rural"
    assert scenarios["DEU_AachenBendplatz-1_80_T-19"].road_type == "intersection"
    stops = scenarios["DEU_AachenHeckstrasse-1_30520_T-539"].signs
    assert (stops[0].name, stops[0].distance) == ("stop", 0.0)


def test_a_scene_tells_itself(write: Write) -> None:
    text = str(load(write()))
    assert "DEU_Test-1_1_T-1" in text
    assert "speed limit: unknown" in text
    assert "current: 600 m, lanelets 1 2" in text
