"""Each bound of the checker at its very value: what is allowed there, and what is not beyond."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely

from certified import constant, drive, made, turning_scene
from reach_scenes import Course
from sandra.certificate import (
    Certificate,
    Violation,
    certificate,
    check,
    collision,
    file,
    literals,
    place,
)
from sandra.certificate import timing as times
from sandra.certificate.atoms import NEIGHBOURHOOD, Trace, decide, safe_distance_slack
from sandra.certificate.atoms import signed_limits as limits
from sandra.certificate.collision import NEAR, clearance
from sandra.certificate.form import (
    LARGEST,
    LONGEST,
    MOST_RULES,
    SMALLEST,
    _array,
    _number,
    _problems,
    _regions,
    _trajectory,
)
from sandra.certificate.geometry import Sweep, sweep
from sandra.certificate.motion import SLACK, motion, speed
from sandra.certificate.others import ALONG, _some, _straight_on
from sandra.certificate.reading import MOST, _count, _WrongKindError
from sandra.certificate.reading import _number as read_number
from sandra.certificate.types import LaneOf, Pavement
from sandra.errors import CertificateError, FormulaError
from sandra.logic import Predicate, Vocabulary, parse, specification
from sandra.planning.types import Trajectory
from sandra.prediction import predict
from sandra.scene.types import Region
from sandra.settings import Assumptions, Settings

BASE = made()
JUST_MORE = 1 + 1e-6


# Atoms


def test_the_safe_distance_itself_is_not_safe() -> None:
    slack = np.array([0.0, 1e-12, -1e-12, np.inf])
    safe = decide(Trace.of(BASE), Predicate("keeps_safe_distance", "preceding"), slack)
    assert safe.true == (False, True, False, True)


def test_the_speed_limit_itself_may_be_driven() -> None:
    for limit, ok in ((10.0, True), (9.999, False)):
        signed = tuple(replace(x, speed_limit=limit) for x in BASE.lanelets)
        assert check(replace(BASE, lanelets=signed)).accepted == ok


@pytest.mark.parametrize("lanes", [(LaneOf("current", (1,)),), ()])
def test_how_wide_a_slit_of_the_map_may_be(lanes: tuple[LaneOf, ...]) -> None:
    """The border's length is a power of two, so that the distance is exact."""
    for y, limit in ((NEIGHBOURHOOD, 8.0), (NEIGHBOURHOOD * JUST_MORE, -np.inf)):
        right = np.array([[-16.0, y], [48.0, y]])
        above = Pavement(1, right + np.array([0.0, 3.0]), right, 8.0)
        assert set(limits(Trace.of(replace(BASE, lanelets=(above,), lanes=lanes)))) == {limit}


def test_of_a_slit_the_own_lane_says_how_fast() -> None:
    right = np.array([[-16.0, NEIGHBOURHOOD], [48.0, NEIGHBOURHOOD]])
    own = Pavement(1, right + np.array([0.0, 3.0]), right, 8.0)
    foreign = replace(own, id=2, speed_limit=3.0)
    c = replace(BASE, lanelets=(own, foreign), lanes=(LaneOf("current", (1,)),))
    assert set(limits(Trace.of(c))) == {8.0}


def ahead(*cars: tuple[float, float, float]) -> float:
    """Slack at the first letter towards cars at (s, d, v), the ego at 10 m/s, 4.5 m long."""
    course = Course(step=5.0)
    others = [course.car(20 + i, s, d, v) for i, (s, d, v) in enumerate(cars)]
    scene = course.scene(course.lanes(left=1, right=0), others, speed=10.0)
    scene = replace(scene, ego=replace(scene.ego, wheelbase=2.6))
    return float(safe_distance_slack(Trace.of(made(scene)))[0])


def test_who_touches_the_front_precedes() -> None:
    needed = 100 / 12 + 4.0
    assert ahead((4.5, 0.0, 0.0)) == pytest.approx(-needed)
    assert ahead((4.4999, 0.0, 0.0)) == np.inf


