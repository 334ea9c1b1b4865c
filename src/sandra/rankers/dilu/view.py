"""What DiLu is told: the nearest cars ahead and behind, lane by lane, as data and as text."""

from __future__ import annotations

import math
from dataclasses import dataclass

from sandra.actions import META_ACTIONS

RANGE = 100.0
"""Cars farther away are not told [m]."""


@dataclass(frozen=True, slots=True)
class Car:
    """Another car, relative to the ego's lane."""

    gap: float
    """Bumper to bumper [m]; negative where the two overlap along the road, 0 if it is only known
    that they do."""
    speed: float
    """Along the road [m/s]; NaN if it is unknown."""
    acceleration: float
    """[m/s^2]"""
    kind: str = "car"


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
    target: float | None = None
    """The speed that the ego is going to [m/s]; None, like the next two, if it is set to none."""
    slower: float | None = None
    """That speed after SLOWER [m/s]."""
    faster: float | None = None
    """That speed after FASTER [m/s]."""
    allowed: frozenset[str] = frozenset(META_ACTIONS)
    """The actions that are offered, where there is a lane for them."""
    behind: float = RANGE
    """Cars farther behind are not told [m]."""

    def situation(self) -> str:
        """The situation in words; this is what memory is searched by."""
        speed, acceleration = _rounded(self.speed), _rounded(self.acceleration)
        lines = [
            f"The road has {_lanes(self.lanes)} in your direction; lane 1 is the leftmost. "
            f"You are in lane {self.own.number}.",
            f"You drive {speed} m/s, your acceleration is {acceleration} m/s²."
            if self.target is None
            else f"You drive {speed} m/s, your acceleration is {acceleration} m/s², "
            f"and you are set to {_rounded(self.target)} m/s.",
            *(
                []
                if self.changing_to is None
                else [f"You are changing to lane {self.changing_to}."]
            ),
            *self._lane(f"Your lane (lane {self.own.number})", self.own),
        ]
        for side, lane in (("left", self.left), ("right", self.right)):
            if lane is None:
                lines.append(f"There is no lane on your {side}.")
            else:
                lines += self._lane(f"The lane on your {side} (lane {lane.number})", lane)
        return "\n".join(lines)

    def choices(self) -> str:
        """The actions that can be chosen here, with the numbers they are answered by."""
        same = "keep the speed" if self.target is None else "set to the same speed"
        words = {
            "IDLE": f"stay in the lane, and {same}",
            "FASTER": _set_to("faster", self.faster),
            "SLOWER": _set_to("slower", self.slower),
        }
        if self.left is not None:
            words["LANE_LEFT"] = "change to the lane on your left"
        if self.right is not None:
            words["LANE_RIGHT"] = "change to the lane on your right"
        return "\n".join(
            f"{number} {action}: {words[action]}"
            for number, action in enumerate(META_ACTIONS)
            if action in words and action in self.allowed
        )

    def text(self) -> str:
        """Situation and choices, as one turn of the conversation."""
        return f"{self.situation()}\n\nYou can choose:\n{self.choices()}"

    def _lane(self, title: str, lane: LaneView) -> list[str]:
        return [
            f"{title}:",
            _car("ahead", lane.ahead, RANGE),
            _car("behind", lane.behind, self.behind),
        ]


def _lanes(number: int) -> str:
    return "1 lane" if number == 1 else f"{number} lanes"


def _set_to(how: str, speed: float | None) -> str:
    return f"drive {how}" if speed is None else f"set the speed to {_rounded(speed)} m/s"


def _car(place: str, car: Car | None, within: float) -> str:
    if car is None:
        return f"- {place}: nobody within {within:g} m"
    where = f"{_rounded(car.gap)} m away"
    if car.gap <= 0.0:
        where = "beside you" + (f", overlapping by {_rounded(-car.gap)} m" if car.gap else "")
    speed = "an unknown speed" if math.isnan(car.speed) else f"{_rounded(car.speed)} m/s"
    article = "an" if car.kind[:1] in "aeiou" else "a"
    return (
        f"- {place}: {article} {car.kind} {where}, at {speed}, "
        f"acceleration {_rounded(car.acceleration)} m/s²"
    )


def _rounded(value: float) -> str:
    """One decimal, without a negative zero."""
    return f"{round(value, 1) + 0.0:.1f}"
