"""From the state of a highway-env simulation to a `Scene`.

highway-env counts y to the right of +x, and angles clockwise; CommonRoad and `Scene` count y to the
left, and angles counter-clockwise. So y, headings and steering angles change their sign here, and
left is left: d > 0. Reads plain attributes of the simulation's objects, imports nothing of it.

Expressed: lanes of any shape with their directions, neighbours and successors, speed limits, the
ego's route, vehicles, static obstacles. Not expressed: priorities at crossings of lanes (who yields
to whom), line markings, landmarks that mark a goal.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sandra.errors import ScenarioError
from sandra.scene.lanes import lanes_around
from sandra.scene.network import Network, ego_lanelet
from sandra.scene.road import road_type
from sandra.scene.types import Ego, Lanelet, Obstacle, Region, Scene, State

Array = NDArray[np.float64]
LaneIndex = tuple[str, str, int]

SPACING = 2.0
"""Distance between the points of a bent lane's borders [m]."""
FIRST_VEHICLE = 10_000
"""Vehicles get ids from here on, in the order in which the simulation lists them."""
LONG = 1500.0
"""A straight lane longer than this is taken in part: what matters to the ego is near [m]."""
BEHIND, AHEAD = 200.0, 500.0
"""This much of it, at least, behind and ahead of the ego [m]."""
MOVE = 100.0
"""The part moves on in steps of this length, so that a map serves many scenes [m]."""
_SAME_LINE = 0.1
"""Borders this close are the same line [m]."""


@dataclass(frozen=True, slots=True, eq=False)
class RoadMap:
    """The lanes of a simulated road as lanelets; `ids` names each by highway-env's lane index."""

    network: Network
    ids: dict[LaneIndex, int]

    @staticmethod
    def of(road_network: Any, around: tuple[float, float] | None = None) -> RoadMap:
        """All lanes of a `highway_env.road.road.RoadNetwork`.

        Args:
            around: a position of highway-env [m]; of `LONG` straight lanes only what is near it.

        Raises:
            ScenarioError: if it has no lane.
        """
        lanes = {
            (start, end, i): lane
            for start, ends in road_network.graph.items()
            for end, several in ends.items()
            for i, lane in enumerate(several)
        }
        if not lanes:
            raise ScenarioError("the simulated road has no lane: reset the environment first")
        ids = {index: number for number, index in enumerate(lanes, start=1)}
        borders = {index: _borders(lane, around) for index, lane in lanes.items()}
        network = {ids[index]: _lanelet(index, lane, ids, borders) for index, lane in lanes.items()}
        return RoadMap(network, ids)

    def route(self, here: int, route: Sequence[Any] | None) -> tuple[int, ...]:
        """The lanelets of a route of highway-env, from `here` on; `here` alone without one."""
        found = [here]
        for start, end, i in route or ():
            chosen = self.ids.get((start, end, self._beside(found[-1], i)))
            if chosen is not None and chosen != here:
                found.append(chosen)
        return tuple(found)

    def _beside(self, before: int, lane: int | None) -> int:
        """The position of a lane among its neighbours; that of the one before where it is free."""
        if lane is not None:
            return int(lane)
        return next(index[2] for index, number in self.ids.items() if number == before)


def _borders(lane: Any, around: tuple[float, float] | None) -> tuple[Array, Array]:
    """(n, 2) left and right border [m], y to the left."""
    straight = type(lane).__name__ == "StraightLane"
    count = 2 if straight else max(3, math.ceil(lane.length / SPACING) + 1)
    start, end = 0.0, lane.length
    if straight and lane.length > LONG and around is not None:
        here = lane.local_coordinates(np.array(around))[0]
        start, end = max(start, here - BEHIND - MOVE), min(end, here + AHEAD + MOVE)
    along = np.linspace(start, end, count)
    half = [lane.width_at(s) / 2 for s in along]
    flip = np.array([1.0, -1.0])
    left = np.array([lane.position(s, -w) for s, w in zip(along, half, strict=True)]) * flip
    right = np.array([lane.position(s, w) for s, w in zip(along, half, strict=True)]) * flip
    for line in (left, right):
        line.setflags(write=False)
    return left, right


def _lanelet(
    index: LaneIndex,
    lane: Any,
    ids: dict[LaneIndex, int],
    borders: dict[LaneIndex, tuple[Array, Array]],
) -> Lanelet:
    start, end, i = index
    left, right = borders[index]
    return Lanelet(
        id=ids[index],
        left=left,
        right=right,
        kinds=(),
        successors=tuple(_joined(borders, ids, index, end, forwards=True)),
        predecessors=tuple(_joined(borders, ids, index, start, forwards=False)),
        adjacent_left=_adjacent((start, end, i - 1), ids, borders, left, side=1)
        or _opposite(index, ids, borders, left, side=0),
        adjacent_right=_adjacent((start, end, i + 1), ids, borders, right, side=0)
        or _opposite(index, ids, borders, right, side=1),
        speed_limit=None if lane.speed_limit is None else float(lane.speed_limit),
    )


def _joined(
    borders: dict[LaneIndex, tuple[Array, Array]],
    ids: dict[LaneIndex, int],
    index: LaneIndex,
    node: str,
    *,
    forwards: bool,
) -> Iterator[int]:
    """Lanes at a node that go on where this one ends, or end where it begins."""
    ends = (-1, 0) if forwards else (0, -1)
    here = sum(line[ends[0]] for line in borders[index]) / 2
    course = _course(borders[index], ends[0])
    for other, number in ids.items():
        if other[0 if forwards else 1] != node:
            continue
        there = sum(line[ends[1]] for line in borders[other]) / 2
        # Where both directions share one lane, the other one is no way on.
        same_way = float(course @ _course(borders[other], ends[1])) > 0.0
        if same_way and float(np.linalg.norm(there - here)) <= 1.0:
            yield number


