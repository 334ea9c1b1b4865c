"""From a CommonRoad file to a `Scene`.

CommonRoad's files give positions of the centre of the body, angles counter-clockwise in rad, SI
units. commonroad-io objects are typed `Any`: the library has no type information.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sandra.errors import ScenarioError
from sandra.scene.file import Content, read
from sandra.scene.lanes import lanes_around
from sandra.scene.network import Network, ego_lanelet, lanelets_near, route_to
from sandra.scene.obstacles import (
    dynamic_obstacle,
    environment_obstacle,
    number,
    phantom_obstacle,
    point,
    region_of,
    split_ego,
    static_obstacle,
)
from sandra.scene.regulation import lights_ahead, own_limits, signs_ahead, speed_limits
from sandra.scene.road import road_type
from sandra.scene.types import Ego, Lanelet, Obstacle, Region, Scene, State
from sandra.settings import Settings

Array = NDArray[np.float64]


def load(
    path: str | Path, *, planning_problem: int | None = None, settings: Settings | None = None
) -> Scene:
    """Read a CommonRoad scenario (XML 2018b or 2020a, or protobuf) as a decision problem.

    The scene is that of the planning problem's initial time step; row 0 of every recording is
    that step. An obstacle that is the recording of the ego itself is taken out.

    Args:
        path: the file. planning_problem: id of the problem; by default the one with the lowest id.
        settings: gives the ego's size where the file does not record the ego.

    Raises:
        ScenarioError: one line that says why the file cannot be used.
    """
    path = Path(path)
    settings = settings or Settings()
    content = read(path)
    problem = _problem(content, planning_problem, path)
    try:
        return _scene(content, problem, settings, path)
    except ScenarioError as error:
        raise ScenarioError(f"{path}: {error}") from None


def _problem(content: Content, wanted: int | None, path: Path) -> Any:
    if wanted is None:
        return next(iter(content.problems.values()))
    if wanted not in content.problems:
        known = ", ".join(str(i) for i in content.problems)
        raise ScenarioError(f"{path}: no planning problem {wanted}; choose from {known}")
    return content.problems[wanted]


def _scene(content: Content, problem: Any, settings: Settings, path: Path) -> Scene:
    first = math.floor(number(problem.initial_state.time_step))
    state = _ego_state(content, problem)
    recorded, obstacles = split_ego(obstacles_from(content, first), state)
    ego = _ego(problem.planning_problem_id, state, recorded, content, settings)
    network = network_of(content)
    start = Start(
        ego,
        first,
        obstacles,
        None if recorded is None else recorded.states,
        _goal_lanelets(problem, network),
        _goal_region(problem),
    )
    return scene_from(content, network, start, path)


@dataclass(frozen=True, slots=True, eq=False)
class Start:
    """Whose decision problem it is, from which time step on, among whom, and where to.

    `recorded` is what the ego did from `step` on, (n, 5) as in `Scene`, None where it is not known;
    `goals` are the lanelets of the goal.
    """

    ego: Ego
    step: int
    obstacles: tuple[Obstacle, ...]
    recorded: Array | None = None
    goals: frozenset[int] = frozenset()
    goal: Region | None = None


def scene_from(content: Content, network: Network, start: Start, path: Path) -> Scene:
    """The scene of a start.

    Raises:
        ScenarioError: the ego is off the road.
    """
    scenario, ego, goals = content.scenario, start.ego, start.goals
    state = ego.state
    here = ego_lanelet(network, state.x, state.y, state.heading, goals)
    route = (route_to(network, here, goals) if goals else None) or (here,)
    lanes, meetings = lanes_around(network, here, route, state.speed)
    current = lanes[0]
    s = float(current.frame.to_curvilinear(np.array([[state.x, state.y]]))[0, 0])
    front = s + ego.length / 2
    country = _country(scenario)
    return Scene(
        name=path.stem if scenario.scenario_id is None else str(scenario.scenario_id),
        dt=float(scenario.dt),
        ego=ego,
        lanes=(*lanes, *(meeting.lane for meeting in meetings)),
        obstacles=start.obstacles,
        lanelets=tuple(network.values()),
        road_type=road_type(
            lanes,
            meetings,
            network,
            ego_lanelet=here,
            ego_s=s,
            in_intersections=_inside_intersections(scenario.lanelet_network),
            tags={str(tag.value) for tag in scenario.tags or ()},
        ),
        country=country,
        weather=content.facts.weather,
        time_of_day=content.facts.time_of_day,
        lights=lights_ahead(
            scenario.lanelet_network, current, network, ego_s=s, front=front, step=start.step
        ),
        signs=signs_ahead(scenario.lanelet_network, current, network, here, front),
        goal=start.goal,
        recorded_ego=start.recorded,
        source=path,
    )


def _ego_state(content: Content, problem: Any) -> State:
    """The initial state; the file's own numbers where commonroad-io lost them."""
    initial = problem.initial_state
    centre, _ = point(initial.position)
    given = (content.facts.initial or {}).get(problem.planning_problem_id, {})
    values = {
        "position": float(centre.sum()),
        "orientation": number(initial.orientation),
        "velocity": number(initial.velocity),
        "acceleration": given.get("acceleration", number(initial.acceleration)),
        "yaw rate": given.get("yawRate", number(initial.yaw_rate)),
        "steering angle": given.get("steeringAngle", math.nan),
    }
    for name, value in values.items():
        if not math.isfinite(value) and name != "steering angle":
            raise ScenarioError(
                f"planning problem {problem.planning_problem_id}: initial {name} = {value} is no "
                "finite number; mend it"
            )
    if values["velocity"] < 0.0:
        raise ScenarioError(
            f"planning problem {problem.planning_problem_id}: initial velocity = "
            f"{values['velocity']} m/s is negative; the ego must drive forwards"
        )
    return State(
        x=float(centre[0]),
        y=float(centre[1]),
        heading=values["orientation"],
        speed=values["velocity"],
        acceleration=values["acceleration"],
        steering_angle=values["steering angle"],
        yaw_rate=values["yaw rate"],
    )


