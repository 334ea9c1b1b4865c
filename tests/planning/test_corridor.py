"""The point-mass trajectory: inside the chain's sets at every step, and the smoothest there."""

from __future__ import annotations

import numpy as np
import pytest

from corridors import base, box, corridor, wide
from reach_scenes import Course
from sandra.actions import ActionPair
from sandra.planning import in_corridor
from sandra.planning.corridor import _chains, _smoothest
from sandra.reach.sets import BaseSet, ReachableSet
from sandra.scene.types import Scene
from sandra.settings import Settings

SETTINGS = Settings()
PAIR = ActionPair.parse("keep,follow-lane")
START = 40.0
"""s of the ego [m]."""
NOW = {"s": (START, START), "v": (10.0, 10.0), "d": (0.0, 0.0), "v_d": (0.0, 0.0)}


def scene(kappa: float = 0.0) -> Scene:
    return Course(kappa, step=1.0 if kappa else 5.0).scene()


def driven(where: ReachableSet, on: Scene | None = None) -> np.ndarray | None:
    found = in_corridor(scene() if on is None else on, PAIR, where, SETTINGS)
    if found is None:
        return None
    assert (found.kind, found.pair, found.dt) == ("reachable", PAIR, 0.1)
    assert "not certified" in found.note
    assert found.states.shape == (where.horizon + 1, 5)
    return found.states


def test_nothing_needs_to_be_done() -> None:
    states = driven(corridor(base(**NOW), *[base() for _ in range(5)]))
    assert states is not None
    assert states[:, 0] == pytest.approx(np.arange(6.0), abs=1e-6)
    assert states[:, 1:3] == pytest.approx(0.0, abs=1e-6)
    assert states[:, 3] == pytest.approx(10.0)
    assert states[:, 4] == pytest.approx(0.0, abs=1e-6)


def test_one_acceleration_where_the_end_asks_for_it() -> None:
    """2 m/s more after 1 s, without haste: 2 m/s^2 throughout."""
    steps = [base(**NOW), *[base() for _ in range(9)], base(v=(12.0, 50.0))]
    states = driven(corridor(*steps))
    assert states is not None
    t = 0.1 * np.arange(11)
    assert states[:, 4] == pytest.approx(2.0, abs=1e-4)
    assert states[:, 3] == pytest.approx(10.0 + 2.0 * t, abs=1e-4)
    assert states[:, 0] == pytest.approx(10.0 * t + t**2, abs=1e-4)


def test_across_the_lane_and_back() -> None:
    steps = [base(**NOW), *[base(d=(-2.0, 2.0)) for _ in range(20)]]
    steps[10] = base(d=(0.5, 2.0))
    steps[20] = base(d=(-2.0, 0.0))
    states = driven(corridor(*steps))
    assert states is not None
    assert states[10, 1] >= 0.5 - 1e-6
    assert states[20, 1] <= 1e-6
    v_d = np.gradient(states[:, 1], 0.1)
    assert states[3:-3, 2] == pytest.approx(np.arctan2(v_d, 10.0)[3:-3], abs=0.05)
    assert np.abs(np.diff(v_d)).max() <= 0.1 * SETTINGS.a_lat_max + 1e-6
    assert states[1:, 3] == pytest.approx(np.hypot(10.0, v_d)[1:], abs=0.2)


def test_inputs_are_those_of_each_step() -> None:
    steps = [
        base(**NOW, a=(1.0, 2.0)),
        base(a=(-3.0, -2.5)),
        base(a=(0.5, 0.5)),
        base(a=(9.0, 9.0)),
    ]
    states = driven(corridor(*steps))
    assert states is not None
    assert states[:3, 4] == pytest.approx([1.0, -2.5, 0.5], abs=1e-6)
    assert states[3, 4] == states[2, 4]  # the last step's inputs lead to nowhere


def test_another_chain_where_the_first_holds_nothing() -> None:
    """The larger set is tried first; what is reached of it goes no further."""
    large = base(s=(START - 5.0, START + 5.0), a=(0.0, 0.0))
    small = base(s=(START + 0.9, START + 1.1), a=(0.0, 0.0))
    last = BaseSet(box((START + 1.9, START + 2.1), (0.0, 50.0)), small.lat, 0, (0.0, 0.0), (1,))
    where = corridor(base(**NOW, a=(0.0, 0.0)), [large, small], last)
    states = driven(where)
    assert states is not None
    assert states[:, 0] == pytest.approx([0.0, 1.0, 2.0], abs=1e-5)
    chains = list(_chains(scene(), where, SETTINGS))
    assert chains == [[where.steps[0][0], small, last]]


def test_larger_sets_first() -> None:
    now = base(**NOW, a=(-1.0, 1.0))
    sizes = [0.2, 3.0, 1.0]
    sets = [base(d=(-x, x)) for x in sizes]
    found = [chain[1] for chain in _chains(scene(), corridor(now, sets), SETTINGS)]
    # By what is reached of them: 0.04 m across at most, so the two wide ones are the same.
    assert {id(x) for x in found} == {id(x) for x in sets}
    reach = [base(s=(START + low, START + 5.0)) for low in (1.0, 0.0, 0.996)]
    order = [chain[1] for chain in _chains(scene(), corridor(now, reach), SETTINGS)]
    assert [reach.index(x) for x in order] == [1, 2, 0]