def test_of_two_at_the_same_place_the_slower_precedes() -> None:
    slow, fast = (40.0, 0.2, 2.0), (40.0, -0.2, 12.0)
    expected = 35.5 - (100 / 12 - 4 / 24 + 4.0)
    assert ahead(slow, fast) == pytest.approx(expected)
    assert ahead(fast, slow) == pytest.approx(expected)
    # Who is farther does not matter, however slow.
    assert ahead(slow, (41.0, 0.0, 0.0)) == pytest.approx(expected)
    assert ahead((41.0, 0.0, 0.0), slow) == pytest.approx(expected)


def test_the_largest_formula_is_checked(monkeypatch: pytest.MonkeyPatch) -> None:
    formula = parse("true -> true")
    monkeypatch.setattr(literals, "LARGEST", 5)
    assert literals.holds(formula, {}, 1)
    monkeypatch.setattr(literals, "LARGEST", 4)
    with pytest.raises(FormulaError, match="too large"):
        literals.holds(formula, {}, 1)


# The builder


@pytest.mark.parametrize(
    ("right", "left", "kept"),
    [
        (50.0, 54.0, True),
        (50.001, 54.0, False),
        (-54.0, -50.0, True),
        (-54.0, -50.001, False),
    ],
)
def test_lanelets_up_to_50_m_away_are_kept(right: float, left: float, kept: bool) -> None:
    course = Course(step=5.0)
    beside = course.lane("other", 900, right, left)
    scene = course.scene(course.lanes(left=1, right=0), more_lanelets=[beside], speed=10.0)
    scene = replace(scene, ego=replace(scene.ego, wheelbase=2.6))
    assert (900 in {x.id for x in made(scene).lanelets}) == kept


def test_only_smaller_numbers_than_rounding_become_zero() -> None:
    assert made(turning_scene(d=1e-30)).initial[1] == 1e-30
    assert made(turning_scene(d=0.999e-30)).initial[1] == 0.0


# Collisions


def box(x0: float, x1: float) -> Region:
    return Region(np.array([[x0, 0.0], [x1, 0.0], [x1, 1.0], [x0, 1.0]]))


def boxes(*edges: tuple[float, float], margins: float = 0.0) -> Sweep:
    hulls = np.array([shapely.box(x0, 0.0, x1, 1.0) for x0, x1 in edges])
    return Sweep(hulls, np.full(len(hulls), margins))


def test_the_first_touch_counts_not_the_deepest() -> None:
    # Step 0 only touches, step 1 is a metre in.
    moving = boxes((0.0, 2.0), (1.0, 3.0), margins=0.0)
    deeper = Sweep(moving.hulls, np.array([0.0, 1.0]))
    for steps_per_interval in (2, 1):  # in one interval of the prediction, and in two
        regions = ((box(2.0, 4.0),), (box(2.0, 4.0),))
        found = clearance(deeper, 0, steps_per_interval, [regions])
        assert (found.distance, found.step) == (0.0, 0)


def test_of_equal_clearances_the_first_is_told() -> None:
    found = clearance(boxes((0.0, 1.0), (0.0, 1.0)), 0, 1, [((box(2.0, 3.0),),) * 2])
    assert (found.distance, found.step) == (1.0, 0)


def test_clearances_up_to_2_m_are_exact() -> None:
    slanted = Region(np.array([[1.0 + NEAR, 5.0], [9.0, 0.0], [9.0, 5.0]]))
    exact = float(shapely.distance(shapely.box(0, 0, 1, 1), shapely.Polygon(slanted.vertices)))
    assert exact > NEAR + 0.5
    assert clearance(boxes((0.0, 1.0)), 0, 1, [((slanted,),)]).distance == exact
    farther = Region(slanted.vertices + np.array([1e-6, 0.0]))
    assert clearance(boxes((0.0, 1.0)), 0, 1, [((farther,),)]).distance == pytest.approx(2.0)


