"""The peer's side of `sandra bench reach`: runs in the peer's environment, knows nothing of sandra.

Reads one JSON object per line from stdin and answers each with one line on stdout: what was asked,
or `{"error": ...}`. What it can be asked for are the public methods of `Worker`; `do` names one.
Times are process CPU times in s.
"""

from __future__ import annotations

import json
import os
import sys
import time
from importlib.metadata import version
from types import SimpleNamespace
from typing import Any

# Whatever the packages print goes to stderr; the answers keep the real stdout to themselves.
_ANSWERS = os.fdopen(os.dup(1), "w", encoding="utf-8")
os.dup2(2, 1)

import numpy as np  # noqa: E402
import shapely  # noqa: E402
from commonroad.geometry.shape import Polygon, ShapeGroup  # noqa: E402
from commonroad.prediction.prediction import Occupancy, SetBasedPrediction  # noqa: E402
from commonroad.scenario.lanelet import Lanelet  # noqa: E402
from commonroad.scenario.obstacle import DynamicObstacle, ObstacleType, StaticObstacle  # noqa: E402
from commonroad.scenario.scenario import Scenario  # noqa: E402
from commonroad.scenario.state import InitialState  # noqa: E402
from commonroad_clcs.pycrccosy import (  # noqa: E402
    CartesianProjectionDomainError,
    CurvilinearCoordinateSystem,
)
from commonroad_dc import pycrcc  # noqa: E402
from commonroad_reach import pycrreach  # noqa: E402
from commonroad_reach.data_structure.collision_checker import CollisionChecker  # noqa: E402
from commonroad_reach.data_structure.configuration_builder import ConfigurationBuilder  # noqa: E402

PACKAGES = (
    *("commonroad-reach", "commonroad-drivability-checker"),
    *("commonroad-clcs", "commonroad-io"),
)
PROJECTION = 60.0
"""How far from the reference path the coordinate system may reach [m]; it ends before its radius
of curvature."""


class Worker:
    """One problem at a time, and what was computed for it."""

    def hello(self, asked: dict[str, Any]) -> dict[str, Any]:
        """The versions of the packages."""
        return {"versions": {name: version(name) for name in PACKAGES}}

    def scene(self, asked: dict[str, Any]) -> dict[str, Any]:
        """Take a problem; `hand_over.problem_of` says what it consists of.

        Answers with the time for the coordinate system.
        """
        scenario = Scenario(dt=asked["dt"])
        scenario.add_objects([_lanelet(row) for row in asked["lanelets"]])
        for row in asked["obstacles"]:
            scenario.add_objects(_obstacle(row))
        line = [np.array(point, dtype=np.float64) for point in asked["line"]]
        begin = time.process_time()
        frame = CurvilinearCoordinateSystem(line, PROJECTION, 0.1, 1e-4)
        frame.compute_and_set_curvature()
        spent = time.process_time() - begin
        self.config = _configuration(asked, scenario, frame)
        return {"frame_s": spent}

    def locate(self, asked: dict[str, Any]) -> dict[str, Any]:
        """(s, d) of each of `points` (x, y), None outside of the coordinate system."""
        frame = self.config.planning.CLCS
        return {"points": [_in_frame(frame, x, y) for x, y in asked["points"]]}

    def prepare(self, asked: dict[str, Any]) -> dict[str, Any]:
        """Make the collision checker; then, not timed, add `beyond`: boxes that stay forbidden."""
        reachable = self.config.reachable_set
        reachable.size_grid, reachable.radius_terminal_split = asked["grid"], asked["split"]
        begin = time.process_time()
        self.checker = CollisionChecker(self.config).cpp_collision_checker
        spent = time.process_time() - begin
        self.checker.add_collision_object(_group(asked["beyond"]))
        return {"prepare_s": spent}

    def forbid(self, asked: dict[str, Any]) -> dict[str, Any]:
        """Instead of `prepare`: for each step the forbidden boxes, taken as they are."""
        reachable = self.config.reachable_set
        reachable.size_grid, reachable.radius_terminal_split = asked["grid"], asked["split"]
        moving = pycrcc.TimeVariantCollisionObject(self.config.planning.step_start)
        for boxes in asked["boxes"]:
            moving.append_obstacle(_group(boxes))
        self.checker = pycrcc.CollisionChecker()
        self.checker.add_collision_object(moving)
        self.checker.add_collision_object(_group(asked["beyond"]))
        return {}

    def collides(self, asked: dict[str, Any]) -> dict[str, Any]:
        """For each of `steps`, whether its points (s, d) are forbidden."""
        found = []
        for step, points in zip(asked["steps"], asked["points"], strict=True):
            checker = self.checker.time_slice(step)
            found.append([checker.collide(pycrcc.RectAABB(1e-3, 1e-3, s, d)) for s, d in points])
        return {"collides": found}

    def compute(self, asked: dict[str, Any]) -> dict[str, Any]:
        """Compute the reachable set in the peer's core, without copying it into Python."""
        config = self.config.convert_to_cpp_configuration()
        first = self.config.planning.step_start + 1
        begin = time.process_time()
        self.found = pycrreach.ReachableSet(config, self.checker)
        for step in range(first, first + self.config.planning.steps_computation):
            self.found.compute(step, step)
        return {"compute_s": time.process_time() - begin}

    def sets(self, asked: dict[str, Any]) -> dict[str, Any]:
        """Of each step: the area, `boxes` (s_low, d_low, s_high, d_high) that cover it, the number
        of base sets and their ranges of speed."""
        return {"steps": [_step(nodes) for _, nodes in sorted(self.found.reachable_set().items())]}


