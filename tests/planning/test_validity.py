"""Collision and road checks against shapely, between the grid points too."""

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from reach_scenes import Course
from sandra.planning.tracking import advance
from sandra.planning.validity import Occupied, Road, corners, deviation, separation
from sandra.prediction import PredictedObstacle, Prediction
from sandra.scene.types import Ego, Obstacle, Region, State

EGO = Ego(1, State(0.0, 0.0, 0.0, 10.0), 4.5, 1.8, 2.6)


def drive(rng: np.random.Generator, n: int, tau: float) -> tuple[np.ndarray, np.ndarray]:
    state = [0.0, 0.0, rng.uniform(-3, 3), rng.uniform(0, 30), rng.uniform(-0.2, 0.2)]
    states, inputs = [state], []
    for _ in range(n):
        inputs.append((float(rng.uniform(-6, 6)), float(rng.uniform(-0.4, 0.4))))
        states.append(advance(states[-1], inputs[-1], tau, EGO.wheelbase))
    return np.array(states)[None], np.array(inputs)[None]


def prediction(regions: list[list[Region]], dt: float) -> Prediction:
    obstacle = Obstacle(7, "car", Region.rectangle(4.0, 2.0), State(0.0, 0.0, 0.0, 0.0))
    between = tuple(tuple(step) for step in regions)
    at = (*between, between[-1])
    states = np.full((len(at), 5), np.nan)
    found = PredictedObstacle(obstacle, at, between, states)
    return Prediction("recorded", dt, len(between), (found,))


def region(rng: np.random.Generator) -> Region:
    count = int(rng.integers(1, 8))
    hull = shapely.MultiPoint(rng.normal(size=(count, 2)) * 3).convex_hull
    points = shapely.get_coordinates(shapely.normalize(hull))
    if hull.geom_type == "Polygon":
        points = points[:-1][::-1]
    radius = float(rng.uniform(0, 1)) if rng.random() < 0.5 else 0.0
    return Region(points + rng.uniform(-12, 12, 2), radius)


def shape(found: Region) -> shapely.Geometry:
    return shapely.MultiPoint(found.vertices).convex_hull


@settings(max_examples=80, deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_gaps_are_lower_bounds_of_the_distance_at_every_instant(seed: int) -> None:
    rng = np.random.default_rng(seed)
    tau, n = 0.05, 8
    states, inputs = drive(rng, n, tau)
    regions = [[region(rng) for _ in range(3)] for _ in range(4)]
    occupied = Occupied.of(prediction(regions, 0.1))
    gaps = occupied.gaps(states, inputs, tau, EGO, within=3.0)[0]
    for i in range(n):
        for part in np.linspace(0.0, 1.0, 6):
            state = states[0, i].tolist()
            if part > 0.0:
                state = advance(state, tuple(inputs[0, i]), part * tau, EGO.wheelbase)
            body = shapely.Polygon(corners(np.array(state), EGO))
            distance = min(shape(r).distance(body) - r.radius for r in regions[i // 2])
            assert gaps[i] <= max(distance, 0.0) + 1e-9
    # Not too careful: what is well away is free.
    bodies = [shapely.Polygon(b) for b in corners(states[0], EGO)]
    least = min(
        shapely.union(bodies[i], bodies[i + 1]).convex_hull.distance(shape(r)) - r.radius
        for i in range(n)
        for r in regions[i // 2]
    )
    if least > 0.2:
        assert occupied.free(states, inputs, tau, EGO)[0]


@settings(max_examples=100, deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_separation_is_positive_exactly_if_disjoint(seed: int) -> None:
    rng = np.random.default_rng(seed)
    states, _ = drive(rng, 1, 0.05)
    body = corners(states[0], EGO)
    hull = np.concatenate([body[0], body[1]])
    other = region(rng)
    distance = shapely.MultiPoint(hull).convex_hull.distance(shape(other))
    found = float(separation(hull[None], other.vertices[None])[0])
    assert found <= distance + 1e-9
    # A lower bound, with no fixed share of the distance: sharp corners may face each other.
    if distance > 1e-3:
        assert found > 0.0
    elif distance == 0.0:
        assert found <= 1e-9


@settings(max_examples=50, deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_bodies_stay_in_the_widened_hull(seed: int) -> None:
    rng = np.random.default_rng(seed)
    tau = float(rng.uniform(0.01, 0.1))
    states, inputs = drive(rng, 1, tau)
    bound = float(deviation(states, inputs, tau, EGO)[0, 0])
    body = corners(states[0], EGO)
    hull = shapely.MultiPoint(np.concatenate([body[0], body[1]])).convex_hull.buffer(bound + 1e-9)
    for part in np.linspace(0.05, 0.95, 7):
        state = advance(states[0, 0].tolist(), tuple(inputs[0, 0]), part * tau, EGO.wheelbase)
        assert hull.covers(shapely.Polygon(corners(np.array(state), EGO)))


def test_intervals_and_start() -> None:
    ahead = Region.rectangle(2.0, 2.0).placed(6.0, 0.0, 0.0)
    away = Region.rectangle(2.0, 2.0).placed(60.0, 0.0, 0.0)
    occupied = Occupied.of(prediction([[away], [ahead], [away]], 0.1))
    states = np.zeros((1, 3, 5))
    states[0, :, 0] = [0.0, 1.0, 2.0]
    states[..., 3] = 20.0
    inputs = np.zeros((1, 2, 2))
    assert occupied.free(states[:, :2], inputs[:, :1], 0.05, EGO)[0]
    assert occupied.free(states, inputs, 0.05, EGO)[0]
    assert occupied.free(states[:, :2], inputs[:, :1], 0.05, EGO, start=0.1)[0]
    assert not occupied.free(states[:, 1:] + 0.0, inputs[:, :1], 0.05, EGO, start=0.15)[0] or (
        occupied.gaps(states[:, 1:], inputs[:, :1], 0.05, EGO, start=0.15).min() > 0.02
    )
    states[0, :, 0] += 1.5
    assert occupied.free(states, inputs, 0.05, EGO)[0]
    assert not occupied.free(states, inputs, 0.05, EGO, start=0.1)[0]
    assert occupied.free(states, inputs, 0.05, EGO, start=0.2)[0]
    assert occupied.nearest(states, inputs, 0.05, EGO, start=0.1) == (0, pytest.approx(0.15))
    with pytest.raises(ValueError, match="longer than the prediction"):
        occupied.gaps(states, inputs, 0.05, EGO, start=0.25)


def test_nobody_there() -> None:
    empty = Prediction("recorded", 0.1, 3, ())
    assert Occupied.of(empty).free(np.zeros((2, 3, 5)), np.zeros((2, 2, 2)), 0.1, EGO).all()


def test_road() -> None:
    course = Course()
    scene = course.scene(course.lanes(left=1, right=0), speed=10.0)
    road = Road.of(scene)
    ego = scene.ego

    def on_road(d: float, heading: float = 0.0) -> bool:
        states = np.zeros((1, 2, 5))
        states[..., 1], states[..., 2] = d, heading
        return bool(road.holds(states, np.zeros((1, 1, 2)), 0.05, ego)[0])

    edge = 1.75 - ego.width / 2
    assert on_road(0.0)
    assert on_road(1.75)  # across the line between two lanes
    assert on_road(-edge + 0.05)
    assert not on_road(-edge - 0.01)
    assert not on_road(-edge + 0.1, heading=0.2)
    assert not on_road(3.5 + edge + 0.01)
