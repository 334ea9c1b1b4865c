"""Collision geometry: against another library, and against many moments between grid points."""

from __future__ import annotations

import math

import commonroad_dc.pycrcc as pycrcc
import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from certified import WHEELBASE, drive
from sandra.certificate.collision import clearance
from sandra.certificate.geometry import Reference, Sweep, bodies, corners, hulls, outline, sweep
from sandra.certificate.motion import PIECES, highest_lateral, successors
from sandra.certificate.types import Body, Pavement
from sandra.planning.single_track import derivative, lateral_acceleration, step
from sandra.planning.types import Trajectory
from sandra.scene.types import Region

BODY = Body(1, 4.5, 1.8, WHEELBASE)
REAL = st.floats(-8.0, 8.0)
SEEDS = st.integers(0, 2**32 - 1)


def random_convex(rng: np.random.Generator) -> np.ndarray:
    count = int(rng.integers(3, 9))
    angles = np.sort(rng.uniform(0.0, 2 * math.pi, count))
    points = np.column_stack([np.cos(angles), np.sin(angles)]) * rng.uniform(0.5, 4.0)
    return points + rng.uniform(-6.0, 6.0, 2)


@settings(deadline=None)
@given(SEEDS)
def test_shapely_and_pycrcc_agree_on_rectangles_and_polygons(seed: int) -> None:
    rng = np.random.default_rng(seed)
    x, y, angle = rng.uniform(-4.0, 4.0, 3)
    mine = bodies(np.array([[x, y, angle]]), BODY)[0]
    theirs = pycrcc.RectOBB(BODY.length / 2, BODY.width / 2, angle, x, y)
    points = random_convex(rng)
    polygon = shapely.convex_hull(shapely.multipoints(points))
    if shapely.area(polygon) < 1e-3:
        return
    triangles = pycrcc.ShapeGroup()
    for i in range(1, len(points) - 1):
        triangles.add_shape(pycrcc.Triangle(*points[0], *points[i], *points[i + 1]))
    apart = float(shapely.distance(mine, polygon))
    deep = float(shapely.area(shapely.intersection(mine, polygon)))
    if apart > 1e-6 or deep > 1e-6:
        assert theirs.collide(triangles) == (apart == 0.0)
    x2, y2, angle2 = rng.uniform(-4.0, 4.0, 3)
    other = bodies(np.array([[x2, y2, angle2]]), BODY)[0]
    apart = float(shapely.distance(mine, other))
    deep = float(shapely.area(shapely.intersection(mine, other)))
    if apart > 1e-6 or deep > 1e-6:
        box = pycrcc.RectOBB(BODY.length / 2, BODY.width / 2, angle2, x2, y2)
        assert theirs.collide(box) == (apart == 0.0)


@settings(deadline=None)
@given(SEEDS)
def test_shapely_and_pycrcc_agree_on_discs_along_a_trajectory(seed: int) -> None:
    """The clearance of a body that stands at each grid point, against discs."""
    rng = np.random.default_rng(seed)
    states = np.column_stack([rng.uniform(-6.0, 6.0, (6, 3)), np.zeros((6, 2))])
    centre, radius = rng.uniform(-6.0, 6.0, 2), float(rng.uniform(0.1, 2.0))
    found = clearance(
        Sweep(bodies(states, BODY), np.zeros(6)), 0, 6, [((Region(centre[None], radius),),)]
    )
    if abs(found.distance) < 1e-6:
        return
    disc = pycrcc.Circle(radius, *centre)
    hits = [
        pycrcc.RectOBB(BODY.length / 2, BODY.width / 2, s[2], s[0], s[1]).collide(disc)
        for s in states
    ]
    assert (found.distance <= 0.0) == any(hits)
    if any(hits):
        assert found.step == hits.index(True)


def random_drive(seed: int, steps: int = 12) -> Trajectory:
    """Anything that the model can do, within steering angles of the default car."""
    rng = np.random.default_rng(seed)
    start = [*rng.uniform(-50, 50, 2), rng.uniform(-4, 4), rng.uniform(0, 30), 0.0]
    start[4] = rng.uniform(-0.5, 0.5) if start[3] < 10 else rng.uniform(-0.05, 0.05)
    inputs = np.column_stack([rng.uniform(-6, 6, steps), rng.uniform(-0.4, 0.4, steps)])
    # No driving backwards.
    speeds = start[3] + np.cumsum(inputs[:, 0]) * 0.05
    inputs[speeds < 0.5, 0] = 6.0
    return drive(start, inputs)


@settings(deadline=None, max_examples=25)
@given(SEEDS)
def test_the_body_stays_in_the_sweep_between_grid_points(seed: int) -> None:
    t = random_drive(seed)
    swept = sweep(t, BODY)
    for i, inputs in enumerate(t.inputs):
        times = np.linspace(0.0, t.tau, 12)[1:-1]
        between = np.array([step(t.states[i], inputs, time, WHEELBASE) for time in times])
        points = shapely.points(corners(between, BODY).reshape(-1, 2))
        assert (shapely.distance(swept.hulls[i], points) <= swept.margins[i]).all()


def test_the_margin_of_the_sweep_is_needed() -> None:
    """Without it bodies between grid points stick out: the bound is not vacuous."""
    t = drive([0.0, 0.0, 0.0, 10.0, 0.3], np.tile([-6.0, 0.4], (10, 1)))
    swept = sweep(t, BODY)
    out = 0.0
    for i, inputs in enumerate(t.inputs):
        middle = step(t.states[i], inputs, t.tau / 2, WHEELBASE)
        points = shapely.points(corners(middle[None], BODY)[0])
        out = max(out, float((shapely.distance(swept.hulls[i], points) / swept.margins[i]).max()))
    assert 0.3 < out <= 1.0


