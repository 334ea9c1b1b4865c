"""Naive drivers: what was measured for them on the paper's seeds, and that they can be repeated."""

import numpy as np
import pytest

from sandra.errors import SettingsError
from sandra.evaluation.closed_loop import PAPER, measure, summarise
from sandra.simulation import highway
from sandra.simulation.highway import SEEDS
from sandra.simulation.oracle import search
from sandra.simulation.policies import play, policy

pytest.importorskip("highway_env")


@pytest.mark.parametrize(
    ("name", "setting", "percent", "distance"),
    [
        ("idle", 2, 10, 69),
        ("idle", 3, 10, 54),
        ("faster", 2, 10, 64),
    ],
)
def test_the_papers_seeds(name, setting, percent, distance):
    """As measured once with other code; `make closed-loop` prints all rows."""
    world = highway(setting, "paper")
    runs = [play(world, seed, policy(name), steps=31) for seed in SEEDS]
    row = summarise([(run.seed, measure(run, convention=PAPER)) for run in runs])
    assert 100 * row.success_rate == pytest.approx(percent)
    assert row.distance_all == pytest.approx(distance, abs=0.6)
    assert row.seeds == 10


@pytest.mark.parametrize(("name", "distance"), [("fail-safe", 44), ("slower", 73)])
def test_one_of_the_papers_seeds(name, distance):
    """Who only brakes drives as far in every episode that ends well."""
    run = play(highway(3, "paper"), 7294, policy(name), steps=31)
    metrics = measure(run, convention=PAPER)
    assert metrics.success
    assert metrics.distance == pytest.approx(distance, abs=0.2)


def test_the_idm_ego_changes_lanes():
    run = play(highway(3, "paper"), 4176, policy("idm"))
    metrics = measure(run)
    assert metrics.success
    assert metrics.lane_changes == 2
    assert set(run.actions) == {"IDM/MOBIL"}


def test_an_episode_is_told_step_by_step():
    run = play(highway(2, "paper"), 5838, policy("idle"))
    assert run.steps == 6
    assert list(run.crashed) == [False] * 6 + [True]
    assert len(run.x) == len(run.speed) == len(run.lane) == len(run.traffic_speed) == 7
    assert run.actions == ("IDLE",) * 6
    assert np.all(np.diff(run.x) > 0)
    assert run.speed[0] == 25.0
    assert run.dt == pytest.approx(0.2)


def test_random_drivers_can_be_repeated():
    world = highway(1)
    first, again, other = (
        play(world, 2421, policy("random", repeat), steps=8) for repeat in (0, 0, 1)
    )
    assert first.actions == again.actions != other.actions
    assert np.array_equal(first.x, again.x)


def test_fail_safe_steps_are_told_apart():
    run = play(highway(1, "paper"), 2421, policy("fail-safe"), steps=5)
    assert run.fail_safe.all()
    assert not play(highway(1, "paper"), 2421, policy("slower"), steps=5).fail_safe.any()


@pytest.mark.parametrize("cautious", [0, 1])
def test_the_oracle_leaves_the_world_alone_and_keeps_its_promise(cautious):
    """What it found is what happens; the world that it looked ahead in is where it was."""
    world = highway(2, "paper")
    world.reset(5838)
    before = [(*v.position, v.speed) for v in world.env.road.vehicles]
    plan = search(world, 8, 2, cautious=cautious)
    assert [(*v.position, v.speed) for v in world.env.road.vehicles] == before
    assert world.ticks == 0
    assert len(plan) == 8
    for action in plan:
        world.step(action)
    assert not world.ego.crashed  # IDLE crashes in step 6
    braked = play(highway(2, "paper"), 5838, policy("fail-safe"), steps=8)
    assert world.ego.position[0] > braked.x[-1] + 10


def test_a_policy_that_is_not_known():
    with pytest.raises(SettingsError, match="policy: 'x' is unknown"):
        policy("x")
