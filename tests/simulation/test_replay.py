"""The authors' recorded runs, driven again: the environment is theirs."""

import xml.etree.ElementTree as ElementTree

import numpy as np
import pytest

from sandra.simulation import ACTIONS, FAIL_SAFE, highway

pytest.importorskip("highway_env")
EXACT = 1e-3
"""Recorded coordinates have four decimals [m]."""


def recorded(shared, name):
    """{id: {step: (x, y, vx)}}; id 5 is the ego, step 1 the start (step 0 repeats it)."""
    path = shared / "data/scenarios" / f"ZAM_Sandra-5838_1_T-1001-{name}.xml"
    if not path.exists():
        pytest.skip(f"no recorded run {path.name}")
    rows = {}
    for obstacle in ElementTree.parse(path).getroot().iter("dynamicObstacle"):
        rows[int(obstacle.get("id"))] = {
            int(state.find("time/exact").text): tuple(
                float(state.find(key).text)
                for key in ("position/point/x", "position/point/y", "velocity/exact")
            )
            for state in (obstacle.find("initialState"), *obstacle.iter("state"))
        }
    return rows


def off(vehicle, row):
    """How far a vehicle is from a recorded row (y to the left)."""
    x, y = vehicle.position
    return max(abs(x - row[0]), abs(-y - row[1]))


def off_in_speed(vehicle, row):
    """The ego's recorded speed is that along x."""
    return abs(vehicle.speed * np.cos(vehicle.heading) - row[2])


@pytest.mark.parametrize(("name", "fail_safes"), [("DiLu", 0), ("set-no-rule", 2)])
def test_recorded_runs_replay(shared, name, fail_safes):
    """Step by step a meta-action leads to the recorded ego; the others follow by themselves."""
    rows = recorded(shared, name)
    ego = rows.pop(5)
    world = highway(2, "paper")
    world.reset(5838)
    assert off(world.ego, ego[1]) < EXACT
    actions = []
    for step in range(2, max(ego) + 1):
        ends = []
        for action in (*ACTIONS, FAIL_SAFE):
            end = world.copy()
            end.step(action)
            error = max(off(end.ego, ego[step]), off_in_speed(end.ego, ego[step]))
            ends.append((error, action, end))
        error, action, world = min(ends, key=lambda entry: entry[0])
        assert error < EXACT, f"step {step}: no meta-action leads there"
        actions.append(action)
        for number, states in rows.items():
            if step in states:
                assert min(off(v, states[step]) for v in world.others) < EXACT, (step, number)
    assert actions.count(FAIL_SAFE) == fail_safes
    assert len(actions) == max(ego) - 1


def test_stock_is_not_what_they_recorded(shared):
    """The fail-safe of the library brakes less: without the profile the runs do not replay."""
    ego = recorded(shared, "set-no-rule")[5]
    world = highway(2, "stock")
    world.reset(5838)
    for action in ("SLOWER", "IDLE", FAIL_SAFE):
        world.step(action)
    assert off(world.ego, ego[4]) > 0.1
    assert off_in_speed(world.ego, ego[4]) > 1.0
