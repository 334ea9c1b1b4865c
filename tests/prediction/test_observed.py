"""Which assumptions hold: exactly at each limit they still do."""

from __future__ import annotations

import math
from dataclasses import fields, replace

import numpy as np
import pytest

from prediction.traffic import car, scene, straight_road
from sandra.errors import SettingsError
from sandra.prediction.lane_cutting import build_map
from sandra.prediction.observed import (
    BACKWARDS,
    ON_LANE,
    TowardsEgo,
    _touches,
    along_lane,
    check_assumptions,
    observe,
    safe_distance,
    towards_ego,
)
from sandra.scene.types import Obstacle, Region, State
from sandra.settings import Assumptions, Settings

ROAD = straight_road()
MAP = build_map(ROAD, 20.0)
A = Assumptions()
UNLIMITED = ("max_braking", "max_driving")
BOUNDS = [
    f.name
    for f in fields(Assumptions)
    if isinstance(getattr(A, f.name), float) and f.name not in UNLIMITED
]


def seen(obstacle: Obstacle, a: Assumptions = A):  # type: ignore[no-untyped-def]
    return observe(obstacle, obstacle.state, MAP, a)


def test_bounds_may_be_zero_but_not_negative_nor_infinite() -> None:
    assert len(BOUNDS) == 8
    for name in BOUNDS:
        check_assumptions(replace(A, **{name: 0.0}))
        for bad in (-1e-9, math.inf, math.nan):
            with pytest.raises(SettingsError, match=rf"assumptions\.{name} = "):
                check_assumptions(replace(A, **{name: bad}))
    for name in UNLIMITED:
        for good in (0.0, math.inf):
            check_assumptions(replace(A, **{name: good}))
        for bad in (-1e-9, math.nan):
            with pytest.raises(SettingsError, match=rf"assumptions\.{name} = "):
                check_assumptions(replace(A, **{name: bad}))


def test_at_the_greatest_speed_the_bound_holds() -> None:
    for speed in (A.max_speed, -A.max_speed):
        found = seen(car(1, 0, 1.75, speed=speed))
        assert found.bounds.v_max == A.max_speed
        assert "max_speed" in found.assumptions
    faster = math.nextafter(A.max_speed, math.inf)
    found = seen(car(1, 0, 1.75, speed=-faster))
    assert found.bounds.v_max == faster
    assert "max_speed" in found.dropped


def test_at_the_greatest_speed_across_the_bound_holds() -> None:
    obstacle = car(1, 0, 1.75, heading=0.3, speed=10.0)
    across = 10.0 * abs(math.sin(seen(obstacle).places[0].relative_heading))
    for most, name in ((across, "assumptions"), (math.nextafter(across, 0.0), "dropped")):
        found = seen(obstacle, replace(A, max_lateral_speed=most))
        assert "max_lateral_speed" in getattr(found, name)
        assert found.lateral_speed == across


@pytest.mark.parametrize("obstacle", [
    car(1, 0, 1.75, 0.5, 0.0), car(1, 0, 1.75, 0.5, speed_is_known=False)
])  # fmt: skip
def test_who_stands_or_whose_speed_is_not_known_moves_across_as_assumed(obstacle: Obstacle) -> None:
    found = seen(obstacle, replace(A, max_lateral_speed=0.1))
    assert found.lateral_speed == 0.1
    assert "max_lateral_speed" in found.assumptions


def test_noise_is_not_reversing() -> None:
    found = seen(car(1, 0, 1.75, speed=-BACKWARDS))
    assert not found.reversing
    assert "no_reversing" in found.assumptions
    found = seen(car(1, 0, 1.75, speed=math.nextafter(-BACKWARDS, -1.0)))
    assert found.reversing
    assert "no_reversing" in found.dropped


def test_a_lane_is_held_up_to_two_centimetres_beside_it_and_sixty_degrees_off() -> None:
    for beside, held in ((ON_LANE - 1e-6, True), (ON_LANE + 1e-6, False)):
        assert bool(seen(car(1, 0, -beside)).places) == held
    for degrees, held in ((59.9, True), (60.1, False), (-59.9, True), (-60.1, False)):
        assert bool(seen(car(1, 0, 1.75, math.radians(degrees), 1.0)).places) == held


