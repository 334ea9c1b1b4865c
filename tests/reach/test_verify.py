"""Verdicts: independent of each other, never positive without proof, and with the right cause."""

import random
from dataclasses import replace
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pytest

from reach_particles import TOLERANCE, World, contained, fly
from reach_scenes import Course, prediction
from sandra.actions import ALL_PAIRS, ActionPair
from sandra.errors import SettingsError
from sandra.logic import Specification, Vocabulary, specification
from sandra.prediction import predict
from sandra.reach import (
    Ground,
    ReachableSet,
    Status,
    Verdict,
    compute,
    ground,
    verify,
    verify_on,
    verify_pair,
)
from sandra.scene import Scene, load
from sandra.settings import Settings

H = 15
SETTINGS = Settings(horizon=H)


def busy(kappa: float = 0.02, settings: Settings = SETTINGS) -> Ground:
    """A bent road with a slow car ahead, one on the left and one on the right."""
    course = Course(kappa)
    places = {2: (18.0, 0.0, 4.0), 3: (8.0, 3.5, 8.0), 4: (-10.0, -3.5, 14.0)}
    cars = [course.car(i, s, d, v) for i, (s, d, v) in places.items()]
    scene = course.scene(obstacles=cars)
    paths = {
        i: course.drive(car, *places[i][:2], H, 0.1) for i, car in zip(places, cars, strict=True)
    }
    return ground(scene, prediction(scene, H, paths), settings)


def empty_road(settings: Settings = SETTINGS, **changes) -> Ground:
    scene = Course().scene(**changes)
    return ground(scene, prediction(scene, settings.horizon), settings)


def only(text: str, base: Ground) -> Specification:
    spec = specification(ALL_PAIRS[0], (text,), base.settings, dt=base.scene.dt)
    return Specification(spec.pair, spec.parts[2:])


def inside(small: ReachableSet, large: ReachableSet, k: int, n: int = 300) -> bool:
    """Whether random states of one set lie in the other (boxes may part the sets differently)."""
    rng = np.random.default_rng(k)
    for base in small.steps[k]:
        parts = [rng.dirichlet(np.full(len(p), 0.4), n) @ np.array(p) for p in (base.lon, base.lat)]
        if not contained(large, k, np.hstack(parts)).all():
            return False
    return True


# ------------------------------------------------------------------ independence


def test_verdicts_do_not_depend_on_what_was_verified_before() -> None:
    base = busy()
    rules = ("R_G1", "R_G3")
    together = verify_on(base, ALL_PAIRS, rules)
    shuffled = list(ALL_PAIRS)
    random.Random(1).shuffle(shuffled)
    again = verify_on(base, [*shuffled, *shuffled], rules)
    for pair in ALL_PAIRS:
        alone = verify_pair(busy(), pair, rules)
        for other in [alone, *(v for v in again if v.pair == pair)]:
            one = together[pair]
            assert other.status is one.status
            assert other.reason == one.reason
            assert other.reachable_set.steps == one.reachable_set.steps


# ------------------------------------------------------------------ deny by default


def test_no_positive_verdict_without_a_set() -> None:
    base = busy()
    spec = specification(ALL_PAIRS[0])
    full = compute(base, Specification(ALL_PAIRS[0], ()))
    short = ReachableSet(full.steps[:-1], H, base.lattice)
    hollow = ReachableSet((*full.steps[:-1], ()), H, base.lattice)
    gap = ReachableSet((*full.steps[:3], (), *full.steps[4:]), H, base.lattice)
    nothing = ReachableSet((), H, base.lattice)
    for found, step in ((short, H), (hollow, H), (gap, 3), (nothing, 0)):
        assert found.first_empty_step == step
        assert found.corridor().steps == ()
        with pytest.raises(ValueError, match="contradicts"):
            Verdict(ALL_PAIRS[0], Status.REACHABLE, spec, found, None, 0.0)
        Verdict(ALL_PAIRS[0], Status.UNSAFE, spec, found, None, 0.0)
    with pytest.raises(ValueError, match="contradicts"):
        Verdict(ALL_PAIRS[0], Status.UNSAFE, spec, full, None, 0.0)
    with pytest.raises(ValueError, match="certificate"):
        Verdict(ALL_PAIRS[0], Status.CERTIFIED, spec, full, None, 0.0)