def test_initial_sets_in_their_order() -> None:
    two = [base(**NOW), base(**NOW, a=(-1.0, 1.0))]
    found = [chain[0] for chain in _chains(scene(), corridor(two, base(parents=(0, 1))), SETTINGS)]
    assert [id(x) for x in found] == [id(x) for x in two]


def test_children_are_those_whose_parents_they_have() -> None:
    now = [base(**NOW), base(**NOW)]
    later = [base(parents=(1,)), base(parents=(0, 1)), base(parents=())]
    found = {tuple(map(id, c)) for c in _chains(scene(), corridor(now, later), SETTINGS)}
    wanted = [(now[0], later[1]), (now[1], later[0]), (now[1], later[1])]
    assert found == {tuple(map(id, pair)) for pair in wanted}


def test_none_where_no_chain_holds_one() -> None:
    """Reached in each step alone, but not by one trajectory: too far across in the time."""
    assert driven(corridor(base(**NOW), base(d=(0.5, 1.0)))) is None
    assert driven(corridor(base(**NOW), base(s=(START + 2.0, START + 3.0)))) is None
    empty = wide(3)
    assert driven(ReachableSet(empty.steps[:2], 3, empty.lattice)) is None


def test_how_far_across_the_lateral_limit_leads() -> None:
    """4 m/s^2 for 0.1 s are 0.02 m to each side."""
    for d, there in ((0.0199, True), (0.0201, False)):
        for sign in (1, -1):
            low, high = sorted((sign * d, sign * 1.0))
            assert (driven(corridor(base(**NOW), base(d=(low, high)))) is not None) == there


def test_the_smoothest_has_the_least_change_then_the_least_input() -> None:
    """From rest to 1 m/s after two of three steps: a constant input, and no more than needed."""
    polygons = [box((0.0, 0.0), (0.0, 0.0))] + [box((-9.0, 9.0), (-9.0, 9.0))] * 3
    polygons[2] = box((-9.0, 9.0), (1.0, 9.0))
    found = _smoothest(polygons, np.tile([-9.0, 9.0], (3, 1)), 0.5)
    assert found is not None
    x, v, u = found.T
    assert u == pytest.approx([1.0] * 4, abs=1e-5)
    assert v == pytest.approx([0.0, 0.5, 1.0, 1.5], abs=1e-5)
    assert x == pytest.approx([0.0, 0.125, 0.5, 1.125], abs=1e-5)


def test_it_starts_in_the_middle_of_the_first_set() -> None:
    polygons = [box((0.0, 2.0), (1.0, 3.0)), box((-9.0, 9.0), (-9.0, 9.0))]
    found = _smoothest(polygons, np.array([[-1.0, 1.0]]), 0.5)
    assert found is not None
    assert found[0] == pytest.approx([1.0, 2.0, 0.0], abs=1e-6)
    assert found[1] == pytest.approx([2.0, 2.0, 0.0], abs=1e-6)


@pytest.mark.parametrize("kappa", [0.02, -0.02])
def test_in_a_bend_the_speed_is_that_of_the_path(kappa: float) -> None:
    on = scene(kappa)
    steps = [base(**{**NOW, "d": (1.0, 1.0)}), *[base(d=(0.9, 1.1)) for _ in range(5)]]
    states = driven(corridor(*steps), on)
    assert states is not None
    assert states[1:, 3] == pytest.approx(10.0 * (1.0 - kappa), abs=0.02)
    s = START + np.arange(1.0, 6.0)
    points = np.column_stack([s, np.ones(5)])
    assert states[1:, :2] == pytest.approx(on.frame.to_cartesian(points), abs=1e-5)
    assert states[1:, 2] == pytest.approx(on.frame.heading(s), abs=1e-5)


def test_standing_bodies_keep_the_lanes_heading() -> None:
    """Below 0.1 m/s the direction of motion is noise."""
    steps = [base(**{**NOW, "v": (0.0, 0.0)})]
    steps += [base(s=(START, START), v=(0.0, 0.0), d=(0.0, 0.05)) for _ in range(2)]
    steps.append(base(s=(START, START), v=(0.0, 0.0), d=(0.001, 0.05), v_d=(-5.0, 5.0)))
    states = driven(corridor(*steps))
    assert states is not None
    assert states[:, 2] == pytest.approx(0.0)
    assert states[-1, 1] > 0.0


def test_so_many_base_sets_are_looked_at_and_no_more(monkeypatch: pytest.MonkeyPatch) -> None:
    """A chain of three takes three looks."""
    where = corridor(base(**NOW), base(), base())
    for most, found in ((3, 1), (2, 0)):
        monkeypatch.setattr("sandra.planning.corridor.MOST_SETS", most)
        assert len(list(_chains(scene(), where, SETTINGS))) == found