def test_of_two_lanes_at_one_place_the_smaller_speed_across_counts() -> None:
    """A second lanelet on the same place, turned by 0.5 rad."""
    turn = np.array([[np.cos(0.5), np.sin(0.5)], [-np.sin(0.5), np.cos(0.5)]])
    left, right = (np.array([[-50.0, y], [50.0, y]]) @ turn for y in (5.0, -5.0))
    other = replace(straight_road(1)[0], id=99, left=left, right=right, successors=())
    lanes = build_map((*straight_road(1), other), 20.0)
    obstacle = car(1, 1.0, 1.75, heading=0.1, speed=20.0)
    found = observe(obstacle, obstacle.state, lanes, A)
    assert {p.lanelet for p in found.places} >= {99, 12}
    assert found.lateral_speed == A.max_lateral_speed > 20.0 * math.sin(0.1)
    assert "max_lateral_speed" in found.assumptions


def law(obstacle: Obstacle, speed: float = 15.0, a: Assumptions = A) -> TowardsEgo:
    """Towards an ego in the middle lane of three, at x = 0."""
    now = scene(ROAD, (obstacle,), State(0.0, 5.25, 0.0, speed), current=(21, 22))
    return towards_ego(now, obstacle, obstacle.state, seen(obstacle), Settings(assumptions=a))


def test_behind_is_behind_only() -> None:
    for x, behind in ((-1e-6, True), (0.0, False), (1e-6, False)):
        found = law(car(1, x, 5.25))
        assert (found.behind, found.drop_own) == (behind, behind)
        assert ("no_rear_end" in found.holds) == behind
        # Who starts in the ego's lane ahead of it may do what it likes.
        assert found.drop_cut == behind


def test_at_the_safe_distance_cutting_in_is_legal() -> None:
    """The ego stands: bumper to bumper is far enough."""
    for x, drop in ((4.5, False), (4.5 - 1e-6, True)):
        found = law(car(1, x, 8.75), speed=0.0)
        assert found.drop_cut == drop
        assert ("legal_cut_in" in found.holds) == drop


def test_safe_distance_is_that_of_the_rule() -> None:
    """15^2 / 2 a - 10^2 / 2 a_obs + reaction; 0 where the other is much faster."""
    s = replace(Settings(), a_min=-10.0, a_obs_min=-5.0, t_d=0.4)
    assert safe_distance(15.0, 10.0, s) == pytest.approx(11.25 - 10.0 + 6.0)
    assert safe_distance(0.0, 30.0, s) == 0.0


def test_each_assumption_towards_the_ego_can_be_switched_off() -> None:
    behind, beside = car(1, -15, 5.25), car(2, 0, 8.75)
    assert law(behind).holds == ("no_rear_end", "legal_cut_in")
    assert law(beside).holds == ("legal_cut_in", "no_rear_end")
    no_law = replace(A, legal_cut_in=False)
    assert law(behind, a=no_law) == TowardsEgo(True, True, False, ("no_rear_end",))
    assert law(beside, a=no_law) == TowardsEgo(False, False, False)
    no_care = replace(A, no_rear_end=False)
    assert law(behind, a=no_care) == TowardsEgo(True, False, False)
    assert law(beside, a=no_care) == TowardsEgo(False, False, False)


LANE = np.array([[-200.0, 3.5], [200.0, 3.5], [200.0, 7.0], [-200.0, 7.0]])


def touches(x: float, y: float, heading: float = 0.0, outline: Region | None = None) -> bool:
    obstacle = car(1, x, y, heading)
    if outline is not None:
        obstacle = replace(obstacle, outline=outline)
    return _touches(obstacle, obstacle.state, LANE)


def test_a_body_reaches_into_a_lane_by_its_edges() -> None:
    one = 1e-6
    assert touches(0.0, 7.9 - one)
    assert not touches(0.0, 7.9 + one)
    assert touches(0.0, 2.6 + one)
    assert not touches(0.0, 2.6 - one)
    # Turned by 90 degrees it is longer across; a corner alone may reach in.
    assert touches(0.0, 9.2, np.pi / 2)
    assert touches(0.0, 8.6, np.pi / 4)
    assert not touches(0.0, 10.0, np.pi / 4)
    disc = Region.disc(0.5)
    assert touches(0.0, 5.0, outline=disc)
    assert not touches(0.0, 20.0, outline=disc)


def test_touching_a_border_from_outside_is_not_reaching_in() -> None:
    assert 7.9 - 0.9 == 7.0
    assert not touches(0.0, 7.9)
    assert not touches(200.0 + 2.25, 5.25)


def test_places_along_the_lane_of_an_ego_that_has_none() -> None:
    places = np.array([[3.0, 1.0], [7.0, -2.0]])
    nowhere = along_lane(scene(ROAD, ()), places)
    assert nowhere.dtype == np.float64
    assert np.isnan(nowhere).tolist() == [True, True]
    on_lane = along_lane(scene(ROAD, (), current=(21, 22)), places)
    assert np.diff(on_lane) == pytest.approx([4.0])
