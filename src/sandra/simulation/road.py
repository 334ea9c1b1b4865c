"""highway-env's road, without what it computes many times over; and cheap copies of it.

The results are the library's to the last bit (a test compares them); a decision step with 50
vehicles costs about a quarter.
"""

from __future__ import annotations

import copy
from collections import deque
from typing import Any

import numpy as np
from highway_env.road.lane import StraightLane
from highway_env.road.road import Road, RoadNetwork
from highway_env.vehicle.objects import Landmark

REACH = 1e-6
"""Pairs are handed to the collision check up to this far beyond its own bound [m]."""


class QuickRoad(Road):  # type: ignore[misc]
    """A road that looks up once per tick, not once per question, who is on which lane."""

    _lanes: dict[Any, tuple[dict[int, float], list[tuple[float, Any]]]] | None = None
    """By lane, while all decide: s of each vehicle on the road, and (s, vehicle) on the lane."""

    @classmethod
    def of(cls, road: Any) -> Any:
        """The same road, its vehicles and objects moved over; itself if it has rules of its own."""
        if type(road) is not Road:  # At the intersection, it makes vehicles yield.
            return road
        quick = cls.__new__(cls)
        quick.__dict__.update(road.__dict__)
        quick.network = QuickNetwork.of(road.network)
        for body in (*quick.vehicles, *quick.objects):
            body.road = quick
        return quick

    def act(self) -> None:
        """All decide. Nobody moves meanwhile, so places are looked up only once."""
        self._lanes = {}
        try:
            super().act()
        finally:
            self._lanes = None

    def step(self, dt: float) -> None:
        """All move; then collisions, of those that are near each other."""
        vehicles = self.vehicles
        for vehicle in vehicles:
            vehicle.step(dt)
        if len(vehicles) < 2:
            near = np.zeros((len(vehicles),) * 2, dtype=bool)
        else:
            xy = np.array([v.position for v in vehicles])
            half = np.array([v.diagonal for v in vehicles]) / 2
            far = np.hypot(*(xy[:, None] - xy[None]).transpose(2, 0, 1))
            bound = half[:, None] + half + dt * np.array([[v.speed] for v in vehicles])
            near = ~(far > bound + REACH)
        for i, vehicle in enumerate(vehicles):
            for j in np.flatnonzero(near[i, i + 1 :]):
                vehicle.handle_collisions(vehicles[i + 1 + j], dt)
            for other in self.objects:
                vehicle.handle_collisions(other, dt)

    def neighbour_vehicles(self, vehicle: Any, lane_index: Any = None) -> tuple[Any, Any]:
        """The vehicles before and behind a vehicle, on its lane or on another."""
        lane_index = lane_index or vehicle.lane_index
        if self._lanes is None or self.neighbour_vehicles_connected_lanes or not lane_index:
            return super().neighbour_vehicles(vehicle, lane_index)  # type: ignore[no-any-return]
        if lane_index not in self._lanes:
            self._lanes[lane_index] = self._places(self.network.get_lane(lane_index))
        places, on_lane = self._lanes[lane_index]
        s = places.get(id(vehicle))
        if s is None:  # not on this road
            return super().neighbour_vehicles(vehicle, lane_index)  # type: ignore[no-any-return]
        front = rear = None
        s_front = s_rear = 0.0
        for s_v, v in on_lane:
            if v is vehicle:
                continue
            if s <= s_v and (front is None or s_v <= s_front):
                s_front, front = s_v, v
            if s_v < s and (rear is None or s_v > s_rear):
                s_rear, rear = s_v, v
        return front, rear

    def _places(self, lane: Any) -> tuple[dict[int, float], list[tuple[float, Any]]]:
        bodies = self.vehicles + self.objects
        if _along_x(lane):
            x0, y0 = lane.start.tolist()
            both = [(float(v.position[0]) - x0, float(v.position[1]) - y0) for v in bodies]
            half, low = lane.width / 2 + 1, -lane.VEHICLE_LENGTH
            high = float(lane.length) + lane.VEHICLE_LENGTH
            on = [abs(r) <= half and low <= s < high for s, r in both]
        else:
            both = [lane.local_coordinates(v.position) for v in bodies]
            on = [
                lane.on_lane(v.position, s, r, margin=1)
                for v, (s, r) in zip(bodies, both, strict=True)
            ]
        places = {id(v): s for v, (s, _) in zip(bodies, both, strict=True)}
        on_lane = [
            (places[id(v)], v)
            for v, is_on in zip(bodies, on, strict=True)
            if is_on and not isinstance(v, Landmark)
        ]
        return places, on_lane


class QuickNetwork(RoadNetwork):  # type: ignore[misc]
    """Parallel straight lanes along x, as those of highway-v0."""

    @classmethod
    def of(cls, network: Any) -> Any:
        """The same network; itself if it has other lanes."""
        lanes = network.lanes_list()
        if not all(_along_x(lane) and lane.heading == lanes[0].heading for lane in lanes):
            return network
        quick = cls.__new__(cls)
        quick.__dict__.update(network.__dict__)
        return quick

    def get_closest_lane_index(self, position: Any, heading: float | None = None) -> Any:
        """The index of the closest lane: the library's sums, the angle computed only once."""
        if heading is None:
            return super().get_closest_lane_index(position, heading)
        x, y = position.tolist()
        angle = best = closest = None
        for start, ends in self.graph.items():
            for end, lanes in ends.items():
                for number, lane in enumerate(lanes):
                    x0, y0 = lane.start.tolist()
                    s = x - x0
                    if angle is None:
                        angle = float(np.abs(lane.local_angle(heading, s)))
                    far = abs(y - y0) + max(s - float(lane.length), 0) + max(0 - s, 0) + angle
                    if best is None or far < best:
                        best, closest = far, (start, end, number)
        return closest


def _along_x(lane: Any) -> bool:
    """Whether the products of `local_coordinates` are exact, so that differences are the same."""
    return type(lane) is StraightLane and lane.direction[0] == 1 and lane.direction[1] == 0


def copy_world(env: Any) -> Any:
    """An independent copy of an environment for looking ahead: it acts, steps and collides alike.

    Lanes, configuration and spaces are shared with the original (nothing changes them in an
    episode); vehicles, objects, time and random numbers are not. It cannot be observed or drawn.
    """
    twin = copy.copy(env)
    twin.viewer = None
    road = twin.road = copy.copy(env.road)
    road.np_random = twin._np_random = copy.deepcopy(env.road.np_random)
    same: dict[int, Any] = {}
    for body in (*env.road.vehicles, *env.road.objects):
        new = same[id(body)] = copy.copy(body)
        new.road = road
        new.position = np.array(body.position)
        for name in ("action", "route"):
            if getattr(body, name, None) is not None:
                setattr(new, name, copy.copy(getattr(body, name)))
        if hasattr(body, "history"):
            new.history, new.log = deque(body.history, body.history.maxlen), []
    road.vehicles = [same[id(v)] for v in env.road.vehicles]
    road.objects = [same[id(o)] for o in env.road.objects]
    twin.controlled_vehicles = [same[id(v)] for v in env.controlled_vehicles]
    return twin