def _ego(
    id: int, state: State, recorded: Obstacle | None, content: Content, settings: Settings
) -> Ego:
    """The ego with the size of its recording, if there is one.

    The wheelbase keeps its share of the length. A steering angle that the file does not give is
    that of a single-track model without slip: tan(delta) = wheelbase * yaw rate / speed.
    """
    size = settings.ego_length, settings.ego_width
    if recorded is not None:
        size = recorded.length, recorded.width
    wheelbase = settings.ego_wheelbase * size[0] / settings.ego_length
    if math.isnan(state.steering_angle):
        moving = state.speed > settings.v_err
        steering = math.atan(wheelbase * state.yaw_rate / state.speed) if moving else 0.0
        state = replace(state, steering_angle=steering)
    return Ego(id=id, state=state, length=size[0], width=size[1], wheelbase=wheelbase)


def obstacles_from(content: Content, first: int) -> tuple[Obstacle, ...]:
    """All obstacles: dynamic, static, environment, phantom; each by ascending id."""
    scenario, initial = content.scenario, content.facts.initial

    def by_id(obstacles: Any) -> Any:
        return sorted(obstacles, key=lambda obstacle: obstacle.obstacle_id)

    dynamic = [
        dynamic_obstacle(o, first, scenario.dt, None if initial is None else initial[o.obstacle_id])
        for o in by_id(scenario.dynamic_obstacles)
    ]
    static = [static_obstacle(o) for o in by_id(scenario.static_obstacles)]
    environment = [environment_obstacle(o) for o in by_id(scenario.environment_obstacle)]
    phantom = [phantom_obstacle(o, first) for o in by_id(scenario.phantom_obstacle)]
    return tuple(o for o in (*dynamic, *static, *environment, *phantom) if o is not None)


def network_of(content: Content) -> dict[int, Lanelet]:
    """All lanelets by ascending id, with the speed limit in force on each.

    Raises:
        ScenarioError: for borders that are none.
    """
    network = content.scenario.lanelet_network
    lanelets = sorted(network.lanelets, key=lambda lanelet: lanelet.lanelet_id)
    limits = speed_limits(own_limits(network), {x.lanelet_id: x.successor for x in lanelets})
    result: dict[int, Lanelet] = {}
    for lanelet in lanelets:
        id = lanelet.lanelet_id
        left = np.array(lanelet.left_vertices, dtype=float)[:, :2]
        right = np.array(lanelet.right_vertices, dtype=float)[:, :2]
        if len(left) != len(right) or len(left) < 2 or not np.isfinite([left, right]).all():
            raise ScenarioError(
                f"lanelet {id} needs two borders with the same number (>= 2) of finite points; "
                "mend it"
            )
        left.setflags(write=False)
        right.setflags(write=False)
        result[id] = Lanelet(
            id=id,
            left=left,
            right=right,
            kinds=tuple(sorted(str(kind.value) for kind in lanelet.lanelet_type)),
            successors=tuple(sorted(lanelet.successor)),
            predecessors=tuple(sorted(lanelet.predecessor)),
            adjacent_left=_adjacent(lanelet.adj_left, lanelet.adj_left_same_direction),
            adjacent_right=_adjacent(lanelet.adj_right, lanelet.adj_right_same_direction),
            speed_limit=limits.get(id),
        )
    return result


def _adjacent(id: int | None, same_direction: bool | None) -> tuple[int, bool] | None:
    return None if id is None else (id, bool(same_direction))


def _goal_lanelets(problem: Any, network: Network) -> frozenset[int]:
    """Lanelets that the goal names, else those that hold the centre of a goal position."""
    goal = problem.goal
    named = {i for ids in (goal.lanelets_of_goal_position or {}).values() for i in ids}
    for k, state in enumerate(goal.state_list):
        if getattr(state, "position", None) is None or k in (goal.lanelets_of_goal_position or {}):
            continue
        centre, _ = point(state.position)
        named.update(lanelets_near(network, float(centre[0]), float(centre[1])))
    return frozenset(named & set(network))


def _goal_region(problem: Any) -> Region | None:
    """The position of the first goal state as one convex region; None if it gives lanelets."""
    named: Mapping[int, Any] = problem.goal.lanelets_of_goal_position or {}
    for k, state in enumerate(problem.goal.state_list):
        position = getattr(state, "position", None)
        if k not in named and hasattr(position, "shapely_object"):
            return region_of(position)
    return None


def _inside_intersections(network: Any) -> Collection[int]:
    return {
        i
        for intersection in network.intersections
        for incoming in intersection.incomings
        for ids in (incoming.outgoing_left, incoming.outgoing_straight, incoming.outgoing_right)
        for i in ids or ()
    }


def _country(scenario: Any) -> str | None:
    """The country of the map; "ZAM" (Zamunda) is CommonRoad's name for no country."""
    country = getattr(scenario.scenario_id, "country_id", None)
    return None if country in (None, "", "ZAM") else str(country)
