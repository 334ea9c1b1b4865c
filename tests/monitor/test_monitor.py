"""Robustness of the rules: by hand at the boundaries, by rtamt, and beside the certificate."""

from __future__ import annotations

import json
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from certified import made
from monitor_roads import DT, as_trace, car, collided, recording, rows
from reach_scenes import Course
from sandra.certificate.atoms import safe_distance_slack, signed_limits
from sandra.cli import main
from sandra.errors import FormulaError, ScenarioError, SettingsError
from sandra.monitor import Robustness, monitor
from sandra.scenarios import example
from sandra.scene import load
from sandra.scene.types import Lanelet, Region, Scene
from sandra.settings import Settings

BASE = made()
STRAIGHT = Course()
STEPS = 12
NAN = float("nan")


def steady(speed: float = 10.0, **options: Any) -> np.ndarray:
    return rows(STRAIGHT, speed * DT * np.arange(STEPS), speed=speed, **options)


def leader(gap: float, speed: float = 10.0, number: int = 7, d: float = 0.0) -> Any:
    """A car whose rear end is `gap` ahead of the ego's front."""
    s = gap + 4.5 + speed * DT * np.arange(STEPS)
    return car(STRAIGHT, number, rows(STRAIGHT, s, d, speed))


def slack_of(*others: Any, ego: np.ndarray | None = None, **options: Any) -> np.ndarray:
    scene = recording(STRAIGHT, steady() if ego is None else ego, others)
    return monitor(scene, "R_G1", **options)["R_G1"].values


# R_G1


def test_the_distance_beyond_the_safe_one() -> None:
    """d_safe = 100/12 - 100/24 + 4 = 8.1667 m at 10 m/s behind 10 m/s."""
    assert slack_of(leader(20.0)) == pytest.approx(np.full(STEPS, 20.0 - 8.0 - 1.0 / 6.0))
    assert (slack_of() == np.inf).all()


def test_at_the_safe_distance_the_rule_is_broken() -> None:
    safe = Settings(a_min=-5.0, a_obs_min=-5.0)  # d_safe = v t_d = 4 m
    for gap, holds in ((4.0 + 1e-6, True), (4.0 - 1e-6, False)):
        found = monitor(recording(STRAIGHT, steady(), [leader(gap)]), ["R_G1"], safe)
        assert found.holds is holds
        assert found["R_G1"].minimum == pytest.approx(gap - 4.0, abs=1e-9)
        assert found["R_G1"].ids == (7,) * STEPS


def test_the_nearest_precedes_even_where_another_leaves_less() -> None:
    near, far = leader(30.0, 10.0), leader(45.0, 0.0, number=8)
    assert slack_of(near, far)[0] == pytest.approx(30.0 - 8.0 - 1.0 / 6.0)


def test_the_slower_of_two_side_by_side_precedes() -> None:
    fast, slow = leader(30.0, 12.0, 7, 0.8), leader(30.0, 6.0, 8, -0.8)
    assert slack_of(fast, slow)[0] == pytest.approx(slack_of(slow)[0])


def test_another_lane_counts_from_the_step_at_which_the_body_touches_it() -> None:
    d = np.linspace(0.0, 3.5, STEPS)
    ego = steady(d=d)
    found = slack_of(leader(5.0, d=3.5), ego=ego)
    touched = d + 0.9 >= 1.75
    assert np.isinf(found[~touched]).all()
    assert found[touched] == pytest.approx(5.0 - 8.0 - 1.0 / 6.0)


def test_who_is_beside_or_behind_does_not_precede_who_was_run_into_does() -> None:
    assert np.isinf(slack_of(leader(-20.0))).all()
    ego = steady(d=1.4)
    assert np.isinf(slack_of(leader(-2.0, d=3.5), ego=ego)).all()
    assert slack_of(leader(-1.0)) == pytest.approx(np.full(STEPS, -1.0 - 8.0 - 1.0 / 6.0))


def test_pedestrians_precede_nobody_and_what_stands_stays() -> None:
    walker = car(STRAIGHT, 7, rows(STRAIGHT, np.full(STEPS, 30.0), speed=0.0), kind="pedestrian")
    assert np.isinf(slack_of(walker)).all()
    parked = replace(STRAIGHT.car(8, 60.0, 0.0), is_static=True)
    s = 2.0 * np.arange(STEPS)
    expected = 60.0 - 4.5 - s - 100.0 / 12.0 - 4.0
    assert slack_of(parked) == pytest.approx(expected)


