"""Candidates: which samples are inside, what they aim at, and how their bodies move."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from corridors import base, corridor, wide
from reach_scenes import Course, prediction
from sandra.actions import Lateral
from sandra.planning.candidates import FIRST, TOO_MUCH, Sampler
from sandra.planning.cost import Weights
from sandra.planning.sampling import STEEPEST, motions, simple_plans
from sandra.reach import ground
from sandra.reach.sets import ReachableSet
from sandra.scene.types import Scene
from sandra.settings import Settings

HORIZON = 8
CENTRE = Weights(jerk=0.0, lateral=0.0, speed=0.0, change=0.0)
"""Only the distance to the wanted lane's centre costs."""


def sampler(
    where: ReachableSet | None = None,
    scene: Scene | None = None,
    lateral: Lateral = Lateral.FOLLOW_LANE,
    weights: Weights = CENTRE,
) -> Sampler:
    scene = Course(step=5.0).scene() if scene is None else scene
    where = wide(HORIZON) if where is None else where
    on = ground(scene, prediction(scene, where.horizon), Settings(horizon=where.horizon))
    return Sampler(on, where, lateral, weights, Counter())


def moving(s: float, d: float) -> tuple[np.ndarray, np.ndarray]:
    return np.full((1, HORIZON + 1), s), np.full((1, HORIZON + 1), d)


@pytest.mark.parametrize(
    ("s", "d", "expected"),
    [
        (20.0, 0.5, True),
        (10.0, 0.5, True),
        (30.0, 0.5, True),
        (20.0, -1.0, True),
        (20.0, 2.0, True),
        (9.999, 0.5, False),
        (30.001, 0.5, False),
        (20.0, -1.001, False),
        (20.0, 2.001, False),
        (np.nan, 0.5, False),
    ],
)
def test_inside_is_within_closed_rectangles(s: float, d: float, expected: bool) -> None:
    found = sampler(wide(HORIZON, s=(10.0, 30.0), d=(-1.0, 2.0)))
    answer = found.inside(*moving(s, d), 0.0)
    assert answer.tolist() == [expected]
    assert answer.dtype == np.bool_
    assert found.inside(*moving(s, d), 0.01)[0] == (not np.isnan(s))


def test_inside_at_every_step_but_the_first() -> None:
    found = sampler(wide(HORIZON, s=(10.0, 30.0)))
    s, d = moving(20.0, 0.0)
    for k in range(HORIZON + 1):
        away = s.copy()
        away[0, k] = 50.0
        # The first is the initial state: nothing can be changed about it.
        assert found.inside(away, d, 0.0)[0] == (k == 0)


def test_inside_any_of_several_rectangles_each_for_itself() -> None:
    two = [base(s=(0.0, 10.0), d=(0.0, 1.0)), base(s=(20.0, 30.0), d=(2.0, 3.0))]
    found = sampler(corridor(*[two] * (HORIZON + 1)))
    s = np.array([5.0, 25.0, 5.0, 15.0])[:, None] + np.zeros(HORIZON + 1)
    d = np.array([0.5, 2.5, 2.5, 0.5])[:, None] + np.zeros(HORIZON + 1)
    assert found.inside(s, d, 0.0).tolist() == [True, True, False, False]


def test_the_wanted_centre_is_that_of_the_lane_that_is_aimed_at() -> None:
    course = Course(step=5.0)
    scene = course.scene(
        [
            course.lane("current", 100, -1.75, 1.75),
            # The left lane moves away: its centre is at d = 3 + 0.05 s.
            course.lane("left", 101, 1.75, lambda s: 4.25 + 0.1 * (s + 40.0)),
            course.lane("right", 99, -4.75, -1.75),
        ]
    )
    place = wide(HORIZON, s=(60.0, 80.0))
    expected = {
        Lateral.FOLLOW_LANE: 0.0,
        Lateral.LEFT_LANE: 6.5,
        Lateral.RIGHT_LANE: -3.25,
    }
    for lateral, d in expected.items():
        assert sampler(place, scene, lateral)._centre == pytest.approx(d, abs=1e-6)


def test_a_lane_that_is_not_there_has_no_centre() -> None:
    scene = Course(step=5.0).scene(Course(step=5.0).lanes(left=0, right=0))
    assert sampler(scene=scene, lateral=Lateral.LEFT_LANE)._centre == 0.0


