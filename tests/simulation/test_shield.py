"""The shield: whoever drives, what is executed is verified; else the environment stays itself."""

import subprocess
import sys
import warnings

import numpy as np
import pytest

from sandra import ActionPair
from sandra.actions import Lateral
from sandra.decider import Decider
from sandra.errors import SettingsError
from sandra.simulation import Traffic, highway
from sandra.simulation.episode import drive

gymnasium = pytest.importorskip("gymnasium")
pytest.importorskip("highway_env")

from sandra.simulation import Shield  # noqa: E402
from sandra.simulation.proposal import TABLE, meaning, table_with  # noqa: E402
from sandra.simulation.shield import WEIGHTS  # noqa: E402

LEFT, IDLE, RIGHT, FASTER, SLOWER = range(5)
CHANGING = ("keep", "accelerate", "decelerate")
QUIET = {"vehicles_count": 3, "policy_frequency": 5, "lanes_count": 3}
"""Few others, so that a decision is quick."""
ONE_LANE = {"vehicles_count": 2, "policy_frequency": 5, "lanes_count": 1}


def make(name="highway-v0", **config):
    return gymnasium.make(name, config=config)


def run(env, policy, seed, steps):
    """(observations, rewards, infos) until the episode or the steps end."""
    observation, _ = env.reset(seed=seed)
    seen, rewards, infos = [observation], [], []
    for i in range(steps):
        observation, reward, terminated, truncated, info = env.step(policy(i))
        seen.append(observation)
        rewards.append(reward)
        infos.append(info)
        if terminated or truncated:
            break
    return seen, rewards, infos


def braking(prompt):
    """A ranker: a function of the prompt."""
    return [ActionPair.parse(pair) for pair in ("decelerate,follow-lane", "stop,follow-lane")]


def test_who_always_goes_faster_crashes_and_with_the_shield_does_not():
    seed, steps = 1, 14
    env = Shield(make(**ONE_LANE), replacement=braking, horizon=10)
    _, _, without = run(make(**ONE_LANE), lambda i: FASTER, seed, steps)
    _, _, with_it = run(env, lambda i: FASTER, seed, steps)
    assert without[-1]["crashed"]
    assert len(with_it) == steps
    assert not with_it[-1]["crashed"]
    replaced = [info for info in with_it if info["replaced"]]
    assert replaced
    assert len(replaced) < steps
    for info in with_it:
        assert info["proposed"].longitudinal.value in ("accelerate", "keep")
        assert info["replaced"] == (info["executed"] != info["proposed"])
        assert (info["verdict"] == "CERTIFIED") >= (info["executed"] == info["proposed"])
        assert info["why"] or not info["replaced"]


def test_random_policies_can_be_repeated_and_seeds_differ():
    env = Shield(make(**QUIET))

    def random(seed):
        actions = np.random.default_rng(seed).integers(5, size=4)
        return run(env, lambda i: actions[i], seed, 4)

    first, again, other = random(3), random(3), random(4)
    assert np.array_equal(first[0], again[0])
    assert first[1:] == again[1:]
    assert not np.array_equal(first[0][-1], other[0][-1])


def test_spaces_observation_and_reward_are_the_environments():
    env = make(**QUIET)
    shield = Shield(env)
    assert shield.observation_space == env.observation_space
    assert shield.action_space == env.action_space
    observation, _ = shield.reset(seed=5)
    assert np.array_equal(observation, env.reset(seed=5)[0])
    shield.reset(seed=5)
    observation, reward, terminated, truncated, info = shield.step(IDLE)
    base = env.unwrapped
    assert observation in shield.observation_space
    assert np.array_equal(observation, base.observation_type.observe())
    assert reward == base._reward(IDLE)
    assert (terminated, truncated) == (base._is_terminated(), base._is_truncated())
    assert info["speed"] == base.vehicle.speed
    assert base.time == pytest.approx(0.2)
    assert base.steps == 3


@pytest.mark.filterwarnings("ignore::UserWarning")
def test_the_checker_of_gymnasium_has_nothing_to_say():
    from gymnasium.utils.env_checker import check_env

    plain, shield = (make(**QUIET) for _ in range(2))
    said = []
    for env in (plain, Shield(shield)):
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            check_env(env, skip_render_check=True)
        said.append(
            {
                str(w.message)
                for w in caught
                if "is different from the unwrapped" not in str(w.message)
            }
        )
    assert said[1] <= said[0]


