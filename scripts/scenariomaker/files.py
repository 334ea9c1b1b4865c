"""Scenarios put together, and written so that the same scenario gives the same bytes."""

from __future__ import annotations

import logging
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from commonroad.common.common_scenario import (
    Environment,
    FileInformation,
    MapMetaInformation,
    ScenarioID,
    TimeOfDay,
    Underground,
    Weather,
)
from commonroad.common.file_writer import CommonRoadFileWriter
from commonroad.common.protobuf.dynamic.commonroad_dynamic_pb2 import CommonRoadDynamic
from commonroad.common.protobuf.scenario.commonroad_scenario_pb2 import CommonRoadScenario
from commonroad.common.util import FileFormat, Interval, Time
from commonroad.common.writer.file_writer_interface import OverwriteExistingFile
from commonroad.geometry.obstacle_shapes.obstacle_shape import ObstacleShape
from commonroad.geometry.obstacle_shapes.rect_obstacle_shape import RectObstacleShape
from commonroad.geometry.occupancy.occupancy import Occupancy
from commonroad.geometry.occupancy.occupancy_group import OccupancyGroup
from commonroad.planning.goal import GoalRegion
from commonroad.planning.planning_problem import PlanningProblem, PlanningProblemSet
from commonroad.prediction.prediction import SetBasedPrediction, TrajectoryPrediction
from commonroad.scenario.obstacle import DynamicObstacle, ObstacleType, StaticObstacle
from commonroad.scenario.scenario import Scenario, Tag
from commonroad.scenario.state import CustomState, ExtendedPMState, InitialState
from commonroad.scenario.trajectory import Trajectory
from lxml import etree
from numpy.typing import NDArray

from scenariomaker.roads import Road
from scenariomaker.traffic import Driver, simulate

Array = NDArray[np.float64]
DATE = "2026-11-21"
AUTHOR = "The SanDRA developers"
SOURCE = "scripts/make_scenarios.py"
TYPES = {kind.value: kind for kind in ObstacleType}
# CommonRoad has no word of its own for these.
TYPES |= {"tractor": ObstacleType.TRUCK, "van": ObstacleType.TRUCK}