def test_a_round_body_ends_at_its_radius() -> None:
    round_ = car(
        STRAIGHT, 7, rows(STRAIGHT, 30.0 + 2.0 * np.arange(STEPS)), outline=Region.disc(0.5)
    )
    assert slack_of(round_) == pytest.approx(30.0 - 0.5 - 2.25 - 8.0 - 1.0 / 6.0)


def test_who_cut_in_is_excused_for_t_c_and_no_longer() -> None:
    d = np.where(np.arange(STEPS) < 2, 3.5, 0.0)
    s = 10.0 + 2.0 * np.arange(STEPS)
    cutter = car(STRAIGHT, 7, rows(STRAIGHT, s, d))
    strict = slack_of(cutter)
    excused = slack_of(cutter, settings=Settings(cut_in_exception=True, t_c=1.0))
    assert np.isinf(strict[:2]).all()
    assert (strict[2:] < 0.0).all()
    assert np.isinf(excused[:7]).all()
    assert excused[7:] == pytest.approx(strict[7:])
    # Who appears in the lane has been there before.
    states = rows(STRAIGHT, s)
    states[:2] = NAN
    late = slack_of(car(STRAIGHT, 7, states), settings=Settings(cut_in_exception=True))
    assert (late[2:] < 0.0).all()


def test_a_recording_that_ends_and_an_ego_that_is_not_seen() -> None:
    short = replace(leader(20.0), states=leader(20.0).states[:4])
    found = slack_of(short)
    assert np.isfinite(found[:4]).all()
    assert np.isinf(found[4:]).all()
    ego = steady()
    ego[3] = NAN
    found = slack_of(leader(20.0), ego=ego)
    assert np.isnan(found).tolist() == [k == 3 for k in range(STEPS)]


def chain() -> tuple[Lanelet, ...]:
    """Three lanelets in a row; the last one, or two of them, follow a bend to the left."""

    def strip(number: int, low: float, high: float, end: float, **links: Any) -> Lanelet:
        ends = np.array([low, high])
        left, right = (np.column_stack([ends, [y, y + end]]) for y in (1.75, -1.75))
        values = {"successors": (), "predecessors": (), **links}
        return Lanelet(
            number,
            left,
            right,
            (),
            **values,
            adjacent_left=None,
            adjacent_right=None,
            speed_limit=None,
        )

    return (
        strip(1, -40.0, 30.0, 0.0, successors=(2, 3)),
        strip(2, 30.0, 90.0, 0.0, predecessors=(1,)),
        strip(3, 30.0, 90.0, 40.0, predecessors=(1,)),
    )


def test_each_branch_of_a_fork_has_its_leader() -> None:
    straight = car(STRAIGHT, 7, rows(STRAIGHT, 60.0 + 2.0 * np.arange(STEPS)))
    aside = np.column_stack(
        [np.full(STEPS, 45.0), np.full(STEPS, 10.0), np.full(STEPS, 0.59), np.zeros((STEPS, 2))]
    )
    other = car(STRAIGHT, 8, aside)
    scene = replace(recording(STRAIGHT, steady(), [straight, other]), lanelets=chain())
    found = monitor(scene, "R_G1")["R_G1"]
    # The one that stands on the branch demands more.
    assert found.ids == (8,) * STEPS
    only = monitor(replace(scene, obstacles=(straight,)), "R_G1")["R_G1"]
    assert only.ids == (7,) * STEPS
    assert only.values == pytest.approx(60.0 - 4.5 - 8.0 - 1.0 / 6.0)


def test_against_the_traffic_distances_grow_ahead_of_the_ego() -> None:
    """The whole map turned about: the ego drives against all lanes."""

    def turned(x: Lanelet) -> Lanelet:
        return replace(x, left=x.right[::-1], right=x.left[::-1])

    scene = recording(STRAIGHT, steady(), [leader(20.0, 10.0)])
    scene = replace(scene, lanelets=tuple(turned(x) for x in scene.lanelets))
    assert monitor(scene, "R_G1")["R_G1"].values == pytest.approx(20.0 - 8.0 - 1.0 / 6.0)