def test_an_action_lasts_and_is_looked_at_again():
    env = Shield(make("highway-fast-v0", vehicles_count=3))
    assert (env.period, env.dt) == (0.2, 0.2)
    _, _, infos = run(env, lambda i: IDLE, 2, 2)
    assert [info["decisions"] for info in infos] == [5, 5]
    assert len(env.decided) == 5
    assert env.decision.certificate is not None
    assert env.unwrapped.vehicle.deviation < 1e-6


def test_a_change_of_lane_goes_on_until_it_is_told_otherwise():
    env = Shield(make(**{**QUIET, "vehicles_count": 0, "lanes_count": 2}))
    env.reset(seed=0)
    ego = env.unwrapped.vehicle
    lane = ego.lane_index[2]
    there, away = (LEFT, "left-lane") if lane == 1 else (RIGHT, "right-lane")
    pairs = []
    for i in range(12):
        _, _, _, _, info = env.step(there if i == 0 else IDLE)
        pairs.append(info["executed"])
        assert not info["replaced"], info
    assert pairs[0] == pairs[1]
    assert pairs[0].lateral.value == away
    assert pairs[-1].lateral is Lateral.FOLLOW_LANE
    assert ego.lane_index[2] == 1 - lane
    # There is no lane beyond: the environment's ego would stay, and so does ours.
    _, _, _, _, info = env.step(there)
    assert info["proposed"] == ActionPair.parse("keep,follow-lane")
    assert not info["replaced"]


def test_with_no_action_of_its_own_it_drives_as_the_replacement_does():
    traffic = Traffic(lanes=2, vehicles=3)
    seed, steps = 1, 3
    decider = Decider(
        "exhaustive", prediction="most-likely", horizon=20, emergency_braking=12.0, k=12,
        walk="first", weights=WEIGHTS,
    )  # fmt: skip
    episode = drive(highway(traffic), seed, decider, steps=steps)
    env = Shield(highway(traffic).env, table=dict.fromkeys(TABLE, ()))
    _, _, infos = run(env, lambda i: FASTER, seed, steps)
    assert [info["executed"] for info in infos] == [step.pair for step in episode.steps]
    assert [info["operation"] for info in infos] == [x.operation.value for x in episode.steps]
    assert all(info["replaced"] and info["proposed"] is None for info in infos)
    ego = env.unwrapped.vehicle
    x, y, heading, speed, _ = episode.recording.ego[-1]
    assert np.allclose([*ego.position, ego.heading, ego.speed], [x, -y, -heading, speed], atol=0)


def test_without_a_replacement_the_fail_safe_is_driven():
    env = Shield(make(**ONE_LANE), replacement=None)
    _, _, infos = run(env, lambda i: FASTER, 1, 12)
    executed = {info["executed"] for info in infos}
    assert None in executed
    assert executed <= {None, *(info["proposed"] for info in infos)}
    assert not infos[-1]["crashed"]
    assert {"carried", "emergency"} & {info["operation"] for info in infos}


def test_off_the_road_the_episode_is_truncated():
    env = Shield(make(**QUIET))
    env.reset(seed=1)
    env.unwrapped.vehicle.position = np.array([200.0, 60.0])
    _, _, _, truncated, info = env.step(IDLE)
    assert truncated
    assert info["ended"]
    assert info["decisions"] == 0
    env.reset(seed=1)
    assert env.step(IDLE)[4]["ended"] is None


def test_step_needs_a_reset():
    with pytest.raises(gymnasium.error.ResetNeeded):
        Shield(highway(1).env).step(IDLE)