def test_a_prediction_of_another_time_step_is_refused() -> None:
    scene = Course().scene()
    with pytest.raises(SettingsError, match="predict again"):
        ground(scene, replace(prediction(scene, H), dt=0.2), SETTINGS)
    with pytest.raises(SettingsError, match="predict again"):
        ground(scene, replace(prediction(scene, H), dt=0.1 + 1e-6), SETTINGS)
    with pytest.raises(SettingsError, match="dt = nan s"):
        ground(scene, replace(prediction(scene, H), dt=float("nan")), SETTINGS)
    assert ground(scene, replace(prediction(scene, H), dt=0.3 / 3), SETTINGS).horizon == H


# ------------------------------------------------------------------ monotonicity


@pytest.mark.parametrize("text", ["keep,follow-lane", "accelerate,left-lane", "keep,right-lane"])
def test_a_specification_never_enlarges_the_free_set(text: str) -> None:
    """Compared by trajectories: the polygons themselves are rounded in different ways."""
    base = busy()
    free = compute(base, Specification(ALL_PAIRS[0], ()))
    spec = specification(ActionPair.parse(text))
    found = compute(base, spec)
    some = fly(World(base), spec, found, 4000, 5).survivors
    assert some.shape[1] > 100
    for k in range(H + 1):
        assert contained(free, k, some[k]).all()
        assert found.area(k) <= 1.05 * free.area(k) + 1e-9


def test_a_rule_never_lets_more_trajectories_through() -> None:
    """Everything that complies with the rules lies in the set without them."""
    world = World(busy())
    for text in ("decelerate,follow-lane", "keep,left-lane"):
        pair = ActionPair.parse(text)
        plain = compute(world.ground, specification(pair))
        ruled = specification(pair, ("R_G1", "R_G2", "R_G3"))
        found = compute(world.ground, ruled)
        some = fly(world, ruled, found, 2000, 3).survivors
        for k in range(some.shape[0]):
            assert contained(plain, k, some[k]).all()
        if plain.first_empty_step is not None:
            assert found.first_empty_step is not None
            assert found.first_empty_step <= plain.first_empty_step


def test_an_obstacle_never_enlarges_the_set() -> None:
    base = busy()
    spec = Specification(ALL_PAIRS[0], ())
    with_all = compute(base, spec)
    without = compute(base, spec, base.forbidden_without(0))
    for k in range(H + 1):
        assert inside(with_all, without, k)
    assert with_all.area(H) < without.area(H) - 0.5


# ------------------------------------------------------------------ causes


def test_contradicting_input_ranges_are_empty_at_once() -> None:
    verdict = verify_pair(empty_road(), ActionPair.parse("decelerate,follow-lane"), ("G(a >= 0)",))
    assert verdict.status is Status.UNSAFE
    assert verdict.first_empty_step == 0
    assert "empty at step 0" in str(verdict.reason)
    assert "decelerate" in str(verdict.reason) or "a >= 0" in str(verdict.reason)


def test_decelerating_from_standstill_is_empty() -> None:
    verdict = verify_pair(empty_road(speed=0.0), ActionPair.parse("decelerate,follow-lane"))
    assert verdict.first_empty_step == 1
    assert "decelerate" in str(verdict.reason)


def test_missing_lanes() -> None:
    course = Course()
    scene = course.scene(course.lanes(left=0, right=0))
    base = ground(scene, prediction(scene, H), SETTINGS)
    for side in ("left", "right"):
        for longitudinal in ("keep", "accelerate", "decelerate", "stop"):
            verdict = verify_pair(base, ActionPair.of(longitudinal, f"{side}-lane"))
            assert verdict.status is Status.UNSAFE
            assert f"no {side}-adjacent lane" in str(verdict.reason)


def test_initial_speed_above_the_highest() -> None:
    for verdict in verify_on(empty_road(speed=31.0), ALL_PAIRS):
        assert verdict.first_empty_step == 0
        if verdict.pair.lateral.value == "follow-lane":
            assert "31.0 m/s exceeds v_max = 30 m/s" in str(verdict.reason)
    at_limit = empty_road(speed=30.0)
    assert verify_pair(at_limit, ActionPair.parse("keep,follow-lane")).status is Status.REACHABLE