def _course(lines: tuple[Array, Array], end: int) -> Array:
    """(2,) direction of travel at the start (0) or the end (-1) of a lane."""
    first, second = (0, 1) if end == 0 else (-2, -1)
    return np.asarray(sum(line[second] - line[first] for line in lines))


def _adjacent(
    other: LaneIndex,
    ids: dict[LaneIndex, int],
    borders: dict[LaneIndex, tuple[Array, Array]],
    line: Array,
    side: int,
) -> tuple[int, bool] | None:
    """The lane of that index, if its border on that side is this line at one of its ends."""
    if other not in ids:
        return None
    there = borders[other][side]
    close = np.linalg.norm(there[[0, -1]] - line[[0, -1]], axis=1).min() <= 1.0
    return (ids[other], True) if close else None


def _opposite(
    index: LaneIndex,
    ids: dict[LaneIndex, int],
    borders: dict[LaneIndex, tuple[Array, Array]],
    line: Array,
    side: int,
) -> tuple[int, bool] | None:
    """The lane in the other direction whose border on its own same side is this line."""
    start, end, _ = index
    for other, number in ids.items():
        if other[:2] != (end, start):
            continue
        there = borders[other][side][::-1]
        if float(np.linalg.norm(there[[0, -1]] - line[[0, -1]], axis=1).max()) <= _SAME_LINE:
            return number, False
    return None


@dataclass(slots=True, eq=False)
class Observer:
    """Makes the scenes of one episode: the same map, and the same id for the same vehicle.

    Args of `of`: the simulation (`env.unwrapped`) after its reset, and the name of the scenes.
    """

    road: Any
    name: str
    dt: float
    whole: RoadMap
    """All lanes in full length."""
    near: tuple[tuple[float, float], RoadMap] | None = None
    """A position of the ego, and the map of what is near it."""
    ids: dict[int, int] = field(default_factory=dict)
    """Ids by the identity of the simulation's objects; these are kept in `_seen`, so that no
    identity is given away twice."""
    _seen: list[Any] = field(default_factory=list)

    @staticmethod
    def of(env: Any, name: str, dt: float) -> Observer:
        """See the class; `dt` is the step of the scenes [s]."""
        observer = Observer(env.road, name, dt, RoadMap.of(env.road.network))
        for body in (*env.road.vehicles, *env.road.objects):
            observer.id_of(body)
        return observer

    def id_of(self, body: Any) -> int:
        """The id of a vehicle or object of the simulation."""
        if id(body) not in self.ids:
            self.ids[id(body)] = FIRST_VEHICLE + len(self._seen)
            self._seen.append(body)
        return self.ids[id(body)]

    def state(self, body: Any) -> State:
        """The state of a vehicle or object of the simulation."""
        action = getattr(body, "action", None) or {}
        return State(
            x=float(body.position[0]),
            y=-float(body.position[1]),
            heading=-float(body.heading),
            speed=float(getattr(body, "speed", 0.0)),
            acceleration=float(action.get("acceleration", 0.0)),
            steering_angle=-float(action.get("steering", 0.0)),
        )

    def scene(self, vehicle: Any) -> Scene:
        """The scene around a vehicle of the simulation, now.

        Raises:
            ScenarioError: if its centre is off the road.
        """
        state = self.state(vehicle)
        road_map = self._near(vehicle)
        network = road_map.network
        here = ego_lanelet(network, state.x, state.y, state.heading, ())
        route = road_map.route(here, getattr(vehicle, "route", None))
        lanes, meetings = lanes_around(network, here, route, state.speed)
        s = float(lanes[0].frame.to_curvilinear(np.array([[state.x, state.y]]))[0, 0])
        length, width = float(vehicle.LENGTH), float(vehicle.WIDTH)
        return Scene(
            name=self.name,
            dt=self.dt,
            # The slip of highway-env's model is that of a single-track model with this wheelbase.
            ego=Ego(self.id_of(vehicle), state, length, width, wheelbase=length),
            lanes=(*lanes, *(meeting.lane for meeting in meetings)),
            obstacles=tuple(self._obstacles(vehicle)),
            lanelets=tuple(network.values()),
            road_type=road_type(
                lanes,
                meetings,
                network,
                ego_lanelet=here,
                ego_s=s,
                in_intersections=(),
                tags=(),
            ),
        )

    def _near(self, vehicle: Any) -> RoadMap:
        x, y = map(float, vehicle.position)
        if self.near is None or math.dist(self.near[0], (x, y)) > MOVE:
            self.near = (x, y), RoadMap.of(self.road.network, (x, y))
        return self.near[1]

    def _obstacles(self, ego: Any) -> Iterator[Obstacle]:
        for body in self.road.vehicles:
            if body is not ego:
                outline = Region.rectangle(float(body.LENGTH), float(body.WIDTH))
                yield Obstacle(self.id_of(body), "car", outline, self.state(body))
        for body in self.road.objects:
            if body.solid:
                outline = Region.rectangle(float(body.LENGTH), float(body.WIDTH))
                yield Obstacle(
                    self.id_of(body), "unknown", outline, self.state(body), is_static=True
                )
