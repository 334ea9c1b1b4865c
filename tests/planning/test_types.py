"""Maneuvers and trajectories as they are handed on."""

import numpy as np
import pytest

import sandra
from sandra.planning.types import Maneuver, Trajectory

STATES = np.arange(35.0).reshape(7, 5)
INPUTS = np.column_stack([10.0 + np.arange(6.0), 20.0 + np.arange(6.0)])


def test_a_maneuver_as_data() -> None:
    pair = sandra.ActionPair.parse("decelerate,left-lane")
    maneuver = Maneuver("certified", pair, np.zeros((2, 5)), 0.1, "")
    assert maneuver.to_dict() == {
        "kind": "certified",
        "longitudinal": "decelerate",
        "lateral": "left-lane",
    }
    assert (maneuver.fail_safe, maneuver.fail_safe_start) == (None, 0.0)
    braking = Maneuver("fail-safe", None, np.zeros((2, 5)), 0.1, "")
    assert braking.to_dict() == {"kind": "fail-safe", "longitudinal": None, "lateral": None}


def test_a_row_has_the_acceleration_that_is_applied_from_it_on() -> None:
    rows = Trajectory(STATES, INPUTS, 0.05).every(0.05)
    assert np.array_equal(rows[:, :4], STATES[:, :4])
    # The last state has no input of its own: it shows the one that led to it.
    assert rows[:, 4].tolist() == [10.0, 11.0, 12.0, 13.0, 14.0, 15.0, 15.0]


@pytest.mark.parametrize(
    ("dt", "index"), [(0.1, [0, 2, 4, 6]), (0.15, [0, 3, 6]), (0.2, [0, 4, 6]), (0.01, range(7))]
)
def test_rows_every_dt_and_the_last_one(dt: float, index: list[int]) -> None:
    rows = Trajectory(STATES, INPUTS, 0.05).every(dt)
    assert np.array_equal(rows[:, :4], STATES[list(index), :4])


def test_who_stands_already_has_one_row() -> None:
    rows = Trajectory(STATES[:1], np.zeros((0, 2)), 0.05).every(0.1)
    assert rows.tolist() == [[0.0, 1.0, 2.0, 3.0, 0.0]]


def test_the_end_counts_from_the_start() -> None:
    assert Trajectory(STATES, INPUTS, 0.05).end == pytest.approx(0.3)
    assert Trajectory(STATES, INPUTS, 0.05, start=0.2).end == pytest.approx(0.5)
