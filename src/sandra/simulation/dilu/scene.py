"""The traffic around the ego as text: the nearest cars ahead and behind, lane by lane."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from sandra.simulation.highway import ACTIONS, Environment

RANGE = 100.0
"""Cars farther away are not told [m]."""


@dataclass(frozen=True, slots=True)
class Car:
    """Another car, relative to the ego's lane."""

    gap: float
    """Bumper to bumper [m]; negative where the two overlap along the road."""
    speed: float
    """[m/s]"""
    acceleration: float
    """[m/s^2]"""


@dataclass(frozen=True, slots=True)
class LaneView:
    """One lane: who is the nearest ahead and behind in it, None where nobody is in range."""

    number: int
    """From 1 at the left."""
    ahead: Car | None
    behind: Car | None


@dataclass(frozen=True, slots=True)
class View:
    """What the driver is told. `left` and `right` are None where there is no lane."""

    lanes: int
    own: LaneView
    left: LaneView | None
    right: LaneView | None
    changing_to: int | None
    """Number of the lane that a change under way leads to."""
    speed: float
    """Of the ego [m/s]."""
    acceleration: float
    """[m/s^2]"""
    target: float
    """The speed that the ego is going to [m/s]."""
    slower: float
    """That speed after SLOWER [m/s]."""
    faster: float
    """That speed after FASTER [m/s]."""

    def situation(self) -> str:
        """The situation in words; this is what memory is searched by."""
        lines = [
            f"The road has {self.lanes} lanes in your direction; lane 1 is the leftmost. "
            f"You are in lane {self.own.number}.",
            f"You drive {_rounded(self.speed)} m/s, your acceleration is "
            f"{_rounded(self.acceleration)} m/s², and you are set to {_rounded(self.target)} m/s.",
            *(
                []
                if self.changing_to is None
                else [f"You are changing to lane {self.changing_to}."]
            ),
            *_lane(f"Your lane (lane {self.own.number})", self.own),
        ]
        for side, lane in (("left", self.left), ("right", self.right)):
            if lane is None:
                lines.append(f"There is no lane on your {side}.")
            else:
                lines += _lane(f"The lane on your {side} (lane {lane.number})", lane)
        return "\n".join(lines)

    def choices(self) -> str:
        """The actions that can be chosen here, with the numbers they are answered by."""
        words = {
            "IDLE": "stay in the lane, and set to the same speed",
            "FASTER": f"set the speed to {_rounded(self.faster)} m/s",
            "SLOWER": f"set the speed to {_rounded(self.slower)} m/s",
        }
        if self.left is not None:
            words["LANE_LEFT"] = "change to the lane on your left"
        if self.right is not None:
            words["LANE_RIGHT"] = "change to the lane on your right"
        return "\n".join(
            f"{number} {action}: {words[action]}"
            for number, action in enumerate(ACTIONS)
            if action in words
        )

    def text(self) -> str:
        """Situation and choices, as one turn of the conversation."""
        return f"{self.situation()}\n\nYou can choose:\n{self.choices()}"


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


def _lane(title: str, lane: LaneView) -> list[str]:
    return [f"{title}:", _car("ahead", lane.ahead), _car("behind", lane.behind)]


def _car(place: str, car: Car | None) -> str:
    if car is None:
        return f"- {place}: nobody within {RANGE:g} m"
    where = f"{_rounded(car.gap)} m away"
    if car.gap <= 0.0:
        where = f"beside you, overlapping by {_rounded(-car.gap)} m"
    return (
        f"- {place}: a car {where}, at {_rounded(car.speed)} m/s, "
        f"acceleration {_rounded(car.acceleration)} m/s²"
    )


def _rounded(value: float) -> str:
    """One decimal, without a negative zero."""
    return f"{round(value, 1) + 0.0:.1f}"