def _group(boxes: list[list[float]]) -> pycrcc.ShapeGroup:
    """Boxes (s_low, s_high, d_low, d_high)."""
    group = pycrcc.ShapeGroup()
    for a, b, c, d in boxes:
        group.add_shape(pycrcc.RectAABB((b - a) / 2, (d - c) / 2, (a + b) / 2, (c + d) / 2))
    return group


def _in_frame(frame: Any, x: float, y: float) -> list[float] | None:
    try:
        found: list[float] = frame.convert_to_curvilinear_coords(x, y).tolist()
    except CartesianProjectionDomainError:
        return None
    return found


def _step(nodes: list[Any]) -> dict[str, Any]:
    if not nodes:
        return {"area": 0.0, "boxes": [], "sets": 0, "v_lon": None, "v_lat": None}
    boxes = [shapely.box(n.p_lon_min, n.p_lat_min, n.p_lon_max, n.p_lat_max) for n in nodes]
    lon, lat = [n.polygon_lon for n in nodes], [n.polygon_lat for n in nodes]
    return {
        "area": shapely.union_all(boxes).area,
        "boxes": [b.bounds for b in boxes],
        "sets": len(nodes),
        "v_lon": [min(p.v_min for p in lon), max(p.v_max for p in lon)],
        "v_lat": [min(p.v_min for p in lat), max(p.v_max for p in lat)],
    }


def _lanelet(row: dict[str, Any]) -> Lanelet:
    left, right = np.array(row["left"]), np.array(row["right"])
    beside_left, beside_right = row["adjacent_left"], row["adjacent_right"]
    return Lanelet(
        left_vertices=left,
        center_vertices=(left + right) / 2,
        right_vertices=right,
        lanelet_id=row["id"],
        predecessor=row["predecessors"],
        successor=row["successors"],
        adjacent_left=beside_left and beside_left[0],
        adjacent_left_same_direction=beside_left and beside_left[1],
        adjacent_right=beside_right and beside_right[0],
        adjacent_right_same_direction=beside_right and beside_right[1],
    )


def _obstacle(row: dict[str, Any]) -> StaticObstacle | DynamicObstacle:
    """`row["at"]` holds the polygons of each step."""
    shapes = [ShapeGroup([Polygon(np.array(p)) for p in polygons]) for polygons in row["at"]]
    first = next(k for k, shape in enumerate(shapes) if shape.shapes)
    start = InitialState(
        time_step=first, position=np.zeros(2), orientation=0.0, velocity=0.0, acceleration=0.0
    )
    if row["static"]:
        return StaticObstacle(row["id"], ObstacleType.UNKNOWN, shapes[first], start)
    later = [Occupancy(k, shape) for k, shape in enumerate(shapes) if k > first and shape.shapes]
    prediction = SetBasedPrediction(first + 1, later)
    return DynamicObstacle(row["id"], ObstacleType.UNKNOWN, shapes[first], start, prediction)


def _configuration(asked: dict[str, Any], scenario: Scenario, frame: Any) -> Any:
    config = ConfigurationBuilder().build_configuration("bench")
    ego, planning = config.vehicle.ego, config.planning
    ego.length, ego.width = asked["length"], asked["width"]
    for name, value in asked["bounds"].items():
        setattr(ego, name, value)
    ego.radius_inflation = min(ego.length, ego.width) / 2
    planning.dt = asked["dt"]
    planning.steps_computation = asked["horizon"]
    planning.uncertainty_p_lon = planning.uncertainty_p_lat = asked["uncertainty"]
    planning.uncertainty_v_lon = planning.uncertainty_v_lat = asked["uncertainty"]
    config.reachable_set.num_threads = 1
    config.reachable_set.prune_nodes_not_reaching_final_step = False
    x, y, heading, speed = asked["initial"]["state"]
    state = InitialState(
        time_step=0,
        position=np.array([x, y]),
        orientation=heading,
        velocity=speed,
        acceleration=0.0,
        yaw_rate=0.0,
        slip_angle=0.0,
    )
    # Of a planning problem it reads the initial state only.
    problem = SimpleNamespace(initial_state=state)
    config.update(scenario=scenario, planning_problem=problem, CLCS=frame)
    planning.p_initial = tuple(asked["initial"]["position"])
    planning.v_initial = tuple(asked["initial"]["velocity"])
    return config


def main() -> None:
    sys.argv = sys.argv[:1]  # the peer reads configurations from the command line
    worker = Worker()
    for line in sys.stdin:
        try:
            asked = json.loads(line)
            answer = getattr(worker, asked["do"])(asked)
        except Exception as error:  # noqa: BLE001  whatever the peer raises is its answer
            answer = {"error": f"{type(error).__name__}: {error}"}
        _ANSWERS.write(json.dumps(answer) + "\n")
        _ANSWERS.flush()


if __name__ == "__main__":
    main()