# R_G2 and R_G3


def test_braking_is_abrupt_below_the_threshold_unless_it_is_justified() -> None:
    a = np.array([0.0, -2.0, -2.0 - 1e-9, -5.0] + [0.0] * 8)
    scene = recording(STRAIGHT, steady(a=a))
    found = monitor(scene, "R_G2")["R_G2"]
    assert found.values == pytest.approx(a + 2.0)
    assert found.kept.tolist() == [True, True, False, False] + [True] * 8
    assert (found.minimum, found.step) == (-3.0, 3)
    excused = np.array([False, False, True, True] + [False] * 8)
    found = monitor(scene, "R_G2", justified=excused)["R_G2"]
    assert found.holds
    assert found.minimum == 0.0
    assert np.isinf(found.values[2:4]).all()


def test_accelerations_that_are_not_recorded_come_from_speeds() -> None:
    speed = np.linspace(10.0, 10.0 - 11 * 0.5, STEPS)
    ego = rows(STRAIGHT, np.arange(STEPS), speed=speed, a=NAN)
    assert monitor(recording(STRAIGHT, ego), "R_G2")["R_G2"].values == pytest.approx(-2.5 + 2.0)


@pytest.mark.parametrize(("limit", "allowed"), [(12.0, 12.0), (None, 43.0), (60.0, 43.0)])
def test_the_signed_limit_and_the_others(limit: float | None, allowed: float) -> None:
    found = monitor(recording(STRAIGHT, steady(), limit=limit), "R_G3")
    assert found["R_G3"].values == pytest.approx(allowed - 10.0)
    assert np.isnan(found.limits).all() == (limit is None)
    assert ("no signed speed limit is known" in str(found)) == (limit is None)


def test_at_the_limit_the_rule_is_kept() -> None:
    assert monitor(recording(STRAIGHT, steady(), limit=10.0), "R_G3").holds
    assert not monitor(recording(STRAIGHT, steady(), limit=9.999), "R_G3").holds
    truck = Settings(v_type=9.5)
    assert monitor(recording(STRAIGHT, steady()), "R_G3", truck)["R_G3"].minimum == -0.5


def test_off_the_road_no_limit_is_known() -> None:
    found = monitor(recording(STRAIGHT, steady(d=20.0), limit=5.0), "R_G3")
    assert found.off_road.all()
    assert found["R_G3"].values == pytest.approx(33.0)
    assert "off all lanelets at 12 of 12 steps" in str(found)


# Two ways to the truth


def drawn(seed: int, kappa: float = 0.0) -> Scene:
    """An ego that changes lanes among vehicles on three lanes."""
    rng = np.random.default_rng(seed)
    course = Course(kappa, step=1.0)
    n = int(rng.integers(2, 30))
    t = DT * np.arange(n)

    def wander(start: float, speed: float) -> np.ndarray:
        d = 3.5 * rng.integers(-1, 2) + rng.normal() * 0.3
        to = np.clip(d + rng.choice([-3.5, 0.0, 3.5]), -4.0, 4.0)
        part = np.clip((t - rng.uniform(0.0, 3.0)) / 3.0, 0.0, 1.0)
        return rows(
            course,
            start + speed * t,
            d + (to - d) * part,
            speed,
            rng.normal() * 0.02,
            rng.uniform(-4.0, 2.0),
        )

    ego = wander(0.0, rng.uniform(0.0, 20.0))
    others = []
    for i in range(int(rng.integers(0, 6))):
        states = wander(rng.uniform(-30.0, 80.0), rng.uniform(0.0, 20.0))
        if rng.random() < 0.3:
            states[: int(rng.integers(0, n))] = NAN
        if np.isfinite(states).any():
            others.append(car(course, 10 + i, states))
    return recording(course, ego, others, limit=float(rng.uniform(5.0, 25.0)))


