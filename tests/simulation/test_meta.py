"""Meta-actions: the ego's exact response, whom it meets, and what is driven."""

import numpy as np
import pytest
import shapely

from sandra.actions import ALL_PAIRS, ActionPair, Longitudinal
from sandra.errors import SettingsError
from sandra.evaluation.closed_loop.drive import Drive, play
from sandra.prediction import predict
from sandra.scene.highway import Observer
from sandra.simulation import ACTIONS, FAIL_SAFE, highway
from sandra.simulation.meta import META, Meta, contact, response

pytest.importorskip("highway_env")
TICKS, DT = 3, 1 / 15


def test_the_papers_mapping():
    assert {str(p) for p in ALL_PAIRS if p not in META} == {
        "stop,follow-lane",
        "stop,left-lane",
        "stop,right-lane",
    }
    assert META[ActionPair.parse("accelerate,follow-lane")] == "FASTER"
    assert META[ActionPair.parse("decelerate,follow-lane")] == "SLOWER"
    assert META[ActionPair.parse("keep,follow-lane")] == "IDLE"
    for longitudinal in ("keep", "accelerate", "decelerate"):
        assert META[ActionPair.parse(f"{longitudinal},left-lane")] == "LANE_LEFT"
        assert META[ActionPair.parse(f"{longitudinal},right-lane")] == "LANE_RIGHT"
    assert all(pair.longitudinal is not Longitudinal.STOP for pair in META)


@pytest.mark.parametrize("profile", ["stock", "paper"])
@pytest.mark.parametrize("action", [*ACTIONS, FAIL_SAFE])
def test_the_response_is_what_is_driven(profile, action):
    """Beside the whole simulation, also in the midst of a change of lane; to the last bit."""
    world = highway(1, profile)
    world.reset(2421)
    compared = 0
    for before in ("IDLE", "LANE_LEFT", "LANE_LEFT", "SLOWER"):
        world.step(before)
        state = (*world.ego.position, world.ego.heading, world.ego.speed)
        foreseen = response(world.ego, action, TICKS, DT, 24)
        assert (*world.ego.position, world.ego.heading, world.ego.speed) == state
        twin = world.copy()
        for tick in range(len(foreseen) - 1):
            if tick % TICKS == 0:
                twin.act(action if tick == 0 else FAIL_SAFE)
            twin.tick()
            if twin.ego.crashed:
                break
            x, y = twin.ego.position
            row = np.array([x, -y, -twin.ego.heading, twin.ego.speed])
            assert (foreseen[tick + 1, :4] == row).all()
            compared += 1
    assert compared > 40


def test_contact_as_the_bodies_are():
    """Against shapely, tick by tick, over responses in dense traffic."""
    world = highway(3, "paper")
    found = []
    for seed in (5838, 7294, 1):
        world.reset(seed)
        observer = Observer.of(world.env, "meta", TICKS * DT)
        scene = observer.scene(world.ego)
        for kind in ("most-likely", "set-based"):
            prediction = predict(scene, kind, 8)
            for action in ("FASTER", "SLOWER", "LANE_LEFT", "LANE_RIGHT"):
                states = response(world.ego, action, TICKS, DT, 24)
                met = contact(states, DT, prediction, scene.ego)
                truth = _touches(states, prediction, scene.ego)
                assert (met is not None) is bool(truth)
                if met is not None:
                    assert met[0] in {number for number, _ in truth}
                found.append(met is not None)
    assert True in found
    assert False in found


def _touches(states, prediction, ego):
    bodies = [ego.outline.placed(*row[:3]).vertices for row in states]
    touching = []
    for tick in range(min(len(states) - 1, 3 * prediction.horizon)):
        hull = shapely.convex_hull(shapely.multipoints(np.vstack(bodies[tick : tick + 2])))
        for o in prediction.obstacles:
            for region in o.between[tick // TICKS]:
                other = shapely.convex_hull(shapely.multipoints(region.vertices))
                if hull.distance(other) <= region.radius:
                    touching.append((o.obstacle.id, tick))
    return touching


def test_an_episode():
    """The paper's seed: what was foreseen is driven; at its start no pair is reachable."""
    how = Drive(execution="meta", setting=2, profile="paper", steps=5)
    episode, outcome = play(how, 5838)
    assert [step.operation for step in episode.steps] == [Meta.FAIL_SAFE] * 3 + [Meta.VERIFIED] * 2
    assert all(step.breach == 0.0 for step in episode.steps)
    assert outcome.operations == {"fail-safe": 3, "verified": 2}
    assert outcome.first_certificate is None
    assert "UNSAFE" in episode.steps[0].decision.maneuver.note
    assert str(episode.steps[3].pair) == "decelerate,right-lane"
    assert outcome.metrics.fail_safe_rate == 0.6


def test_unknown_executions():
    with pytest.raises(SettingsError, match="execution 'x'"):
        Drive(execution="x")
