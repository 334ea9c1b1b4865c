"""A planner of the user's own: what it plans is certified, or refused with what is wrong."""

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import sandra
from sandra.certificate import check_file, save
from sandra.certify import Basis, Proven, certify
from sandra.errors import SandraError, SettingsError
from sandra.prediction import predict
from sandra.reach import Status, Verdicts, ground, verify_on
from sandra.scene.types import Region, Scene
from straight_road import Road

HORIZON = 15
ROAD = Road(angle=0.8, x=5.0, y=-30.0)
PAIR = "decelerate,follow-lane"
Planner = Callable[[Scene], np.ndarray]


def street(**changes: object) -> Scene:
    """Three lanes, a car well ahead, one beside."""
    return ROAD.scene(
        ROAD.obstacle(11, 45.0, 0.0, speed=10.0),
        ROAD.obstacle(12, 0.0, 2.8, speed=9.0),
        lanes=ROAD.three_lanes(),
        **{"speed": 10.0, **changes},
    )


def verified(scene: Scene, pair: str = PAIR, rules: tuple[str, ...] = ()) -> Verdicts:
    return sandra.verify(scene, pair, rules=rules, horizon=HORIZON)


def lane_follower(
    scene: Scene, acceleration: float = -1.0, across: float = 0.0, step: float | None = None
) -> np.ndarray:
    """Constant acceleration along the lane; `across` metres to the left, smoothly."""
    step = scene.dt if step is None else step
    t = step * np.arange(round(HORIZON * scene.dt / step) + 1)
    speed = scene.ego.state.speed + acceleration * t
    s = scene.ego.state.speed * t + acceleration * t**2 / 2
    u = t / t[-1]
    d = across * u**3 * (10 - 15 * u + 6 * u**2)
    rate = across * 30 * u**2 * (1 - u) ** 2 / t[-1]
    points = ROAD.origin + np.column_stack([s, d]) @ ROAD._axes
    heading = ROAD.angle + np.arctan2(rate, speed)
    return np.column_stack([points, heading, speed])


@pytest.fixture(scope="module")
def verdicts() -> Verdicts:
    return verified(street())


def test_a_lane_follower_is_certified(verdicts: Verdicts, tmp_path: Path) -> None:
    scene = verdicts.ground.scene
    states = lane_follower(scene)
    verdict = sandra.certify_trajectory(verdicts, PAIR, states)
    assert verdict.status is Status.CERTIFIED, verdict
    assert isinstance(verdict.proof, Proven)
    driven = verdict.proof.witness.every(scene.dt)
    assert driven[:, :4] == pytest.approx(states, abs=0.01)
    assert driven[:, 4] == pytest.approx(-1.0, abs=1e-6)
    # The file convinces whoever distrusts all of this.
    assert check_file(save(verdict.proof.certificate, tmp_path / "c.json")).accepted
    # What was given is untouched, and the verdicts are what they were.
    assert verdicts[PAIR].status is Status.REACHABLE
    assert (states == lane_follower(scene)).all()


@pytest.mark.parametrize("step", [0.05, 0.02])
def test_finer_states(verdicts: Verdicts, step: float) -> None:
    states = lane_follower(verdicts.ground.scene, across=0.3, step=step)
    verdict = sandra.certify_trajectory(verdicts, PAIR, states.tolist(), step=step)
    assert verdict.status is Status.CERTIFIED, verdict


def test_more_columns_and_a_longer_trajectory_than_needed(verdicts: Verdicts) -> None:
    states = lane_follower(verdicts.ground.scene)
    wild = np.vstack([np.column_stack([states, states]), np.full((3, 8), np.nan)])
    verdict = sandra.certify_trajectory(verdicts, PAIR, wild)
    assert verdict.status is Status.CERTIFIED, verdict


def test_rules_come_with_the_verdicts() -> None:
    scene = street()
    strict = verified(scene, rules=("G(v <= 9.99)",))
    assert strict[0].status is Status.UNSAFE
    slower = verified(scene, rules=("F(v <= 8.9)",))
    refused = sandra.certify_trajectory(slower, PAIR, lane_follower(scene, -0.7))
    assert "does not satisfy 'F(v <= 8.9)'" in str(refused.reason)
    accepted = sandra.certify_trajectory(slower, PAIR, lane_follower(scene, -1.0))
    assert accepted.status is Status.CERTIFIED, accepted
    assert accepted.proof is not None
    assert accepted.proof.certificate.rules == ("F(v <= 8.9)",)  # type: ignore[attr-defined]


