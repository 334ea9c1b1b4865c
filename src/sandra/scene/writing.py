"""A `Scene` with what was recorded in it, as a CommonRoad file (XML 2020a).

`sandra.load` reads it back: positions and angles to 0.1 mm and 1e-4 rad, ids as they are.
"""

from __future__ import annotations

import logging
import math
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sandra.errors import ScenarioError
from sandra.scene.types import Lanelet, Obstacle, Region, Scene, State

Array = NDArray[np.float64]

DECIMALS = 4
"""Digits after the point, of lengths [m], angles [rad], speeds and accelerations."""


def write(scene: Scene, path: str | Path, *, source: str = "sandra") -> Path:
    """Write a scene with the recordings of its obstacles and of its ego.

    The recorded ego is a vehicle of the file with the ego's id, and the start of its planning
    problem, whose id is the first that is free; there is no goal but the end of time.

    Args:
        path: the file, `.xml`. source: what made the recording, for the file's header.

    Raises:
        ScenarioError: if the file cannot be written, or an outline is no rectangle, disc or
            polygon.
    """
    from commonroad.common.file_writer import CommonRoadFileWriter
    from commonroad.common.util import FileFormat
    from commonroad.common.writer.file_writer_interface import OverwriteExistingFile
    from commonroad.scenario.scenario import Tag

    scenario, problems = _scenario(scene, source)
    writer = CommonRoadFileWriter(
        scenario,
        problems,
        author="sandra",
        affiliation="",
        source=source,
        tags={Tag.SIMULATED},
        decimal_precision=DECIMALS,
        file_format=FileFormat.XML,
    )
    path = Path(path)
    with _quiet():
        try:
            writer.write_to_file(str(path), OverwriteExistingFile.ALWAYS)
        except OSError as error:
            raise ScenarioError(
                f"{path}: cannot be written ({error.strerror}); choose another place"
            ) from None
    return path


def _scenario(scene: Scene, source: str) -> tuple[Any, Any]:
    from commonroad.common.common_scenario import FileInformation, MapMetaInformation, ScenarioID
    from commonroad.common.util import Interval, Time
    from commonroad.planning.goal import GoalRegion
    from commonroad.planning.planning_problem import PlanningProblem, PlanningProblemSet
    from commonroad.scenario.scenario import Scenario
    from commonroad.scenario.state import CustomState

    name = "".join(part.capitalize() for part in scene.name.replace("-", " ").split())
    name = "".join(c for c in name if c.isalnum()) or "Recording"
    information = FileInformation(Time(0, 0, 1, 1, 2026), "sandra", "", source)
    scenario = Scenario(
        scene.dt,
        ScenarioID(False, scene.country or "ZAM", name, 1, 1, "T", 1),
        information,
        set(),
    )
    network = _network(scene.lanelets)
    network.meta_information = MapMetaInformation(
        ScenarioID(False, scene.country or "ZAM", name, 1), information
    )
    scenario.add_objects(network)
    obstacles = [_obstacle(each) for each in scene.obstacles]
    ego = scene.ego
    if scene.recorded_ego is not None:
        own = Obstacle(ego.id, "car", ego.outline, ego.state, states=scene.recorded_ego)
        obstacles.append(_obstacle(own))
    scenario.add_objects([each for each in obstacles if each is not None])
    taken = {ego.id, *(o.id for o in scene.obstacles), *(x.id for x in scene.lanelets)}
    last = scene.recorded_steps if scene.recorded_ego is None else len(scene.recorded_ego) - 1
    problem = PlanningProblem(
        max(taken) + 1,
        _initial(_values(ego.state), 0, ego.state.yaw_rate),
        GoalRegion([CustomState(time_step=Interval(last, last))]),
    )
    return scenario, PlanningProblemSet([problem])


