"""Scenes of highway-env: left is left, the same vehicle has the same id, every kind of road."""

from types import SimpleNamespace

import numpy as np
import pytest

from sandra.errors import ScenarioError
from sandra.scene.highway import FIRST_VEHICLE, LONG, MOVE, Observer, RoadMap
from sandra.simulation.highway import Traffic, highway

pytest.importorskip("highway_env")


def observed(setting=1, seed=5838):
    world = highway(setting)
    world.reset(seed)
    return world, Observer.of(world.env, "test", 0.2)


def test_left_is_left_and_the_state_is_that_of_the_vehicle() -> None:
    world, observer = observed()
    ego = world.ego
    ego.heading, ego.action = 0.1, {"steering": 0.05, "acceleration": -2.0}
    scene = observer.scene(ego)
    number = ego.lane_index[2]
    state = scene.ego.state
    assert (state.x, state.y) == (ego.position[0], -ego.position[1])
    assert (state.heading, state.steering_angle) == (-0.1, -0.05)
    assert (state.speed, state.acceleration) == (25.0, -2.0)
    assert scene.ego_curvilinear[1] == pytest.approx(0.0, abs=1e-9)
    # highway-env counts lanes from the left: the one with the next number is to the right.
    right = scene.right
    assert right is not None
    assert right.center[0, 1] == -4.0 * (number + 1)
    assert scene.frame.to_curvilinear(right.center)[0, 1] == pytest.approx(-4.0)
    left = scene.left
    assert left is not None
    assert scene.frame.to_curvilinear(left.center)[0, 1] == pytest.approx(4.0)
    assert scene.speed_limit == 30.0
    assert scene.road_type == "highway"
    assert len(scene.obstacles) == 50


def test_the_wheelbase_is_that_of_highway_envs_model() -> None:
    """Its heading changes by v sin(beta) / (LENGTH / 2), ours by 2 v sin(beta) / wheelbase."""
    world, observer = observed()
    assert observer.scene(world.ego).ego.wheelbase == world.ego.LENGTH == 5.0


def test_ids_stay_with_their_vehicles() -> None:
    world, observer = observed()
    before = {o.id: o.state.x for o in observer.scene(world.ego).obstacles}
    assert min(before) == FIRST_VEHICLE + 1
    for _ in range(3):
        world.step("IDLE")
    world.env.road.vehicles.reverse()
    after = {o.id: o.state.x for o in observer.scene(world.ego).obstacles}
    assert after.keys() == before.keys()
    assert all(0.0 < after[i] - before[i] < 0.6 * 35.0 for i in before)


def test_long_lanes_are_cut_to_what_is_near_and_follow_the_ego() -> None:
    world, observer = observed()
    ego = world.ego
    scene = observer.scene(ego)
    assert scene.frame.length < LONG
    assert observer.whole.network[1].right[1, 0] == 10_000.0
    first = observer.near
    ego.position = ego.position + np.array([MOVE / 2, 0.0])
    assert observer.scene(ego).lanelets[0] is scene.lanelets[0]
    assert observer.near is first
    ego.position = ego.position + np.array([MOVE, 0.0])
    moved = observer.scene(ego)
    assert observer.near is not first
    s = moved.ego_curvilinear[0]
    assert s >= 200.0
    assert moved.frame.length - s >= 500.0


@pytest.mark.parametrize(
    "environment", ["merge-v0", "roundabout-v0", "intersection-v0", "racetrack-v0", "two-way-v0"]
)
def test_other_roads(environment: str) -> None:
    world = highway(Traffic(environment=environment))
    world.reset(3)
    observer = Observer.of(world.env, environment, 0.2)
    scene = observer.scene(world.ego)
    ids = {lanelet.id for lanelet in scene.lanelets}
    graph = world.env.road.network.graph
    assert len(ids) == sum(len(lanes) for ends in graph.values() for lanes in ends.values())
    for lanelet in scene.lanelets:
        assert set(lanelet.successors) <= ids
        for other in lanelet.successors:
            there = next(x for x in scene.lanelets if x.id == other)
            assert np.linalg.norm(lanelet.center[-1] - there.center[0]) <= 1.0
            assert lanelet.id in there.predecessors
    _, d, heading, _ = scene.ego_curvilinear
    assert abs(d) < 2.0
    assert abs(heading) < 0.5
    assert scene.current.relation == "current"


def test_both_directions_on_one_lane_do_not_lead_into_each_other() -> None:
    world = highway(Traffic(environment="two-way-v0"))
    world.reset(0)
    scene = Observer.of(world.env, "two-way", 0.2).scene(world.ego)
    assert all(not lanelet.successors for lanelet in scene.lanelets)
    assert scene.left is not None
    oncoming = [o for o in scene.obstacles if abs(o.state.heading) > 3.0]
    assert oncoming


def test_what_stands_in_the_way_is_a_static_obstacle() -> None:
    world = highway(Traffic(environment="merge-v0"))
    world.reset(0)
    scene = Observer.of(world.env, "merge", 0.2).scene(world.ego)
    (barrier,) = [o for o in scene.obstacles if o.is_static]
    assert barrier.length == 2.0


def test_a_road_without_lanes_and_an_ego_off_the_road() -> None:
    with pytest.raises(ScenarioError, match="no lane"):
        RoadMap.of(SimpleNamespace(graph={}))
    world, observer = observed()
    world.ego.position = np.array([400.0, 60.0])
    with pytest.raises(ScenarioError, match="off the road"):
        observer.scene(world.ego)
