"""Paths across the lane: where they aim, and that their derivatives are those of the path."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from corridors import base, corridor, wide
from reach_scenes import Course
from sandra.planning.sampling import (
    EDGE,
    Plans,
    Start,
    double_plans,
    intervals,
    motions,
    reference,
    simple_plans,
    targets,
)
from sandra.planning.tracking import advance

TAU = 0.1


def test_neighbouring_ranges_are_one() -> None:
    made = corridor(
        [
            base(d=(2.0, 3.0)),
            base(d=(-3.0, -1.0)),
            base(d=(-2.0, 0.5)),
            base(d=(0.5, 1.0)),
        ]
    )
    assert intervals(made, 0) == [(-3.0, 1.0), (2.0, 3.0)]
    assert intervals(corridor([base(d=(0.0, 5.0)), base(d=(1.0, 2.0))]), 0) == [(0.0, 5.0)]


def test_targets_are_the_wanted_ones_inside_and_spread_ones() -> None:
    made = corridor(base(d=(-1.0, 1.0)), [base(d=(-2.0, 2.0)), base(d=(4.0, 4.2))])
    found = targets(made, 1, (0.5, 3.0, -1.95, 0.5, 4.1), 3)
    # Spread ones keep `EDGE` from the ends, a quarter of it in a narrow range, and 0.1 m from
    # wanted ones.
    assert found == pytest.approx([-1.95, 0.5, 0.0, 2.0 - EDGE, 4.1])
    assert targets(made, 1, (), 3) == pytest.approx([-1.9, 0.0, 1.9, 4.05, 4.1, 4.15])


@pytest.mark.parametrize("edge", [-1.0, 1.0])
def test_a_wanted_offset_at_the_end_of_a_range_is_inside(edge: float) -> None:
    assert targets(wide(2), 2, (edge,), 1)[0] == edge
    assert edge * 1.001 not in targets(wide(2), 2, (edge * 1.001,), 1)


def test_simple_plans_move_once() -> None:
    plans = simple_plans(wide(20), 0.3, (0.0,), TAU)
    assert len(plans) == len(plans.first) == len(plans.duration)
    at_once = plans.second == 0.0
    # Half to twice the horizon of 2 s.
    assert set(np.round(plans.until[at_once], 9)) == {1.0, 1.5, 2.0, 3.0, 4.0}
    for aim in (0.0, 0.3, 0.15, 0.4, -0.4, -0.9, 0.9):
        assert np.isclose(plans.first[at_once], aim).any()
    later = ~at_once
    assert (plans.first[later] == 0.3).all()
    aims = plans.first[later] + plans.second[later]
    assert (np.abs(aims - 0.3) > 0.2).all()
    assert (np.abs(aims) <= 1.0).all()
    starts = {
        (round(b, 9), round(x, 9))
        for b, x in zip(plans.begin[later], plans.lasting[later], strict=True)
    }
    assert starts == {(0.4, 1.2), (0.8, 1.2), (1.0, 1.6)}
    assert plans.until[later] == pytest.approx(0.6)
    assert plans.duration[at_once] == pytest.approx(plans.until[at_once])
    assert plans.duration[later] == pytest.approx((plans.begin + plans.lasting)[later])


def test_double_plans_pass_through_a_range_in_between() -> None:
    steps = [base(d=(-4.0, 4.0)) for _ in range(21)]
    steps[10] = base(d=(2.0, 3.0))
    plans = double_plans(corridor(*steps), (0.0,), TAU)
    half = np.isclose(plans.until, 1.0)
    assert half.any()
    assert ((plans.first[half] >= 2.0) & (plans.first[half] <= 3.0)).all()
    ends = plans.first + plans.second
    assert (np.abs(ends) <= 4.0 + 1e-9).all()
    assert np.isclose(ends, 0.0).any()
    assert set(np.round(plans.until, 9)) == {0.6, 1.0, 1.4}
    # The second move begins when the first ends, or a little before, and ends after the horizon.
    share = plans.begin / plans.until
    assert set(np.round(share, 9)) == {0.7, 1.0}
    assert plans.begin + plans.lasting == pytest.approx(2.2)


def test_rows_of_plans() -> None:
    plans = Plans(*(np.arange(3.0) + 10 * i for i in range(5)))
    some = plans.rows(np.array([2, 2, 0]))
    assert some.first.tolist() == [2.0, 2.0, 0.0]
    assert some.lasting.tolist() == [42.0, 42.0, 40.0]
    assert len(some) == 3


def plans(
    first: float,
    until: float,
    second: float = 0.0,
    begin: float = 0.0,
    lasting: float = 1.0,
) -> Plans:
    return Plans(*(np.array([x]) for x in (first, until, second, begin, lasting)))


@pytest.mark.parametrize(
    "plan",
    [plans(1.5, 2.0), plans(-1.0, 1.0, 2.5, 0.8, 1.6), plans(0.5, 2.0, -1.0, 1.0, 2.0)],
)
@pytest.mark.parametrize("speed", [10.0, 4.0])
def test_a_path_starts_as_it_is_and_ends_parallel(plan: Plans, speed: float) -> None:
    scene = Course(step=5.0).scene()
    start = Start(50.0, 0.3, 0.1, 0.004, speed)
    n, tau = 600, 0.005
    found = motions(scene, start, np.full((1, n + 1), speed), tau, plan)
    gone = speed * tau * np.arange(n + 1)
    assert (found.d[0, 0], found.slope[0, 0], found.bend[0, 0]) == pytest.approx((0.3, 0.1, 0.004))
    # Derivatives by l, the distance driven.
    assert np.gradient(found.d[0], gone, edge_order=2) == pytest.approx(found.slope[0], abs=2e-3)
    assert np.gradient(found.slope[0], gone, edge_order=2)[2:-2] == pytest.approx(
        found.bend[0, 2:-2], abs=1e-2
    )
    first_ends = round(float(plan.until[0]) / tau)
    if plan.second[0] == 0.0:
        assert found.d[0, first_ends:] == pytest.approx(plan.first[0])
        assert found.slope[0, first_ends:] == pytest.approx(0.0, abs=1e-12)
        assert found.bend[0, first_ends:] == pytest.approx(0.0, abs=1e-12)
        assert abs(found.d[0, first_ends - 40] - plan.first[0]) > 1e-4
    over = round(float(plan.duration[0]) / tau)
    if over <= n:
        assert found.d[0, over:] == pytest.approx(plan.first[0] + plan.second[0])
        assert found.slope[0, over:] == pytest.approx(0.0, abs=1e-12)


@pytest.mark.parametrize("kappa", [0.0, 0.02, -0.02])
def test_samples_drive_with_their_speed_along_the_lane_and_across(kappa: float) -> None:
    """The distance between samples in the plane is what is driven in between."""
    scene = Course(kappa, step=0.25).scene()
    start = Start(40.0, 0.5, 0.05, 0.0, 8.0)
    tau, n = 0.02, 150
    speed = 8.0 - 1.5 * tau * np.arange(n + 1)[None]
    found = motions(scene, start, speed, tau, plans(-0.5, 2.5))
    acceleration = np.full((1, n), -1.5)
    track = reference(scene, found, acceleration)
    assert track.acceleration is acceleration
    moved = np.linalg.norm(np.diff(track.points[0], axis=0), axis=1)
    assert moved == pytest.approx((speed[0, 1:] + speed[0, :-1]) / 2 * tau, rel=3e-3)
    direction = np.diff(track.points[0], axis=0)
    course = np.arctan2(direction[:, 1], direction[:, 0])
    between = (track.course[0, 1:] + track.course[0, :-1]) / 2
    assert course == pytest.approx(between, abs=6e-3)
    assert found.along[0] == pytest.approx(np.gradient(found.s[0], tau), abs=0.05)
    assert found.s[0, 0] == 40.0


def test_a_move_goes_on_beyond_the_horizon_at_the_mean_speed() -> None:
    """A path that takes 4 s is half done after 2 s at constant speed."""
    scene = Course(step=5.0).scene()
    found = motions(
        scene,
        Start(50.0, 0.0, 0.0, 0.0, 5.0),
        np.full((1, 21), 5.0),
        TAU,
        plans(2.0, 4.0),
    )
    assert found.d[0, -1] == pytest.approx(1.0)
    # Braking to a standstill: 10 m in 2 s, a mean of 5 m/s, so the path is 20 m long.
    speed = np.linspace(10.0, 0.0, 21)[None]
    found = motions(scene, Start(50.0, 0.0, 0.0, 0.0, 10.0), speed, TAU, plans(2.0, 4.0))
    assert found.d[0, -1] == pytest.approx(1.0)


def test_times_between_samples_are_interpolated() -> None:
    """A path that ends after 1.05 s at 10 m/s is 10.5 m long."""
    scene = Course(step=5.0).scene()
    start = Start(50.0, 0.0, 0.0, 0.0, 10.0)
    found = motions(scene, start, np.full((1, 21), 10.0), TAU, plans(1.0, 1.05))
    x = 10.0 / 10.5
    assert found.d[0, 10] == pytest.approx(x**3 * (10 - 15 * x + 6 * x**2))
    assert found.d[0, 11] == 1.0


def test_paths_are_at_least_a_metre_long() -> None:
    scene = Course(step=5.0).scene()
    start = Start(50.0, 0.0, 0.0, 0.0, 0.1)
    speed = np.full((1, 21), 0.25)
    found = motions(scene, start, speed, TAU, plans(0.1, 0.4, 0.1, 0.4, 0.4))
    x = 0.5
    once = 0.1 * x**3 * (10 - 15 * x + 6 * x**2)
    y = 0.4
    twice = 0.1 * y**3 * (10 - 15 * y + 6 * y**2)
    assert found.d[0, -1] == pytest.approx(once + twice)


def test_too_steep_paths_are_cut_off_before_they_turn_back() -> None:
    scene = Course(step=5.0).scene()
    start = Start(50.0, 0.0, 0.0, 0.0, 1.0)
    found = motions(scene, start, np.full((1, 21), 1.0), TAU, plans(5.0, 0.5))
    assert found.slope.max() == 0.99
    assert np.isfinite(found.s).all()
    assert (np.diff(found.s) >= 0.0).all()


@pytest.mark.parametrize("kappa", [0.0, 0.02, -0.02])
@pytest.mark.parametrize("steering", [-0.05, 0.0, 0.08])
def test_the_start_is_the_state(kappa: float, steering: float) -> None:
    """d, d'(l), d''(l) against a drive over a few centimetres."""
    course = Course(kappa, step=0.25)
    scene = course.scene(speed=7.0, d=0.6, angle=0.07)
    state = replace(scene.ego.state, steering_angle=steering)
    scene = replace(scene, ego=replace(scene.ego, state=state))
    start = Start.of(scene)
    assert start.speed == 7.0
    assert (start.s, start.d) == pytest.approx(scene.ego_curvilinear[:2])

    def d_after(length: float) -> float:
        x = [state.x, state.y, state.heading, 7.0, steering]
        after = advance(x, (0.0, 0.0), length / 7.0, scene.ego.wheelbase)
        return float(scene.frame.to_curvilinear(np.array([after[:2]]))[0, 1])

    h = 0.4
    before, now, after = d_after(-h), d_after(0.0), d_after(h)
    assert start.slope == pytest.approx((after - before) / (2 * h), abs=1e-3)
    assert start.bend == pytest.approx((after - 2 * now + before) / h**2, abs=2e-3)


def test_at_the_thresholds() -> None:
    """A gap of a micrometre is none; 0.1 m from a wanted target is near; 0.2 m is no move."""
    assert intervals(corridor([base(d=(-1.0, 0.0)), base(d=(1e-6, 1.0))]), 0) == [(-1.0, 1.0)]
    assert targets(wide(2), 2, (0.1,), 3) == pytest.approx([0.1, -0.9, 0.9])
    plans = simple_plans(wide(20), 0.0, (0.2,), TAU)
    assert 0.2 in plans.first
    assert 0.2 not in plans.second
