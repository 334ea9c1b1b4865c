"""The search over free stretches, node by node."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from corridors import Range, box
from fail_safe_scenes import SETTINGS, STRAIGHT, by_hand, road, state_of
from sandra.planning.fail_safe_candidates import Task, lateral_paths
from sandra.planning.optimised_profiles import (
    MOST_WAYS,
    _ahead,
    _may_rest,
    _Node,
    _stops,
    _widest,
    profiles,
)
from sandra.planning.path_gaps import Track, _stretches
from sandra.planning.strategies import stopping_aims
from sandra.planning.surroundings import Surroundings
from sandra.scene.types import Region

HORIZON = 60


def node(s: Range, v: Range = (5.0, 6.0), gap: Range = (0.0, 100.0)) -> _Node:
    return _Node(box(s, v), gap, (np.inf, 0.0), None, ())


def test_what_others_reach_already_is_not_followed() -> None:
    large, small, beside = node((0.0, 10.0)), node((2.0, 5.0)), node((8.0, 12.0))
    assert _widest([small, large, beside]) == [large, beside]
    # The same states in another gap are another way.
    elsewhere = node((2.0, 5.0), gap=(1.0, 9.0))
    assert _widest([large, elsewhere]) == [large, elsewhere]


def test_the_widest_ways_are_followed() -> None:
    nodes = [node((0.0, 1.0 + i), gap=(0.0, 50.0 + i)) for i in range(MOST_WAYS + 2)]
    assert _widest(nodes) == nodes[:1:-1]


def test_gaps_are_numbered_where_there_is_a_choice() -> None:
    """From s = 0 to 10 at 5 m/s, for a tenth of a second with no input at all."""
    at = node((0.0, 10.0), (5.0, 5.0))

    def ahead(*gaps: Range) -> list[tuple[int | None, Range]]:
        return [(number, gap) for number, gap, _ in _ahead(at, list(gaps), 0.0, 0.0, 0.1)]

    assert ahead((-5.0, 20.0)) == [(None, (-5.0, 20.0))]
    assert ahead((0.0, 4.0), (6.0, 20.0)) == [(0, (0.0, 4.0)), (1, (6.0, 20.0))]
    # One that cannot be reached is no choice; one that is left within the step is no way.
    assert ahead((0.0, 20.0), (30.0, 40.0)) == [(None, (0.0, 20.0))]
    assert ahead((30.0, 40.0)) == []
    assert ahead((-9.0, 0.2), (0.4, 20.0)) == [(1, (0.4, 20.0))]
    ((_, _, polygon),) = _ahead(at, [(-5.0, 20.0)], 0.0, 0.0, 0.1)
    places = [s for s, _ in polygon]
    assert (min(places), max(places)) == (0.5, 10.5)


def track(regions: dict[int, Region] | dict[int, tuple[Region, ...]]) -> Track:
    scene = road(STRAIGHT, speed=8.0)
    prediction = by_hand(scene, regions, HORIZON)
    state = state_of(scene)
    shared = Surroundings.of(scene, prediction)
    task = Task.of(scene, state, 0.0, 0, HORIZON, SETTINGS, shared)
    aims = stopping_aims(scene, state, task.now)[:1]
    ((_, along),) = lateral_paths(task, aims, 60.0)
    assert along is not None
    found = Track.of(task, along)
    assert found is not None
    return found


def test_on_a_free_road_nothing_is_chosen() -> None:
    stops, reason = _stops(track({}))
    assert reason == ""
    assert stops
    assert {x.choices for stop in stops for x in stop.nodes} == {()}


def test_a_choice_is_remembered() -> None:
    """Something crosses 14 to 16 m ahead after 2 s: before it or behind it."""
    across = Region.rectangle(2.0, 3.0).placed(15.0, 0.0, 0.0)
    stops, _ = _stops(track(dict.fromkeys(range(20, 26), across)))
    chosen = {x.choices for stop in stops for x in stop.nodes}
    assert {choice for way in chosen for choice in way} <= {0, 1}
    assert any(chosen)


def test_it_comes_to_a_standstill_gently() -> None:
    """The mildest way on a free road: slowly at last, not stopped from a metre per second."""
    found, _ = profiles(track({}))
    assert found
    for profile in found:
        assert profile[-1] == 0.0
        assert (profile[:-1] > 0.0).all()
    assert any(x[x > 0.0].min() < 0.5 for x in found)
    assert min(len(x) for x in found) == len(found[0])


def test_stretches_end_with_the_path_and_have_a_length() -> None:
    free = np.array([True, True, False, True])
    assert _stretches(free, 9.0) == [(0.0, 0.5), (0.75, 1.0)]
    assert _stretches(free, 9.0, start=2.0) == [(2.0, 2.5), (2.75, 3.0)]
    assert _stretches(free, 0.8) == [(0.0, 0.5), (0.75, 0.8)]
    assert _stretches(free, 0.75) == [(0.0, 0.5)]


def test_the_bound_on_the_speed_is_a_line_below_it() -> None:
    """Along a path on which the bound falls by 0.1 m/s each metre."""
    at = track({})
    falling = replace(at, fastest=20.0 - 0.1 * at.distance)
    for low, high in ((10.0, 20.0), (30.0, 31.0), (0.0, 50.0)):
        c, m = falling.speed_bound(low, high)
        s = np.linspace(low, high, 50)
        assert (c + m * s <= 20.0 - 0.1 * s + 1e-9).all()
        middle = (low + high) / 2
        # Slopes are tried in steps of 1.6: the line is off by some of the slope at the ends.
        assert c + m * middle >= 20.0 - 0.1 * middle - 0.05 * (high - low) / 2 - 0.05
        assert m < 0.0
    level = replace(at, fastest=np.full(len(at.distance), 7.0))
    assert level.speed_bound(10.0, 20.0) == (7.0, 0.0)


def test_a_place_whose_beginning_alone_is_reached_is_none() -> None:
    """Standstills from 0 to 5 m."""
    last = [(0.0, 0.0), (5.0, 0.0)]
    assert not _may_rest(last, (5.0, 9.0))
    assert _may_rest(last, (float(np.nextafter(5.0, 0.0)), 9.0))
    assert not _may_rest(last, (7.0, 9.0))
    assert not _may_rest([], (0.0, 9.0))


def test_what_ends_a_stretch_within_two_metres_of_the_end_is_the_end() -> None:
    across = Region.rectangle(2.0, 3.0).placed(20.0, 0.0, 0.0)
    at = replace(track(dict.fromkeys(range(HORIZON), across)), length=20.0)
    assert at.in_the_way(0, 18.0) == "leaves the road"
    assert at.in_the_way(0, float(np.nextafter(18.0, 0.0))) == "may meet obstacle 7 0.00 s from now"


def test_stretches_of_the_part_that_is_asked_for_to_the_cell() -> None:
    """The front, 2.25 m before the centre, keeps 5 cm from what stands at 20 to 30 m."""
    at = track(dict.fromkeys(range(HORIZON), Region.rectangle(10.0, 3.0).placed(25.0, 0.0, 0.0)))
    assert at.free(0, 0.0, 40.0) == [(0.0, 17.5), (32.5, 42.0)]
    # Two metres more to both sides.
    assert at.free(0, 40.0, 50.0) == [(38.0, 52.0)]


def test_the_bound_on_the_speed_is_of_the_part_that_is_asked_for() -> None:
    at = track({})
    slow_before = replace(at, fastest=np.where(at.distance < 9.0, 1.0, 7.0))
    assert slow_before.speed_bound(10.0, 20.0) == (7.0, 0.0)


@pytest.mark.parametrize("side", [1.0, -1.0])
@pytest.mark.parametrize(("apart", "free"), [(0.051, True), (0.049, False)])
def test_what_stands_beside_the_path_takes_it_from_5_cm_on(
    side: float, apart: float, free: bool
) -> None:
    """The body is 1.8 m wide; the block 1 m, and 4 m long."""
    beside = Region.rectangle(4.0, 1.0).placed(20.0, side * (0.9 + apart + 0.5), 0.0)
    found = track(dict.fromkeys(range(HORIZON), beside)).free(0, 0.0, 40.0)
    assert (len(found) == 1) == free