def _network(lanelets: tuple[Lanelet, ...]) -> Any:
    from commonroad.scenario.lanelet import Lanelet as TheirLanelet
    from commonroad.scenario.lanelet import LaneletNetwork, LaneletType
    from commonroad.scenario.traffic_sign import (
        TrafficSign,
        TrafficSignElement,
        TrafficSignIDZamunda,
    )

    network = LaneletNetwork()
    first = max(lanelet.id for lanelet in lanelets) + 1
    limits = sorted({x.speed_limit for x in lanelets if x.speed_limit is not None})
    signs = {limit: first + i for i, limit in enumerate(limits)}
    for lanelet in lanelets:
        left, right = lanelet.adjacent_left, lanelet.adjacent_right
        sign = set() if lanelet.speed_limit is None else {signs[lanelet.speed_limit]}
        network.add_lanelet(
            TheirLanelet(
                left_vertices=lanelet.left,
                center_vertices=lanelet.center,
                right_vertices=lanelet.right,
                lanelet_id=lanelet.id,
                predecessor=list(lanelet.predecessors),
                successor=list(lanelet.successors),
                adjacent_left=None if left is None else left[0],
                adjacent_left_same_direction=None if left is None else left[1],
                adjacent_right=None if right is None else right[0],
                adjacent_right_same_direction=None if right is None else right[1],
                lanelet_type={LaneletType(kind) for kind in lanelet.kinds or ("unknown",)},
                traffic_signs=sign,
            )
        )
    for limit, number in signs.items():
        there = {x.id for x in lanelets if x.speed_limit == limit}
        place = next(x.right[0] for x in lanelets if x.speed_limit == limit)
        element = TrafficSignElement(TrafficSignIDZamunda.MAX_SPEED, [repr(limit)])
        network.add_traffic_sign(TrafficSign(number, [element], there, place), set())
    return network


def _obstacle(obstacle: Obstacle) -> Any:
    """As an object of commonroad-io; None for one that is never there."""
    from commonroad.prediction.prediction import TrajectoryPrediction
    from commonroad.scenario.obstacle import DynamicObstacle, ObstacleType, StaticObstacle
    from commonroad.scenario.trajectory import Trajectory

    kind = ObstacleType(obstacle.kind)
    shape = _shape(obstacle)
    if obstacle.is_static:
        return StaticObstacle(obstacle.id, kind, shape, _initial(_values(obstacle.state), 0))
    states = obstacle.states
    if states is None:
        states = _values(obstacle.state)[None]
    there = np.flatnonzero(np.isfinite(states[:, 0]))
    if not len(there):
        return None
    # CommonRoad has no gaps: what is seen again later counts as another appearance.
    first = int(there[0])
    count = int(np.argmin(np.append(np.isfinite(states[first:, 0]), False)))
    later = [_later(states[k], k) for k in range(first + 1, first + count)]
    prediction = TrajectoryPrediction(Trajectory(first + 1, later), shape) if later else None
    return DynamicObstacle(obstacle.id, kind, shape, _initial(states[first], first), prediction)


def _shape(obstacle: Obstacle) -> Any:
    from commonroad.geometry.obstacle_shapes.circle_obstacle_shape import CircleObstacleShape
    from commonroad.geometry.obstacle_shapes.polygon_obstacle_shape import PolygonObstacleShape
    from commonroad.geometry.obstacle_shapes.rect_obstacle_shape import RectObstacleShape

    outline = obstacle.outline
    if len(outline.vertices) == 1:
        return CircleObstacleShape(outline.radius)
    if outline.radius > 0.0:
        raise ScenarioError(
            f"obstacle {obstacle.id}: CommonRoad has no shape for a widened polygon; "
            "give a rectangle, a disc or a polygon"
        )
    if _is_rectangle(outline):
        return RectObstacleShape(width=obstacle.width, length=obstacle.length)
    return PolygonObstacleShape(outline.vertices)


def _is_rectangle(outline: Region) -> bool:
    low, high = outline.vertices.min(axis=0), outline.vertices.max(axis=0)
    corners = {tuple(np.round(v, 6)) for v in outline.vertices}
    return len(outline.vertices) == 4 and corners == {
        (round(x, 6), round(y, 6)) for x in (low[0], high[0]) for y in (low[1], high[1])
    }


def _values(state: State) -> Array:
    return np.array([state.x, state.y, state.heading, state.speed, state.acceleration])


def _later(row: Array, step: int) -> Any:
    from commonroad.scenario.state import ExtendedPMState

    return ExtendedPMState(**_fields(row, step))


def _initial(row: Array, step: int, yaw_rate: float = 0.0) -> Any:
    from commonroad.scenario.state import InitialState

    return InitialState(**_fields(row, step), yaw_rate=yaw_rate, slip_angle=0.0)


def _fields(row: Array, step: int) -> dict[str, Any]:
    x, y, heading, speed, acceleration = row.tolist()
    return {
        "time_step": step,
        "position": np.array([x, y]),
        "orientation": math.atan2(math.sin(heading), math.cos(heading)),
        "velocity": speed,
        "acceleration": 0.0 if math.isnan(acceleration) else acceleration,
    }


@contextmanager
def _quiet() -> Iterator[None]:
    """commonroad-io warns of names that only a later format has; the file is 2020a."""
    before = logging.root.manager.disable
    logging.disable(logging.WARNING)
    try:
        yield
    finally:
        logging.disable(before)