def test_too_fast_scenario(shared: Path) -> None:
    scene = load(shared / "data" / "scenarios" / "DEU_LocationALower-11_10_T-1.xml")
    for verdict in verify(scene, ["keep,follow-lane", "stop,right-lane"], horizon=5):
        assert verdict.first_empty_step == 0
        assert "35.7 m/s exceeds v_max" in str(verdict.reason)


def test_ego_in_collision() -> None:
    course = Course()
    scene = course.scene(obstacles=[course.car(7, 1.0, 0.5), course.car(8, 60.0, 3.5)])
    base = ground(scene, prediction(scene, H), SETTINGS)
    verdict = verify_pair(base, ActionPair.parse("keep,follow-lane"))
    assert verdict.first_empty_step == 0
    assert "car 7 leaves no room" in str(verdict.reason)


def test_stopped_car_ahead() -> None:
    course = Course()
    lanes = course.lanes(left=0, right=0)
    scene = course.scene(lanes, [course.car(7, 16.0, 0.0), course.car(8, -30.0, 0.0)], speed=15.0)
    base = ground(scene, prediction(scene, H), SETTINGS)
    verdict = verify_pair(base, ActionPair.parse("keep,follow-lane"))
    assert verdict.status is Status.UNSAFE
    # bodies touch when the inscribed disc does: 16 m less half a car and the disc
    first = (16.0 - 2.25 - 0.9) / 15.0
    assert verdict.first_empty_step is not None
    assert first / 0.1 - 1 <= verdict.first_empty_step <= first / 0.1 + 2
    assert "car 7 leaves no room" in str(verdict.reason)
    assert "lasts through" in str(verdict.reason)


def test_safe_distance() -> None:
    course = Course()
    lanes = course.lanes(left=0, right=0)
    car = course.car(7, 14.0, 0.0, 10.0)
    scene = course.scene(lanes, [car], speed=10.0)
    path = {7: course.drive(car, 14.0, 0.0, H, 0.1)}
    base = ground(scene, prediction(scene, H, path), SETTINGS)
    pair = ActionPair.parse("keep,follow-lane")
    assert verify_pair(base, pair).status is Status.REACHABLE
    # bumper to bumper 9.5 m; v^2/12 - v^2/24 + 0.4 v = 8.17 m suffice, 11 m/s would need 8.98 m
    assert verify_pair(base, pair, ("R_G1",)).status is Status.REACHABLE
    near = course.car(7, 12.0, 0.0, 10.0)
    scene = course.scene(lanes, [near], speed=10.0)
    path = {7: course.drive(near, 12.0, 0.0, H, 0.1)}
    verdict = verify_pair(ground(scene, prediction(scene, H, path), SETTINGS), pair, ("R_G1",))
    assert verdict.first_empty_step == 0
    assert "rule R_G1" in str(verdict.reason)


def test_border_of_the_road() -> None:
    """At 3 m/s towards the border, 0.5 m before it."""
    course = Course()
    scene = course.scene(course.lanes(left=0, right=0), d=0.3, speed=15.0, angle=0.25)
    base = ground(scene, prediction(scene, H), SETTINGS)
    verdict = verify_pair(base, ActionPair.parse("keep,follow-lane"))
    assert verdict.status is Status.UNSAFE
    assert "the border of the road" in str(verdict.reason)


def test_speed_limit() -> None:
    course = Course()
    scene = course.scene(course.lanes(limit=9.0), speed=10.0)
    base = ground(scene, prediction(scene, H), SETTINGS)
    verdict = verify_pair(base, ActionPair.parse("keep,follow-lane"), ("R_G3",))
    assert verdict.first_empty_step == 0
    assert "rule R_G3" in str(verdict.reason)


def test_verdicts_print_and_look_up() -> None:
    found = verify_on(empty_road(), [ALL_PAIRS[0], ALL_PAIRS[9]])
    assert len(found) == 2
    assert found["keep,follow-lane"] is found[0] is found[ALL_PAIRS[0]]
    with pytest.raises(KeyError, match="was not verified"):
        found["keep,left-lane"]
    entry = found.to_list()[1]
    assert entry["status"] == "UNSAFE"
    assert entry["first_empty_step"] == H
    assert "stop" in str(found).splitlines()[1]
    assert TOLERANCE < 1e-5


