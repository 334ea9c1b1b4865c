"""What the signs and lights along a lane say: speed limits, signs ahead, lights with their state.

The functions read commonroad-io objects (typed `Any`: the library has no type information).
"""

from __future__ import annotations

import heapq
import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from sandra.scene.types import Lane, Lanelet, TrafficLight, TrafficSign

_LIMIT = frozenset({"max_speed", "max_speed_zone_start"})
_LIMIT_ENDS = frozenset({"max_speed_end", "max_speed_zone_end", "all_max_speed_and_overtaking_end"})
_TURNS = {
    "left": {"left", "leftStraight", "leftRight"},
    "straight": {"straight", "leftStraight", "straightRight"},
    "right": {"right", "straightRight", "leftRight"},
}


def speed_limits(
    own: Mapping[int, float | None], successors: Mapping[int, Sequence[int]]
) -> dict[int, float]:
    """The limit in force on each lanelet [m/s]; lanelets without a known limit are left out.

    A limit applies to the lanelets that refer to its sign and stays in force on their successors
    until another sign. Where lanes with different limits meet, the lower one is taken.

    Args:
        own: the limit from a lanelet's own signs [m/s], None where a sign ends the limit; lanelets
            without such a sign are left out.
        successors: the successors of each lanelet.
    """
    limits = {i: limit for i, limit in own.items() if limit is not None}
    queue = [(limit, i) for i, limit in limits.items()]
    heapq.heapify(queue)
    while queue:
        limit, i = heapq.heappop(queue)
        for j in successors.get(i, ()):
            if j not in own and j not in limits:
                limits[j] = limit
                heapq.heappush(queue, (limit, j))
    return limits


def own_limits(network: Any) -> dict[int, float | None]:
    """The limit from the signs that each lanelet refers to: input of `speed_limits`."""
    by_id = {sign.traffic_sign_id: sign for sign in network.traffic_signs}
    own: dict[int, float | None] = {}
    for lanelet in network.lanelets:
        elements = [
            element
            for i in sorted(lanelet.traffic_signs)
            if i in by_id
            for element in by_id[i].traffic_sign_elements
        ]
        values = [
            value
            for element in elements
            if sign_name(element) in _LIMIT
            for text in element.additional_values[:1]
            if (value := _speed(text)) is not None
        ]
        if values:
            own[lanelet.lanelet_id] = min(values)
        elif any(sign_name(element) in _LIMIT_ENDS for element in elements):
            own[lanelet.lanelet_id] = None
    return own


def sign_name(element: Any) -> str:
    """CommonRoad's name of a sign in lower case, the same in every country, e.g. "max_speed"."""
    return str(element.traffic_sign_element_id.name).lower()


def _speed(text: Any) -> float | None:
    try:
        value = float(text)
    except (TypeError, ValueError):
        return None
    return value if math.isfinite(value) and value >= 0.0 else None


def _starts(lane: Lane, by_id: Mapping[int, Lanelet]) -> list[float]:
    """s of the start of each lanelet of the lane [m]."""
    starts = [by_id[i].center[:1] for i in lane.lanelets]
    return [float(s) for s in lane.frame.to_curvilinear(np.vstack(starts))[:, 0]]


def _ends(lane: Lane, by_id: Mapping[int, Lanelet]) -> list[float]:
    ends = [by_id[i].center[-1:] for i in lane.lanelets]
    return [float(s) for s in lane.frame.to_curvilinear(np.vstack(ends))[:, 0]]


def signs_ahead(
    network: Any, lane: Lane, by_id: Mapping[int, Lanelet], ego_lanelet: int, front: float
) -> tuple[TrafficSign, ...]:
    """The signs that lanelets of the lane refer to, from the ego's lanelet on; nearest first.

    Args:
        network: commonroad-io's lanelet network. lane: the current lane. by_id: its lanelets.
        ego_lanelet: where the list starts. front: s of the ego's front [m].
    """
    signs = {sign.traffic_sign_id: sign for sign in network.traffic_signs}
    found: dict[tuple[int, int], TrafficSign] = {}
    for index, (i, start) in enumerate(zip(lane.lanelets, _starts(lane, by_id), strict=True)):
        if index < lane.lanelets.index(ego_lanelet):
            continue
        for sign_id in sorted(network.find_lanelet_by_id(i).traffic_signs):
            elements = signs[sign_id].traffic_sign_elements if sign_id in signs else ()
            for k, element in enumerate(elements):
                found.setdefault(
                    (sign_id, k),
                    TrafficSign(
                        id=sign_id,
                        name=sign_name(element),
                        values=tuple(str(value) for value in element.additional_values),
                        distance=max(0.0, start - front),
                    ),
                )
    return tuple(sorted(found.values(), key=lambda sign: (sign.distance, sign.id)))


def lights_ahead(
    network: Any,
    lane: Lane,
    by_id: Mapping[int, Lanelet],
    *,
    ego_s: float,
    front: float,
    step: int,
) -> tuple[TrafficLight, ...]:
    """The lights that the ego's centre has not passed, nearest first, with their state at `step`.

    A light with arrows is left out where the lane turns another way. The distance is negative
    where the ego's front stands beyond the stop line.

    Args:
        network: commonroad-io's lanelet network. lane: the current lane. by_id: its lanelets.
        ego_s, front: s of the ego's centre and front [m]. step: the current time step.
    """
    lights = {light.traffic_light_id: light for light in network.traffic_lights}
    found: dict[int, TrafficLight] = {}
    for index, (i, end) in enumerate(zip(lane.lanelets, _ends(lane, by_id), strict=True)):
        lanelet = network.find_lanelet_by_id(i)
        stop = _stop_line(lanelet, lane)
        at = end if stop is None else min(stop, end)
        if at < ego_s:
            continue
        turn = _turn(network, i, lane.lanelets[index + 1 : index + 2])
        for light_id in sorted(lanelet.traffic_lights):
            light = lights.get(light_id)
            if light is None or light_id in found or not _applies(light, turn):
                continue
            found[light_id] = TrafficLight(light_id, light_state(light, step), at - front)
    return tuple(sorted(found.values(), key=lambda light: (light.distance, light.id)))


def _stop_line(lanelet: Any, lane: Lane) -> float | None:
    line = lanelet.stop_line
    if line is None or line.start is None or line.end is None:
        return None
    points = np.array([line.start[:2], line.end[:2]], dtype=float)
    return float(lane.frame.to_curvilinear(points)[:, 0].min())


def _turn(network: Any, lanelet: int, following: Iterable[int]) -> str | None:
    """The way the lane turns after a lanelet, by the map's intersections; None if not told."""
    for intersection in network.intersections:
        for incoming in intersection.incomings:
            if lanelet in incoming.incoming_lanelets:
                for j in following:
                    if j in incoming.outgoing_left:
                        return "left"
                    if j in incoming.outgoing_right:
                        return "right"
                    if j in incoming.outgoing_straight:
                        return "straight"
    return None


def _applies(light: Any, turn: str | None) -> bool:
    direction = light.direction.value
    return turn is None or direction == "all" or direction in _TURNS[turn]


def light_state(light: Any, step: int) -> str:
    """State of a commonroad-io light at a time step, as in `TrafficLight.state`."""
    cycle = light.traffic_light_cycle
    elements = [] if cycle is None else cycle.cycle_elements
    if sum(element.duration for element in elements or ()) <= 0:
        return "unknown"
    if light.active is False or cycle.active is False:
        return "inactive"
    return str(cycle.get_state_at_time_step(step).value)
