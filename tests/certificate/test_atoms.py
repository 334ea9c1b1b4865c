"""Who precedes, in which lane, at which speed; and since when: against counting by hand."""

from __future__ import annotations

import itertools
import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import shapely

from certified import made
from sandra.certificate import Certificate, Violation, atoms, literals
from sandra.certificate.atoms import (
    Trace,
    _in_traffic,
    _traffic,
    decide,
    safe_distance_slack,
    signed_limits,
)
from sandra.certificate.trace import formula, trace
from sandra.certificate.types import LaneOf, Participant, Pavement
from sandra.errors import FormulaError
from sandra.logic import Comparison, Predicate
from sandra.scene.types import Region

BASE = made()
CAR = replace(BASE.obstacles[0], outline=Region.rectangle(4.5, 1.8))
LETTERS = 16
START = -40.0
"""x where the lane, and with it s, begins [m]."""


def strip(number: int, low: float, high: float, limit: float | None = None) -> Pavement:
    ends = np.array([-60.0, 160.0])
    left, right = (np.column_stack([ends, np.full(2, y)]) for y in (high, low))
    return Pavement(number, left, right, limit)


def standing(*pose: float, **changes: Any) -> Participant:
    """A car of which every state is x, y, heading, speed."""
    states = np.tile([*pose, 0.0], (LETTERS, 1))
    return replace(CAR, states=states, **changes)


def slack(c: Certificate) -> np.ndarray:
    return safe_distance_slack(Trace.of(c))


# Lanes


def test_several_lanes_may_have_one_relation() -> None:
    """The body reaches from -0.9 m to 0.9 m across, and from x = -2.25 m on along."""
    ahead = Pavement(2, *(np.array([[8.0, y], [30.0, y]]) for y in (2.0, -2.0)), None)
    there = strip(1, 5.0, 9.0)
    lanes = (LaneOf("left", (1,)), LaneOf("left", (2,)))
    for several in (lanes, lanes[::-1], (LaneOf("left", (1, 2)),)):
        c = replace(BASE, lanelets=(there, ahead), lanes=several)
        found = decide(Trace.of(c), Predicate("in_lane", "left"), np.zeros(LETTERS))
        # Its front, 2.25 m before the centre, gets to x = 8 m after 0.575 s.
        assert found.true == tuple(k >= 6 for k in range(LETTERS))
        assert found.false == tuple(k < 6 for k in range(LETTERS))


def test_the_road_of_a_trace() -> None:
    seen = Trace.of(BASE)
    assert seen.states[:, 0] == pytest.approx(np.arange(LETTERS))
    assert len(seen.bodies) == LETTERS
    assert shapely.centroid(seen.bodies[3]).x == pytest.approx(3.0)
    assert set(seen.lanelets) == {100, 101}
    assert seen.lanes("right") == []
    (left,) = seen.lanes("left")
    assert shapely.equals(left, seen.lanelets[101])


@pytest.mark.parametrize("relation", ["current", "left", "right", "opposite"])
def test_signs_of_own_lanes_go_before_others(relation: str) -> None:
    lanelets = (strip(1, -2.0, 2.0, 12.0), strip(2, -2.0, 2.0, 7.0), strip(3, 5.0, 9.0, 3.0))
    c = replace(BASE, lanelets=lanelets, lanes=(LaneOf(relation, (1,)),))
    expected = 7.0 if relation == "opposite" else 12.0
    assert signed_limits(Trace.of(c)).tolist() == [expected] * LETTERS


def test_the_strictest_sign_counts_and_none_is_no_limit() -> None:
    lanelets = (strip(1, -2.0, 2.0, 12.0), strip(2, -2.0, 2.0, 9.0), strip(3, -2.0, 2.0))
    c = replace(BASE, lanelets=lanelets, lanes=(LaneOf("current", (1, 2, 3)),))
    assert signed_limits(Trace.of(c)).tolist() == [9.0] * LETTERS
    assert set(signed_limits(Trace.of(replace(c, lanelets=lanelets[2:], lanes=())))) == {math.inf}
    # Each letter has its own: the second half of the way has another sign.
    later = Pavement(4, *(np.array([[7.5, y], [99.0, y]]) for y in (2.0, -2.0)), 4.0)
    c = replace(BASE, lanelets=(strip(1, -2.0, 2.0, 12.0), later), lanes=())
    assert signed_limits(Trace.of(c)).tolist() == [12.0] * 8 + [4.0] * 8


