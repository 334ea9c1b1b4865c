"""Collision and road checks at their thresholds, by bodies and blocks with round numbers."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from reach_scenes import Course
from sandra.planning.validity import (
    CLEARANCE,
    ROAD_MARGIN,
    ROUGH,
    SLIT,
    Occupied,
    Road,
    corners,
    deviation,
    separation,
)
from sandra.prediction import PredictedObstacle, Prediction
from sandra.scene.types import Ego, Region, Scene, State

EGO = Ego(1, State(0.0, 0.0, 0.0, 0.0), 4.5, 1.5, 2.6)
COURSE = Course(step=5.0)
STANDING = np.zeros((1, 3, 5))
NOTHING = np.zeros((1, 2, 2))


def predicted(*obstacles: list[tuple[Region, ...]], dt: float = 0.1) -> Prediction:
    """Each obstacle's regions by interval."""
    h = len(obstacles[0])
    nan = np.full((h + 1, 5), np.nan)
    found = tuple(
        PredictedObstacle(COURSE.car(7 + i, 99.0, 0.0), ((),) * (h + 1), tuple(x), nan)
        for i, x in enumerate(obstacles)
    )
    return Prediction("set-based", dt, h, found)


def block(x: float, y: float = 0.0, size: float = 1.0) -> Region:
    return Region.rectangle(size, size).placed(x, y, 0.0)


AHEAD = [(block(3.0),)] * 3
"""From x = 2.5 on: 0.25 m before the body's front."""


@pytest.mark.parametrize(("clearance", "free"), [(0.2499, True), (0.25, False), (0.2501, False)])
def test_free_is_more_than_the_clearance_away(clearance: float, free: bool) -> None:
    found = Occupied.of(predicted(AHEAD)).free(STANDING, NOTHING, 0.1, EGO, clearance=clearance)
    assert found.tolist() == [free]


def test_gaps_are_distances_up_to_a_bound() -> None:
    around = Occupied.of(predicted([(block(3.0), block(0.0, 6.0)), (), (block(0.0, -4.0),)]))
    states, inputs = np.zeros((1, 4, 5)), np.zeros((1, 3, 2))
    assert around.gaps(states, inputs, 0.1, EGO).tolist() == [[0.25, 5.0, 2.75]]
    assert around.gaps(states, inputs, 0.1, EGO, within=1.0).tolist() == [[0.25, 1.0, 1.0]]
    assert around.free(states, inputs, 0.1, EGO).tolist() == [True]
    # A radius comes off; two trajectories are each for itself.
    disc = Occupied.of(predicted([(Region(np.array([[0.0, 2.0]]), 1.0),)]))
    two = np.zeros((2, 2, 5))
    two[1, :, 1] = -2.0
    assert disc.gaps(two, np.zeros((2, 1, 2)), 0.1, EGO).tolist() == [[0.25], [2.25]]


@pytest.mark.parametrize(("start", "fits"), [(-0.1, False), (0.0, True), (0.1, True), (0.2, False)])
def test_a_trajectory_is_within_the_prediction(start: float, fits: bool) -> None:
    """Two steps of three that are predicted."""
    around = Occupied.of(predicted(AHEAD))
    if fits:
        assert around.gaps(STANDING, NOTHING, 0.1, EGO, start=start).shape == (1, 2)
        return
    with pytest.raises(ValueError, match="longer than the prediction"):
        around.gaps(STANDING, NOTHING, 0.1, EGO, start=start)


def test_no_step_meets_nobody() -> None:
    around = Occupied.of(predicted(AHEAD))
    assert around.gaps(np.zeros((1, 1, 5)), np.zeros((1, 0, 2)), 0.1, EGO, 9.0).shape == (1, 0)


def test_grid_points_begin_the_interval_after_them() -> None:
    """Three fine steps for each interval, also where 3 x 0.1 / 3 is not 0.1 in the computer."""
    for k in range(3):
        regions: list[tuple[Region, ...]] = [(), (), ()]
        regions[k] = (block(3.0),)
        around = Occupied.of(predicted(regions))
        found = around.gaps(np.zeros((1, 10, 5)), np.zeros((1, 9, 2)), 0.1 / 3, EGO)[0]
        assert np.flatnonzero(found < 1.0).tolist() == [3 * k, 3 * k + 1, 3 * k + 2]


