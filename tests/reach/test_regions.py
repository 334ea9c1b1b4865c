"""Regions: a state of which a predicate is true (or false) by its definition is admitted."""

from dataclasses import replace

import numpy as np
import pytest

from reach_particles import World
from reach_scenes import Course, prediction
from sandra.errors import FormulaError
from sandra.logic import Atom, Predicate, parse
from sandra.logic.formula import Not
from sandra.reach import Ground, ground
from sandra.reach.problem import Region
from sandra.reach.regions import regions_of
from sandra.settings import Settings

TOLERANCE = 1e-9


def bent(kappa: float, step: float) -> Ground:
    course = Course(kappa, step)
    places = {2: (18.0, 0.2, 4.0), 3: (12.0, 3.0, 9.0), 4: (30.0, 0.4, 0.0), 5: (22.0, -3.5, 6.0)}
    cars = [course.car(i, s, d, v) for i, (s, d, v) in places.items()]
    own = [
        replace(x, speed_limits=(20.0,)) if x.relation == "left" else x
        for x in course.lanes(limit=13.0)
    ]
    lanes = (*own, course.lane("opposite", 120, 8.75, 5.25, limit=13.0))
    scene = course.scene(lanes, cars, angle=0.05)
    return ground(scene, prediction(scene, 20), Settings(horizon=20))


def admits(region: Region, state: np.ndarray) -> bool:
    s, v, d, _ = state
    return all(
        any(
            piece.box[0] - TOLERANCE <= s <= piece.box[1] + TOLERANCE
            and piece.box[2] - TOLERANCE <= d <= piece.box[3] + TOLERANCE
            and all(a * s + b * v <= c + TOLERANCE for a, b, c in piece.cuts)
            for piece in union
        )
        for union in region
    )


def states_of(base: Ground, n: int, seed: int) -> np.ndarray:
    rng = np.random.default_rng(seed)
    return np.column_stack(
        [
            base.lon[0][0] + rng.uniform(-0.5, 30.0, n),
            rng.choice([0.0, 30.0, 0.5], n, p=[0.05, 0.05, 0.9])
            + rng.uniform(0.0, 14.0, n) * (rng.random(n) < 0.9),
            rng.uniform(-5.0, 7.5, n),
            rng.normal(0.0, 2.0, n),
        ]
    )


ATOMS = [
    "in_lane(current)",
    "in_lane(left)",
    "in_lane(right)",
    "in_lane(opposite)",
    "in_lanelet(101)",
    "keeps_safe_distance(preceding)",
    "keeps_lane_speed_limit",
    "v <= 7.5",
    "v < 7.5",
    "s <= 52",
    "d < -0.5",
]


def atom_of(text: str) -> Atom:
    found = parse(text)
    assert isinstance(found, Atom)
    return found


@pytest.mark.parametrize("text", ATOMS)
@pytest.mark.parametrize(("kappa", "step"), [(0.0, 10.0), (1 / 30, 2.0), (-1 / 20, 4.0)])
def test_true_and_false_states_are_admitted(text: str, kappa: float, step: float) -> None:
    base = bent(kappa, step)
    world = World(base)
    atom = atom_of(text)
    regions = regions_of(base, (atom,))
    rng = np.random.default_rng(4)
    states = states_of(base, 1200, 3)
    states = states[states[:, 1] <= 30.0]
    for k in (1, 7):
        xy = world.positions(states)
        truth = world.truth(atom, states, xy, world.headings(states, k, rng), k)
        for state, holds in zip(states, truth, strict=True):
            lon, lat = [(state[0], state[1])], [(state[2], state[3])]
            assert admits(regions((0, bool(holds)), k, lon, lat), state), (state, holds)
            # and as a part of a larger set
            wide_lon = [(state[0] - 1.0, state[1]), (state[0] + 1.0, state[1] + 1.0)]
            wide_lat = [(state[2] - 0.5, state[3] - 0.3), (state[2] + 0.5, state[3] + 0.2)]
            assert admits(regions((0, bool(holds)), k, wide_lon, wide_lat), state), (state, holds)


@pytest.mark.parametrize("text", ATOMS)
def test_regions_tell_states_apart(text: str) -> None:
    """Most states for which an atom is false are outside the region in which it may be true."""
    base = bent(0.0, 10.0)
    world = World(base)
    atom = atom_of(text)
    regions = regions_of(base, (atom,))
    rng = np.random.default_rng(4)
    states = states_of(base, 1500, 9)
    states[:, 1] = np.clip(states[:, 1], 4.0, 30.0)
    states[:, 3] *= 0.1
    truth = world.truth(atom, states, world.positions(states), world.headings(states, 7, rng), 7)
    kept = [admits(regions((0, True), 7, [tuple(x[:2])], [tuple(x[2:])]), x) for x in states]
    wrong = np.mean(np.array(kept)[~truth]) if (~truth).any() else 0.0
    # the loosest limit of all lanes counts, so limits tell least
    assert wrong < (0.6 if text == "keeps_lane_speed_limit" else 0.35), wrong
    if text.startswith("in_lane("):
        out = [admits(regions((0, False), 7, [tuple(x[:2])], [tuple(x[2:])]), x) for x in states]
        assert np.mean(np.array(out)[truth]) < 0.5


def test_a_leader_counts_as_soon_as_the_disc_touches_its_lane() -> None:
    """0.9 m: the inscribed disc's radius. The left lane begins at d = 1.75 m."""
    course = Course()
    scene = course.scene(obstacles=[course.car(2, 8.0, 3.5)])
    base = ground(scene, prediction(scene, 5), Settings(horizon=5))
    regions = regions_of(base, (Predicate("keeps_safe_distance", "preceding"),))
    s, v = base.lon[0]
    for d, free in ((0.7, True), (0.95, False), (1.5, False), (3.5, False), (6.0, False)):
        region = regions((0, True), 2, [(s, v)], [(d, 0.0)])
        assert admits(region, np.array([s, v, d, 0.0])) == free, d


@pytest.mark.parametrize("text", ["in_lane(none)", "in_lanelet(999)", "no_such_thing", "in_lane"])
def test_unknown_atoms(text: str) -> None:
    name, _, rest = text.partition("(")
    atom = Predicate(name, rest.rstrip(")") or None)
    with pytest.raises(FormulaError):
        regions_of(bent(0.0, 10.0), (atom,))
    assert isinstance(~atom, Not)


def test_lanes_that_are_not_there() -> None:
    course = Course()
    scene = course.scene(course.lanes(left=0, right=0))
    base = ground(scene, prediction(scene, 5), Settings(horizon=5))
    regions = regions_of(base, (Predicate("in_lane", "left"),))
    lon, lat = [(0.0, 10.0)], [(0.0, 0.0)]
    assert not admits(regions((0, True), 1, lon, lat), np.array([0.0, 10.0, 0.0, 0.0]))
    assert admits(regions((0, False), 1, lon, lat), np.array([0.0, 10.0, 0.0, 0.0]))
