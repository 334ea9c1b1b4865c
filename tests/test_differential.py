"""Every UNSAFE verdict is confirmed by an exhaustive grid search; and the search can be trusted.

The quick version of `make differential` (docs/differential.md). The search knows nothing of the
reachable set: see `grid_search`.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import replace
from itertools import product

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from grid_check import fault
from grid_compare import Outcome, Reached, compare, scene_of, search
from grid_formula import progressed
from grid_search import Found, Progression, Search, grids
from grid_world import Body, Cells, World, distance, holds, touches
from random_scenes import draw
from sandra.actions import ActionPair
from sandra.logic import Atom, Comparison, Formula, Specification, parse, specification
from sandra.logic.evaluate import evaluate
from sandra.logic.formula import atoms_of
from sandra.prediction import predict
from sandra.reach import Status, ground, verify_on
from sandra.scene.types import Region
from sandra.settings import Settings

SEEDS = st.integers(0, 2**32 - 1)
QUICK = range(60)
KEEP = ActionPair.parse("keep,follow-lane")


def refuted(outcomes: list[Outcome]) -> list[Outcome]:
    return [x for x in outcomes if x.status is Status.UNSAFE and x.grid is not None]


@pytest.mark.parametrize("first", range(0, len(QUICK), 10))
def test_every_unsafe_verdict_is_confirmed(first: int) -> None:
    outcomes = [x for seed in QUICK[first : first + 10] for x in compare(seed, certificates=False)]
    assert not refuted(outcomes), refuted(outcomes)
    # There was something to confirm: pairs that are UNSAFE, and not for want of a lane.
    assert sum(not x.trivial for x in outcomes) >= 3


@pytest.mark.parametrize(
    "rule",
    [
        "F(v >= 8 & X(v < 8))",
        "in_lane(current) U in_lane(left)",
        "G(!in_lane(right)) & F[1,3](a > 1)",
        "F(!in_lane(current)) | G(d <= 0.2)",
        "G(a > 0.5 -> N(a <= 0.5))",
    ],
)
def test_unsafe_verdicts_under_other_formulas_are_confirmed(rule: str) -> None:
    """Until, next and bounded operators, negated lanes: all of the product with the automaton."""
    outcomes = [x for seed in (4, 8, 9) for x in compare(seed, False, (rule,))]
    assert not refuted(outcomes), refuted(outcomes)
    assert outcomes


def test_scenes_are_of_every_kind() -> None:
    kinds = Counter(scene_of(seed)[:2] for seed in QUICK)
    assert len(kinds) == 4
    assert min(kinds.values()) == 15
    assert {scene_of(seed)[2] for seed in QUICK} == {6, 7, 8, 9, 10}
    scenes = [draw(seed).scene for seed in QUICK]
    assert {len(x.obstacles) for x in scenes} == {0, 1, 2, 3}
    assert {len(x.lanes) for x in scenes} >= {1, 2, 3}


@pytest.mark.parametrize("seed", [5, 8])
def test_how_far_the_other_pairs_get(seed: int) -> None:
    """Certified pairs are found on the grid as well; who has no certificate got less far."""
    outcomes = [x for x in compare(seed) if x.status is not Status.UNSAFE]
    assert outcomes
    for outcome in outcomes:
        assert (outcome.status is Status.CERTIFIED) == (outcome.reached is Reached.CERTIFIED)
        if outcome.status is Status.CERTIFIED:
            assert outcome.grid is Body.FULL


# ------------------------------------------------------------------ the comparison can fail


def world_of(seed: int, body: Body, horizon: int = 6, **changes: float) -> World:
    drawn = draw(seed)
    values = Settings(horizon=horizon, **changes)
    predicted = predict(drawn.scene, "most-likely", horizon, values)
    return World(drawn, predicted, values, body)


@pytest.mark.parametrize(
    ("changes", "pair", "rules"),
    [
        ({"a_lat_max": 0.3}, "keep,left-lane", ()),
        ({"a_lon_min": -1.0}, "stop,follow-lane", ()),
        ({"a_lon_max": 0.1}, "accelerate,follow-lane", ()),
        ({"a_min": -1.0}, "keep,follow-lane", ("R_G1",)),
    ],
)
def test_wrong_verdicts_are_refuted(
    changes: dict[str, float], pair: str, rules: tuple[str, ...]
) -> None:
    """A verifier that counts on less than the ego can do calls pairs UNSAFE that are not."""
    wrong = 0
    for seed in range(12):
        world = world_of(seed, Body.DISC)
        small = world.settings.replace(**changes)
        base = ground(world.drawn.scene, world.prediction, small)
        (verdict,) = verify_on(base, [ActionPair.parse(pair)], rules, reasons=False)
        spec = specification(verdict.pair, rules, world.settings, dt=world.drawn.scene.dt)
        wrong += verdict.status is Status.UNSAFE and search(world, spec, seed) is not None
    assert wrong > 0


# ------------------------------------------------------------------ the search is exhaustive


def formula(text: str, world: World) -> Specification:
    whole = specification(KEEP, (text,), world.settings, dt=world.drawn.scene.dt)
    return Specification(KEEP, tuple(p for p in whole.parts if p.name == text))


@pytest.mark.parametrize(
    "text",
    [
        "G(v >= 0)",
        "F(a > 1 & X(a < -1)) & F G(d <= 0.3 | v <= 7)",
        "F[1,2](v < 8) & (d <= 0.5 U a < -1)",
        "G(in_lane(current)) & F(!in_lane(left) & X X in_lane(left))",
        "R_G1",
    ],
)
@pytest.mark.parametrize("body", [Body.AT_STEPS, Body.DISC])
def test_all_sequences_of_inputs_are_looked_at(text: str, body: Body) -> None:
    """Against plain enumeration of every sequence: the same states are reached at the end."""
    along, across = Progression(-4.0, 4.0, 3), Progression(-3.0, 3.0, 3)
    seen = 0
    for seed in (4, 9, 16, 25):
        world = world_of(seed, body, horizon=3)
        spec = formula(text, world)
        run = Search(world, spec, along, across)
        ended = run.layers[-1] if len(run.layers) == 4 else {}
        states = {
            tuple(np.round(run.state(3, i, j), 6))
            for alive in ended.values()
            for i, j in np.argwhere(alive)
        }
        assert states == by_enumeration(world, spec, along.values, across.values)
        seen += len(states)
    assert seen > 0


def by_enumeration(
    world: World, spec: Specification, along: np.ndarray, across: np.ndarray
) -> set[tuple[float, ...]]:
    """Depth first: what comes after a collision is not looked at, nothing else is left out."""
    dt, limit, h = world.drawn.scene.dt, world.settings.v_max, world.prediction.horizon
    here = np.array([0])
    found = set()

    def visit(state: np.ndarray, letters: list[dict[Atom, bool]]) -> None:
        k = len(letters)
        cells = Cells.one(k, state)
        if not 0.0 <= state[1] <= limit or not world.free(cells, here, here)[0]:
            return
        true = {x: bool(world.truth(x, cells, here, here)[0]) for x in of_state}
        if k == h:
            last = {x: letters[-1][x] for x in atoms if x not in of_state}
            if evaluate(spec.formula, [*letters, true | last]):
                found.add(tuple(np.round(state, 6)))
            return
        s, v, d, w = state
        for a, b in product(along, across):
            then = np.array(
                [s + v * dt + a * dt**2 / 2, v + a * dt, d + w * dt + b * dt**2 / 2, w + b * dt]
            )
            then[np.abs(then) < 1e-9] = 0.0
            of_input = {x: bool(holds(x, a)) for x in atoms if x not in of_state}
            visit(then, [*letters, true | of_input])

    atoms = atoms_of(spec.formula)
    of_state = [x for x in atoms if not (isinstance(x, Comparison) and x.variable == "a")]
    visit(np.array(world.start()), [])
    return found


# ------------------------------------------------------------------ its parts


TEXTS = (
    "G(p)",
    "F(p & X q)",
    "p U (q & N r)",
    "(p W q) & !(q R r)",
    "G[1,3](p) | F[2,4](q)",
    "G(p -> F q) <-> F G r",
    "N N p & X X X q",
    "G F (p <-> q)",
    "F[0,2] G(r | !p)",
)
NAMES = {"p": "v <= 1", "q": "s <= 1", "r": "d <= 1"}


@settings(max_examples=150, deadline=None)
@given(st.sampled_from(TEXTS), st.lists(st.tuples(*[st.booleans()] * 3), min_size=1, max_size=7))
def test_progression_says_what_evaluation_says(text: str, rows: list[tuple[bool, ...]]) -> None:
    whole = parse(text, definitions=NAMES)
    atoms = [parse(x) for x in NAMES.values()]
    trace = [dict(zip(atoms, row, strict=True)) for row in rows]
    rest: Formula = whole
    for k, letter in enumerate(trace):
        assert evaluate(rest, trace[k:]) == evaluate(whole, trace)
        if k + 1 < len(trace):
            rest = progressed(rest, letter)


@settings(max_examples=60, deadline=None)
@given(SEEDS)
def test_rectangles_touch_as_shapely_says(seed: int) -> None:
    rng = np.random.default_rng(seed)
    points = rng.uniform(-4.0, 4.0, (int(rng.integers(3, 8)), 2))
    hull = shapely.MultiPoint(points).convex_hull
    corners = np.array(hull.exterior.coords)[:-1]
    centres, angles = rng.uniform(-7.0, 7.0, (40, 2)), rng.uniform(-3.0, 3.0, 40)
    found = touches(centres, angles, (2.25, 0.9), Region(corners))
    bodies = [
        shapely.Polygon(Region.rectangle(4.5, 1.8).placed(*c, a).vertices)
        for c, a in zip(centres, angles, strict=True)
    ]
    assert found.tolist() == shapely.intersects(hull, bodies).tolist()
    gaps = shapely.distance(hull, shapely.points(centres))
    assert distance(centres, corners) == pytest.approx(gaps, abs=1e-9)
    one = touches(centres, angles, (2.25, 0.9), Region(points[:1], 0.5))
    exact = shapely.distance(shapely.Point(points[0]), bodies) <= 0.5
    assert one.tolist() == exact.tolist()


def some_trajectory(seed: int, text: str, body: Body) -> tuple[World, Specification, Found]:
    world = world_of(seed, body)
    spec = specification(ActionPair.parse(text), (), world.settings, dt=world.drawn.scene.dt)
    found = search(world, spec, seed)
    assert found is not None
    return world, spec, found


def test_the_exact_check_finds_what_is_wrong() -> None:
    world, spec, found = some_trajectory(12, "keep,follow-lane", Body.FULL)
    assert fault(world, spec, found) is None
    shifted = found.states + np.array([0.0, 0.0, 0.01, 0.0])
    assert fault(world, spec, Found(shifted, found.inputs)) == "initial state"
    jump = found.states.copy()
    jump[3] += 0.01
    assert fault(world, spec, Found(jump, found.inputs)) == "motion"
    assert fault(world, spec, Found(found.states, found.inputs * 10 + 7)) is not None
    other = specification(ActionPair.parse("accelerate,follow-lane"), dt=0.2)
    assert fault(world, other, found) == "formula"


def test_the_exact_check_finds_collisions_and_the_border() -> None:
    world, spec, found = some_trajectory(12, "keep,follow-lane", Body.FULL)
    middle = found.states[3]
    x, y = world.drawn.road.at(middle[0], middle[2])
    standing = world.drawn.road.obstacle(77, 0.0, 0.0)
    standing = replace(
        standing, state=replace(standing.state, x=float(x), y=float(y)), is_static=True
    )
    scene = replace(world.drawn.scene, obstacles=(standing,))
    blocked = World(
        replace(world.drawn, scene=scene),
        predict(scene, "most-likely", 6, world.settings),
        world.settings,
        Body.FULL,
    )
    assert str(fault(blocked, spec, found)).startswith("collision")
    narrow = tuple(
        replace(z, left=z.right + (z.left - z.right) * 0.4) for z in world.drawn.scene.lanelets
    )
    strait = replace(world.drawn, scene=replace(world.drawn.scene, lanelets=narrow))
    assert str(fault(replace(world, drawn=strait), spec, found)).startswith("road")


def test_a_grid_that_ends_in_standstill() -> None:
    world = world_of(12, Body.FULL)
    spec = specification(ActionPair.parse("stop,follow-lane"), (), world.settings, dt=0.2)
    speed = world.start()[1]
    assert speed > 0.0
    with_stop = list(grids(world, spec.formula, fine=True))[-1][0]
    assert (np.abs(with_stop.values) < 1e-9).any()
    steps = speed / (with_stop.gap * world.drawn.scene.dt)
    assert steps == pytest.approx(round(steps))
