"""No state that a compliant, collision-free trajectory of the model reaches may be missing.

Method, Sec. 4. The default run drives 100,000 trajectories per scenario that comes with the
project (5,000 for each reference scenario); `make soundness` a million each, over more steps.
"""

import zlib
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from reach_particles import Outcome, World, contained, fly
from reach_scenes import Course, prediction
from sandra.actions import ALL_PAIRS, ActionPair
from sandra.logic import Specification, specification
from sandra.prediction import predict
from sandra.reach import ReachableSet, compute, ground
from sandra.scenarios import examples
from sandra.scene import Scene, load
from sandra.settings import PRECISIONS, Settings

SHARED = Path(__file__).resolve().parents[2] / ".." / "shared" / "data" / "scenarios"
REFERENCE = (
    "DEU_AachenBendplatz-1_80_T-19",
    "DEU_AachenHeckstrasse-1_30520_T-539",
    "DEU_Gar-1_1_T-1",
    "DEU_Goeppingen-37_1_T-4",
    "DEU_Goeppingen-37_1_T-5",
    "DEU_LocationALower-11_10_T-1",
    "DEU_MONAEast-2_4316_T-4341",
    "ZAM_Sandra-5838_1_T-1001-DiLu",
    "ZAM_Sandra-5838_1_T-1001-set-no-rule",
)
ANY_PAIR = ActionPair.parse("keep,follow-lane")
RULES = ("R_G1", "R_G2", "R_G3")
FORMULAS = (
    "R_G1",
    "R_G3",
    "G(!in_lane(left))",
    "G(!in_lane(opposite))",
    "F(!in_lane(current))",
    "F G(!in_lane(current) & v <= 25)",
    "in_lane(current) U (in_lane(left) | in_lane(right))",
    "F(a > 1 & X(a < -1)) & G(d <= 2 | v <= 20)",
)


def formula(text: str, settings: Settings, dt: float) -> Specification:
    """A specification of nothing but one formula; "" is true of every trajectory."""
    if not text:
        return Specification(ANY_PAIR, ())
    whole = specification(ANY_PAIR, (text,), settings, dt=dt)
    return Specification(ANY_PAIR, tuple(p for p in whole.parts if p.name == text))


def horizon_of(scene: Scene, seconds: float) -> int:
    return int(np.clip(round(seconds / scene.dt), 6, 10 * seconds))


def campaign(world: World, runs: list[tuple[str, Specification, int]], name: str) -> int:
    """Fly all runs; the number of trajectories. Fails where a state is missing."""
    launched = 0
    for text, spec, n in runs:
        seed = zlib.crc32(f"{name} {text}".encode())
        # Half of the sets are quick, half tight.
        precise = world.ground.settings.replace(precision=PRECISIONS[seed % 2])
        found = compute(replace(world.ground, settings=precise), spec)
        outcome = fly(world, spec, found, n, seed)
        launched += outcome.launched
        assert outcome.missing == 0, (
            f"{name}, {text}: {outcome.missing} of {outcome.checked} states are missing; "
            f"{outcome.first_missing}"
        )
        if found.first_empty_step is not None:
            # What has no base set, no trajectory may reach.
            assert outcome.extinct_at is not None
            assert outcome.extinct_at <= found.first_empty_step
    return launched


def everything(
    scene: Scene, settings: Settings, scale: float
) -> list[tuple[str, Specification, int]]:
    """Free, all twelve pairs with and without rules, and formulas: about 100,000 times `scale`."""
    dt = scene.dt
    runs = [("free", formula("", settings, dt), int(22_000 * scale))]
    for pair in ALL_PAIRS:
        runs.append((str(pair), specification(pair, (), settings, dt=dt), int(3_000 * scale)))
        ruled = specification(pair, RULES, settings, dt=dt)
        runs.append((f"{pair} with rules", ruled, int(1_000 * scale)))
    runs += [(text, formula(text, settings, dt), int(2_500 * scale)) for text in FORMULAS]
    return runs


def check(scene: Scene, name: str, scale: float, seconds: float) -> int:
    settings = Settings(horizon=horizon_of(scene, seconds))
    likely = World(
        ground(scene, predict(scene, "most-likely", settings.horizon, settings), settings)
    )
    launched = campaign(likely, everything(scene, settings, scale), name)
    by_sets = World(
        ground(scene, predict(scene, "set-based", settings.horizon, settings), settings)
    )
    some = [("free", formula("", settings, scene.dt), int(5_000 * scale))]
    some += [
        (
            text,
            specification(ActionPair.parse(text), rules, settings, dt=scene.dt),
            int(2_000 * scale),
        )
        for text in ("decelerate,follow-lane", "keep,right-lane", "decelerate,left-lane")
        for rules in ((), RULES)
    ]
    return launched + campaign(by_sets, some, f"{name} set-based")