# ------------------------------------------------------------------ what is asked is what is done


def test_everything_that_is_given_counts(tmp_path: Path) -> None:
    scene = Course().scene(speed=10.0)
    asked = []

    def predictor(*given: object) -> object:
        asked.append(given)
        return prediction(scene, 4)

    words = tmp_path / "words.toml"
    words.write_text('[rules]\nR_SLOW = "G(v <= 9)"\n')
    settings = Settings(horizon=9, v_max=25.0)
    found = verify(
        scene,
        ["keep,follow-lane", ALL_PAIRS[1]],
        prediction=predictor,
        rules=["R_SLOW"],
        horizon=4,
        settings=settings,
        vocabulary=Vocabulary.load(words),
    )
    assert asked == [(scene, 4, settings.replace(horizon=4))]
    assert found.ground.settings == settings.replace(horizon=4)
    assert found.rules == ("R_SLOW",)
    assert [v.pair for v in found] == [ActionPair.parse("keep,follow-lane"), ALL_PAIRS[1]]
    assert "R_SLOW" in str(found[0].reason)
    alone = verify_pair(found.ground, ALL_PAIRS[1], ("R_SLOW",), Vocabulary.load(words))
    assert alone.reason == found[1].reason
    assert found[0].duration_s > 0.0
    plain = verify(scene, "keep,follow-lane", rules=["G(v <= 9)"], horizon=2, reasons=False)
    assert (plain[0].status, plain[0].reason) == (Status.UNSAFE, None)
    told = verify(scene, "keep,follow-lane", rules=["G(v <= 9)"], horizon=2)
    assert verify_pair(told.ground, told[0].pair, ("G(v <= 9)",)).reason == told[0].reason
    assert verify_on(told.ground, [told[0].pair], ("G(v <= 9)",))[0].reason == told[0].reason
    assert "G(v <= 9)" in str(told[0].reason)


def test_without_anything_given_all_pairs_are_verified_as_the_settings_say() -> None:
    found = verify(Course().scene())
    assert [v.pair for v in found] == list(ALL_PAIRS)
    assert found.ground.settings == Settings()
    assert found.ground.horizon == Settings().horizon
    assert found.ground.prediction.kind == "most-likely"
    assert found.rules == ()


def test_bounds_of_motion_are_those_of_the_settings() -> None:
    settings = Settings(
        horizon=2, a_lon_min=-3.0, a_lon_max=2.0, a_lat_max=1.0, v_max=10.3, v_lat_max=0.15
    )
    base = empty_road(settings, speed=10.0)
    found = compute(base, Specification(ALL_PAIRS[0], ()))
    lon = [b.speeds for b in found.steps[2]]
    lat = [v for b in found.steps[2] for _, v in b.lat]
    assert min(low for low, _ in lon) == pytest.approx(10.0 - 0.6)
    assert max(high for _, high in lon) == pytest.approx(10.3)
    assert (min(lat), max(lat)) == pytest.approx((-0.15, 0.15))
    nowhere = tuple(np.ones_like(m) for m in base.forbidden)
    assert compute(base, Specification(ALL_PAIRS[0], ()), nowhere).first_empty_step == 0


def test_sets_are_as_tight_as_the_settings_say() -> None:
    """A parallelogram of speeds and places after a step, or a hexagon of three quarters of it."""
    for precision, corners in (("quick", 4), ("tight", 6)):
        base = empty_road(Settings(horizon=1, precision=precision))
        found = compute(base, Specification(ALL_PAIRS[0], ()))
        assert found.lattice == base.lattice
        (reached,) = found.steps[1]
        assert len(reached.lon) == len(reached.lat) == corners


def test_a_figure_of_verdicts(tmp_path: Path) -> None:
    found = verify_on(empty_road(), [ALL_PAIRS[0]])
    sizes = []
    for dpi in (40, 80):
        path = found.figure(tmp_path / f"{dpi}.png", dpi=dpi, three_d=False)
        assert path == tmp_path / f"{dpi}.png"
        sizes.append(plt.imread(path).shape)
    assert sizes[1][:2] == pytest.approx((2 * sizes[0][0], 2 * sizes[0][1]), abs=2)