@settings(deadline=None, max_examples=30)
@given(SEEDS)
def test_the_motion_is_that_of_an_integrator_with_a_bound_on_its_error(seed: int) -> None:
    t = random_drive(seed, 3)
    for i, found in enumerate(successors(t, WHEELBASE)):
        right = solve_ivp(
            lambda _, x, u=t.inputs[i]: derivative(x, u, WHEELBASE),
            (0.0, t.tau),
            t.states[i],
            method="DOP853",
            rtol=1e-12,
            atol=1e-12,
        )
        assert np.abs(found - right.y[:, -1]).max() < 1e-9
        assert np.abs(found - t.states[i + 1]).max() < 1e-7


@settings(deadline=None, max_examples=60)
@given(SEEDS)
def test_the_lateral_acceleration_is_bounded_tightly(seed: int) -> None:
    t = random_drive(seed)
    bound = highest_lateral(t, WHEELBASE)
    for i, inputs in enumerate(t.inputs):
        share = np.linspace(0.0, t.tau, 5 * PIECES + 3)[:, None]
        states = np.zeros((len(share), 5))
        states[:, 3:] = t.states[i, 3:] + inputs * share
        most = np.abs(lateral_acceleration(states, WHEELBASE)).max()
        assert most <= bound[i] + 1e-9
        largest = np.abs(lateral_acceleration(states, WHEELBASE)).max()
        assert bound[i] <= 1.05 * largest + 0.3


@given(REAL, REAL, st.floats(-3.2, 3.2))
def test_corners_are_those_of_the_rectangle(x: float, y: float, heading: float) -> None:
    found = corners(np.array([[x, y, heading]]), BODY)[0]
    placed = Region.rectangle(BODY.length, BODY.width).placed(x, y, heading).vertices
    assert {tuple(np.round(p, 9) + 0.0) for p in found} == {
        tuple(np.round(p, 9) + 0.0) for p in placed
    }
    assert shapely.area(hulls(found[None])[0]) == pytest.approx(4.5 * 1.8)


def test_a_position_along_and_across_the_reference_line() -> None:
    line = Reference.of(np.array([[0.0, 0.0], [0.0, 0.0], [10.0, 0.0], [10.0, 10.0]]))
    points = np.array([[2.0, 1.0], [-5.0, -2.0], [9.0, 5.0], [12.0, 25.0]])
    assert line.along(points) == pytest.approx([2.0, -5.0, 15.0, 35.0])
    assert line.across(points) == pytest.approx([1.0, -2.0, 1.0, -2.0])
    assert line.direction(np.array([5.0, 15.0])) == pytest.approx(np.array([[1, 0], [0, 1]]))


def test_a_lanelet_whose_borders_cross_keeps_both_parts() -> None:
    left, right = np.array([[0.0, 1.0], [10.0, -1.0]]), np.array([[0.0, -1.0], [10.0, 1.0]])
    assert shapely.area(outline(Pavement(1, left, right, None))) == pytest.approx(10.0)
    flat = Pavement(2, left, left, None)
    assert shapely.is_empty(outline(flat))


def test_a_spike_of_a_crossed_lanelet_is_no_road() -> None:
    right = np.array([[0, 0], [4, 4], [6, 4], [8, 4], [6, 4]], dtype=float)
    left = np.array([[0, 4], [4, 0], [6, 0]], dtype=float)
    area = outline(Pavement(1, left, right, None))
    # A triangle of 4 m^2, and one with a rectangle of 2 m by 4 m beside it; the spike has none.
    assert area.geom_type == "MultiPolygon"
    assert shapely.area(area) == pytest.approx(4 + 4 + 8)
    assert shapely.total_bounds(area).tolist() == [0.0, 0.0, 6.0, 4.0]


def test_nobody_is_infinitely_far() -> None:
    still = np.zeros((2, 5))
    swept = sweep(Trajectory(still, np.zeros((1, 2)), 0.05), BODY)
    assert clearance(swept, 0, 2, []).distance == math.inf
    assert clearance(swept, 0, 2, [((),)]).distance == math.inf


def test_the_clearance_is_that_to_the_nearest_region() -> None:
    still = np.zeros((5, 5))
    swept = sweep(Trajectory(still, np.zeros((4, 2)), 0.05), BODY)
    near, far = Region(np.array([[0.0, 1.9]]), 0.5), Region(np.array([[50.0, 0.0]]), 1.0)
    segment = Region(np.array([[0.0, 1.6], [1.0, 1.6]]), 0.3)
    found = clearance(swept, 0, 2, [((far,), (far,)), ((near,), (segment, near))])
    assert found.distance == pytest.approx(0.4, abs=1e-4)
    assert (found.step, found.obstacle) == (2, 1)
    assert clearance(swept, 0, 2, [((far,), (far,))]).distance == pytest.approx(46.75, abs=1e-3)
    # The trajectory begins in the second interval.
    later = Sweep(swept.hulls[:2], swept.margins[:2])
    assert clearance(later, 2, 2, [((near,), (far,))]).distance == pytest.approx(46.75, abs=1e-3)
    touching = Region(np.array([[0.0, 1.0]]), 0.1)
    found = clearance(swept, 0, 2, [((far,), (far,)), ((far,), (touching,))])
    assert found.distance <= 0.0
    assert (found.step, found.obstacle) == (2, 1)