@pytest.mark.parametrize(
    ("kind", "trajectory", "interval", "step", "condition"),
    [
        ("likely", "witness", 14, 29, "witness-collision"),
        ("possible", "witness", 0, 1, "set-based-collision"),
        ("possible", "fail_safe", 20, 39, "set-based-collision"),
    ],
)
def test_a_touch_is_a_collision(
    monkeypatch: pytest.MonkeyPatch,
    kind: str,
    trajectory: str,
    interval: int,
    step: int,
    condition: str,
) -> None:
    """Without the margin for rounding, or no distance would be exactly zero."""

    def bare(t: Trajectory, body: Any) -> Sweep:
        swept = sweep(t, body)
        return Sweep(swept.hulls, np.zeros_like(swept.margins))

    monkeypatch.setattr(collision, "sweep", bare)
    front = shapely.bounds(sweep(getattr(BASE, trajectory), BASE.ego).hulls[step])[2]
    checks = {
        "witness-collision": collision.witness_collision,
        "set-based-collision": collision.set_based_collision,
    }
    for gap in (0.0, 0.01):
        wall = Region(np.array([[front + gap, -1.0], [front + gap + 1, -1.0], [front + gap, 1.0]]))
        other = BASE.obstacles[0]
        steps = [() for _ in getattr(other, kind)]
        steps[interval] = (wall,)
        c = replace(BASE, obstacles=(replace(other, **{kind: tuple(steps)}),))
        answer = checks[condition](c)
        assert isinstance(answer, Violation) == (gap == 0.0)


# The file and its form


def test_the_largest_file_is_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = file.save(BASE, tmp_path / "c.json")
    size = path.stat().st_size
    monkeypatch.setattr(file, "LARGEST_FILE", size)
    assert check(file.load(path)).accepted
    monkeypatch.setattr(file, "LARGEST_FILE", size - 1)
    with pytest.raises(CertificateError, match="larger than"):
        file.load(path)


def test_numbers_of_a_file_are_below_1e300() -> None:
    assert read_number(0.999e300) == 0.999e300
    for value in (1e300, -1e300):
        with pytest.raises(_WrongKindError):
            read_number(value)
    assert (_count(0), _count(MOST)) == (0, MOST)
    for count in (-1, MOST + 1):
        with pytest.raises(_WrongKindError):
            _count(count)


def test_a_fail_safe_without_steps_comes_back(tmp_path: Path) -> None:
    course = Course(step=5.0)
    scene = course.scene(course.lanes(left=1, right=0), [], speed=0.0)
    scene = replace(scene, ego=replace(scene.ego, wheelbase=2.6))
    c = made(scene, "stop,follow-lane", (), stop=np.zeros((0, 2)))
    back = file.load(file.save(c, tmp_path / "c.json"))
    assert back.fail_safe.inputs.shape == (0, 2)
    assert check(back).accepted


def problems(c: Certificate, word: str) -> bool:
    """Whether a problem is told that holds a word."""
    return any(word in problem for problem in _problems(c))


def test_sizes_at_their_limits_have_a_form() -> None:
    for horizon, ok in ((1, True), (LONGEST, True), (0, False), (LONGEST + 1, False)):
        assert problems(replace(BASE, horizon=horizon), "'horizon'") != ok
    for count, ok in ((MOST_RULES, True), (MOST_RULES + 1, False)):
        assert problems(replace(BASE, rules=("R_G1",) * count), "rules are more") != ok
    for length, ok in ((0.01, True), (100.0, True), (0.0099, False), (100.1, False)):
        for name in ("length", "width", "wheelbase"):
            ego = replace(BASE.ego, **{name: length})
            assert problems(replace(BASE, ego=ego), f"ego.{name}") != ok
    for steps, ok in ((LONGEST, True), (LONGEST + 1, False)):
        t = Trajectory(np.zeros((steps + 1, 5)), np.zeros((steps, 2)), 0.05)
        assert (list(_trajectory("witness", t)) == []) == ok
        empty = replace(BASE.obstacles[0], possible=((),) * steps)
        assert problems(replace(BASE, obstacles=(empty,)), "predicted region") != ok


def test_lines_have_two_points_and_limits_may_be_zero() -> None:
    for points, ok in ((2, True), (1, False)):
        assert problems(replace(BASE, reference=BASE.reference[:points]), "'reference'") != ok
        first = BASE.lanelets[0]
        for side in ("left", "right"):
            short = replace(first, **{side: getattr(first, side)[:points]})
            c = replace(BASE, lanelets=(short, *BASE.lanelets[1:]))
            assert problems(c, "a border is no line") != ok
    for limit, ok in ((0.0, True), (-1e-9, False)):
        c = replace(BASE, lanelets=(replace(BASE.lanelets[0], speed_limit=limit),))
        assert problems(c, "speed limit") != ok


