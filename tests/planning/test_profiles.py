"""Acceleration profiles: inside the corridor's inputs, never backwards, and the ones to expect."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from corridors import base, corridor, wide
from sandra.planning.limits import MARGIN, Limits
from sandra.planning.profiles import profiles
from sandra.reach.sets import ReachableSet

LIMITS = Limits(-6.0, 6.0, 4.0, 30.0, 1.0, 0.4)
DT = 0.1


def made(
    where: ReachableSet, v0: float = 10.0, s0: float = 0.0, limits: Limits = LIMITS
) -> np.ndarray:
    found = profiles(where, v0, s0, DT, limits)
    assert found.shape == (len(found), where.horizon)
    assert len(np.unique(np.round(found, 3), axis=0)) == len(found)
    speed = v0 + np.cumsum(found * DT, axis=1)
    assert speed.min(initial=0.0) >= -1e-9
    assert (speed <= limits.v_max + 1e-9).all()
    return found


def driving(found: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Speeds (P, h + 1) from 10 m/s on, and the distance driven (P,)."""
    speed = 10.0 + np.cumsum(np.column_stack([np.zeros(len(found)), found * DT]), axis=1)
    return speed, ((speed[:, 1:] + speed[:, :-1]) / 2 * DT).sum(axis=1)


def constants(found: np.ndarray) -> set[float]:
    return set(np.round(found[(np.ptp(found, axis=1) < 1e-9)][:, 0], 6))


def test_constant_ones_between_the_bounds() -> None:
    found = constants(made(wide(10, a=(-4.0 - MARGIN, 4.0 + MARGIN)), 20.0))
    # Both bounds, none at all, quarters of the range, and gentle ones.
    assert {-4.0, -2.0, -1.0, 0.0, 1.0, 2.0, 4.0} <= found
    positive = constants(made(wide(10, a=(1.0 - MARGIN, 3.0 + MARGIN)), 20.0))
    assert {1.0, 1.5, 2.0, 2.5, 3.0} <= positive
    negative = constants(made(wide(10, a=(-3.0 - MARGIN, -0.5 + MARGIN)), 20.0))
    assert {-3.0, -2.375, -2.0, -1.75, -1.125, -1.0, -0.5} <= negative


def test_bounds_are_kept_with_a_margin_at_every_step() -> None:
    steps = [base(a=(-2.0, 1.0)) for _ in range(4)] + [base(a=(-1.0, 3.0)) for _ in range(5)]
    found = made(corridor(*steps))
    assert len(found) > 10
    assert (found[:, :4] >= -2.0 + MARGIN - 1e-6).all()
    assert (found[:, :4] <= 1.0 - MARGIN + 1e-6).all()
    assert (found[:, 4:] >= -1.0 + MARGIN - 1e-6).all()
    assert (found[:, 4:] <= 3.0 - MARGIN + 1e-6).all()
    # The last step's inputs are of no profile.
    steps[-1] = base(a=(5.0, 6.0))
    assert np.array_equal(made(corridor(*steps)), found)


def test_several_sets_of_a_step_together_bound_it() -> None:
    steps = [[base(a=(-3.0, -2.0)), base(a=(1.0, 2.0))] for _ in range(6)]
    found = constants(made(corridor(*steps)))
    assert {-3.0 + MARGIN, 0.0, 2.0 - MARGIN} <= found


def test_the_limits_bound_them_too() -> None:
    tight = Limits(-1.0, 0.5, 4.0, 30.0, 1.0, 0.4)
    found = made(wide(10), 20.0, limits=tight)
    assert found.min() == pytest.approx(-1.0)
    assert found.max() == pytest.approx(0.5)


def test_nothing_where_no_input_is_left() -> None:
    assert made(wide(5, a=(1.0, 1.0))).shape == (0, 5)
    steps = [base() for _ in range(6)]
    steps[2] = base(a=(6.5, 7.0))
    assert made(corridor(*steps)).shape == (0, 5)


def test_one_input_is_enough() -> None:
    """Between bounds that leave no more than a number, that number is driven."""
    assert made(wide(5, a=(-MARGIN, MARGIN))).tolist() == [[0.0] * 5]