def test_the_neighbourhood_and_who_is_not_in_traffic() -> None:
    assert atoms.NEIGHBOURHOOD == 0.1
    assert atoms.DRIVEN == ("current", "left", "right")
    assert literals.LARGEST == 20_000


# Who precedes


def test_a_car_across_the_lane_has_its_rear_and_speed_along_it() -> None:
    rear = 40.0 - (2.25 * math.cos(0.5) + 0.9 * math.sin(0.5))
    along = 6.0 * math.cos(0.5)
    for turn in (0.5, -0.5):
        c = replace(BASE, obstacles=(standing(40.0, 0.0, turn, 6.0),))
        present, shapes, rears, speeds = _traffic(Trace.of(c), c.obstacles[0])
        assert present.all()
        assert shapely.area(shapes) == pytest.approx(4.5 * 1.8)
        assert rears == pytest.approx(rear - START)
        assert speeds == pytest.approx(along)
        needed = 100 / 12 - along**2 / 24 + 4.0
        assert slack(c)[0] == pytest.approx(rear - 2.25 - needed)
    backwards = replace(BASE, obstacles=(standing(40.0, 0.0, 2.0, 6.0),))
    assert _traffic(Trace.of(backwards), backwards.obstacles[0])[3].tolist() == [0.0] * LETTERS


def test_a_round_outline_is_wider_by_its_radius() -> None:
    disc = standing(40.0, 0.0, 0.3, 6.0, outline=Region.disc(1.5))
    _, shapes, rears, _ = _traffic(Trace.of(BASE), disc)
    assert shapely.bounds(shapes[0]) == pytest.approx([38.5, -1.5, 41.5, 1.5])
    assert rears == pytest.approx(38.5 - START)
    capsule = replace(disc, outline=Region(np.array([[-2.0, 0.0], [1.0, 0.0]]), 0.5))
    _, shapes, rears, _ = _traffic(
        Trace.of(BASE), replace(capsule, states=disc.states * [1, 1, 0, 1, 1])
    )
    assert shapely.bounds(shapes[0]) == pytest.approx([37.5, -0.5, 41.5, 0.5])
    assert rears == pytest.approx(37.5 - START)


def test_who_is_absent_is_nowhere() -> None:
    car = standing(40.0, 0.0, 0.0, 6.0)
    states = car.states.copy()
    states[2:5] = math.nan
    present = _traffic(Trace.of(BASE), replace(car, states=states))[0]
    assert present.tolist() == [not 2 <= k < 5 for k in range(LETTERS)]
    found = slack(replace(BASE, obstacles=(replace(car, states=states),)))
    assert np.isinf(found).tolist() == [2 <= k < 5 for k in range(LETTERS)]


def test_the_lane_with_the_least_slack_counts() -> None:
    """The body touches both lanes; one car is in each, the left one is nearer."""
    both = (strip(1, -2.0, 0.5), strip(2, 0.5, 4.0))
    lanes = (LaneOf("current", (1,)), LaneOf("left", (2,)))
    cars = (standing(50.0, -1.1, 0.0, 0.0, id=1), standing(45.0, 2.0, 0.0, 0.0, id=2))
    c = replace(BASE, lanelets=both, lanes=lanes, obstacles=cars)
    expected = 45.0 - 4.5 - (100 / 12 + 4.0) - np.arange(LETTERS)
    assert slack(c) == pytest.approx(expected)
    assert slack(replace(c, lanes=lanes[::-1], obstacles=cars[::-1])) == pytest.approx(expected)
    # In a lane that it does not touch nobody precedes.
    away = replace(c, lanelets=(both[0], strip(2, 1.0, 4.0)))
    assert slack(away) == pytest.approx(expected + 5.0)


