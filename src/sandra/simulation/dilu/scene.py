"""What DiLu's driver sees of an environment of highway-env."""

from __future__ import annotations

from typing import Any

from sandra.rankers.dilu.view import RANGE, Car, LaneView, View
from sandra.simulation.highway import Environment


def view(world: Environment) -> View:
    """What can be seen from the ego of an environment."""
    ego: Any = world.ego
    start, end, number = ego.lane_index
    target = int(ego.target_lane_index[2])
    lanes = len(ego.road.network.graph[start][end])
    index = int(ego.speed_to_index(ego.speed))
    speeds = ego.target_speeds

    def lane(n: int) -> LaneView | None:
        return _seen(ego, (start, end, n)) if 0 <= n < lanes else None

    return View(
        lanes=lanes,
        own=_seen(ego, ego.lane_index),
        left=lane(number - 1),
        right=lane(number + 1),
        changing_to=None if target == number else target + 1,
        speed=float(ego.speed),
        acceleration=float(ego.action["acceleration"]),
        target=float(ego.target_speed),
        slower=float(speeds[max(index - 1, 0)]),
        faster=float(speeds[min(index + 1, len(speeds) - 1)]),
    )


def _seen(ego: Any, lane_index: Any) -> LaneView:
    lane = ego.road.network.get_lane(lane_index)
    own = float(lane.local_coordinates(ego.position)[0])

    def car(other: Any) -> Car | None:
        if other is None:
            return None
        way = abs(float(lane.local_coordinates(other.position)[0]) - own)
        gap = way - float(ego.LENGTH + other.LENGTH) / 2
        action = getattr(other, "action", None) or {}
        rate = float(action.get("acceleration", 0.0))
        return None if gap > RANGE else Car(gap, float(other.speed), rate)

    front, rear = ego.road.neighbour_vehicles(ego, lane_index)
    return LaneView(lane_index[2] + 1, car(front), car(rear))