def changed(**columns: float) -> Planner:
    """The lane follower with entries of one row changed."""

    def plan(scene: Scene) -> np.ndarray:
        states = lane_follower(scene)
        for name, value in columns.items():
            states[7, ["x", "y", "heading", "speed"].index(name)] = value
        return states

    return plan


REFUSED: dict[str, tuple[Planner, str]] = {
    "NaN": (changed(x=np.nan), "0.70 s is not finite"),
    "infinite": (changed(speed=np.inf), "0.70 s is not finite"),
    "at the end of the world": (changed(x=1e308), "0.70 s is out of this world"),
    "so fast": (changed(speed=1e308), "breaks a limit: speed"),
    "spinning": (changed(heading=1e300), "has another heading"),
    "looking aside": (
        changed(heading=ROAD.angle + 0.3),
        "has another heading: 0.30 rad off at 0.7",
    ),
    "backwards": (changed(speed=-1.0), "drives backwards"),
    "too short": (lambda scene: lane_follower(scene)[:-1], "too short: 15 states where 16"),
    "empty": (lambda scene: np.empty((0, 4)), "too short"),
    "three columns": (lambda scene: lane_follower(scene)[:, :3], "no table (n + 1, 4)"),
    "one row": (lambda scene: lane_follower(scene)[0], "no table (n + 1, 4)"),
    "elsewhere": (
        lambda scene: lane_follower(scene) + np.array([0.5, 0.0, 0.0, 0.0]),
        "starts elsewhere: its x is 0.50 m",
    ),
    "turned": (
        lambda scene: lane_follower(scene) + np.array([0.0, 0.0, 0.2, 0.0]),
        "starts elsewhere: its heading is 0.20 rad",
    ),
    "faster": (
        lambda scene: lane_follower(scene) + np.array([0.0, 0.0, 0.0, 1.0]),
        "starts elsewhere: its speed is 1.00 m/s",
    ),
    "too strong": (lambda scene: lane_follower(scene, -6.5), "acceleration -6.5 m/s^2 at 0.00 s"),
    "positions and speeds differ": (
        lambda scene: np.column_stack(
            [lane_follower(scene, -1.0)[:, :3], lane_follower(scene, -2.0)[:, 3]]
        ),
        "cannot follow it",
    ),
    "a jump": (changed(x=6.0), "cannot follow it"),
    "sideways": (lambda scene: lane_follower(scene, across=5.0), "cannot follow it"),
    "not the action": (lambda scene: lane_follower(scene, -0.1), "does not satisfy 'decelerate'"),
}


@pytest.mark.parametrize("name", REFUSED)
def test_refused_with_the_reason(verdicts: Verdicts, name: str) -> None:
    plan, reason = REFUSED[name]
    verdict = sandra.certify_trajectory(verdicts, PAIR, plan(verdicts.ground.scene))
    assert verdict.status is Status.REACHABLE
    assert verdict.proof is None
    assert str(verdict.reason).startswith("no certificate: ")
    assert reason in str(verdict.reason)


def test_objects_that_are_no_numbers(verdicts: Verdicts) -> None:
    for states in ([["a", "b", "c", "d"]] * 16, [[1.0], [2.0, 3.0]], None):
        verdict = sandra.certify_trajectory(verdicts, PAIR, states)  # type: ignore[arg-type]
        assert verdict.proof is None
        assert "no table" in str(verdict.reason)


def test_a_collision_names_who_and_when(verdicts: Verdicts) -> None:
    """1 m to the left there is car 12, beside the ego."""
    states = lane_follower(verdicts.ground.scene, across=1.2)
    verdict = sandra.certify_trajectory(verdicts, PAIR, states)
    assert verdict.proof is None
    assert "collides with car 12" in str(verdict.reason)


def test_all_that_is_wrong_is_said() -> None:
    """Into a wall across the lane: out of the corridor, and through the wall."""
    scene = ROAD.scene(
        ROAD.obstacle(10, 14.0, 0.0, outline=Region.rectangle(0.5, 3.5), is_static=True),
        lanes=ROAD.three_lanes(),
        speed=10.0,
    )
    found = verified(scene)
    assert found[0].status is Status.REACHABLE, found[0]
    verdict = sandra.certify_trajectory(found, PAIR, lane_follower(scene))
    assert "leaves the corridor from" in str(verdict.reason)
    assert "collides with car 10" in str(verdict.reason)


