"""Each bound at its last bit: the value itself, and its neighbours to both sides."""

from __future__ import annotations

import numpy as np
import pytest

from sandra.planning.bounds import (
    MOVING,
    STILL,
    clear,
    moves,
    overlap,
    stands,
    whole_steps,
    within,
)


def around(value: float) -> np.ndarray:
    """The number before a value, the value, and the number after it."""
    return np.array([np.nextafter(value, -np.inf), value, np.nextafter(value, np.inf)])


@pytest.mark.parametrize("margin", [0.02, 0.01, 0.0, -1.0])
def test_just_the_margin_is_contact(margin: float) -> None:
    assert clear(around(margin), margin).tolist() == [False, False, True]
    assert [bool(clear(x, margin)) for x in around(margin).tolist()] == [False, False, True]
    assert clear(np.array([np.nan, np.inf, -np.inf]), margin).tolist() == [False, True, False]


@pytest.mark.parametrize("slack", [0.0, 0.25])
def test_both_ends_are_within_and_so_is_the_slack(slack: float) -> None:
    low, high = -1.5, 2.0
    assert within(around(low - slack), low, high, slack).tolist() == [False, True, True]
    assert within(around(high + slack), low, high, slack).tolist() == [True, True, False]
    assert within(np.array([np.nan, np.inf, -np.inf]), low, high, slack).tolist() == [False] * 3


def test_within_takes_a_number_or_one_for_each_value() -> None:
    assert within(1.0, 1.0, 1.0)
    values, low, high = np.ones(4), np.array([0.0, 1.0, 2.0, 0.0]), np.array([2.0, 1.0, 3.0, 0.5])
    assert within(values, low, high).tolist() == [True, True, False, False]
    slack = np.array([0.0, 0.0, 1.0, 0.25])
    assert within(values, low, high, slack).tolist() == [True, True, True, False]


@pytest.mark.parametrize("axis", [0, 1])
def test_boxes_that_touch_have_a_point_in_common(axis: int) -> None:
    """A unit box, and one beside it that is moved along one axis."""
    low = np.zeros((3, 2))
    low[:, axis] = around(1.0)
    unit = np.zeros(2), np.ones(2)
    assert overlap(low, low + 1.0, *unit).tolist() == [True, True, False]
    high = np.ones((3, 2))
    high[:, axis] = around(0.0)
    assert overlap(high - 1.0, high, *unit).tolist() == [False, True, True]


def test_boxes_far_away_and_within_each_other() -> None:
    low = np.array([[5.0, 0.2], [0.2, 5.0], [0.2, 0.2], [-5.0, -5.0]])
    high = np.array([[6.0, 0.8], [0.8, 6.0], [0.8, 0.8], [9.0, 9.0]])
    assert overlap(low, high, np.zeros(2), np.ones(2)).tolist() == [False, False, True, True]


def test_a_billionth_is_not_a_standstill_but_less_is() -> None:
    assert stands(around(STILL)).tolist() == [True, False, False]
    assert stands(-around(STILL)).tolist() == [True, False, False]
    assert bool(stands(0.0))
    assert not stands(np.nan)


def test_more_than_a_creep_is_a_direction() -> None:
    assert moves(around(MOVING)).tolist() == [False, False, True]
    assert not moves(np.nan)


def test_whole_steps_up_to_a_tolerance() -> None:
    tolerance, bit = 2.0**-20, 2.0**-40
    for sign in (1.0, -1.0):
        for off, steps in ((tolerance - bit, 4), (tolerance, 4), (tolerance + bit, None)):
            assert whole_steps(1.0 + sign * off, 0.25, tolerance) == steps


def test_no_step_and_steps_back() -> None:
    assert whole_steps(0.0, 0.25, 0.0) == 0
    assert whole_steps(-0.5, 0.25, 0.0) == -2
    assert whole_steps(0.25, np.inf, 1.0) is None