def test_ones_that_change_once() -> None:
    """First at most 0, then at least 1: nothing constant fits."""
    steps = [base(a=(-1.0 - MARGIN, MARGIN))] * 3 + [base(a=(1.0 - MARGIN, 2.0 + MARGIN))] * 8
    found = made(corridor(*steps), 20.0)
    assert len(found)
    assert constants(found) == set()
    changes = {int(np.flatnonzero(np.diff(x) > 1e-6)[0]) + 1 for x in found}
    assert 3 in changes
    for first, second in ((0.0, 1.0), (-1.0, 2.0), (0.0, 2.0), (-1.0, 1.0)):
        wanted = np.repeat([first, second], [3, 7])
        assert (np.abs(found - wanted) < 1e-6).all(axis=1).any()


def test_a_change_after_six_tenths() -> None:
    steps = [base(a=(-1.0 - MARGIN, MARGIN))] * 6 + [base(a=(1.0 - MARGIN, 2.0 + MARGIN))] * 5
    found = made(corridor(*steps), 20.0)
    assert (np.abs(found - np.repeat([0.0, 1.0], [6, 4])) < 1e-6).all(axis=1).any()


@pytest.mark.parametrize("horizon", [1, 2, 3])
def test_short_horizons(horizon: int) -> None:
    found = made(wide(horizon, a=(-4.0 - MARGIN, 4.0 + MARGIN)), 10.0)
    assert {-4.0, 0.0, 4.0} <= constants(found)
    assert (np.ptp(found, axis=1) > 1e-6).any() == (horizon > 1)


def test_brakings_to_a_standstill_stay_there() -> None:
    """4 m/s in 2 s: at once or later, to an end that is reached exactly."""
    found = made(wide(20, a=(-6.0, 6.0)), 4.0)
    speed = 4.0 + np.cumsum(found * DT, axis=1)
    stopping = found[np.abs(speed[:, -1]) < 1e-9]
    for begin, end in ((0, 8), (0, 20), (3, 14), (6, 17), (6, 20)):
        wanted = np.zeros(20)
        wanted[begin:end] = -4.0 / ((end - begin) * DT)
        assert (np.abs(stopping - wanted) < 1e-6).all(axis=1).any(), (begin, end)


def test_who_would_drive_backwards_stands() -> None:
    found = made(wide(10), 1.0)
    hard = found[found[:, 0] < -5.9]
    assert len(hard)
    speed = 1.0 + np.cumsum(hard * DT, axis=1)
    # 0.4 m/s are left after one step, and braked off by less in the second.
    assert np.abs(speed[:, 1:]).min(axis=1).max() < 1e-9
    standing = made(wide(4), 0.0)
    assert (np.abs(standing).max(axis=1) < 1e-9).any()
    assert standing.min() >= -6.0


def test_none_is_faster_than_allowed() -> None:
    found = made(wide(10), 28.0, limits=Limits(-6.0, 6.0, 4.0, 29.0, 1.0, 0.4))
    gained = 28.0 + np.cumsum(found * DT, axis=1)
    assert (gained.max(axis=1) > 28.5).any()
    assert gained.max() <= 29.0 + 1e-9


def test_the_last_step_is_aimed_at() -> None:
    """A corridor that ends in a small set off the plain profiles: some hits its middle."""
    steps = [base() for _ in range(21)]
    # 10 m/s for 2 s would be 20 m; wanted are 22 m with 10 m/s at the end.
    steps[20] = base(s=(21.7, 22.3), v=(9.7, 10.3))
    found = made(corridor(*steps))
    speed, driven = driving(found)
    hits = (np.abs(driven - 22.0) < 1e-6) & (np.abs(speed[:, -1] - 10.0) < 1e-6)
    assert hits.sum() == 2  # changing at a half and at a third
    # And points around it, towards the corners.
    for share in (0.4, 0.8):
        for s, v in ((-1, -1), (1, -1), (1, 1), (-1, 1)):
            ds, dv = 0.3 * share * s, 0.3 * share * v
            near = (np.abs(driven - 22.0 - ds) < 1e-6) & (np.abs(speed[:, -1] - 10.0 - dv) < 1e-6)
            assert near.any(), (share, s, v)


def test_larger_sets_of_the_last_step_come_first() -> None:
    """Only the six largest of the last step are aimed at."""
    last = [base(s=(19.0 + 0.1 * i, 19.5 + 0.2 * i), v=(9.0, 9.1)) for i in range(8)]
    found = made(corridor(*[base() for _ in range(20)], last))
    speed, driven = driving(found)

    def aimed(i: int) -> bool:
        s = (19.0 + 0.1 * i + 19.5 + 0.2 * i) / 2
        return bool(((np.abs(driven - s) < 1e-6) & (np.abs(speed[:, -1] - 9.05) < 1e-6)).any())

    assert [aimed(i) for i in range(8)] == [False, False] + [True] * 6