def test_off_the_road() -> None:
    scene = ROAD.scene(speed=10.0)  # one lane, 3.5 m wide; the ego is 1.8 m wide
    verdict = sandra.certify_trajectory(verified(scene), PAIR, lane_follower(scene, across=1.2))
    assert "a part of its body leaves the road" in str(verdict.reason)


def test_no_fail_safe_no_certificate() -> None:
    """The car ahead may brake harder than the ego: at this distance it may be hit then."""
    scene = ROAD.scene(ROAD.obstacle(11, 9.0, 0.0, speed=10.0), speed=10.0)
    verdict = sandra.certify_trajectory(verified(scene), PAIR, lane_follower(scene))
    assert verdict.proof is None
    assert "no fail-safe trajectory found" in str(verdict.reason)


def test_unsafe_stays_unsafe() -> None:
    scene = ROAD.scene(speed=10.0)
    found = verified(scene, "keep,left-lane")
    verdict = sandra.certify_trajectory(found, 0, lane_follower(scene, 0.0))
    assert verdict is found[0]
    assert verdict.status is Status.UNSAFE


def test_a_certified_verdict_is_judged_anew() -> None:
    """Our own witness's certificate says nothing of the user's trajectory."""
    scene = street()
    decision = sandra.decide(scene, "rules", walk="all", horizon=HORIZON)
    certified = decision.verdicts[PAIR]
    assert certified.status is Status.CERTIFIED
    refused = sandra.certify_trajectory(decision.verdicts, PAIR, lane_follower(scene, -0.1))
    assert refused.status is Status.REACHABLE
    assert refused.proof is None
    assert isinstance(certified.proof, Proven)
    own = certified.proof.witness.every(scene.dt)
    again = sandra.certify_trajectory(decision.verdicts, PAIR, own)
    assert again.status is Status.CERTIFIED, again


def test_on_a_curve_the_drive_is_what_was_given() -> None:
    """What another planner drives with the same model comes back, a lane change on a curve too."""
    scene = sandra.load(sandra.example("merge"))
    pair = "accelerate,left-lane"
    verdicts = sandra.verify(scene, pair)
    own = certify(Basis.of(verdicts.ground), verdicts[pair])
    assert isinstance(own.proof, Proven), own
    given = own.proof.witness.every(scene.dt)
    again = sandra.certify_trajectory(verdicts, pair, given)
    assert isinstance(again.proof, Proven), again
    apart = np.abs(again.proof.witness.states - own.proof.witness.states).max(axis=0)
    assert (apart < [2e-3, 2e-3, 2e-3, 1e-9, 1e-2]).all(), apart


@pytest.mark.parametrize("step", [0.03, 0.2, 0.0, -0.1, np.nan, np.inf])
def test_a_step_that_does_not_divide_dt(verdicts: Verdicts, step: float) -> None:
    with pytest.raises(SettingsError, match="integer part"):
        sandra.certify_trajectory(verdicts, PAIR, lane_follower(verdicts.ground.scene), step=step)


@pytest.mark.parametrize("t_dec", [0.0, -0.1, 0.15, 1.6, 99.0, np.nan, np.inf])
def test_a_decision_that_is_never_due(verdicts: Verdicts, t_dec: float) -> None:
    states = lane_follower(verdicts.ground.scene)
    with pytest.raises(SettingsError, match="must be due"):
        sandra.certify_trajectory(verdicts, PAIR, states, t_dec=t_dec)
    with pytest.raises(SettingsError, match="must be due"):
        sandra.decide(verdicts.ground.scene, horizon=HORIZON, decision_period=t_dec)