def test_stages() -> None:
    found = sampler(wide(20, a=(-4.0, 4.0)))
    assert found.stages == 3
    assert len(found.accelerations) > FIRST
    first, second, third = (found.stage(i) for i in range(3))
    assert (first.profile < FIRST).all()
    assert second.profile.max() < len(found.accelerations) - FIRST
    for at, accelerations in (
        (first, found.accelerations[:FIRST]),
        (second, found.accelerations[FIRST:]),
        (third, found.accelerations),
    ):
        assert len(at) > 10
        assert np.array_equal(at.acceleration, accelerations[at.profile])
        assert (np.diff(at.cost) >= 0.0).all()
        assert len(at.cost) == len(at.motion.s) == len(at.plans) == len(at.profile)
        again = motions(found.ground.scene, found.start, at.motion.speed, 0.1, at.plans)
        assert again.d == pytest.approx(at.motion.d)
    # One move, or, in the last stage, two: away from the middle and on.
    assert (first.plans.first[first.plans.second != 0.0] == 0.0).all()
    assert (third.plans.first[third.plans.second != 0.0] != 0.0).any()


def test_no_profile_no_stage() -> None:
    assert sampler(wide(HORIZON, a=(7.0, 8.0))).stages == 0


@pytest.mark.parametrize("speed", [4.0, 10.0, 20.0])
@pytest.mark.parametrize("wide_by", [0.3, 3.0])
@pytest.mark.parametrize("kappa", [0.0, 0.008])
def test_samples_left_out_are_counted(speed: float, wide_by: float, kappa: float) -> None:
    """Too steep or too sharp by definition; then those outside; each once."""
    scene = Course(kappa).scene(speed=speed)
    found = sampler(wide(HORIZON, d=(-wide_by, wide_by)), scene)
    at = found.stage(0)
    plans = simple_plans(found.corridor, 0.0, (0.0,), 0.1)
    accelerations = np.repeat(found.accelerations[:FIRST], len(plans), axis=0)
    row = np.tile(np.arange(len(plans)), len(accelerations) // len(plans))
    speeds = np.column_stack(
        [np.full(len(row), speed), speed + 0.1 * np.cumsum(accelerations, axis=1)]
    )
    every = motions(scene, found.start, np.maximum(speeds, 0.0), 0.1, plans.rows(row))
    steep = (np.abs(every.slope) > STEEPEST).any(axis=1)
    turning = every.bend + scene.frame.curvature(every.s)
    sharp = (np.abs(every.speed**2 * turning)[:, 1:] > TOO_MUCH * 4.0).any(axis=1)
    outside = (np.abs(every.d[:, 1:]) > wide_by + 0.02).any(axis=1)
    assert found.counts["limits"] == (steep | sharp).sum()
    assert found.counts["corridor"] == (outside & ~(steep | sharp)).sum()
    assert len(at) == (~outside & ~steep & ~sharp).sum() > 0
    if wide_by > 1.0:
        assert (steep if speed < 5.0 else sharp).any()


def test_a_bend_takes_its_part_of_the_lateral_acceleration() -> None:
    """20 m/s on a curvature of 0.02: 8 m/s^2, whatever the path does across the lane."""
    scene = Course(0.02).scene(speed=20.0)
    found = sampler(wide(HORIZON, a=(-0.1, 0.1)), scene)
    assert len(found.stage(0)) == 0
    assert found.counts["corridor"] == 0


def test_the_cheapest_first() -> None:
    """The middle of the lane is wanted: from 0.5 m beside it, the best ends nearest to it."""
    scene = Course(step=5.0).scene(d=0.5)
    at = sampler(scene=scene).stage(0)
    cost = 4.0 * np.abs(at.motion.d[:, 4:]).mean(axis=1) ** 2
    assert at.cost == pytest.approx(cost)
    assert at.cost[-1] > at.cost[0]


@pytest.mark.parametrize(
    ("weights", "limit", "wanted"),
    [
        (Weights(), 12.0, 12.0),
        (Weights(), None, 10.0),
        (Weights(faster=1.5), 12.0, 13.5),
        (Weights(faster=-20.0), 12.0, 0.0),
        (Weights(desired_speed=9.5), 12.0, 9.5),
    ],
)
def test_the_desired_speed(weights: Weights, limit: float | None, wanted: float) -> None:
    """The limit, else the present speed, or what is wanted; never backwards."""
    only = replace(CENTRE, centre=0.0, speed=5.0)
    weights = replace(only, desired_speed=weights.desired_speed, faster=weights.faster)
    course = Course(step=5.0)
    scene = course.scene(course.lanes(limit=limit), speed=10.0)
    at = sampler(wide(HORIZON), scene, weights=weights).stage(0)
    assert at.cost == pytest.approx(np.abs(at.motion.speed - wanted).mean(axis=1))


def test_profiles_come_in_the_order_of_their_cost() -> None:
    only = replace(CENTRE, centre=0.0, speed=5.0, desired_speed=30.0)
    found = sampler(wide(HORIZON), weights=only).accelerations
    gained = np.cumsum(found, axis=1).sum(axis=1)
    assert (np.diff(gained) <= 1e-6).all()
    assert found[0] == pytest.approx(6.0, abs=0.01)


@pytest.mark.parametrize("heading", [0.0, 0.2])
def test_bodies_follow_the_course(heading: float) -> None:
    """Their heading against theta' = 2 v sin(course - theta) / wheelbase, by a solver."""
    scene = Course(step=5.0).scene(speed=8.0, angle=heading)
    found = sampler(wide(HORIZON, d=(-3.0, 3.0)), scene)
    at = found.stage(0)
    rows = np.array([0, len(at) // 2, len(at) - 1])
    bodies = found.bodies(at, rows)
    assert bodies.shape == (3, HORIZON + 1, 5)
    assert (bodies[:, 0, 2] == heading).all()
    dt = scene.dt
    for body, row in zip(bodies, rows, strict=True):
        assert body[:, :2] == pytest.approx(
            scene.frame.to_cartesian(np.column_stack([at.motion.s[row], at.motion.d[row]]))
        )
        course = np.arcsin(at.motion.slope[row])
        times = dt * np.arange(HORIZON + 1)

        def turning(
            t: float,
            theta: np.ndarray,
            row: int = row,
            course: np.ndarray = course,
            times: np.ndarray = times,
        ) -> np.ndarray:
            v = np.interp(t, times, at.motion.speed[row])
            return 2 * v * np.sin(np.interp(t, times, course) - theta) / scene.ego.wheelbase

        answer = solve_ivp(turning, (0.0, times[-1]), [heading], t_eval=times, max_step=0.02)
        assert body[:, 2] == pytest.approx(answer.y[0], abs=0.02)


def test_a_reference_is_the_sample_at_finer_times() -> None:
    scene = Course(0.01).scene(speed=8.0)
    found = sampler(wide(HORIZON, d=(-3.0, 3.0)), scene)
    at = found.stage(0)
    for index in (0, len(at) - 1):
        fine = found.reference(at, index, 0.05, 2)
        assert fine.points.shape == (1, 2 * HORIZON + 1, 2)
        assert fine.acceleration[0].tolist() == np.repeat(at.acceleration[index], 2).tolist()
        coarse = found.bodies(at, np.array([index]))[0, :, :2]
        assert fine.points[0, ::2] == pytest.approx(coarse, abs=0.02)


def test_a_standstill_is_exact() -> None:
    """What rounding leaves of the speed is nothing, to both sides."""
    scene = Course(step=5.0).scene(speed=0.3)
    found = sampler(wide(HORIZON), scene)
    speed = found._speeds(np.array([[-0.1] * 30, [-3.0, 0.0] + [0.0] * 28]), 0.1)
    assert speed[0, -1] == 0.0
    assert speed[1, 1:].tolist() == [0.0] * 30
    assert speed[:, 0].tolist() == [0.3, 0.3]
    assert found._speeds(np.array([[-1.0]]), 0.1)[0].tolist() == pytest.approx([0.3, 0.2])


def test_headings_may_be_wound() -> None:
    """On a road along -x, with the heading of the state a turn away."""
    scene = Course(step=5.0, angle=np.pi).scene(speed=8.0)
    for turns in (-1, 0, 1):
        state = replace(scene.ego.state, heading=np.pi + 0.1 + 2 * np.pi * turns)
        found = sampler(scene=replace(scene, ego=replace(scene.ego, state=state)))
        at = found.stage(0)
        heading = found.bodies(at, np.array([0]))[0, :, 2]
        assert heading[0] == state.heading
        assert np.cos(heading[1:] - np.pi).min() > 0.99
