"""Environments: the library's traffic to the last bit, its classes untouched."""

import os
import subprocess
import sys

import numpy as np
import pytest

from sandra.errors import SettingsError
from sandra.simulation import ACTIONS, FAIL_SAFE, Traffic, highway
from sandra.simulation.highway import SEEDS, SETTINGS

pytest.importorskip("highway_env")


def states(env):
    """x, y, heading, speed, crashed of all vehicles (n, 5)."""
    return np.array([[*v.position, v.heading, v.speed, v.crashed] for v in env.road.vehicles])


def of_the_library(setting, seed, actions, **config):
    """What highway-env itself does, made and stepped as its documentation says."""
    import gymnasium
    import highway_env  # noqa: F401

    traffic = SETTINGS[setting]
    env = gymnasium.make(
        "highway-v0",
        config={
            "lanes_count": traffic.lanes,
            "vehicles_density": traffic.density,
            "vehicles_count": 50,
            "ego_spacing": 4,
            "policy_frequency": 5,
            "simulation_frequency": 15,
            "duration": 30,
            "action": {"type": "DiscreteMetaAction", "target_speeds": np.linspace(5, 32, 9)},
        }
        | config,
        disable_env_checker=True,
    ).unwrapped
    env.reset(seed=seed)
    rows = [states(env)]
    for action in actions:
        env.step(ACTIONS.index(action))
        rows.append(states(env))
    return rows


@pytest.mark.parametrize("setting", [1, 2, 3])
def test_ticks_are_the_librarys_steps_to_the_last_bit(setting):
    seed = SEEDS[setting]
    actions = list(np.random.default_rng(setting).choice(ACTIONS, 8))
    world = highway(setting)
    world.reset(seed)
    for row, action in zip(of_the_library(setting, seed, actions), [*actions, None], strict=True):
        assert np.array_equal(states(world.env), row)
        world.step(action)


def test_paper_is_the_library_with_the_others_delay():
    from highway_env.vehicle.behavior import IDMVehicle

    actions = ["IDLE"] * 12
    expected = of_the_library(
        2, 5838, actions, other_vehicles_type="sandra.simulation.traffic.PaperTraffic"
    )
    world = highway(2, "paper")
    world.reset(5838)
    stock = highway(2)
    stock.reset(5838)
    for action in actions:
        world.step(action)
        stock.step(action)
    assert np.array_equal(states(world.env), expected[-1])
    assert not np.array_equal(states(world.env), states(stock.env))
    assert IDMVehicle.LANE_CHANGE_DELAY == 1.0


@pytest.mark.parametrize(
    "name",
    ["merge-v0", "roundabout-v0", "intersection-v0", "intersection-v1", "racetrack-v0"],
)
def test_other_roads_have_the_same_interface(name):
    world = highway(Traffic(name, target_speeds=(0.0, 5.0, 10.0, 15.0)))
    futures = []
    for _ in range(2):
        world.reset(7)
        rest = world.copy()
        for _ in range(3):
            world.step("SLOWER")
        futures.append(states(world.env))
    assert np.array_equal(*futures)
    assert world.ego in world.env.road.vehicles
    assert world.time == pytest.approx(0.6)
    for _ in range(3):
        rest.step("SLOWER")
    assert np.array_equal(states(rest.env), futures[0])


def test_at_the_intersection_vehicles_yield_as_in_the_library():
    """Its road has rules of its own, which must survive the reset."""
    world, library = highway(Traffic("intersection-v0")), highway(Traffic("intersection-v0"))
    world.reset(3)
    library.env.reset(seed=3)
    yielded = False
    for _ in range(12):
        world.step("IDLE")
        library.env.step(library.env.action_type.actions_indexes["IDLE"])
        assert np.array_equal(states(world.env), states(library.env))
        yielded |= any(getattr(v, "is_yielding", False) for v in world.others)
    assert yielded


def test_intersections_leave_other_traffic_alone():
    """highway-env's intersection writes into the class of its traffic: not into the library's."""
    from highway_env.vehicle.behavior import IDMVehicle

    from sandra.simulation.traffic import StockTraffic

    highway(Traffic("intersection-v0")).reset(0)
    assert IDMVehicle.DISTANCE_WANTED == StockTraffic.DISTANCE_WANTED == 10.0


def test_replacing_the_ego_leaves_the_traffic():
    """Another object in the same state, of another class: the same future."""
    from highway_env.vehicle.controller import MDPVehicle

    class Mine(MDPVehicle):
        pass

    rows = []
    for replaced in (False, True):
        world = highway(3)
        world.reset(2421)
        if replaced:
            mine = Mine.__new__(Mine)
            mine.__dict__.update(world.ego.__dict__)
            world.replace_ego(mine)
            assert world.env.vehicle is mine
        for action in ("FASTER", "LANE_LEFT", "IDLE"):
            world.step(action)
        rows.append(states(world.env))
    assert np.array_equal(*rows)


def test_what_is_unknown_is_named():
    for make in (
        lambda: highway(4),
        lambda: highway(1, "other"),
        lambda: highway(Traffic("no-such-v0")),
        lambda: highway(Traffic("racetrack-v0"), "paper"),
        lambda: Traffic(decision_hz=4),
    ):
        with pytest.raises(SettingsError, match=":"):
            make()


def test_highway_env_is_loaded_only_when_a_world_is_made():
    code = (
        "import sys, sandra, sandra.cli, sandra.simulation; "
        "assert not {'highway_env', 'gymnasium', 'pygame'} & set(sys.modules)"
    )
    subprocess.run([sys.executable, "-c", code], check=True, env=os.environ)


def test_the_librarys_classes_stay_as_they_are():
    """All profiles on all kinds of roads, and not one attribute of a class or module is changed."""
    import highway_env.envs
    from highway_env.road import lane, road
    from highway_env.vehicle import behavior, controller, kinematics, objects

    modules = (highway_env.envs, behavior, controller, kinematics, objects, road, lane)

    def attributes():
        found = {}
        for module in modules:
            for name, value in vars(module).items():
                found[module.__name__, name] = id(value)
                if isinstance(value, type):
                    found |= {(module.__name__, name, k): id(v) for k, v in vars(value).items()}
        return found

    before = attributes()
    for name, profile in (
        ("highway-v0", "paper"),
        ("intersection-v0", "paper"),
        ("merge-v0", "stock"),
    ):
        world = highway(Traffic(name, vehicles=5), profile)
        world.reset(1)
        for action in ("FASTER", FAIL_SAFE):
            world.step(action)
    assert attributes() == before