def test_a_basis_is_shared_and_must_fit(verdicts: Verdicts) -> None:
    basis = Basis.of(verdicts.ground, 0.3)
    states = lane_follower(verdicts.ground.scene)
    verdict = sandra.certify_trajectory(verdicts, PAIR, states, basis=basis)
    assert verdict.status is Status.CERTIFIED
    assert verdict.proof is not None
    assert verdict.proof.fail_safe.trajectory.start == pytest.approx(0.3)  # type: ignore[attr-defined]
    with pytest.raises(SettingsError, match="another t_dec"):
        sandra.certify_trajectory(verdicts, PAIR, states, basis=basis, t_dec=0.1)
    with pytest.raises(SettingsError, match="other verdicts"):
        sandra.certify_trajectory(verified(street()), PAIR, states, basis=basis)
    with pytest.raises(KeyError):
        sandra.certify_trajectory(verdicts, "keep,follow-lane", states)


def test_the_checker_has_the_last_word(verdicts: Verdicts, monkeypatch: pytest.MonkeyPatch) -> None:
    """Where the planner's own checks see nothing, the checker still does: deny by default."""
    monkeypatch.setattr("sandra.planning.given._faults", lambda *_: iter(()))
    states = lane_follower(verdicts.ground.scene, across=1.2)
    verdict = sandra.certify_trajectory(verdicts, PAIR, states)
    assert verdict.proof is None
    assert "checker rejected it" in str(verdict.reason) or "no fail-safe" in str(verdict.reason)


def test_the_corridor_as_data_is_enough_to_plan(verdicts: Verdicts) -> None:
    """A planner that knows nothing but the JSON keeps to the middle of what it is given."""
    data = json.loads(json.dumps(verdicts.corridor(PAIR), allow_nan=False))
    assert data["format"] == "sandra-corridor/1"
    assert len(data["steps"]) == data["horizon"] + 1
    low, high = data["steps"][0][0]["acceleration"]
    wish = min(max(-1.0, low), high)
    states = [[data["ego"][name] for name in ("x", "y", "heading", "speed")]]
    for _ in range(data["horizon"]):
        x, y, heading, speed = states[-1]
        gone = speed * data["dt"] + wish * data["dt"] ** 2 / 2
        x, y = x + gone * np.cos(heading), y + gone * np.sin(heading)
        states.append([x, y, heading, speed + wish * data["dt"]])
    line = np.array(data["reference"])
    along = (line[-1] - line[0]) / np.linalg.norm(line[-1] - line[0])
    for step, (x, y, _, speed) in zip(data["steps"], states, strict=True):
        s = float(np.dot([x, y] - line[0], along))
        assert any(
            part["s"][0] - 1e-6 <= s <= part["s"][1] + 1e-6
            and part["speed"][0] - 1e-6 <= speed <= part["speed"][1] + 1e-6
            for part in step
        )
    assert sandra.certify_trajectory(verdicts, PAIR, states).status is Status.CERTIFIED


def test_parts_of_the_corridor_are_those_of_the_set(verdicts: Verdicts) -> None:
    data = verdicts.corridor(PAIR)
    corridor = verdicts[PAIR].reachable_set.corridor()
    for told, step in zip(data["steps"], corridor.steps, strict=True):
        assert [(*x["s"], *x["d"]) for x in told] == [b.rectangle for b in step]
        assert [tuple(x["speed"]) for x in told] == [b.speeds for b in step]
        assert [tuple(x["parents"]) for x in told] == [b.parents for b in step]
    regions = data["others"][0]["between"][3]
    expected = verdicts.ground.prediction.obstacles[0].between[3]
    assert [x["vertices"] for x in regions] == [r.vertices.tolist() for r in expected]
    assert {x["id"] for x in data["road"]} == {99, 100, 101}


def test_an_unsafe_pair_has_no_corridor() -> None:
    with pytest.raises(SandraError, match="UNSAFE and has no corridor"):
        verified(ROAD.scene(), "keep,left-lane").corridor(0)


def test_a_set_based_prediction_and_a_coarser_clock() -> None:
    scene = replace(street(), dt=0.2)
    settings = sandra.Settings(horizon=8)
    base = ground(scene, predict(scene, "set-based", 8, settings), settings)
    found = verify_on(base, [sandra.ActionPair.parse(PAIR)])
    t = 0.2 * np.arange(9)
    along = ROAD.origin + np.outer(10.0 * t - 1.5 * t**2 / 2, ROAD._axes[0])
    states = np.column_stack([along, np.full(9, ROAD.angle), 10.0 - 1.5 * t])
    verdict = sandra.certify_trajectory(found, PAIR, states)
    assert verdict.status is Status.CERTIFIED, verdict