@pytest.mark.parametrize("kappa", [0.0, 0.004])
@pytest.mark.parametrize("exception", [False, True])
def test_the_certificate_says_the_same(kappa: float, exception: bool) -> None:
    """Its reference is one line for all lanes: on a bend distances differ by d kappa of them."""
    chosen = Settings(cut_in_exception=exception, t_c=1.0)
    broken = kept = 0
    for seed in range(120):
        scene = drawn(seed, kappa)
        trace = as_trace(scene, replace(BASE, settings=chosen))
        ours, theirs = monitor(scene, settings=chosen)["R_G1"].values, safe_distance_slack(trace)
        ran_into = collided(scene)  # the certificate looks at collisions elsewhere
        here = np.isfinite(theirs) & ~ran_into
        if kappa == 0.0:
            assert (np.isfinite(ours) == np.isfinite(theirs))[~ran_into].all()
            assert ours[here] == pytest.approx(theirs[here], abs=1e-6)
        else:
            clear = here & np.isfinite(ours) & (np.abs(theirs) > 2.0)
            assert ((ours > 0.0) == (theirs > 0.0))[clear].all()
        broken, kept = broken + int((theirs < 0).sum()), kept + int((theirs > 0).sum())
        assert monitor(scene, "R_G3").limits == pytest.approx(signed_limits(trace))
    assert min(broken, kept) > 50


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 10**6), st.floats(-3.0, 3.0), st.floats(-200.0, 200.0))
def test_a_turned_and_moved_world_is_as_robust(seed: int, angle: float, x: float) -> None:
    scene = drawn(seed)
    c, s = np.cos(angle), np.sin(angle)
    turn = np.array([[c, s], [-s, c]])

    def moved(points: np.ndarray) -> np.ndarray:
        return points @ turn + [x, -x]

    def states(given: np.ndarray | None) -> np.ndarray:
        assert given is not None
        return np.column_stack([moved(given[:, :2]), given[:, 2] + angle, given[:, 3:]])

    other = replace(
        scene,
        recorded_ego=states(scene.recorded_ego),
        obstacles=tuple(replace(o, states=states(o.states)) for o in scene.obstacles),
        lanelets=tuple(
            replace(x, left=moved(x.left), right=moved(x.right)) for x in scene.lanelets
        ),
    )
    for one, two in zip(monitor(scene).rules, monitor(other).rules, strict=True):
        assert one.values == pytest.approx(two.values, abs=1e-5)


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 10**6), st.floats(0.0, 5.0))
def test_braking_harder_than_counted_on_never_makes_it_safer(seed: int, more: float) -> None:
    scene = drawn(seed)
    weak, strong = Settings(a_obs_min=-6.0), Settings(a_obs_min=-6.0 - more)
    values = [monitor(scene, "R_G1", s)["R_G1"].values for s in (weak, strong)]
    assert (values[1] <= values[0]).all()


@pytest.mark.parametrize("seed", range(12))
def test_rtamt_says_the_same(seed: int) -> None:
    """Discrete-time STL of the same signals; its G over the whole trace is the value at step 0."""
    rtamt = pytest.importorskip("rtamt", reason="rtamt is not installed: no second monitor")
    scene = drawn(seed)
    justified = np.random.default_rng(seed).random(len(scene.recorded_ego)) < 0.2
    found = monitor(scene, justified=justified)
    trace = as_trace(scene, BASE)
    ego = scene.recorded_ego
    slack, limit = np.minimum(safe_distance_slack(trace), 1e6), signed_limits(trace)
    signals = {
        "slack": slack,
        "a": ego[:, 4],
        "excuse": np.where(justified, 1e6, -1e6),
        "v": ego[:, 3],
        "limit": limit,
    }
    texts = {
        "R_G1": "always (slack >= 0)",
        "R_G2": "always ((a < -2.0) implies (excuse >= 0))",
        "R_G3": "always ((v <= limit) and (v <= 50.0) and (v <= 43.0))",
    }
    ours = {rule.rule: rule.minimum for rule in found.rules}
    if collided(scene).any():
        ours.pop("R_G1")  # see the test of the certificate
    for rule, value in ours.items():
        spec = rtamt.StlDiscreteTimeSpecification()
        for name in signals:
            spec.declare_var(name, "float")
        spec.spec = texts[rule]
        spec.parse()
        data = {
            "time": list(range(len(ego))),
            **{k: list(map(float, x)) for k, x in signals.items()},
        }
        expected = spec.evaluate(data)[0][1]
        assert min(value, 1e6) == pytest.approx(min(expected, 1e6), abs=1e-6)