def test_who_is_nearest_and_when() -> None:
    around = Occupied.of(
        predicted([(block(3.5),), (block(3.5),)], [(block(9.0),), (block(0.0, 2.0),)])
    )
    states, inputs = np.zeros((1, 3, 5)), np.zeros((1, 2, 2))
    assert around.nearest(states, inputs, 0.1, EGO) == (0, 0.0)  # 0.75 m at first
    near = Occupied.of(predicted([(block(3.5),)] * 2, [(block(9.0),), (block(0.0, 1.5),)]))
    assert near.nearest(states, inputs, 0.1, EGO) == (1, 0.1)
    far = Occupied.of(predicted([(block(30.0),)] * 2))
    assert far.nearest(states, inputs, 0.1, EGO) is None
    assert around.nearest(states[:, :2], inputs[:, :1], 0.1, EGO, start=0.1) == (0, 0.1)


def test_regions_of_different_corners_in_one_array() -> None:
    triangle = Region(np.array([[5.0, 0.0], [6.0, -1.0], [6.0, 1.0]]))
    around = Occupied.of(predicted([(triangle, block(-4.0)), (Region(np.zeros((1, 2)), 0.5),)]))
    assert around.horizon == 2
    assert around.first.tolist() == [0, 2, 3]
    assert around.owner.tolist() == [0, 0, 0]
    assert around.vertices.shape == (3, 4, 2)
    assert around.vertices[0, 3].tolist() == [6.0, 1.0]
    assert around.radius.tolist() == [0.0, 0.0, 0.5]
    assert around.middle.tolist() == [[5.5, 0.0], [-4.0, 0.0], [0.0, 0.0]]
    assert around.reach == pytest.approx([np.hypot(0.5, 1.0), np.hypot(0.5, 0.5), 0.5])


def test_corners_go_round_to_the_left_from_the_rear_right() -> None:
    body = corners(np.array([10.0, 5.0, np.pi / 2, 0.0, 0.0]), EGO)
    assert body == pytest.approx(
        np.array([[10.75, 2.75], [10.75, 7.25], [9.25, 7.25], [9.25, 2.75]])
    )


def test_deviation_of_closed_forms() -> None:
    """Braking straight on: |a| tau^2 / 8. In a steady turn: v^2/R + r v^2/R^2 more."""
    states, inputs = np.zeros((1, 2, 5)), np.array([[[-4.0, 0.0]]])
    states[0, :, 3] = 10.0, 9.6
    assert deviation(states, inputs, 0.1, EGO)[0, 0] == pytest.approx(4.0 * 0.01 / 8)
    beta = 0.1
    states[0, :, 3], states[0, :, 4] = 10.0, np.arctan(2 * np.tan(beta))
    turn = 2 * 10.0 * np.sin(beta) / 2.6
    radius = np.hypot(4.5, 1.5) / 2
    found = deviation(states, np.zeros((1, 1, 2)), 0.1, EGO)[0, 0]
    assert found == pytest.approx((10.0 * turn + radius * turn**2) * 0.01 / 8)
    # Steering while going straight: beta' is half of the steering rate.
    states[0, :, 4] = 0.0
    found = deviation(states, np.array([[[0.0, 0.4]]]), 0.1, EGO)[0, 0]
    assert found == pytest.approx((10.0 * 0.2 + radius * 2 * 10.0 * 0.2 / 2.6) * 0.01 / 8)
    # The larger of both ends counts, whatever its sign; and the wheel turned makes beta' larger.
    for ends in ((0.0, -0.3), (-0.3, 0.0), (0.3, 0.1)):
        states[0, :, 4] = ends
        beta, squared = np.arctan(np.tan(0.3) / 2), np.tan(0.3) ** 2
        rate = 0.4 * 2 * (1 + squared) / (4 + squared)
        turn = 20.0 * np.sin(beta) / 2.6
        angular = 2 * (3.0 * np.sin(beta) + 10.0 * rate) / 2.6
        expected = 3.0 + 10.0 * (turn + rate) + radius * (angular + turn**2)
        found = deviation(states, np.array([[[3.0, -0.4]]]), 0.1, EGO)[0, 0]
        assert found == pytest.approx(expected * 0.01 / 8)


def test_separation_of_a_body_and_points_around_it() -> None:
    """Abeam and ahead it is the distance; off a corner it is the one to the corner."""
    body = corners(np.zeros((1, 2, 5)), EGO).reshape(1, 8, 2)
    for (x, y), away in (
        ((3.25, 0.0), 1.0),
        ((-4.25, 0.5), 2.0),
        ((0.0, 1.75), 1.0),
        ((1.0, -2.75), 2.0),
        ((5.25, 4.75), 5.0),
        ((-6.25, -3.75), 5.0),
    ):
        points = np.tile([x, y], (1, 3, 1))
        assert separation(body, points)[0] == pytest.approx(away)
    assert separation(body, np.zeros((1, 2, 2)))[0] == pytest.approx(-0.75)


# The road: d from -1.75 to 5.25, x from -40 to 160.