@pytest.mark.parametrize(("low", "high"), [(0.0, 9.0), (11.5, 50.0)])
def test_what_leaves_the_speeds_of_the_corridor_by_far_is_left_out(low: float, high: float) -> None:
    """Speeds in the corridor at the last step, up to 0.5 m/s and a tenth."""
    steps = [base() for _ in range(10)]
    found = made(corridor(*steps, base(v=(low, high))))
    end = 10.0 + (found * DT).sum(axis=1)
    slow = 0.5 + 0.1 * end
    assert len(found)
    assert ((end >= low - slow) & (end <= high + slow)).all()
    assert ((end < low) | (end > high)).any()


@pytest.mark.parametrize(("low", "high"), [(-5.0, 8.0), (11.5, 90.0)])
def test_what_leaves_the_places_of_the_corridor_by_far_is_left_out(low: float, high: float) -> None:
    steps = [base() for _ in range(10)]
    found = made(corridor(*steps, base(s=(3.0 + low, 3.0 + high))), s0=3.0)
    _, driven = driving(found)
    room = 0.5 + 0.1 * driven
    assert len(found)
    assert ((driven >= low - room) & (driven <= high + room)).all()
    assert ((driven < low) | (driven > high)).any()


def test_each_step_but_the_first_is_asked_of() -> None:
    """The first set is the state itself; already the second may be too narrow."""
    steps = [base() for _ in range(6)]
    free = made(corridor(*steps))
    steps[0] = base(s=(0.0, 0.0), v=(10.0, 10.0))
    assert np.array_equal(made(corridor(*steps)), free)
    steps[1] = base(v=(30.0, 40.0))
    assert made(corridor(*steps)).shape == (0, 5)
    steps[1] = base(s=(20.0, 30.0))
    assert made(corridor(*steps)).shape == (0, 5)


def test_brakings_that_are_too_strong_are_none() -> None:
    """4 m/s in 0.8 s would be 5 m/s^2; half of that is allowed, up to rounding."""
    found = made(wide(20, a=(-2.5, 1.0)), 4.0)
    assert found.min() >= -2.5 + MARGIN - 1e-6
    assert found.max() <= 1.0 - MARGIN + 1e-6


def test_the_highest_speed_may_be_driven() -> None:
    found = made(wide(5), 30.0)
    assert (found == 0.0).all(axis=1).any()


@pytest.mark.parametrize("order", [1, -1])
def test_a_change_to_or_from_the_only_input_of_some_steps(order: int) -> None:
    only, other = (-MARGIN, MARGIN), (1.0 - MARGIN, 2.0 + MARGIN)
    first, second = (only, other)[::order]
    share = 3 if order == 1 else 6
    steps = [base(a=first)] * share + [base(a=second)] * (11 - share)
    found = made(corridor(*steps))
    wanted = np.repeat([0.0, 1.0][::order], [share, 10 - share])
    assert (np.abs(found - wanted) < 1e-6).all(axis=1).any()


def test_two_steps_are_enough_to_aim() -> None:
    """2.03 m in 0.2 s with 10 m/s at both ends: 3 m/s^2 to either side would be an odd guess."""
    found = made(corridor(base(), base(), base(s=(2.03, 2.03), v=(10.0, 10.0))))
    assert (np.abs(found - [3.0, -3.0]) < 1e-6).all(axis=1).any()


def test_corners_of_a_round_set_are_aimed_at() -> None:
    """Of eight corners every other one."""
    turn = np.arange(8) * np.pi / 4
    ring = [(22.0 + 0.3 * np.cos(x), 10.0 + 0.3 * np.sin(x)) for x in turn.tolist()]
    last = replace(base(), lon=ring)
    found = made(corridor(*[base() for _ in range(20)], last))
    speed, driven = driving(found)

    def aimed(angle: float) -> bool:
        s, v = 22.0 + 0.24 * np.cos(angle), 10.0 + 0.24 * np.sin(angle)
        return bool(((np.abs(driven - s) < 1e-6) & (np.abs(speed[:, -1] - v) < 1e-6)).any())

    assert [aimed(x) for x in turn.tolist()] == [True, False] * 4