def test_the_safe_distance_is_that_of_the_settings() -> None:
    """v^2 / (2 |a_min|) - v_o^2 / (2 |a_obs_min|) + v t_d, at 10 m/s behind 6 m/s."""
    c = replace(BASE, obstacles=(standing(60.0, 0.0, 0.0, 6.0),))
    for changes, needed in (
        ({}, 100 / 12 - 36 / 24 + 4.0),
        ({"a_min": -5.0}, 100 / 10 - 36 / 24 + 4.0),
        ({"a_obs_min": -9.0}, 100 / 12 - 36 / 18 + 4.0),
        ({"t_d": 1.1}, 100 / 12 - 36 / 24 + 11.0),
    ):
        found = slack(replace(c, settings=c.settings.replace(**changes)))
        assert found[0] == pytest.approx(55.5 - needed)
        assert found[5] == pytest.approx(50.5 - needed)


# Since when


LANE = shapely.box(0.0, 0.0, 4.0, 4.0)
PLACES = {"in": shapely.box(1, 1, 2, 2), "out": shapely.box(6, 1, 7, 2), "absent": None}


def counted(places: tuple[str, ...], exempt: int) -> list[bool]:
    """In the lane, and not within `exempt` steps of having been seen to enter it."""
    entries = [k for k in range(1, len(places)) if places[k] == "in" and places[k - 1] == "out"]
    return [
        here == "in" and not any(e <= k < e + exempt for e in entries)
        for k, here in enumerate(places)
    ]


@pytest.mark.parametrize("exempt", [0, 1, 2, 3])
def test_who_has_just_cut_in_does_not_count(exempt: int) -> None:
    c = replace(BASE, settings=BASE.settings.replace(cut_in_exception=True, t_c=exempt * BASE.dt))
    for places in itertools.product(PLACES, repeat=5):
        present = np.array([p != "absent" for p in places])
        # Who is absent has a shape all the same, wherever it is.
        shapes = np.array([PLACES[p] or PLACES["in"] for p in places])
        found = _in_traffic(LANE, present, shapes, c).tolist()
        # A second entry within the time of the first starts it anew.
        assert found == counted(places, exempt), places
        plain = _in_traffic(LANE, present, shapes, BASE).tolist()
        assert plain == [p == "in" for p in places]


def test_who_only_touches_a_lane_is_not_in_it() -> None:
    shapes = np.array([shapely.box(4, 0, 6, 2), shapely.box(3.99, 0, 6, 2)])
    assert _in_traffic(LANE, np.array([True, True]), shapes, BASE).tolist() == [False, True]


# What is said


def test_what_cannot_be_decided_is_said() -> None:
    seen = Trace.of(BASE)
    for atom, words in (
        (Predicate("in_lane", "above"), "'in_lane(above)' cannot be decided from the certificate"),
        (Predicate("in_lanelet", "5"), "'in_lanelet(5)' cannot be decided from the certificate"),
        (Predicate("sings"), "'sings' cannot be decided from the certificate"),
        (
            Predicate("keeps_safe_distance", "all"),
            "'keeps_safe_distance(all)' cannot be decided from the certificate",
        ),
        (
            Predicate("braking_justification", "x"),
            "'braking_justification(x)' cannot be decided from the certificate",
        ),
    ):
        with pytest.raises(FormulaError) as error:
            decide(seen, atom, np.zeros(LETTERS))
        assert str(error.value) == words


@pytest.mark.parametrize(
    ("variable", "bound", "holds"),
    [
        ("s", 43.0, [True] * 4 + [False] * 12),
        ("v", 10.0, [True] * LETTERS),
        ("v", 9.9, [False] * LETTERS),
        ("d", 0.0, [True] * LETTERS),
        ("d", -0.1, [False] * LETTERS),
        ("a", 0.0, [True] * LETTERS),
        ("a", -0.1, [False] * LETTERS),
    ],
)
def test_comparisons_with_a_number(variable: str, bound: float, holds: list[bool]) -> None:
    found = decide(Trace.of(BASE), Comparison(variable, "<=", bound + 1e-9), np.zeros(LETTERS))
    assert found.true == tuple(holds)
    assert found.false == tuple(not x for x in holds)


def test_a_formula_that_cannot_be_made_is_violated_twice() -> None:
    c = replace(BASE, rules=("R_G9",))
    words = (
        "unknown rule 'R_G9': choose from R_G1, R_G2, R_G3, or write a formula such as "
        "'G(v <= 13.9)'"
    )
    assert formula(c) == Violation("formula", words)
    assert trace(c) == Violation("trace", words)
