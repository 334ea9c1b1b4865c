"""Formulas of geometry and motion, against the same worked out one number at a time."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import shapely

from certified import WHEELBASE, constant, drive, made
from sandra.certificate import Checked, Violation, geometry, motion
from sandra.certificate.geometry import Reference, bodies, convex, corners, outline, pavement, sweep
from sandra.certificate.motion import _quadrature, _within, highest_lateral
from sandra.certificate.place import OWN, conflict_area, road
from sandra.certificate.types import Body, LaneOf, Pavement
from sandra.planning.types import Trajectory
from sandra.scene.types import Region

BASE = made()
BODY = Body(1, 4.5, 1.8, WHEELBASE)
RNG = np.random.default_rng(11)


# The sweep


def margin(t: Trajectory, i: int, body: Body) -> float:
    """How far the body may be outside the hull of its two ends, from the bounds of p''."""
    (v0, delta0), (v1, delta1) = np.abs(t.states[i : i + 2, 3:])
    a, w = np.abs(t.inputs[i])
    v, delta = max(v0, v1), max(delta0, delta1)
    beta = math.atan(math.tan(delta) / 2)
    beta_rate = w * 2 / (1 + 3 * math.cos(delta) ** 2)
    theta_rate = 2 * v * math.sin(beta) / body.wheelbase
    theta_second = 2 * (a * math.sin(beta) + v * beta_rate) / body.wheelbase
    c_second = a + v * (theta_rate + beta_rate)
    half_diagonal = math.sqrt(body.length**2 + body.width**2) / 2
    bound = c_second + half_diagonal * (theta_second + theta_rate**2)
    return t.tau**2 / 8 * bound + math.sqrt(2) * 1e-6 + half_diagonal * 1e-7


@pytest.mark.parametrize("body", [BODY, Body(2, 12.0, 2.5, 6.0)])
@pytest.mark.parametrize("tau", [0.05, 0.02])
def test_the_margin_of_the_sweep(body: Body, tau: float) -> None:
    for _ in range(5):
        states = np.column_stack(
            [RNG.uniform(-9, 9, (9, 3)), RNG.uniform(0, 30, 9), RNG.uniform(-1, 1, 9)]
        )
        inputs = np.column_stack([RNG.uniform(-6, 6, 8), RNG.uniform(-0.4, 0.4, 8)])
        t = Trajectory(states, inputs, tau)
        expected = [margin(t, i, body) for i in range(8)]
        assert sweep(t, body).margins == pytest.approx(expected, rel=1e-12)


def test_the_slip_angle_turns_as_the_bound_says() -> None:
    """beta = atan(tan(delta) / 2), differentiated by small steps."""
    for delta in (0.0, 0.3, 0.9, 1.2):
        slope = (
            math.atan(math.tan(delta + 1e-6) / 2) - math.atan(math.tan(delta - 1e-6) / 2)
        ) / 2e-6
        assert slope == pytest.approx(2 / (1 + 3 * math.cos(delta) ** 2), rel=1e-6)


def test_the_hull_holds_both_ends_and_no_more() -> None:
    t = drive([1.0, 2.0, 0.5, 10.0, 0.0], constant(0.0, 3))
    for i, hull in enumerate(sweep(t, BODY).hulls):
        ends = shapely.convex_hull(shapely.union_all(bodies(t.states[i : i + 2], BODY)))
        assert shapely.area(shapely.symmetric_difference(hull, ends)) < 1e-9


def test_the_corners_of_a_body() -> None:
    states = np.array([[1.0, 2.0, 0.0, 9.0, 9.0], [1.0, 2.0, math.pi / 2, 9.0, 9.0]])
    front_left, rear_left = [3.25, 2.9], [-1.25, 2.9]
    rear_right, front_right = [-1.25, 1.1], [3.25, 1.1]
    found = corners(states, BODY)
    assert found[0] == pytest.approx(np.array([front_left, rear_left, rear_right, front_right]))
    assert found[1][0] == pytest.approx([0.1, 4.25])
    assert found[1][2] == pytest.approx([1.9, -0.25])


# Shapes


def test_no_regions_are_no_shapes() -> None:
    shapes, radii = convex([])
    assert shapes.dtype == object
    assert (len(shapes), len(radii)) == (0, 0)


def test_hulls_of_regions_and_their_radii() -> None:
    several = [Region(np.array([[1.0, 2.0]]), 0.5), Region.rectangle(4.0, 2.0), Region.disc(3.0)]
    shapes, radii = convex(several)
    assert [x.geom_type for x in shapes] == ["Point", "Polygon", "Point"]
    assert shapely.area(shapes).tolist() == [0.0, 8.0, 0.0]
    assert radii.tolist() == [0.5, 0.0, 3.0]


def strip(number: int, low: float, high: float, x0: float = 0.0, x1: float = 10.0) -> Pavement:
    ends = np.array([x0, x1])
    left, right = (np.column_stack([ends, np.full(2, y)]) for y in (high, low))
    return Pavement(number, left, right, None)


def test_slits_of_the_road_up_to_10_cm_are_closed() -> None:
    for slit, parts in ((0.0999, 1), (0.1001, 2)):
        area = pavement([strip(1, 0.0, 3.0), strip(2, 3.0 + slit, 6.0)])
        assert len(shapely.get_parts(area)) == parts
        # The outer border stays in place, with its corners.
        assert shapely.bounds(area) == pytest.approx([0.0, 0.0, 10.0, 6.0])
        assert shapely.area(area) == pytest.approx(60.0 - (0.0 if parts == 1 else 10 * slit))


def test_an_inner_corner_of_the_road_stays_sharp() -> None:
    lying, standing = strip(1, 0.0, 3.0), strip(2, 3.0, 9.0, 0.0, 3.0)
    area = pavement([lying, standing])
    assert shapely.area(area) == pytest.approx(30.0 + 18.0, abs=1e-9)


def test_the_border_of_a_lanelet_runs_there_and_back() -> None:
    area = outline(strip(1, 1.0, 4.0, 2.0, 7.0))
    assert shapely.bounds(area).tolist() == [2.0, 1.0, 7.0, 4.0]
    assert shapely.area(area) == 15.0


# The reference line


CORNER = Reference.of(np.array([[0.0, 0.0], [10.0, 0.0], [10.0, 10.0]]))


def test_the_direction_of_the_line_is_taken_over_half_a_metre() -> None:
    diagonal = np.array([1.0, 1.0]) / math.sqrt(2)
    found = CORNER.direction(np.array([9.74, 9.85, 10.0, 10.26]))
    # 0.15 m from the corner the chord goes 0.4 m along x and 0.1 m along y.
    chord = np.array([0.4, 0.1]) / math.hypot(0.4, 0.1)
    assert found == pytest.approx(np.array([[1.0, 0.0], chord, diagonal, [0.0, 1.0]]))


def test_a_line_that_turns_back_has_a_direction_all_the_same() -> None:
    back = Reference.of(np.array([[0.0, 0.0], [10.0, 0.0], [0.0, 0.0]]))
    found = back.direction(np.array([9.0, 10.0, 11.0]))
    assert found == pytest.approx(np.array([[1.0, 0.0], [0.0, 0.0], [-1.0, 0.0]]))


@pytest.mark.parametrize("turn", [0.4, 1.9, 2.9, -0.5, -1.2, -2.6])
def test_left_of_a_slanted_line_is_positive(turn: float) -> None:
    cosine, sine = math.cos(turn), math.sin(turn)
    along, left = np.array([cosine, sine]), np.array([-sine, cosine])
    begin = np.array([3.0, -7.0])
    line = Reference.of(np.array([begin, begin + 20.0 * along]))
    places = np.array([(s, d) for s in (-6.0, 4.0, 30.0) for d in (-5.0, -0.25, 0.75, 6.0)])
    points = begin + places[:, :1] * along + places[:, 1:] * left
    assert line.along(points) == pytest.approx(places[:, 0])
    assert line.across(points) == pytest.approx(places[:, 1])
    assert line.direction(places[:, 0]) == pytest.approx(np.tile(along, (12, 1)))


def test_the_line_goes_on_for_a_kilometre() -> None:
    points = np.array([[-1500.0, 0.0], [-999.0, 4.0], [10.0, 1009.0], [10.0, 1500.0]])
    assert CORNER.along(points) == pytest.approx([-1000.0, -999.0, 1019.0, 1020.0])
    # Beyond its end the distance is that to the end.
    assert CORNER.across(points[1:3]) == pytest.approx([4.0, 0.0])


def test_points_of_the_line_that_repeat_are_left_out() -> None:
    twice = Reference.of(np.array([[0.0, 0.0], [0.0, 0.0], [5.0, 0.0], [5.0, 0.0], [5.0, 5.0]]))
    once = Reference.of(np.array([[0.0, 0.0], [5.0, 0.0], [5.0, 5.0]]))
    assert shapely.equals_exact(twice.line, once.line)
    assert shapely.length(once.line) == pytest.approx(2010.0)


# Motion


def test_weights_integrate_polynomials() -> None:
    nodes, weights, inner = _quadrature()
    for power in range(8):
        assert weights @ nodes**power == pytest.approx(1 / (power + 1))
        assert inner @ nodes**power == pytest.approx(nodes ** (power + 1) / (power + 1))


@pytest.mark.parametrize(
    ("column", "tolerance"), [(0, 1e-6), (1, 1e-6), (2, 1e-7), (3, 1e-8), (4, 1e-8)]
)
def test_a_state_may_be_off_by_its_tolerance(column: int, tolerance: float) -> None:
    for name in ("witness", "fail_safe"):
        t = Trajectory(np.zeros((4, 5)), np.zeros((3, 2)), 0.05, 0.1)
        c = replace(BASE, witness=t, fail_safe=t)
        for size in (0.99, -0.99):
            states = np.zeros((4, 5))
            states[3, column] = size * tolerance
            answer = motion.motion(replace(c, **{name: replace(t, states=states)}))
            assert isinstance(answer, Checked)
            assert answer.margin == pytest.approx(0.01)
            assert answer.sentence == "at most 99 % of the tolerance used"
        states[3, column] = 1.01 * tolerance
        answer = motion.motion(replace(c, **{name: replace(t, states=states)}))
        assert isinstance(answer, Violation)
        assert (answer.step, answer.allowed) == (2, tolerance)
        assert answer.measured == pytest.approx(1.01 * tolerance)
        assert answer.time == pytest.approx(0.25)


def within(first: list[float], second: list[float]) -> Any:
    return _within(BASE, "some-value", "m", -2.0, 5.0, [np.array(first), np.array(second)])


def test_values_within_bounds() -> None:
    for first, second, margin, largest in (
        ([1.0, 4.5], [0.0], 0.5, "4.5"),
        ([0.0], [1.0, -1.75], 0.25, "1.75"),
        ([-1.5], [4.0, 1.0], 0.5, "4"),
        ([], [-1.0, 3.0], 1.0, "3"),
        ([], [], math.inf, "0"),
        ([5.0 + 0.9e-6], [0.0], -0.9e-6, "5"),
    ):
        answer = within(first, second)
        assert isinstance(answer, Checked)
        assert answer.margin == pytest.approx(margin, rel=1e-6)
        assert answer == Checked(
            "some-value", f"at most {largest} m in magnitude", answer.margin, "m"
        )


def test_values_beyond_bounds() -> None:
    for first, second, wanted in (
        ([0.0, 6.0], [7.0], ("witness", 1, 0.05, 6.0, 5.0)),
        ([0.0, 4.0], [0.0, 0.0, -3.0, 9.0], ("fail-safe", 2, 0.2, -3.0, -2.0)),
    ):
        name, step, time, measured, allowed = wanted
        answer = within(first, second)
        assert answer == Violation(
            "some-value",
            f"{name}, step {step}: some value {measured:g} m is beyond {allowed:g} m",
            step,
            pytest.approx(time),
            measured,
            allowed,
        )


def test_what_is_not_a_number_is_not_within_bounds() -> None:
    answer = within([0.0, math.nan], [0.0])
    assert isinstance(answer, Violation)
    assert (answer.step, answer.allowed) == (1, 5.0)
    still = Trajectory(np.zeros((2, 5)), np.zeros((1, 2)), 0.05)
    lost = replace(still, states=np.array([[0.0] * 5, [math.nan] * 5]))
    assert isinstance(motion.motion(replace(BASE, witness=still, fail_safe=lost)), Violation)


def test_the_lateral_acceleration_of_a_steady_turn_is_exact() -> None:
    states = np.tile([0.0, 0.0, 0.0, 8.0, 0.2], (3, 1))
    t = Trajectory(states, np.zeros((2, 2)), 0.05)
    exact = 2 * 8.0**2 * math.sin(math.atan(math.tan(0.2) / 2)) / 3.0
    assert highest_lateral(t, 3.0) == pytest.approx([exact, exact], rel=1e-12)


def test_constants_of_the_conditions() -> None:
    assert motion.SLACK == 1e-6
    assert (geometry.SLIT, geometry.BEYOND) == (0.05, 1000.0)


# Places


def test_the_least_distance_of_both_trajectories_to_the_edge_is_told() -> None:
    """The witness ends at x = 15 + 2.25 m, the fail-safe stands 0.9 m from the border at 1.75 m."""
    standing = drive(
        BASE.witness.states[2], np.vstack([constant(0.0, 20), constant(-5.0, 40)]), 0.1
    )
    for c, x1, expected in (
        (BASE, 17.75, 0.5),
        (replace(BASE, fail_safe=standing), 23.75, 0.5),
    ):
        answer = road(replace(c, lanelets=(strip(100, -5.0, 5.0, -40.0, x1),)))
        assert isinstance(answer, Checked)
        assert answer.margin == pytest.approx(expected, abs=2e-3)
        assert answer == Checked(
            "road", "at least 0.50 m from the edge of the road", answer.margin, "m"
        )


@pytest.mark.parametrize("relation", ["current", "left", "right", "opposite"])
def test_an_own_lane_takes_its_slivers_from_conflicts(relation: str) -> None:
    """A lanelet 0.1 m wide under the standing body, within a lane of some kind."""
    own = strip(100, -1.75, 1.75, -40.0, 80.0)
    sliver = Pavement(500, *(np.array([[12.0, y], [13.0, y]]) for y in (0.1, 0.0)), None)
    c = replace(BASE, lanelets=(own,), lanes=(LaneOf(relation, (100,)),), conflicts=(sliver,))
    assert isinstance(conflict_area(c), Violation) == (relation == "opposite")
    assert (relation in OWN) == (relation != "opposite")


def test_of_several_conflict_areas_the_nearest_is_told() -> None:
    """The body stands from x = 8.75 to 13.25."""
    lanes = [strip(n, -9.0, 9.0, x, x + 2.0) for n, x in ((1, 15.25), (2, 14.0), (3, 20.0))]
    answer = conflict_area(replace(BASE, conflicts=tuple(lanes)))
    assert isinstance(answer, Checked)
    assert answer.margin == pytest.approx(0.75)
    answer = conflict_area(replace(BASE, conflicts=(*lanes, strip(4, -9.0, 9.0, 12.25, 16.0))))
    assert isinstance(answer, Violation)
    assert "lanelet 4," in answer.sentence
    assert (answer.measured, answer.allowed) == (pytest.approx(1.8), 1e-4)