@dataclass
class Draft:
    """A scenario under construction."""

    country: str
    name: str
    dt: float
    steps: int
    road: Road
    tags: tuple[Tag, ...]
    weather: str | None = None
    time_of_day: str | None = None
    _obstacles: list[StaticObstacle | DynamicObstacle] = field(default_factory=list)
    _problem: PlanningProblem | None = None
    _next_id: int = 1000

    @property
    def benchmark_id(self) -> str:
        """Such as DEU_Intersection-1_1_T-1."""
        return f"{self.country}_{self.name}-1_1_T-1"

    def drive(self, ego: Driver, others: Sequence[Driver], record_ego: bool = False) -> Array:
        """Simulate all together and record the others; returns the ego's recording.

        The ego is part of the simulation, so that those behind it behave, but it is written to
        the file only where `record_ego` asks for it.
        """
        first, *rest = simulate([ego, *others], self.steps, self.dt)
        if record_ego:
            self.record(ego.kind, rectangle(ego.length, ego.width), first)
        for driver, states in zip(others, rest, strict=True):
            self.record(driver.kind, rectangle(driver.length, driver.width), states)
        return first

    def record(self, kind: str, shape: ObstacleShape, states: Array) -> None:
        """Add a moving obstacle from its states (n, 5): x, y, heading, speed, acceleration."""
        later = [ExtendedPMState(**_state(row, k)) for k, row in enumerate(states) if k > 0]
        prediction = TrajectoryPrediction(Trajectory(1, later), shape)
        self._add_dynamic(kind, shape, states[0], prediction)

    def record_set(
        self, kind: str, shape: ObstacleShape, state: Array, sets: Sequence[Occupancy]
    ) -> None:
        """Add an obstacle that is known as a set: `sets[k]` holds it at step k + 1."""
        occupancies: dict[int, Occupancy] = {k + 1: region for k, region in enumerate(sets)}
        self._add_dynamic(kind, shape, state, SetBasedPrediction(1, occupancies))

    def place(self, kind: str, shape: ObstacleShape, x: float, y: float, heading: float) -> None:
        """Add a static obstacle."""
        state = InitialState(
            time_step=0,
            position=np.round([x, y], 3),
            orientation=_angle(heading),
            velocity=0.0,
        )
        self._obstacles.append(StaticObstacle(self._new_id(), TYPES[kind], shape, state))

    def plan(
        self,
        state: Sequence[float],
        goal_lanelets: Sequence[int] = (),
        goal_shape: Occupancy | None = None,
        times: tuple[int, int] | None = None,
    ) -> None:
        """The ego's initial state (x, y, heading, speed, acceleration) and its goal."""
        initial = InitialState(**_state(np.asarray(state), 0), yaw_rate=0.0, slip_angle=0.0)
        network = self.road.network
        if goal_shape is None:
            goal_shape = OccupancyGroup(
                tuple(network.find_lanelet_by_id(i).polygon for i in goal_lanelets)
            )
        interval = Interval(*(times or (self.steps - 10, self.steps)))
        goal = CustomState(position=goal_shape, time_step=interval)
        lanelets = {0: list(goal_lanelets)} if goal_lanelets else None
        self._problem = PlanningProblem(self._new_id(), initial, GoalRegion([goal], lanelets))

    def scenario(self) -> tuple[Scenario, PlanningProblemSet]:
        """The finished scenario and its planning problem."""
        assert self._problem is not None
        year, month, day = map(int, DATE.split("-"))
        information = FileInformation(Time(0, 0, day, month, year), AUTHOR, "", SOURCE)
        scenario = Scenario(
            self.dt,
            ScenarioID(False, self.country, self.name, 1, 1, "T", 1),
            information,
            set(self.tags),
            self._environment(),
        )
        self.road.network.meta_information = MapMetaInformation(
            ScenarioID(False, self.country, self.name, 1), information
        )
        scenario.add_objects(self.road.network)
        scenario.add_objects(self._obstacles)
        return scenario, PlanningProblemSet([self._problem])

    def _environment(self) -> Environment | None:
        if self.weather is None and self.time_of_day is None:
            return None
        return Environment(
            Time(*((21, 30) if self.time_of_day == "night" else (9, 0))),
            TimeOfDay(self.time_of_day or "unknown"),
            Weather(self.weather or "unknown"),
            Underground("wet" if "rain" in (self.weather or "") else "clean"),
        )

    def _add_dynamic(
        self,
        kind: str,
        shape: ObstacleShape,
        state: Array,
        prediction: TrajectoryPrediction | SetBasedPrediction,
    ) -> None:
        initial = InitialState(**_state(state, 0), yaw_rate=0.0, slip_angle=0.0)
        self._obstacles.append(
            DynamicObstacle(self._new_id(), TYPES[kind], shape, initial, prediction)
        )

    def _new_id(self) -> int:
        self._next_id += 1
        return self._next_id


def rectangle(length: float, width: float) -> RectObstacleShape:
    """A rectangle; commonroad-io takes the width first."""
    return RectObstacleShape(width=width, length=length)


def _state(row: Array, step: int) -> dict[str, object]:
    x, y, heading, speed, acceleration = (float(value) for value in row)
    return {
        "time_step": step,
        "position": np.round([x, y], 3) + 0.0,
        "orientation": _angle(heading),
        "velocity": round(speed, 3) + 0.0,
        "acceleration": round(acceleration, 3) + 0.0,
    }


def _angle(heading: float) -> float:
    """Within (-pi, pi], to 1e-4 rad."""
    return round(float(np.arctan2(np.sin(heading), np.cos(heading))), 4) + 0.0


def xml(draft: Draft) -> bytes:
    """The scenario as CommonRoad 2020a XML."""
    (content,) = _written(draft, FileFormat.XML).values()
    tree = etree.fromstring(content)
    tree.set("date", DATE)
    _sort_sets(tree)
    return _formatted(tree)


def protobuf(draft: Draft) -> dict[str, bytes]:
    """The scenario as CommonRoad protobuf: file name -> content of its three files."""
    dynamic, scenario = CommonRoadDynamic(), CommonRoadScenario()
    files = _written(draft, FileFormat.PROTOBUF)
    name = draft.benchmark_id
    dynamic.ParseFromString(files[f"{name}.pb"])
    scenario.ParseFromString(files[f"{name}-SC.pb"])
    # commonroad-io writes the present time, and tags in an order that changes from run to run.
    for problem in scenario.planning_problems:
        tags = sorted(problem.scenario_tags.tags)
        del problem.scenario_tags.tags[:]
        problem.scenario_tags.tags.extend(tags)
    for information in (dynamic.dynamic_meta_information, scenario.scenario_meta_information):
        date = information.file_information.date
        date.year, date.month, date.day = map(int, DATE.split("-"))
        date.hour, date.minute = 0, 0
    return files | {
        f"{name}.pb": dynamic.SerializeToString(deterministic=True),
        f"{name}-SC.pb": scenario.SerializeToString(deterministic=True),
    }


