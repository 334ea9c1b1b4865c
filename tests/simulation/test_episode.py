"""Episodes that are driven with certificates: what is driven is what was certified."""

from dataclasses import replace

import numpy as np
import pytest

from sandra.decider import Decider, Operation
from sandra.planning import Trajectory
from sandra.planning.single_track import step
from sandra.simulation.episode import BREACH, drive
from sandra.simulation.highway import highway
from sandra.simulation.recording import Recorder

pytest.importorskip("highway_env")

FREE = 6382
"""A seed of setting 1 with room at the start."""
CLOSE = 1348
"""One that begins too close behind somebody for any certificate."""


def drove(seed: int, ranker: str = "exhaustive", steps: int = 5, **options):
    decider = Decider(
        ranker, emergency_braking=12.0, prediction="set-based", horizon=8, walk="first", **options
    )
    return drive(highway(1), seed, decider, name="test", steps=steps)


@pytest.fixture(scope="module")
def free():
    return drove(FREE)


def test_from_the_first_certificate_on_everything_is_covered(free) -> None:
    assert free.ended is None
    assert not free.crashed
    assert free.first_certificate == 0
    assert all(x.operation is Operation.CERTIFIED and x.covered for x in free.steps)
    assert all(x.decision.certificate is not None for x in free.steps)


def test_every_tick_is_where_its_certificate_has_it(free) -> None:
    assert free.breaches == 0
    assert max(x.breach for x in free.steps) <= BREACH
    ego = free.recording.ego
    for x in free.steps:
        executed = x.decision.executed
        assert executed is not None
        witness = executed.proof.witness
        ticks = ego[3 * x.index : 3 * x.index + 4]
        ends = witness.states[round(0.2 / witness.tau)]
        assert np.allclose(ticks[0, :4], witness.states[0, :4], atol=1e-9)
        assert np.allclose(ticks[3, :4], ends[:4], atol=1e-6)
        # Between them it drives on with the inputs of the certificate.
        assert np.allclose(
            ticks[1, 3],
            np.interp(1 / 15, witness.tau * np.arange(5), witness.states[:5, 3]),
            atol=1e-9,
        )


def test_the_recording_holds_everybody_at_every_tick(free) -> None:
    scene = free.recording.scene
    assert scene.dt == pytest.approx(1 / 15)
    assert len(free.recording.ego) == 3 * 5 + 1
    assert len(scene.obstacles) == 50
    assert all(o.states.shape == (16, 5) for o in scene.obstacles)
    # The acceleration of a row is that until the next.
    speed, acceleration = free.recording.ego[:, 3], free.recording.ego[:, 4]
    jumps = np.abs(np.diff(speed) * 15 - acceleration[:-1])
    assert np.median(jumps) < 0.2
    assert scene.lanelets[0].left[1, 0] == 10_000.0


def test_the_same_seed_is_the_same_episode(free) -> None:
    again = drove(FREE)
    assert np.array_equal(again.recording.ego, free.recording.ego)
    assert [x.pair for x in again.steps] == [x.pair for x in free.steps]


def test_a_start_too_close_is_an_emergency_and_brakes_hard() -> None:
    episode = drove(CLOSE, steps=3)
    assert [x.operation for x in episode.steps[:2]] == [Operation.EMERGENCY] * 2
    assert not episode.steps[0].covered
    assert episode.steps[0].fail_safe
    speed = episode.recording.ego[:4, 3]
    assert (speed[0] - speed[3]) / 0.2 == pytest.approx(12.0, abs=0.1)


@pytest.mark.parametrize("ranker", ["garbage", "always:accelerate,left-lane", "adversarial"])
def test_no_ranker_makes_it_crash(ranker: str) -> None:
    episode = drove(FREE, ranker, steps=6)
    assert not episode.crashed
    assert all(x.covered for x in episode.steps)
    assert episode.breaches == 0


def test_a_crash_of_the_ego_ends_the_episode() -> None:
    """Somebody is put into its way, from one tick to the next."""
    world = highway(1)

    class Blocked(Decider):
        def decide(self, scene):
            decision = super().decide(scene)
            other = world.others[0]
            other.position = world.ego.position + np.array([5.5, 0.0])
            other.speed = 0.0
            return decision

    decider = Blocked("exhaustive", emergency_braking=12.0, prediction="set-based", horizon=8)
    episode = drive(world, FREE, decider, steps=4)
    assert episode.crashed
    assert episode.ended == "step 0: the ego has crashed"
    assert len(episode.steps) == 1
    tick = episode.recording.ego_crash
    assert tick is not None
    assert 1 <= tick <= 3


def test_between_its_states_a_trajectory_is_the_model() -> None:
    states = [np.array([0.0, 0.0, 0.1, 10.0, 0.02])]
    inputs = np.array([[2.0, 0.1], [-3.0, -0.2], [0.0, 0.0]])
    for u in inputs:
        states.append(step(states[-1], u, 0.05, 5.0))
    plan = Trajectory(np.array(states), inputs, 0.05, start=0.4)
    for i, x in enumerate(states):
        assert np.allclose(plan.at(0.4 + 0.05 * i, 5.0)[0], x, atol=1e-12)
    between, u = plan.at(0.47, 5.0)
    assert np.allclose(between, step(states[1], inputs[1], 0.02, 5.0), atol=1e-9)
    assert u.tolist() == [-3.0, -0.2]
    with pytest.raises(ValueError, match="begins at"):
        plan.at(0.3, 5.0)
    with pytest.raises(ValueError, match="ends at"):
        plan.at(0.7, 5.0)
    standing = Trajectory(np.array([states[0] * [1, 1, 1, 0, 1]]), np.empty((0, 2)), 0.05)
    assert np.array_equal(standing.at(9.0, 5.0)[0], standing.states[0])


def test_who_leaves_and_who_comes_is_recorded_so() -> None:
    """As at highway-env's intersection, where vehicles are spawned and cleared."""
    world = highway(1)
    world.reset(1)
    from sandra.scene.highway import Observer

    observer = Observer.of(world.env, "test", 0.2)
    recorder = Recorder(observer, world.env, observer.scene(world.ego), 1 / 15)
    gone = world.env.road.vehicles.pop()
    world.tick()
    recorder.note()
    recording = recorder.recording()
    states = next(o.states for o in recording.scene.obstacles if o.id == observer.id_of(gone))
    assert np.isfinite(states[0, :4]).all()
    assert np.isnan(states[1]).all()
    assert replace(recording, crashed={}).ego_crash is None