@cache
def traffic(kappa: float, step: float, dt: float) -> tuple[Scene, dict[int, np.ndarray]]:
    """A three-lane road, straight or bent, with four other cars; and their paths."""
    course = Course(kappa, step)
    places = {2: (18.0, 0.0, 4.0), 3: (8.0, 3.5, 8.0), 4: (-10.0, -3.5, 14.0), 5: (30.0, -3.5, 2.0)}
    cars = [course.car(i, s, d, v) for i, (s, d, v) in places.items()]
    paths = {car.id: course.drive(car, *places[car.id][:2], horizon=40, dt=dt) for car in cars}
    return course.scene(obstacles=cars, dt=dt), paths


def bend(kappa: float, step: float, dt: float, h: int, settings: Settings) -> World:
    scene, paths = traffic(kappa, step, dt)
    some = prediction(scene, h, {i: path[: h + 1] for i, path in paths.items()})
    return World(ground(scene, some, settings))


# ------------------------------------------------------------------ the default run


@pytest.mark.parametrize("name", sorted(examples()))
def test_own_scenarios(name: str) -> None:
    assert check(load(examples()[name]), name, scale=1.0, seconds=0.8) >= 100_000


@pytest.mark.parametrize("name", REFERENCE)
def test_reference_scenarios(name: str) -> None:
    path = SHARED / f"{name}.xml"
    if not path.is_file():
        pytest.skip(f"reference scenario {name} is absent")
    assert check(load(path), name, scale=0.05, seconds=0.8) >= 5_000


@pytest.mark.parametrize(
    ("kappa", "step"), [(0.0, 10.0), (1 / 25, 1.0), (1 / 25, 5.0), (-1 / 12, 2.0)]
)
def test_straight_and_bent_roads(kappa: float, step: float) -> None:
    settings = Settings(horizon=12)
    world = bend(kappa, step, 0.1, 12, settings)
    campaign(world, everything(world.ground.scene, settings, 0.06), f"bend {kappa}")


def test_uncertain_initial_state() -> None:
    settings = Settings(horizon=10, s_uncertainty=0.5, v_uncertainty=0.4)
    world = bend(0.02, 1.0, 0.1, 10, settings)
    campaign(world, everything(world.ground.scene, settings, 0.06), "uncertain")


def test_cut_in_exception() -> None:
    """The one that came in still precedes, it hides the next: nothing is asked towards either."""
    course, h = Course(), 12
    near, far = course.car(2, 14.0, 3.5, 10.0), course.car(3, 30.0, 0.0, 0.0)
    path = course.drive(near, 14.0, 3.5, h, 0.1)
    path[:, 1] -= np.linspace(0.0, 3.5, h + 1)
    scene = course.scene(obstacles=[near, far])
    settings = Settings(horizon=h, cut_in_exception=True, t_c=0.5)
    world = World(ground(scene, prediction(scene, h, {2: path}), settings))
    runs = [
        (text, formula(text, settings, 0.1), 6000)
        for text in ("R_G1", "F !keeps_safe_distance(preceding)")
    ]
    campaign(world, runs, "cut in")


def test_one_that_barely_touches_the_lane_precedes() -> None:
    """It hides the slower one before it, whatever little of it is in the lane."""
    course, h = Course(), 10
    barely, slow = course.car(2, 14.0, 2.64, 20.0), course.car(3, 26.0, 0.0, 1.0)
    scene = course.scene(obstacles=[barely, slow])
    settings = Settings(horizon=h)
    world = World(ground(scene, prediction(scene, h), settings))
    campaign(world, [("R_G1", formula("R_G1", settings, 0.1), 6000)], "barely")


@pytest.mark.parametrize("speed", [0.0, 30.0])
def test_speed_leaves_its_bounds_within_steps(speed: float) -> None:
    """Creeping backwards, or beyond v_max, by a dt^2 / 4 in each step."""
    course = Course()
    settings = Settings(horizon=25)
    scene = course.scene(course.lanes(end=300.0), speed=speed, dt=0.2)
    world = World(ground(scene, prediction(scene, 25), settings))
    campaign(world, [("free", formula("", settings, 0.2), 4000)], f"speed {speed}")


def test_lanelets_that_belong_to_no_lane() -> None:
    course = Course()
    settings = Settings(horizon=12)
    more = [course.lane("none", 110, 5.25, 8.75), course.lane("none", 111, 8.75, 12.25)]
    scene = course.scene(more_lanelets=more, dt=0.2)
    world = World(ground(scene, prediction(scene, 12), settings))
    campaign(world, [("free", formula("", settings, 0.2), 4000)], "more lanelets")


def _apart(s: np.ndarray) -> np.ndarray:
    return 1.9 + np.clip(s - 5.0, 0.0, None) * 0.5


def _together(s: np.ndarray) -> np.ndarray:
    return 1.9 + np.clip(25.0 - s, 0.0, None) * 0.6