def two_lanes(gap: float = 0.0) -> Scene:
    lanes = [
        COURSE.lane("current", 100, -1.75, 1.75),
        COURSE.lane("left", 101, 1.75 + gap, 5.25),
    ]
    scene = COURSE.scene(lanes)
    return replace(scene, ego=replace(EGO, state=State(0.0, 0.0, 0.0, 0.0)))


def at(x: float, d: float) -> np.ndarray:
    states = np.zeros((1, 2, 5))
    states[..., 0], states[..., 1] = x, d
    return states


@pytest.mark.parametrize("allowed", [0.01, 0.03])
def test_the_border_with_the_margin_and_what_bodies_deviate(allowed: float) -> None:
    road = Road.of(two_lanes(), allowed=allowed)
    least = ROAD_MARGIN + allowed
    for inside, expected in ((least + 1e-3, True), (least - 1e-3, False)):
        for x, d in (
            (0.0, -1.0 + inside),
            (0.0, 4.5 - inside),
            (-37.75 + inside, 0.0),
            (157.75 - inside, 0.0),
        ):
            assert road.holds(at(x, d), np.zeros((1, 1, 2)), 0.1, EGO)[0] == expected


def test_samples_may_leave_it_by_a_little() -> None:
    road = Road.of(two_lanes())
    for over, expected in ((ROUGH - 1e-3, True), (ROUGH + 1e-3, False)):
        assert road.may_hold(at(0.0, -1.0 - over), EGO)[0] == expected
        assert road.may_hold(at(0.0, 4.5 + over), EGO)[0] == expected
    both = np.concatenate([at(0.0, 0.0), at(0.0, -3.0)])
    assert road.may_hold(both, EGO).tolist() == [True, False]
    both[0, 1, 1] = -3.0
    assert not road.may_hold(both, EGO).any()


@pytest.mark.parametrize(("gap", "closed"), [(1.9 * SLIT, True), (2.1 * SLIT, False)])
def test_slits_between_lanelets(gap: float, closed: bool) -> None:
    road = Road.of(two_lanes(gap))
    assert road.holds(at(0.0, 1.75), np.zeros((1, 1, 2)), 0.1, EGO)[0] == closed


def test_bodies_that_deviate_more_than_the_road_allows() -> None:
    states, inputs = at(0.0, 0.0), np.array([[[-4.0, 0.0]]])
    off = float(deviation(states, inputs, 0.1, EGO)[0, 0])
    for allowed, expected in ((off, True), (0.999 * off, False)):
        road = Road.of(two_lanes(), allowed=allowed)
        assert road.holds(states, inputs, 0.1, EGO)[0] == expected


def test_between_two_grid_points_the_body_cuts_the_corner() -> None:
    """Both bodies are on an L of two lanes; the way from one to the other is not."""
    along = COURSE.lane("current", 100, -1.75, 1.75, start=-40.0, end=40.0)
    up = replace(
        COURSE.lane("left", 101, -1.75, 1.75),
        left=np.array([[36.0, -1.75], [36.0, 40.0]]),
        right=np.array([[40.0, -1.75], [40.0, 40.0]]),
    )
    scene = COURSE.scene([along, up])
    road = Road.of(scene)
    states = np.zeros((1, 2, 5))
    states[0, 0, :3] = 30.0, 0.0, 0.0
    states[0, 1, :3] = 38.0, 8.0, np.pi / 2
    assert road.may_hold(states, EGO)[0]
    assert not road.holds(states, np.zeros((1, 1, 2)), 0.1, EGO)[0]
    for k in (0, 1):
        one = np.repeat(states[:, k : k + 1], 2, axis=1)
        assert road.holds(one, np.zeros((1, 1, 2)), 0.1, EGO)[0]


def test_the_road_is_looked_at_near_the_ego_only() -> None:
    road = Road.of(two_lanes(), reach=30.0)
    assert road.holds(at(20.0, 0.0), np.zeros((1, 1, 2)), 0.1, EGO)[0]
    assert not road.holds(at(28.0, 0.0), np.zeros((1, 1, 2)), 0.1, EGO)[0]
    assert not road.holds(at(-28.0, 0.0), np.zeros((1, 1, 2)), 0.1, EGO)[0]
    assert CLEARANCE == 0.02


def test_a_difference_that_is_too_short_is_no_direction(monkeypatch: pytest.MonkeyPatch) -> None:
    """Off a corner by 3 and 4 m only the direction to it separates by 5 m; edges are shorter."""
    body = corners(np.zeros((1, 2, 5)), EGO).reshape(1, 8, 2)
    points = np.tile([5.25, 4.75], (1, 3, 1))
    for shortest, away in ((5.0, -np.inf), (float(np.nextafter(5.0, 0.0)), 5.0)):
        monkeypatch.setattr("sandra.planning.validity.SHORTEST_AXIS", shortest)
        assert separation(body, points)[0] == away