def xml_2018b(draft: Draft) -> bytes:
    """The scenario as CommonRoad 2018b XML.

    That version knows no signs, lights, intersections, environments or lanelet types; obstacles
    carry their role as an element, and a speed limit belongs to the lanelet.
    """
    tree = etree.fromstring(xml(draft))
    tree.set("commonRoadVersion", "2018b")
    tags = tree.find("scenarioTags")
    tree.set("tags", " ".join(tag.tag for tag in tags))
    limits = {
        sign.get("id"): sign.findtext(".//additionalValue") for sign in tree.findall("trafficSign")
    }
    for name in ("location", "scenarioTags", "trafficSign", "trafficLight", "intersection"):
        for node in tree.findall(name):
            tree.remove(node)
    for lanelet in tree.findall("lanelet"):
        signs = [node.get("ref") for node in lanelet.findall("trafficSignRef")]
        for name in ("laneletType", "userOneWay", "trafficSignRef", "trafficLightRef", "stopLine"):
            for node in lanelet.findall(name):
                lanelet.remove(node)
        if signs and limits[signs[0]] is not None:
            etree.SubElement(lanelet, "speedLimit").text = limits[signs[0]]
    for role in ("static", "dynamic"):
        for node in tree.findall(f"{role}Obstacle"):
            node.tag = "obstacle"
            node.insert(0, etree.Element("role"))
            node[0].text = role
    return _formatted(tree)


def _written(draft: Draft, file_format: FileFormat) -> dict[str, bytes]:
    """File name -> content of what commonroad-io writes."""
    scenario, problems = draft.scenario()
    writer = CommonRoadFileWriter(
        scenario,
        problems,
        author=AUTHOR,
        affiliation="",
        source=SOURCE,
        tags=set(draft.tags),
        decimal_precision=4,
        file_format=file_format,
    )
    name = draft.benchmark_id
    always = OverwriteExistingFile.ALWAYS
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder)
        # commonroad-io warns of names that only a later format has; the file is 2020a.
        logging.disable(logging.WARNING)
        try:
            if file_format is FileFormat.XML:
                writer.write_to_file(str(out / f"{name}.xml"), always)
            else:
                # The protobuf format gives each bound an id of its own.
                for lanelet in scenario.lanelet_network.lanelets:
                    lanelet.left_bound = 100_000 + 2 * lanelet.lanelet_id
                    lanelet.right_bound = lanelet.left_bound + 1
                writer.write_map_to_file(str(out / f"{draft.country}_{draft.name}-1.pb"), always)
                writer.write_dynamic_to_file(str(out / f"{name}.pb"), always)
                writer.write_scenario_to_file(str(out / f"{name}-SC.pb"), always)
        finally:
            logging.disable(logging.NOTSET)
        return {path.name: path.read_bytes() for path in sorted(out.iterdir())}


def _sort_sets(tree: etree._Element) -> None:
    """commonroad-io writes Python sets in an order that changes from run to run."""
    sets = {"laneletType", "userOneWay", "trafficSignRef", "trafficLightRef", "incomingLanelet"}
    sets |= {"successorsRight", "successorsStraight", "successorsLeft"}
    for parent in tree.iter("scenarioTags", "lanelet", "incoming", "stopLine"):
        groups: dict[str, list[etree._Element]] = {}
        for child in parent:
            if parent.tag == "scenarioTags" or child.tag in sets:
                group = "tag" if parent.tag == "scenarioTags" else child.tag
                groups.setdefault(group, []).append(child)
        for children in groups.values():
            place = parent.index(children[0])
            children.sort(key=lambda c: (c.tag, int(c.get("ref", "0")), c.text or ""))
            for i, child in enumerate(children):
                parent.remove(child)
                parent.insert(place + i, child)


def _formatted(tree: etree._Element) -> bytes:
    """Indented, but with each point and each state on one line: a third of the size."""
    etree.indent(tree, " ")
    for node in tree.iter("point", "state", "occupancy", "initialState", "cycleElement"):
        for inner in node.iter():
            if inner is not node:
                inner.tail = None
            if inner.text is not None and not inner.text.strip():
                inner.text = None
    return bytes(etree.tostring(tree, xml_declaration=True, encoding="utf-8")) + b"\n"