@pytest.mark.parametrize("border", [_apart, _together, None])
def test_lanes_that_are_not_parallel(border) -> None:
    """The body reaches a border that moves towards it beside its own place along the lane."""
    course = Course()
    settings = Settings(horizon=15)
    if border is None:
        other = Course(angle=0.6).lane("left", 101, 3.0, 6.5, start=8.0)
    else:
        other = course.lane("left", 101, border, lambda s: border(s) + 3.5)
    tarmac = course.lane("none", 109, 1.75, 20.0)
    scene = course.scene([course.lane("current", 100, -1.75, 1.75), other], more_lanelets=[tarmac])
    world = World(ground(scene, prediction(scene, 15), settings))
    texts = ("F G(in_lane(left))", "G(!in_lane(left))", "F(in_lane(left) & X(!in_lane(current)))")
    runs = [(text, formula(text, settings, 0.1), 5000) for text in texts]
    campaign(world, runs, "not parallel")


def test_lane_across_the_own() -> None:
    course = Course()
    settings = Settings(horizon=20)
    across = Course(angle=np.pi / 2 - 0.2)
    lane = across.lane("opposite", 102, -16.0, -12.5, start=-30.0, end=30.0)
    scene = course.scene([*course.lanes(), lane])
    world = World(ground(scene, prediction(scene, 20), settings))
    texts = ("F(in_lane(opposite))", "G(!in_lane(opposite))")
    campaign(world, [(text, formula(text, settings, 0.1), 6000) for text in texts], "across")


# ------------------------------------------------------------------ the check can fail


def _shrunk(world: World, spec: Specification, **changes: float) -> Outcome:
    settings = world.ground.settings.replace(**changes)
    found = compute(replace(world.ground, settings=settings), spec)
    return fly(world, spec, found, 10_000, 7)


@pytest.mark.parametrize(
    "changes", [{"a_lon_max": 5.88}, {"a_lon_min": -5.88}, {"a_lat_max": 3.92}, {"v_max": 10.5}]
)
def test_particles_see_inputs_that_are_two_percent_too_small(changes: dict[str, float]) -> None:
    settings = Settings(horizon=12)
    world = bend(0.0, 10.0, 0.1, 12, settings)
    assert _shrunk(world, formula("", settings, 0.1), **changes).missing > 100


def test_particles_see_wrong_labels() -> None:
    settings = Settings(horizon=12)
    world = bend(0.0, 10.0, 0.1, 12, settings)
    spec = formula("F(in_lane(left) & X(!in_lane(current)))", settings, 0.1)
    found = compute(world.ground, spec)
    assert len({b.label for step in found.steps for b in step}) > 2
    wrong = tuple(
        tuple(replace(b, label=max(0, b.label - 1)) for b in step) for step in found.steps
    )
    other = ReachableSet(wrong, found.horizon, found.lattice)
    assert fly(world, spec, other, 4000, 7).missing > 100


def test_particles_reach_nearly_all_of_a_free_set() -> None:
    """The particles explore: their extent comes within 10 % of the set's."""
    settings = Settings(horizon=12)
    course = Course()
    scene = course.scene()
    world = World(ground(scene, prediction(scene, 12), settings))
    spec = formula("", settings, 0.1)
    found = compute(world.ground, spec)
    last = fly(world, spec, found, 20_000, 1).survivors[-1]
    corners = np.array([c for b in found.steps[-1] for c in b.lon])
    extent = np.ptp(corners, axis=0)
    assert (np.ptp(last[:, :2], axis=0) > 0.9 * extent).all()
    sides = np.array([c for b in found.steps[-1] for c in b.lat])
    assert np.ptp(last[:, 2]) > 0.9 * np.ptp(sides[:, 0])


def test_contained_agrees_with_the_set() -> None:
    settings = Settings(horizon=10)
    world = bend(0.02, 1.0, 0.1, 10, settings)
    found = compute(world.ground, formula("", settings, 0.1))
    rng = np.random.default_rng(0)
    sets = found.steps[10]
    low = np.min(
        [[min(p[i] for p in q) for q in (b.lon, b.lat) for i in (0, 1)] for b in sets], axis=0
    )
    high = np.max(
        [[max(p[i] for p in q) for q in (b.lon, b.lat) for i in (0, 1)] for b in sets], axis=0
    )
    states = rng.uniform(low - 0.1, high + 0.1, (3000, 4))
    expected = [found.contains(10, *state) for state in states]
    assert contained(found, 10, states).tolist() == expected
    assert 100 < sum(expected) < 2900


# ------------------------------------------------------------------ make soundness


@pytest.mark.soundness
@pytest.mark.parametrize("name", sorted(examples()))
def test_own_scenarios_long(name: str) -> None:
    assert check(load(examples()[name]), name, scale=10.0, seconds=2.0) >= 1_000_000


@pytest.mark.soundness
@pytest.mark.parametrize("name", REFERENCE)
def test_reference_scenarios_long(name: str) -> None:
    path = SHARED / f"{name}.xml"
    if not path.is_file():
        pytest.skip(f"reference scenario {name} is absent")
    assert check(load(path), name, scale=10.0, seconds=2.0) >= 1_000_000