def test_the_ground_of_all_pairs() -> None:
    """One lane of each relation; curvature by column; limits of the own lanes alone."""
    course = Course(0.02)
    opposite = course.lane("opposite", 120, 8.75, 5.25, limit=7.0)
    other = course.lane("other", 121, 8.75, 12.25, limit=8.0)
    car = course.car(2, 6.0, 0.0, 5.0)
    scene = course.scene([*course.lanes(limit=15.0), opposite, other], [car])
    base = ground(scene, prediction(scene, 4), Settings(horizon=4))
    assert [name for name, _ in base.bands] == ["current", "right", "left", "opposite"]
    assert [[len(step) for step in steps] for steps in base.leaders] == [[1] * 5, *[[0] * 5] * 3]
    assert [limit[2:] for limit in base.limits] == [(None, None), (15.0, 15.0), (None, None)]
    low, high = base.curvature
    assert low.shape == high.shape == (base.lattice.columns,)
    assert (low <= high).all()
    assert low == pytest.approx(0.02, abs=1e-3)
    assert high == pytest.approx(0.02, abs=1e-3)
    assert len(base.forbidden) == 5
    # a sharper corner shows in the columns beside it
    line = scene.frame.stations
    s = base.lattice.corners()[0]
    at = scene.frame.curvature(line)
    for i in range(base.lattice.columns):
        here = (line >= s[i]) & (line <= s[i + 1])
        assert (at[here] <= high[i] + 1e-4).all()
        assert (at[here] >= low[i] - 1e-4).all()
    assert base.obstacles_at(0, base.forbidden[0]) == [0]
    without = base.forbidden_without(0, road=False)
    assert len(without) == 5
    assert not any(mask.any() for mask in without)
    assert [m.tolist() for m in base.forbidden_without(0)] == [base.off_road.tolist()] * 5


def test_who_can_only_brake_is_farthest_before_the_end() -> None:
    """At 10 m/s and at best -2 m/s^2 the ego is 25 m on after 5 s; the horizon is 8 s."""
    course = Course()
    scene = course.scene(course.lanes(), (), speed=10.0, dt=0.2)
    only_brakes = Settings(a_lon_max=-2.0, horizon=40)
    found = verify(scene, "keep,follow-lane", settings=only_brakes, reasons=False)[0]
    assert found.first_empty_step == 0  # |a| <= 0.2 cannot be
    found = verify(scene, "stop,follow-lane", settings=only_brakes, reasons=False)[0]
    s0 = scene.ego_curvilinear[0]
    for k in range(26):
        farthest = s0 + 10.0 * 0.2 * k - (0.2 * k) ** 2
        assert max(b.rectangle[1] for b in found.reachable_set.steps[k]) >= farthest - 1e-6
    # From then on it would drive backwards.
    assert found.first_empty_step == 26


def test_bounds_in_seconds_are_those_of_the_scene() -> None:
    """At 10 m/s and -6 m/s^2 the ego is at 4 m/s after 1 s, and not at 2 m/s."""
    course = Course()
    base = ground_of(course.scene(course.lanes(), (), speed=10.0, dt=0.2))
    pair = ActionPair.parse("decelerate,follow-lane")
    assert verify_pair(base, pair, ["F[0,1s](v <= 4.1)"]).status is Status.REACHABLE
    assert verify_pair(base, pair, ["F[0,1s](v <= 2)"]).status is Status.UNSAFE


def test_a_single_verdict_explains_itself_unless_told_not_to() -> None:
    course = Course()
    base = ground_of(course.scene(course.lanes(left=0), (), speed=10.0, dt=0.2))
    pair = ActionPair.parse("keep,left-lane")
    explained, short = verify_pair(base, pair), verify_pair(base, pair, reasons=False)
    assert explained.status is short.status is Status.UNSAFE
    assert explained.status.value == "UNSAFE"
    assert explained.reason is not None
    assert "no left-adjacent lane" in explained.reason
    assert short.reason is None
    corridor = explained.reachable_set.corridor()
    assert corridor.steps == ()
    assert corridor.lattice is explained.reachable_set.lattice
    assert corridor.horizon == base.horizon


def ground_of(scene: Scene) -> Ground:
    settings = Settings(horizon=10)
    return ground(scene, predict(scene, "most-likely", 10, settings), settings)
