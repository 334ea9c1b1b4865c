"""Many cycles: induction, and recovery from a start without a certificate."""

from dataclasses import replace

import numpy as np
import pytest
import shapely

import sandra
from sandra.decider import Decider, Operation
from sandra.errors import SettingsError
from sandra.rankers import Ranking
from sandra.scene import Obstacle, Scene, State
from slow_server import Pace, slow_server
from straight_road import Road


class Silent:
    """A ranker that never has an answer."""

    name = "silent"

    def rank(self, prompt: object, deadline: float | None = None) -> Ranking:
        return Ranking((), self.name)


def later(scene: Scene, states: np.ndarray) -> Scene:
    """The scene one step later: the ego as planned, the others as recorded."""
    x, y, heading, speed, acceleration = states[1]
    ego = replace(scene.ego, state=State(x, y, heading, max(speed, 0.0), acceleration))

    def moved(obstacle: Obstacle) -> Obstacle:
        if obstacle.states is None or len(obstacle.states) < 2:
            return obstacle
        row = obstacle.states[1]
        now = State(*row[:5]) if np.isfinite(row).all() else obstacle.state
        return replace(obstacle, states=obstacle.states[1:], state=now)

    return replace(scene, ego=ego, obstacles=tuple(moved(o) for o in scene.obstacles))


def collides(scene: Scene) -> bool:
    ego = scene.ego
    body = shapely.Polygon(ego.outline.placed(ego.state.x, ego.state.y, ego.state.heading).vertices)
    for o in scene.obstacles:
        if o.states is not None and np.isfinite(o.states[0, :3]).all():
            placed = o.outline.placed(*o.states[0, :3])
            other = shapely.Polygon(placed.vertices) if len(placed.vertices) > 2 else None
            if other is not None and body.distance(other) <= placed.radius:
                return True
    return False


def test_a_lost_ranker_ends_in_the_carried_fail_safe_at_a_standstill() -> None:
    scene = sandra.load(sandra.example("roadworks"))
    decider = Decider("exhaustive", horizon=15)
    decision = decider.decide(scene)
    assert decider.operation is Operation.CERTIFIED
    assert decision.certificate is not None
    decider._ranker = Silent()
    for _ in range(100):
        scene = later(scene, decision.maneuver.states)
        assert not collides(scene)
        decision = decider.decide(scene)
        assert decider.operation is Operation.CARRIED
        assert decision.maneuver.pair is None
        if scene.ego.state.speed == 0.0:
            break
    assert scene.ego.state.speed == 0.0
    assert np.allclose(decision.maneuver.states[:, 3], 0.0)


def test_certified_cycles_follow_each_other() -> None:
    scene = sandra.load(sandra.example("roadworks"))
    decider = Decider("exhaustive", horizon=15)
    for cycle in range(5):
        decision = decider.decide(scene)
        assert decider.operation is not Operation.EMERGENCY
        assert decider.memory.cycles == cycle + 1
        scene = later(scene, decision.maneuver.states)
        assert not collides(scene)
    assert len(decider.memory.past) >= 1


def test_a_start_without_certificate_is_an_emergency_and_says_so() -> None:
    decider = Decider("exhaustive", horizon=10)
    decision = decider.decide(sandra.load(sandra.example("nothing-safe")))
    assert decider.operation is Operation.EMERGENCY
    assert decision.maneuver.kind == "fail-safe"
    assert "no certificate has been accepted yet" in decision.maneuver.note


def test_options_that_are_its_own() -> None:
    with pytest.raises(SettingsError, match="accept"):
        Decider(accept="reachable")


def road_with(*obstacles: Obstacle, speed: float) -> Scene:
    road = Road()
    return road.scene(*obstacles, lanes=road.three_lanes(), speed=speed)


def after_a_surprise(distance: float) -> tuple[Decider, sandra.Decision, Scene]:
    """A certified cycle at 20 m/s; in the next a car stands in the lane, out of nowhere."""
    decider = Decider("exhaustive", horizon=10)
    first = decider.decide(road_with(speed=20.0))
    assert decider.operation is Operation.CERTIFIED
    assert decider.memory.carried is not None
    ends = decider.memory.carried.fail_safe.states[-1, 0]
    assert ends > 50.0  # mild: full braking takes less than 36 m
    decider._ranker = Silent()
    x, _, _, speed, _ = first.maneuver.states[1]
    car = Road().obstacle(7, distance, 0.0)
    scene = road_with(car, speed=float(speed))
    scene = replace(scene, ego=replace(scene.ego, state=State(float(x), 0.0, 0.0, float(speed))))
    return decider, decider.decide(scene), scene


def test_a_carried_fail_safe_that_no_longer_holds_is_replaced() -> None:
    decider, decision, _ = after_a_surprise(48.0)
    assert decider.operation is Operation.RENEWED
    assert decision.maneuver.kind == "fail-safe"
    assert decision.maneuver.states[-1, 0] < 48.0 - 4.5
    assert decision.maneuver.states[-1, 3] == 0.0
    again = decider.memory.carried
    assert again is not None
    assert again.age == 0.0


def test_if_nothing_else_is_found_the_carried_one_goes_on_and_says_so() -> None:
    decider, decision, _ = after_a_surprise(15.0)
    assert decider.operation is Operation.CARRIED
    assert "may no longer be clear" in decision.maneuver.note


def test_what_is_clear_is_carried_on() -> None:
    decider, decision, _ = after_a_surprise(150.0)
    assert decider.operation is Operation.CARRIED
    assert "may no longer" not in decision.maneuver.note


def test_the_server_that_is_named_is_asked(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("OPENAI_API_KEY", "none")
    with slow_server(Pace(reason=0.0, rank=0.0)) as server:
        decider = Decider("openai:model", base_url=server.url, horizon=8)
        decision = decider.decide(sandra.load(sandra.example("roadworks")))
    assert len(server.requests) == 1
    assert decision.ranking.failure is None
    assert decision.ranking.pairs