@pytest.mark.parametrize(
    ("row", "side", "speed", "pairs"),
    [
        ("IDLE", "follow-lane", 20.0, ["keep,follow-lane"]),
        ("IDLE", "left-lane", 20.0, [*(f"{a},left-lane" for a in CHANGING), "keep,follow-lane"]),
        ("FASTER", "follow-lane", 20.0, ["accelerate,follow-lane"]),
        ("FASTER", "follow-lane", 29.9, ["keep,follow-lane"]),
        ("SLOWER", "right-lane", 20.0, [
            "decelerate,right-lane", "keep,right-lane", "accelerate,right-lane",
            "decelerate,follow-lane",
        ]),
        ("SLOWER", "follow-lane", 0.3, ["stop,follow-lane"]),
        ("LANE_LEFT", "left-lane", 20.0, [f"{a},left-lane" for a in CHANGING]),
        ("LANE_LEFT", "follow-lane", 29.9, [f"{a},follow-lane" for a in ("keep", "decelerate")]),
        ("LANE_LEFT", "right-lane", 20.0, [f"{a},right-lane" for a in CHANGING]),
    ],
)  # fmt: skip
def test_what_a_meta_action_means(row, side, speed, pairs):
    found = meaning(TABLE[row], Lateral(side), speed, 0.6, 30.0)
    assert found == tuple(map(ActionPair.parse, pairs))


def test_a_table_of_ones_own():
    keep, stop = ActionPair.parse("keep,follow-lane"), ActionPair.parse("stop,follow-lane")
    table = table_with({"IDLE": [keep, stop]})
    assert table["IDLE"] == (keep, stop)
    assert table["FASTER"] == TABLE["FASTER"]
    left = ActionPair.parse("keep,left-lane")
    assert meaning((left, keep), Lateral.LEFT_LANE, 20.0, 0.6, 30.0) == (left, keep)


@pytest.mark.parametrize(
    "table",
    [
        {"BRAKE": [ActionPair.parse("stop,follow-lane")]},
        {"IDLE": ["keep,follow-lane"]},
        {"IDLE": [ActionPair.parse("keep,follow-lane"), ActionPair.parse("keep,left-lane")]},
        {"IDLE": [ActionPair.parse("keep,right-lane"), ActionPair.parse("keep,left-lane")]},
    ],
)
def test_a_table_that_cannot_be_is_refused(table):
    with pytest.raises(SettingsError, match="table"):
        table_with(table)


@pytest.mark.parametrize(
    ("hz", "policy_hz", "given", "period", "dt"),
    [
        (15, 1, None, 0.2, 0.2),
        (15, 5, None, 0.2, 0.2),
        (5, 1, None, 0.2, 0.2),
        (15, 3, None, 1 / 3, 1 / 6),
        (20, 2, None, 0.1, 0.1),
        (15, 1, 1.0, 1.0, 0.2),
        (20, 2, 0.5, 0.5, 0.25),
    ],
)
def test_frequencies(hz, policy_hz, given, period, dt):
    env = make(simulation_frequency=hz, policy_frequency=policy_hz, vehicles_count=1)
    shield = Shield(env, period=given)
    assert (shield.period, shield.dt) == (pytest.approx(period), pytest.approx(dt))


@pytest.mark.parametrize(
    ("config", "options", "words"),
    [
        ({"simulation_frequency": 15, "policy_frequency": 4}, {}, "no multiple"),
        ({"simulation_frequency": 15, "policy_frequency": 15}, {}, "not supported"),
        ({"simulation_frequency": 15, "policy_frequency": 1}, {"period": 0.4}, "must divide"),
        ({"simulation_frequency": 15, "policy_frequency": 1}, {"period": 0.1}, "must divide"),
        ({"simulation_frequency": 15, "policy_frequency": 1}, {"period": 0.0}, "must divide"),
        ({"action": {"type": "ContinuousAction"}}, {}, "DiscreteMetaAction"),
    ],
)
def test_what_is_not_supported_is_refused(config, options, words):
    with pytest.raises(SettingsError, match=words):
        Shield(make(vehicles_count=1, **config), **options)


def test_other_environments_are_refused():
    with pytest.raises(SettingsError, match="highway-env"):
        Shield(gymnasium.make("CartPole-v1"))


def test_nothing_of_gymnasium_is_imported_before_it_is_asked_for():
    code = (
        "import sys, sandra.simulation; assert 'gymnasium' not in sys.modules; "
        "sandra.simulation.Shield; assert 'gymnasium' in sys.modules"
    )
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