def test_a_lane_may_have_all_lanelets_there_are() -> None:
    for ids, ok in (((100, 101), True), ((100, 101, 102), False)):
        c = replace(BASE, lanes=(LaneOf("current", ids),))
        assert problems(c, "lanelets that are not there") != ok


def test_settings_at_their_limits_have_a_form() -> None:
    for angle, ok in ((math.nextafter(math.pi / 2, 0.0), True), (math.pi / 2, False)):
        assert problems(replace(BASE, settings=Settings(steering_angle_max=angle)), "pi/2") != ok
    for value, ok in ((-LARGEST, True), (-LARGEST * JUST_MORE, False)):
        assert problems(replace(BASE, settings=Settings(a_lon_min=value)), "a_lon_min") != ok
    for value, ok in ((0.0, True), (-1e-9, False)):
        loose = replace(Assumptions())
        object.__setattr__(loose, "max_acceleration", value)
        settings = replace(Settings(), assumptions=loose)
        assert problems(replace(BASE, settings=settings), "max_acceleration") != ok


def test_numbers_at_their_limits_are_sensible() -> None:
    for size, ok in (
        (LARGEST, True),
        (LARGEST * JUST_MORE, False),
        (SMALLEST, True),
        (SMALLEST / JUST_MORE, False),
        (0.0, True),
    ):
        for value in (size, -size):
            assert _number(value) == ok
            assert _array(np.array([value]), (1,)) == ok
    for radius, ok in ((0.0, True), (-1e-9, False)):
        region = Region(np.zeros((1, 2)))
        object.__setattr__(region, "radius", radius)
        assert _regions([region]) == ok


# Motion


def standing(speed_after: float) -> Certificate:
    """One step from a standstill, after which the speed is said to be something."""
    states = np.zeros((2, 5))
    states[1, 3] = speed_after
    t = Trajectory(states, np.zeros((1, 2)), 0.05)
    return replace(BASE, witness=t, fail_safe=t)


def test_tolerances_of_the_motion_may_be_used_in_full() -> None:
    assert not isinstance(motion(standing(1e-8)), Violation)
    assert isinstance(motion(standing(1e-8 * JUST_MORE)), Violation)


def test_the_slack_of_bounds_may_be_used_in_full() -> None:
    v_max = BASE.settings.v_max
    for value in (-SLACK, v_max + SLACK):
        assert not isinstance(speed(standing(value)), Violation)
    for value, bound in ((-SLACK * JUST_MORE, 0.0), (v_max + 1.1 * SLACK, v_max)):
        answer = speed(standing(value))
        assert isinstance(answer, Violation)
        assert answer.allowed == bound


# Others


def test_intervals_that_are_looked_at() -> None:
    assert _some(0) == []
    assert _some(1) == [0]
    assert _some(4) == [0, 1, 2, 3]
    assert _some(5) == [0, 1, 2, 4]
    assert _some(9) == [0, 1, 2, 4, 8]
    assert _some(12) == [0, 1, 2, 4, 8, 11]


def played(heading: float, v: float) -> bool:
    """Whether a round vehicle in the middle of a wide lanelet along x is played."""
    state = np.array([[0.0, 0.0, heading, v, 0.0]])
    other = replace(BASE.obstacles[0], outline=Region.disc(1.0), states=state)
    left, right = (np.array([[-50.0, y], [50.0, y]]) for y in (50.0, -50.0))
    wide = Pavement(1, left, right, None)
    return bool(_straight_on(replace(BASE, obstacles=(other,), lanelets=(wide,))))


def test_who_drives_along_its_lane_is_played() -> None:
    for sign in (1, -1):
        assert played(sign * ALONG, 5.0)
        assert not played(sign * ALONG * JUST_MORE, 5.0)
    assert played(0.0, 0.0)
    assert not played(0.0, -1e-9)


# Places


