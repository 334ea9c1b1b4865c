"""What DiLu is told of a prompt: the facts behind it, as a `View`."""

from __future__ import annotations

import math
from collections.abc import Iterable

from sandra.actions import ActionPair
from sandra.describe.facts import BEHIND
from sandra.describe.types import ObstacleFacts, Situation
from sandra.rankers.dilu.view import RANGE, Car, LaneView, View

PAIRS = {
    "LANE_LEFT": ActionPair.parse("keep,left-lane"),
    "IDLE": ActionPair.parse("keep,follow-lane"),
    "LANE_RIGHT": ActionPair.parse("keep,right-lane"),
    "FASTER": ActionPair.parse("accelerate,follow-lane"),
    "SLOWER": ActionPair.parse("decelerate,follow-lane"),
}
"""What the actions mean. No action means `stop`, or a change of lane at another speed."""


def view_of(facts: Situation) -> View:
    """What is told of a situation; only actions whose pair is feasible are offered."""
    number = facts.lanes_left + 1

    def lane(relation: str, number: int) -> LaneView:
        return _lane(number, (o for o in facts.obstacles if _is_in(o, relation)))

    return View(
        lanes=facts.lanes_left + 1 + facts.lanes_right,
        own=lane("same", number),
        left=lane("left", number - 1) if facts.lanes_left else None,
        right=lane("right", number + 1) if facts.lanes_right else None,
        changing_to=None,
        speed=facts.speed,
        acceleration=facts.acceleration,
        allowed=frozenset(action for action, pair in PAIRS.items() if pair in facts.feasible),
        behind=BEHIND,
    )


def _is_in(o: ObstacleFacts, relation: str) -> bool:
    return o.relation == relation or (relation == "same" and o.in_ego_lane)


def _lane(number: int, obstacles: Iterable[ObstacleFacts]) -> LaneView:
    """The nearest ahead (whoever is beside counts as that) and behind."""
    near = sorted(obstacles, key=lambda o: abs(o.gap))
    ahead = [_car(o) for o in near if 0.0 <= o.gap <= RANGE]
    behind = [_car(o) for o in near if -BEHIND <= o.gap < 0.0]
    return LaneView(number, ahead[0] if ahead else None, behind[0] if behind else None)


def _car(o: ObstacleFacts) -> Car:
    kind = "unknown obstacle" if o.kind == "unknown" else o.kind
    along = math.cos(o.heading)
    return Car(abs(o.gap), o.speed * along, o.acceleration * along, kind)