# Results, errors, the command line


def test_results_print_and_are_plain_data(tmp_path: Path) -> None:
    scene = recording(STRAIGHT, steady(a=-3.0), [leader(5.0)], limit=20.0)
    found = monitor(scene)
    assert isinstance(found, Robustness)
    assert not found.holds
    data = json.loads(json.dumps(found.to_dict()))
    assert [rule["holds"] for rule in data["rules"]] == [False, False, True]
    assert data["rules"][0]["preceding"] == [7] * STEPS
    assert "R_G1  BROKEN  smallest -3.167 m at step 0, vehicle 7; broken at 12 steps" in str(found)
    assert (np.abs(found["R_G1"].normalised) <= 1.0).all()
    assert found["R_G2"].normalised == pytest.approx(-0.25)
    with pytest.raises(KeyError, match="monitored were R_G1"):
        found["R_G4"]
    drawn_to = found.figure(tmp_path / "r.svg")
    assert drawn_to.read_text().startswith("<?xml")
    once, again = (found.figure(tmp_path / f"{i}.png").read_bytes() for i in (1, 2))
    assert once == again
    with pytest.raises(SettingsError, match="must end in"):
        found.figure(tmp_path / "r.bmp")


def test_a_figure_of_one_step_without_anybody(tmp_path: Path) -> None:
    found = monitor(recording(STRAIGHT, steady()[:1]))
    assert found.figure(tmp_path / "one.png").stat().st_size > 1000


def test_what_cannot_be_monitored() -> None:
    scene = recording(STRAIGHT, steady())
    with pytest.raises(FormulaError, match="'R_G4' is not monitored: choose from R_G1"):
        monitor(scene, "R_G1,R_G4")
    with pytest.raises(FormulaError, match="no rule"):
        monitor(scene, ())
    with pytest.raises(ScenarioError, match="not recorded"):
        monitor(replace(scene, recorded_ego=None))
    with pytest.raises(ScenarioError, match=r"shape \(3, 4\)"):
        monitor(scene, states=np.zeros((3, 4)))
    with pytest.raises(ScenarioError, match="at least one"):
        monitor(scene, states=np.full((3, 5), NAN))
    with pytest.raises(ScenarioError, match="12 booleans"):
        monitor(scene, justified=np.zeros(3, dtype=bool))
    with pytest.raises(ScenarioError, match="type float64"):
        monitor(scene, justified=np.zeros(STEPS))


def test_the_command(capsys: Any, tmp_path: Path) -> None:
    assert main(["monitor", "recorded-ego"]) == 0
    assert "R_G1  kept" in capsys.readouterr().out
    picture = tmp_path / "r.png"
    assert (
        main(["monitor", "recorded-ego", "--rules", "R_G2", "--json", "--figure", str(picture)])
        == 0
    )
    data = json.loads(capsys.readouterr().out)
    assert data["steps"] == 61
    assert Path(data["figure"]).exists()
    strict = tmp_path / "strict.toml"
    strict.write_text("a_abrupt = 0.0\n")
    words = ["monitor", "recorded-ego", "--settings", str(strict)]
    assert main(words) == 1
    assert main([*words, "--justified", "0-60"]) == 0
    assert main([*words, "--justified", "3-99"]) == 2
    assert "is no step or range of steps from 0 to 60" in capsys.readouterr().err
    assert main(["monitor", "nothing-safe"]) == 2
    assert "the ego is not recorded" in capsys.readouterr().err


def test_thousands_of_bodies_take_milliseconds() -> None:
    others = [
        car(
            STRAIGHT,
            10 + i,
            rows(STRAIGHT, 7.0 * (i // 3) + 2.0 * np.arange(31), 3.5 * (i % 3 - 1)),
        )
        for i in range(50)
    ]
    scene = recording(STRAIGHT, rows(STRAIGHT, 2.0 * np.arange(31)), others)
    monitor(scene)
    times = []
    for _ in range(5):
        begin = time.process_time()
        monitor(scene)
        times.append(time.process_time() - begin)
    assert min(times) < 0.1


def test_the_recording_that_is_shipped() -> None:
    found = monitor(load(example("recorded-ego")))
    assert found.holds
    assert len(found.limits) == 61