def test_the_edge_of_the_road_may_be_touched(monkeypatch: pytest.MonkeyPatch) -> None:
    """Without the margin for rounding, or no distance would be exactly zero."""

    def bare(t: Trajectory, body: Any) -> Sweep:
        swept = sweep(t, body)
        return Sweep(swept.hulls, np.zeros_like(swept.margins))

    hulls = np.concatenate([sweep(t, BASE.ego).hulls for t in (BASE.witness, BASE.fail_safe)])
    x0, y0, x1, y1 = shapely.total_bounds(hulls)
    monkeypatch.setattr(place, "sweep", bare)
    monkeypatch.setattr(place, "pavement", lambda lanelets: shapely.box(x0, y0, x1, y1))
    assert not isinstance(place.road(BASE), Violation)
    monkeypatch.setattr(place, "pavement", lambda lanelets: shapely.box(x0, y0, x1 - 1e-9, y1))
    assert isinstance(place.road(BASE), Violation)


def test_what_is_a_standstill() -> None:
    for last, ok in ((1e-6, True), (-1e-6, True), (1.01e-6, False)):
        states = BASE.fail_safe.states.copy()
        states[-1, 3] = last
        c = replace(BASE, fail_safe=replace(BASE.fail_safe, states=states))
        assert isinstance(place.standstill(c), Violation) != ok


def test_how_much_of_a_conflict_area_may_be_covered(monkeypatch: pytest.MonkeyPatch) -> None:
    left, right = np.array([[13.0, -20.0], [13.0, 20.0]]), np.array([[16.0, -20.0], [16.0, 20.0]])
    c = replace(BASE, conflicts=(Pavement(500, left, right, None),))
    covered = place.conflict_area(c)
    assert isinstance(covered, Violation)
    assert covered.measured is not None
    monkeypatch.setattr(place, "OVERLAP", covered.measured)
    assert not isinstance(place.conflict_area(c), Violation)


# Times: steps of 1/32 s, and rounding of 2^-30 s, so that all sums are exact


ROUNDING = 2.0**-30
TAU = 2.0**-5


def gridded(
    tau: float = TAU,
    n: int = 3,
    horizon: int = 21,
    decide_at: int = 3,
    **changes: Any,
) -> Certificate:
    """A certificate of which only the times mean something; n steps of tau per dt."""
    steps = n * horizon
    witness = Trajectory(np.zeros((steps + 1, 5)), np.zeros((steps, 2)), tau)
    at = decide_at * tau
    fail_safe = Trajectory(np.zeros((9, 5)), np.zeros((8, 2)), tau, at)
    values: dict[str, Any] = {
        "dt": n * tau,
        "horizon": horizon,
        "witness": witness,
        "fail_safe": fail_safe,
        "t_dec": at,
    }
    for name, change in changes.items():
        values[name] = change(values[name])
    return replace(BASE, **values)


