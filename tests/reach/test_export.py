"""The corridor as plain data: complete, consistent with the set, ready for JSON."""

import json
from dataclasses import replace

import numpy as np
import pytest

from reach_scenes import Course, prediction
from sandra.actions import ActionPair
from sandra.errors import SandraError
from sandra.reach import Ground, Verdicts, ground, verify_on
from sandra.reach.export import FORMAT, NEAR, _nearby, corridor_data
from sandra.reach.polygon import range_y
from sandra.settings import Settings

H = 6
PAIRS = [ActionPair.parse(x) for x in ("keep,follow-lane", "decelerate,left-lane")]


def base() -> Ground:
    course = Course(0.01)
    cars = [course.car(2, 40.0, 0.0, 8.0), course.car(3, 30.0, 3.5, 8.0, kind="truck")]
    far = course.lane("none", 120, 200.0, 203.0)
    scene = course.scene(obstacles=cars, d=0.25, angle=0.05, more_lanelets=[far])
    return ground(scene, prediction(scene, H), Settings(horizon=H))


@pytest.fixture(scope="module")
def verdicts() -> Verdicts:
    return verify_on(base(), PAIRS)


def test_all_that_a_planner_needs(verdicts: Verdicts) -> None:
    found = corridor_data(verdicts, "keep,follow-lane")
    ground, scene = verdicts.ground, verdicts.ground.scene
    settings = ground.settings
    assert json.loads(json.dumps(found, allow_nan=False)) == found
    assert list(found) == [
        "format",
        "scenario",
        "pair",
        "formula",
        "prediction",
        "dt",
        "horizon",
        "reference",
        "ego",
        "limits",
        "steps",
        "road",
        "others",
    ]
    assert found["format"] == FORMAT == "sandra-corridor/1"
    assert found["scenario"] == "TST_Course-1_1_T-1"
    assert found["pair"] == {"longitudinal": "keep", "lateral": "follow-lane"}
    assert found["formula"] == str(verdicts[0].specification.formula)
    assert (found["prediction"], found["dt"], found["horizon"]) == ("recorded", 0.1, H)
    assert found["reference"] == scene.frame.line.tolist()
    s, d, *_ = scene.ego_curvilinear
    assert found["ego"] == {
        "x": scene.ego.state.x,
        "y": scene.ego.state.y,
        "heading": 0.05,
        "speed": 10.0,
        "acceleration": 0.0,
        "steering_angle": 0.0,
        "yaw_rate": 0.0,
        "s": s,
        "d": d,
        "length": 4.5,
        "width": 1.8,
        "wheelbase": 2.6,
    }
    assert found["limits"] == {
        "acceleration": [settings.a_lon_min, settings.a_lon_max],
        "lateral_acceleration": settings.a_lat_max,
        "speed": settings.v_max,
        "steering_angle": settings.steering_angle_max,
        "steering_rate": settings.steering_rate_max,
    }


def test_steps_are_those_of_the_corridor(verdicts: Verdicts) -> None:
    for pair in PAIRS:
        steps = verdicts.corridor(pair)["steps"]
        corridor = verdicts[pair].reachable_set.corridor()
        assert len(steps) == H + 1
        for step, expected in zip(steps, corridor.steps, strict=True):
            assert step == [
                {
                    "s": list(b.rectangle[:2]),
                    "d": list(b.rectangle[2:]),
                    "speed": list(b.speeds),
                    "lateral_speed": list(range_y(b.lat)),
                    "acceleration": list(b.inputs),
                    "parents": list(b.parents),
                }
                for b in expected
            ]


def test_the_others_and_where_they_are_between_steps(verdicts: Verdicts) -> None:
    others = corridor_data(verdicts, 0)["others"]
    assert [(x["id"], x["kind"]) for x in others] == [(2, "car"), (3, "truck")]
    for told, predicted in zip(others, verdicts.ground.prediction.obstacles, strict=True):
        assert len(told["between"]) == H
        for regions, expected in zip(told["between"], predicted.between, strict=True):
            assert regions == [
                {"vertices": r.vertices.tolist(), "radius": r.radius} for r in expected
            ]


def test_the_road_nearby(verdicts: Verdicts) -> None:
    road = corridor_data(verdicts, 0)["road"]
    assert sorted(x["id"] for x in road) == [99, 100, 101]
    by_id = {x.id: x for x in verdicts.ground.scene.lanelets}
    for each in road:
        assert each["left"] == by_id[each["id"]].left.tolist()
        assert each["right"] == by_id[each["id"]].right.tolist()


def test_lanelets_count_up_to_a_distance_in_each_direction(verdicts: Verdicts) -> None:
    """Squares that touch the box of all positions, widened by 50 m, and squares that do not."""
    verdict, ground = verdicts[0], verdicts.ground
    rectangles = [b.rectangle for step in verdict.reachable_set.steps for b in step]
    places = np.array([(s, d) for a, b, c, e in rectangles for s in (a, b) for d in (c, e)])
    points = ground.scene.frame.to_cartesian(places)
    low, high = points.min(axis=0) - NEAR, points.max(axis=0) + NEAR
    middle = (low + high) / 2
    pattern = ground.scene.lanelets[0]
    for axis in (0, 1):
        for edge, outwards in ((low, -1.0), (high, 1.0)):
            for beyond, there in ((0.0, True), (1e-6, False)):
                corner = middle.copy()
                corner[axis] = edge[axis] + outwards * beyond
                away = corner.copy()
                away[axis] += 5.0 * outwards
                # one border on the edge, the other one outside: each of them may be the near one
                for lines in ((corner, away), (away, corner)):
                    left, right = (np.array([p, p]) for p in lines)
                    one = replace(pattern, id=7, left=left, right=right)
                    scene = replace(ground.scene, lanelets=(one,))
                    got = _nearby(replace(ground, scene=scene), verdict)
                    assert [x.id for x in got] == ([7] if there else [])


def test_no_corridor_of_what_is_unsafe_or_was_not_verified() -> None:
    scene = Course().scene(speed=10.0)
    some = ground(scene, prediction(scene, H), Settings(horizon=H))
    verdicts = verify_on(some, PAIRS, ("G(v <= 5)",))
    with pytest.raises(SandraError, match=r"is UNSAFE and has no corridor \(empty at step 0"):
        corridor_data(verdicts, 0)
    with pytest.raises(KeyError, match="was not verified"):
        corridor_data(verdicts, "stop,right-lane")
