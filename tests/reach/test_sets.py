"""Sets: area, corridor, membership."""

from dataclasses import replace

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st

from reach_scenes import Course, prediction
from sandra.actions import ActionPair
from sandra.logic import Specification, specification
from sandra.reach import BaseSet, Lattice, ReachableSet, compute, ground
from sandra.reach.moves import moves_of
from sandra.settings import Settings

LATTICE = Lattice.around((0.0, 10.0), (-5.0, 5.0), 0.5, 0.2)
coordinate = st.integers(-20, 20).map(lambda i: i / 4)
rectangles = st.tuples(coordinate, coordinate, coordinate, coordinate).map(
    lambda r: (min(r[:2]), max(r[:2]), min(r[2:]), max(r[2:]))
)


def base_set(s0: float, s1: float, d0: float, d1: float) -> BaseSet:
    lon = [(s0, 1.0), (s1, 2.0), (s1, 3.0)]
    lat = [(d0, -1.0), (d1, 0.0)]
    return BaseSet(lon, lat, 0, (-1.0, 1.0))


@given(st.lists(rectangles, max_size=8))
def test_area_is_that_of_the_union(some: list[tuple[float, float, float, float]]) -> None:
    found = ReachableSet((tuple(base_set(*r) for r in some),), 3, LATTICE)
    exact = shapely.union_all([shapely.box(a, c, b, d) for a, b, c, d in some])
    assert found.area(0) == pytest.approx(exact.area)
    assert found.area(1) == 0.0


def reach(pair: str, horizon: int = 15) -> ReachableSet:
    course = Course(0.02)
    places = {2: (18.0, 0.0, 4.0), 3: (8.0, 3.5, 8.0), 4: (-10.0, -3.5, 14.0)}
    cars = [course.car(i, s, d, v) for i, (s, d, v) in places.items()]
    scene = course.scene(obstacles=cars)
    paths = {c.id: course.drive(c, *places[c.id][:2], horizon, 0.1) for c in cars}
    base = ground(scene, prediction(scene, horizon, paths), Settings(horizon=horizon))
    return compute(base, specification(ActionPair.parse(pair)))


@pytest.mark.parametrize("pair", ["keep,follow-lane", "decelerate,left-lane", "keep,right-lane"])
def test_corridor(pair: str) -> None:
    whole = reach(pair)
    assert whole.first_empty_step is None
    corridor = whole.corridor()
    assert corridor.first_empty_step is None
    assert corridor.steps[-1] == tuple(
        BaseSet(b.lon, b.lat, b.label, b.inputs, c.parents)
        for b, c in zip(whole.steps[-1], corridor.steps[-1], strict=True)
    )
    for k, step in enumerate(corridor.steps):
        polygons = [(b.lon, b.lat, b.label) for b in whole.steps[k]]
        assert all((b.lon, b.lat, b.label) in polygons for b in step)
        assert corridor.area(k) <= whole.area(k) + 1e-9
        if k > 0:
            used = {p for b in step for p in b.parents}
            # each has an ancestor, and each of the step before has a descendant
            assert all(b.parents for b in step)
            assert used == set(range(len(corridor.steps[k - 1])))
    assert corridor.corridor().steps == corridor.steps


def test_corridor_keeps_the_right_parents() -> None:
    """The parents of the corridor are those of the set, although much of the set is pruned."""
    steps = (
        tuple(base_set(i, i + 1.0, -1.0, 1.0) for i in range(3)),
        tuple(replace(base_set(i, i + 1.5, -1.0, 1.0), parents=(i % 3,)) for i in range(5)),
        tuple(replace(base_set(i, i + 2.0, -1.0, 1.0), parents=(4, i)) for i in (2, 1)),
    )
    whole = ReachableSet(steps, 2, LATTICE)
    corridor = whole.corridor()
    # of step 1 only 1, 2 and 4 have children; they have the parents 1 and 2 at step 0
    assert [len(step) for step in corridor.steps] == [2, 3, 2]
    assert [b.rectangle[0] for b in corridor.steps[0]] == [1.0, 2.0]
    assert [b.rectangle[0] for b in corridor.steps[1]] == [1.0, 2.0, 4.0]
    assert [b.parents for b in corridor.steps[1]] == [(0,), (1,), (0,)]
    assert [b.parents for b in corridor.steps[2]] == [(2, 1), (2, 0)]


def test_corridor_of_a_set_that_becomes_empty() -> None:
    """It tells as well what was within reach when the set became empty."""
    contested = np.ones((2, 3), dtype=bool)
    found = ReachableSet(((base_set(0.0, 1.0, -1.0, 1.0),),), 2, LATTICE, contested).corridor()
    assert (found.steps, found.horizon, found.first_empty_step) == ((), 2, 0)
    assert found.lattice is LATTICE
    assert found.contested is contested


def test_parents_lead_to_their_children() -> None:
    """From each parent its child is reached: their boxes, moved and widened, meet."""
    whole = reach("keep,follow-lane")
    for k in range(1, len(whole.steps)):
        for child in whole.steps[k]:
            assert child.parents
            for p in child.parents:
                parent = whole.steps[k - 1][p]
                low = parent.rectangle[0] + parent.speeds[0] * 0.1 - 0.04
                high = parent.rectangle[1] + parent.speeds[1] * 0.1 + 0.04
                assert child.rectangle[0] <= high
                assert child.rectangle[1] >= low


@pytest.mark.parametrize(
    "text", ["F(in_lane(left) & X X X !in_lane(current))", "F G(in_lane(right))", "G(v <= 12)"]
)
def test_only_what_can_still_accept_is_kept(text: str) -> None:
    horizon = 12
    scene = Course().scene()
    base = ground(scene, prediction(scene, horizon), Settings(horizon=horizon))
    spec = specification(ActionPair.parse("keep,follow-lane"), (text,))
    spec = Specification(spec.pair, spec.parts[2:])
    found = compute(base, spec)
    moves = moves_of(spec.dfa, (-6.0, 6.0), horizon)
    assert found.first_empty_step is None
    for k in range(horizon):
        # `horizon - k` letters are still to be read
        assert {b.label for b in found.steps[k]} <= moves.live[horizon - k]
    assert {b.label for b in found.steps[horizon]} == {-1}


def test_the_last_letter_asks_for_the_last_acceleration() -> None:
    scene = Course().scene()
    base = ground(scene, prediction(scene, 3), Settings(horizon=3))
    spec = specification(ActionPair.parse("keep,follow-lane"), ("G(a < -1 | a > 1)", "F G(a > 1)"))
    spec = Specification(spec.pair, spec.parts[2:])
    found = compute(base, spec)
    # two steps with anything from -6 to 6 m/s^2, then one with more than 1
    assert min(b.speeds[0] for b in found.steps[3]) == pytest.approx(10.0 - 1.2 + 0.1)
    assert max(b.speeds[1] for b in found.steps[3]) == pytest.approx(10.0 + 1.8)


def test_membership() -> None:
    one = base_set(0.0, 4.0, -1.0, 1.0)
    found = ReachableSet(((one,),), 0, LATTICE)
    assert found.contains(0, 4.0, 2.5, 0.0, -0.5)
    assert not found.contains(0, 4.0, 3.1, 0.0, -0.5)
    assert not found.contains(0, 4.0, 2.5, 0.0, -0.4)
    assert not found.contains(1, 4.0, 2.5, 0.0, -0.5)
    assert one.speeds == (1.0, 3.0)
    assert found.boxes(0) == [LATTICE.touched(0.0, 4.0, -1.0, 1.0)]
    assert np.isclose(found.area(0), 8.0)
    assert found.area(1) == 0.0
