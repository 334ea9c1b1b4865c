"""Scenes for fail-safe trajectories, and what each of these must keep, by other means."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
import shapely

from reach_scenes import CAR, Course
from sandra.planning.fail_safe_search import FailSafe, Miss, fail_safe, fail_safe_horizon
from sandra.planning.single_track import SPEED, STEERING, lateral_acceleration, step
from sandra.planning.types import Trajectory
from sandra.prediction import PredictedObstacle, Prediction, predict
from sandra.scene.frame import Frame
from sandra.scene.types import Lane, Obstacle, Region, Scene, State
from sandra.settings import Settings

SETTINGS = Settings()
STRAIGHT = Course(step=5.0)
FINE = 5
"""Bodies are looked at so many times per step of a trajectory."""


def road(course: Course, *obstacles: Obstacle, lanes: int = 1, **changes: float) -> Scene:
    """The ego in the right of `lanes` lanes, which know that they are neighbours."""
    scene = course.scene(course.lanes(left=lanes - 1, right=0), obstacles, **changes)  # type: ignore[arg-type]
    linked = tuple(
        dataclasses.replace(
            x,
            adjacent_left=(x.id + 1, True) if i + 1 < lanes else None,
            adjacent_right=(x.id - 1, True) if i else None,
        )
        for i, x in enumerate(scene.lanelets)
    )
    return dataclasses.replace(scene, lanelets=linked)


def state_of(scene: Scene) -> np.ndarray:
    now = scene.ego.state
    return np.array([now.x, now.y, now.heading, now.speed, now.steering_angle])


def search(scene: Scene, t_dec: float = 0.0, state: np.ndarray | None = None) -> FailSafe | Miss:
    horizon = fail_safe_horizon(scene, SETTINGS, t_dec)
    prediction = predict(scene, "set-based", horizon, SETTINGS)
    state = state_of(scene) if state is None else state
    found = fail_safe(scene, state, t_dec, prediction, SETTINGS)
    if isinstance(found, FailSafe):
        assert_holds(scene, prediction, found, state, t_dec)
    return found


def by_hand(
    scene: Scene, regions: dict[int, Region] | dict[int, tuple[Region, ...]], horizon: int
) -> Prediction:
    """A prediction in which one obstacle is there only during some intervals."""
    each = [regions.get(k, ()) for k in range(horizon)]
    between = tuple((x,) if isinstance(x, Region) else x for x in each)
    obstacle = STRAIGHT.car(7, 200.0, 0.0)
    nan = np.full((horizon + 1, 5), np.nan)
    each = PredictedObstacle(obstacle, ((),) * (horizon + 1), between, nan)
    return Prediction("set-based", scene.dt, horizon, (each,))


def dense(trajectory: Trajectory, wheelbase: float) -> np.ndarray:
    """(n, FINE + 1, 5) states within each step, by the model."""
    parts = np.linspace(0.0, trajectory.tau, FINE + 1)
    found = [
        [step(x, u, t, wheelbase) if t > 0 else x for t in parts]
        for x, u in zip(trajectory.states[:-1], trajectory.inputs, strict=True)
    ]
    return np.array(found).reshape(-1, FINE + 1, 5)


def bodies(states: np.ndarray, scene: Scene) -> np.ndarray:
    """(m,) shapely polygons for states (..., 5)."""
    flat = states.reshape(-1, 5)
    outline = scene.ego.outline
    placed = np.array([outline.placed(*x[:3]).vertices for x in flat]).reshape(-1, 4, 2)
    return np.asarray(shapely.polygons(placed))


def shape(region: Region) -> shapely.Geometry:
    hull = shapely.convex_hull(shapely.MultiPoint(region.vertices))
    return hull.buffer(region.radius) if region.radius else hull


def assert_holds(
    scene: Scene, prediction: Prediction, found: FailSafe, state: np.ndarray, t_dec: float
) -> None:
    """Everything a fail-safe promises, with other means than those that found it."""
    trajectory, wheelbase = found.trajectory, scene.ego.wheelbase
    states, inputs, tau = trajectory.states, trajectory.inputs, trajectory.tau
    assert trajectory.start == t_dec
    assert np.array_equal(states[0], state)
    assert len(states) == len(inputs) + 1
    assert states[-1, SPEED] == 0.0 or (len(inputs) == 0 and states[-1, SPEED] < 1e-6)
    assert (states[1:-1, SPEED] > 0.0).all()
    for x, u, after in zip(states[:-1], inputs, states[1:], strict=True):
        assert np.abs(step(x, u, tau, wheelbase) - after).max() < 1e-6
    everywhere = dense(trajectory, wheelbase)
    assert (inputs[:, 0] >= SETTINGS.a_lon_min).all()
    assert (inputs[:, 0] <= SETTINGS.a_lon_max).all()
    assert (np.abs(inputs[:, 1]) <= SETTINGS.steering_rate_max).all()
    assert (np.abs(everywhere[..., STEERING]) <= SETTINGS.steering_angle_max).all()
    grip = np.abs(lateral_acceleration(everywhere, wheelbase))
    assert (grip <= SETTINGS.a_lat_max).all()
    if len(inputs):
        assert found.deceleration == pytest.approx(max(0.0, -inputs[:, 0].min()))
    for i, within in enumerate(everywhere):
        k = int((t_dec + i * tau) / scene.dt + 1e-6)
        regions = [shape(r) for each in prediction.obstacles for r in each.between[k]]
        for region in regions:
            gaps = shapely.distance(bodies(within, scene), region)
            assert gaps.min() >= max(found.margins.clearance, 0.02) - 1e-9
    land = shapely.union_all(
        [shapely.Polygon(np.vstack([x.right, x.left[::-1]])).buffer(0) for x in scene.lanelets]
    ).buffer(0.06)
    shapely.prepare(land)
    assert shapely.covers(land, bodies(everywhere, scene)).all()
    (last,) = bodies(states[-1:], scene)
    for lane in scene.incoming:
        for own in (scene.current, scene.left, scene.right):
            if own is not None:
                shared = shapely.Polygon(lane.polygon).intersection(shapely.Polygon(own.polygon))
                assert not last.intersects(shared.buffer(-0.11))


def still(obstacle: Obstacle) -> Obstacle:
    return dataclasses.replace(obstacle, is_static=True)


def crossing(x: float) -> Lane:
    y = np.linspace(40.0, -40.0, 81)
    lines = [np.column_stack([np.full_like(y, x + d), y]) for d in (2.0, -2.0, 0.0)]
    return Lane("incoming-left", (300,), *lines, (None,), Frame(lines[2]))


def before_crossing(x: float, speed: float, *obstacles: Obstacle) -> Scene:
    """The conflict area covers s in [x - 2, x + 2], the front of the ego is at 2.25."""
    lanes = [STRAIGHT.lanes(left=0, right=0)[0], crossing(x)]
    return STRAIGHT.scene(lanes, obstacles, speed=speed)


def junction(seed: int) -> Scene:
    """A lane, straight or bent, that another one crosses; a car on that, often one ahead."""
    rng = np.random.default_rng(seed)
    course = Course(float(rng.choice([0.0, 0.0, 0.01, -0.01])), step=2.0)
    s = float(rng.uniform(5.0, 25.0))
    x = float(course.at(s, 0.0)[0])
    coming = State(x, float(rng.uniform(12.0, 45.0)), -np.pi / 2, float(rng.uniform(3.0, 12.0)))
    cars = [Obstacle(7, "car", CAR, coming)]
    if rng.random() < 0.5:
        ahead = s + float(rng.uniform(8.0, 40.0))
        cars.append(course.car(8, ahead, 0.0, float(rng.uniform(0.0, 12.0))))
    lanes = [course.lanes(left=0, right=0)[0], crossing(x)]
    d, angle = float(rng.uniform(-0.4, 0.4)), float(rng.uniform(-0.04, 0.04))
    return course.scene(lanes, cars, speed=float(rng.uniform(4.0, 14.0)), d=d, angle=angle)