@pytest.fixture(name="exact")
def _exact(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(times, "ROUNDING", ROUNDING)


def plus(amount: float) -> Callable[[float], float]:
    return lambda value: value + amount


def late(amount: float) -> Callable[[Trajectory], Trajectory]:
    return lambda t: replace(t, start=t.start + amount)


def slower(amount: float) -> Callable[[Trajectory], Trajectory]:
    return lambda t: replace(t, tau=t.tau + amount)


@pytest.mark.parametrize(
    ("name", "change"),
    [
        ("dt", plus),
        ("witness", late),
        ("fail_safe", late),
        # Over 64 states it may add up to `ROUNDING`.
        ("fail_safe", lambda amount: slower(amount / 64)),
    ],
)
def test_times_may_be_off_by_rounding(
    exact: None, name: str, change: Callable[[float], Any]
) -> None:
    assert not isinstance(times.grid(gridded()), Violation)
    for sign in (1, -1):
        assert not isinstance(times.grid(gridded(**{name: change(sign * ROUNDING)})), Violation)
        assert isinstance(times.grid(gridded(**{name: change(sign * 1.5 * ROUNDING)})), Violation)


def test_the_decision_is_on_the_grid_but_for_rounding(exact: None) -> None:
    for i, off, ok in ((3, 3.0, True), (3, 3.5, False), (1, 1.0, True), (1, 1.5, False)):
        shift = off * ROUNDING
        c = gridded(decide_at=i, t_dec=plus(shift), fail_safe=late(shift))
        assert isinstance(times.grid(c), Violation) != ok


def test_the_decision_is_after_0_and_not_after_the_end() -> None:
    for i, ok in ((1, True), (63, True), (0, False), (64, False)):
        assert isinstance(times.grid(gridded(decide_at=i)), Violation) != ok


def test_lengths_of_steps() -> None:
    def refused(c: Certificate, word: str) -> bool:
        answer = times.grid(c)
        return isinstance(answer, Violation) and word in answer.sentence

    # One step of the trajectory per step of the prediction will do.
    assert not isinstance(times.grid(gridded(n=1)), Violation)
    for tau, ok in ((1e-4, True), (0.99e-4, False), (0.05 + 1e-9, True), (0.05 + 3e-9, False)):
        assert refused(gridded(tau, n=20), "step must be at most") != ok
    for dt, ok in ((1e-3, True), (0.99e-3, False), (10.0, True), (10.01, False)):
        assert refused(gridded(dt=lambda _, dt=dt: dt), "dt must be between") != ok


def test_states_may_differ_by_rounding() -> None:
    for gap, ok in ((1e-9, True), (1e-9 * JUST_MORE, False)):
        c = replace(BASE, initial=np.zeros(5), witness=replace(BASE.witness))
        states = BASE.witness.states.copy()
        states[0] = [0.0, gap, 0.0, 0.0, 0.0]
        c = replace(c, witness=replace(BASE.witness, states=states))
        assert isinstance(times.initial_state(c), Violation) != ok


def test_braking_that_uses_every_bound_is_accepted() -> None:
    c = made(inputs=constant(0.0, 30), settings=Settings(v_max=10.0, a_lon_min=-5.0))
    assert check(c).accepted


# What a violation tells


def test_a_collision_is_told_with_its_time() -> None:
    """An obstacle where the ego is at 1 s, in the prediction of one trajectory or of all."""
    wall = Region(np.array([[9.0, -1.0], [10.0, -1.0], [10.0, 1.0], [9.0, 1.0]]))
    other = BASE.obstacles[0]
    for kind, begin, condition in (
        ("likely", 0.0, "witness-collision"),
        ("possible", BASE.t_dec, "set-based-collision"),
    ):
        steps = list(getattr(other, kind))
        steps[10] = (*steps[10], wall)
        c = replace(BASE, obstacles=(replace(other, **{kind: tuple(steps)}),))
        violation = check(c).violation
        assert violation is not None
        assert (violation.condition, violation.allowed) == (condition, 0.0)
        assert violation.step is not None
        assert violation.time == pytest.approx(1.0)
        assert violation.time == pytest.approx(begin + violation.step * 0.05)
        assert violation.measured is not None
        assert violation.measured < 0.0


def test_a_prediction_that_is_too_short_is_told_with_its_length() -> None:
    other = BASE.obstacles[1]
    short = replace(other, possible=other.possible[:12])
    violation = check(replace(BASE, obstacles=(BASE.obstacles[0], short))).violation
    assert violation is not None
    assert (violation.step, violation.measured, violation.allowed) == (12, 12.0, 21.0)
    assert violation.time == pytest.approx(1.2)


def test_a_step_that_the_model_does_not_lead_to_is_told() -> None:
    for name, begin in (("witness", 0.0), ("fail_safe", BASE.t_dec)):
        t = getattr(BASE, name)
        states = t.states.copy()
        states[8:, 1] += 0.25
        violation = motion(replace(BASE, **{name: replace(t, states=states)}))
        assert isinstance(violation, Violation)
        assert violation.step == 7
        assert violation.time == pytest.approx(begin + 8 * 0.05)
        assert violation.measured == pytest.approx(0.25)
        assert violation.allowed == 1e-6


def test_what_has_no_form_is_named() -> None:
    t = BASE.witness
    c = replace(BASE, witness=replace(t, states=t.states[:-1]))
    assert problems(c, "witness.states is no (31, 5) array")
    assert problems(replace(c, witness=replace(t, inputs=t.states)), "witness.inputs is no (n, 2)")
    other = BASE.obstacles[0]
    short = replace(other, states=other.states[:-1])
    assert problems(replace(BASE, obstacles=(short,)), "obstacle 7: its states are no (16, 5)")


# What the builder keeps


def test_nothing_is_said_about_what_comes_after_the_fail_safe() -> None:
    scene = turning_scene()
    spec = specification(BASE.pair, (), Settings(), dt=0.1)
    likely = predict(scene, "most-likely", BASE.horizon)
    longer = predict(scene, "set-based", 30)
    c = certificate(scene, spec, (), likely, longer, BASE.witness, 0.1, BASE.fail_safe, Settings())
    # It stands after 2.1 s.
    assert [len(o.possible) for o in c.obstacles] == [21, 21]
    assert check(c).accepted


def test_own_words_are_kept_by_kind() -> None:
    words = Vocabulary.default()
    own = Vocabulary({**words.actions}, {**words.rules, "slow": "G(v <= 30)"}, words.predicates, {})
    c = made(vocabulary=own)
    assert c.vocabulary is not None
    assert c.vocabulary == {
        "actions": own.actions,
        "rules": own.rules,
        "predicates": own.predicates,
    }
    assert check(c).accepted


# The sweep


def test_the_margin_of_a_step_is_its_own() -> None:
    rng = np.random.default_rng(5)
    inputs = np.column_stack([rng.uniform(-3, 3, 20), rng.uniform(-0.4, 0.4, 20)])
    t = drive([0.0, 0.0, 0.3, 9.0, 0.1], inputs)
    margins = sweep(t, BASE.ego).margins
    for i in range(20):
        alone = Trajectory(t.states[i : i + 2], t.inputs[i : i + 1], t.tau)
        assert sweep(alone, BASE.ego).margins[0] == margins[i]


def test_the_margin_of_going_straight_on_is_rounding() -> None:
    """A millionth of a metre each way, and the far corner turned by a ten-millionth."""
    corner = math.hypot(BASE.ego.length, BASE.ego.width) / 2
    expected = math.hypot(1e-6, 1e-6) + corner * 1e-7
    assert sweep(BASE.witness, BASE.ego).margins == pytest.approx(expected, rel=1e-9)
    # Braking at 5 m/s^2 adds 5 tau^2 / 8.
    braking = sweep(BASE.fail_safe, BASE.ego).margins
    assert braking == pytest.approx(expected + 5 * 0.05**2 / 8, rel=1e-6)


def test_another_first_state_is_told_with_both_values() -> None:
    elsewhere = BASE.initial + np.array([0.0, 0.5, 0.0, 0.0, 0.0])
    violation = times.initial_state(replace(BASE, initial=elsewhere))
    assert isinstance(violation, Violation)
    assert (violation.step, violation.time) == (0, 0.0)
    assert (violation.measured, violation.allowed) == (0.0, 0.5)
    assert violation.sentence.startswith("the witness's first state has y 0.000000 m at 0.00 s")
    later = replace(BASE.fail_safe, states=BASE.fail_safe.states + elsewhere)
    violation = times.continuity(replace(BASE, fail_safe=later))
    assert isinstance(violation, Violation)
    assert (violation.step, violation.time) == (0, BASE.t_dec)
    assert violation.sentence.startswith("the fail-safe's first state has speed 20.000000 m/s")


def test_a_vehicle_is_played_in_the_lanelet_that_holds_it() -> None:
    ends = np.array([-50.0, 50.0])
    elsewhere, here = (
        Pavement(
            number,
            np.column_stack([ends, np.full(2, low + 20.0)]),
            np.column_stack([ends, np.full(2, low)]),
            None,
        )
        for number, low in ((1, 50.0), (2, -10.0))
    )
    state = np.array([[0.0, 0.0, 0.0, 5.0, 0.0]])
    other = replace(BASE.obstacles[0], outline=Region.disc(1.0), states=state)
    found = _straight_on(replace(BASE, obstacles=(other,), lanelets=(elsewhere, here)))
    assert found
    assert all(each.within.bounds == (-50.0, -10.0, 50.0, 10.0) for each in found)
