"""Trajectories driven on the forbidden cells: where they are, our set is."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import sandra
from sandra.evaluation.reach_bench.checks import NotTheSame, check_nothing_lost
from sandra.evaluation.reach_bench.measure import SETTINGS
from sandra.evaluation.reach_bench.ours import free_set, prepare
from sandra.evaluation.reach_bench.seen import _advanced, _start, seen
from sandra.reach import Ground, ReachableSet

Boxes = list[list[tuple[float, float, float, float]]]


@pytest.fixture(scope="module", params=["merge", "intersection"])
def case(request: pytest.FixtureRequest) -> tuple[Ground, ReachableSet, Boxes, list[float]]:
    settings = SETTINGS.replace(horizon=15)
    base = prepare(sandra.load(sandra.example(request.param), settings=settings), settings)
    found = free_set(base)
    boxes = [[b.rectangle for b in step] for step in found.steps]
    return base, found, boxes, [found.area(k) for k in range(16)]


def test_nothing_is_outside_of_our_set(
    case: tuple[Ground, ReachableSet, Boxes, list[float]],
) -> None:
    base, found, boxes, areas = case
    driven = seen(base, [found], boxes, areas)
    assert (driven.lost_by_us, driven.lost_by_peer) == (0.0, 0.0)
    assert driven.ratios == (pytest.approx(1.0),)


def test_what_a_smaller_set_lacks_is_seen(
    case: tuple[Ground, ReachableSet, Boxes, list[float]],
) -> None:
    """A third of each rectangle is left out along s: trajectories visit nearly all of it."""
    base, found, boxes, areas = case
    shorter = [[(a, b - (b - a) / 3, c, d) for a, b, c, d in step[:1]] for step in boxes]
    parts = [(b - a) * (d - c) for ((a, b, c, d),) in shorter]
    naive = max(x / y for x, y in zip(areas, parts, strict=True) if y >= 1.0)
    driven = seen(base, [found], shorter, parts)
    assert driven.lost_by_peer > 0.05
    assert 1.0 <= driven.ratios[0] < 1.0 + 0.7 * (naive - 1.0)


def test_a_set_of_ours_that_lacks_something_is_refused(
    case: tuple[Ground, ReachableSet, Boxes, list[float]],
) -> None:
    base, found, boxes, areas = case
    cut = replace(found, steps=found.steps[:12])
    driven = seen(base, [found, cut], boxes, areas)
    assert driven.lost_by_us > 0.1
    with pytest.raises(NotTheSame, match="our set lacks"):
        check_nothing_lost(driven.lost_by_us)
    check_nothing_lost(0.0)


def test_states_after_a_step_are_those_of_the_model() -> None:
    settings = SETTINGS.replace(horizon=3)
    base = prepare(sandra.load(sandra.example("merge"), settings=settings), settings)
    found = free_set(base)
    rng = np.random.default_rng(1)
    states = _start(base, rng)[:300]
    for k in range(4):
        assert all(found.contains(k, *state) for state in states[:300])
        states = rng.permutation(_advanced(base, states, rng))[:300]
    # and they go to its ends
    wide = _advanced(base, _start(base, rng), rng)
    assert np.ptp(wide[:, 1]) == pytest.approx(12.0 * base.scene.dt, rel=0.05)
    assert np.ptp(wide[:, 3]) == pytest.approx(8.0 * base.scene.dt, rel=0.05)
