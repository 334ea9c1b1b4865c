"""A plain rule-based ranker: no model, no network, no chance.

It asks what an ordinary driver would: how fast may I and do I want to go, who is in front, is the
light red, is the lane beside me better and free. Every pair gets a score, and the best k are
returned with the reasons in words.

* Longitudinal: the acceleration a* that the intelligent driver model (IDM; Treiber, Hennecke,
  Helbing 2000) takes behind whatever is next in front: the leader, somebody who will be met in
  the lane, a red light. The nearer an action comes to a*, the better.
* Lateral: a lane is chosen for the acceleration it allows, against a threshold, and only if
  nobody is beside, the gap in front suffices, and the one behind need not brake hard (MOBIL;
  Kesting, Treiber, Helbing 2007).

It knows only `Prompt.situation`. It promises nothing: safety is the verifier's business.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from sandra.actions import ActionPair, Lateral, Longitudinal
from sandra.describe.types import ObstacleFacts, Prompt, Situation
from sandra.rankers.types import Ranking
from sandra.rankers.wish import Wish, read_wish

_MAX_ACCELERATION = 1.5
"""IDM a [m/s^2]."""
_COMFORT = 2.0
"""IDM b, comfortable braking [m/s^2]."""
_STANDSTILL_GAP = 2.0
"""IDM s_0 [m]."""
_HARDEST = -8.0
"""Below this, IDM accelerations all mean the same [m/s^2]."""
_TIME_GAP = {-1: 2.2, 0: 1.5, 1: 1.0}
"""IDM T by the pace that the driver wishes [s]."""
_PACE = {-1: 0.8, 0: 1.0, 1: 1.1}
"""Part of the usual speed that the driver wishes; never above the limit."""
_USUAL_SPEED = {
    "highway": 33.3,
    "merge": 25.0,
    "rural": 25.0,
    "urban": 13.9,
    "intersection": 13.9,
    "residential": 8.3,
}
"""Desired speed by road type where no limit is known [m/s]."""
_QUEUE_GAP = 10.0
"""Behind somebody who stands this near, an ego that stands stays where it is [m]."""
_DECENT_BRAKING = 5.0
"""A standstill that needs more than this within the horizon is not proposed [m/s^2]."""
_MEET = 5.0
"""Whoever would be met within this time is treated as standing in the way [s]."""
_CHANGE_THRESHOLD = 0.4
"""A change of lane must gain this acceleration [m/s^2]."""
_REAR_BRAKING = -2.0
"""Nobody behind may have to brake harder than this for a change of lane [m/s^2]."""
_FRONT_BRAKING = -3.0
"""A lane in which the ego itself had to brake harder than this is not entered [m/s^2]."""
_YELLOW_BRAKING = 3.0
"""A yellow light is passed if stopping needed more than this [m/s^2]."""
_STANDING = 0.5
"""Below this speed somebody counts as standing [m/s]."""
_CLEAR = 0.7
"""An acceleration that is clearly one, or clearly a braking [m/s^2]."""
_TIE = 0.5
"""Decides for a standstill where braking would do as well [m/s^2]."""
_UNSAFE = -50.0
_WISHED = 3.0
_UNWISHED = -20.0
_SIDES = {Lateral.LEFT_LANE: "left", Lateral.RIGHT_LANE: "right"}


@dataclass(frozen=True, slots=True)
class Ahead:
    """Something to keep a gap to [m], with its speed along the lane [m/s] and its name."""

    gap: float
    speed: float
    name: str


@dataclass(frozen=True, slots=True)
class Option:
    """A lateral action: the acceleration it allows, its worth [m/s^2], and why."""

    lateral: Lateral
    acceleration: float
    worth: float
    ahead: Ahead | None
    why: str


@dataclass(frozen=True, slots=True)
class RulesRanker:
    """See the module. Deterministic; always answers with k pairs."""

    name: str = "rules"

    def rank(self, prompt: Prompt, deadline: float | None = None) -> Ranking:
        """See `Ranker`."""
        facts = prompt.situation
        wish = read_wish(facts.command)
        options = [_option(facts, lateral, wish) for lateral in prompt.lateral]
        scored = [
            (option.worth + _longitudinal_score(lon, option, facts, wish), lon, option)
            for lon in prompt.longitudinal
            for option in options
            if ActionPair(lon, option.lateral) in prompt.feasible
        ]
        scored.sort(key=lambda item: -item[0])
        pairs = tuple(ActionPair(lon, option.lateral) for _, lon, option in scored[: prompt.k])
        best = next(option for option in options if option.lateral is pairs[0].lateral)
        return Ranking(pairs, self.name, reasoning=_reasons(facts, wish, best, options))


def desired_speed(facts: Situation, wish: Wish) -> float:
    """The speed that the driver wants [m/s].

    Never above the limit; where none is known, usual for the road or the present one if higher.
    """
    limit = facts.speed_limit
    if limit is not None:
        return min(limit * _PACE[wish.pace], limit)
    return max(_USUAL_SPEED.get(facts.road_type, 8.3), facts.speed) * _PACE[wish.pace]


def idm(speed: float, desired: float, time_gap: float, ahead: Ahead | None) -> float:
    """Acceleration of the intelligent driver model [m/s^2], at least `_HARDEST`."""
    free = 1.0 - (speed / max(desired, 0.1)) ** 4
    if ahead is None:
        return max(_MAX_ACCELERATION * free, -_COMFORT)
    closing = speed * (speed - ahead.speed) / (2.0 * math.sqrt(_MAX_ACCELERATION * _COMFORT))
    wanted_gap = _STANDSTILL_GAP + max(0.0, speed * time_gap + closing)
    pull = (wanted_gap / max(ahead.gap, 0.1)) ** 2
    return max(_MAX_ACCELERATION * (max(free, -_COMFORT) - pull), _HARDEST)


def _option(facts: Situation, lateral: Lateral, wish: Wish) -> Option:
    lane = _SIDES.get(lateral, "same")
    desired, time_gap = desired_speed(facts, wish), _TIME_GAP[wish.pace]
    choices = [(idm(facts.speed, desired, time_gap, a), a) for a in _in_front(facts, lane)]
    acceleration, ahead = min(
        choices, key=lambda c: c[0], default=(idm(facts.speed, desired, time_gap, None), None)
    )
    if lane == "same":
        return Option(lateral, acceleration, acceleration, ahead, "")
    obstacle = _hindrance(facts, lane, acceleration, time_gap)
    if obstacle is not None:
        return Option(lateral, acceleration, _UNSAFE, ahead, obstacle)
    worth = acceleration - _CHANGE_THRESHOLD
    if wish.side == lane:
        worth += _WISHED
    if wish.stay:
        worth += _UNWISHED
    return Option(lateral, acceleration, worth, ahead, "")


def _in_front(facts: Situation, lane: str) -> list[Ahead]:
    """Whatever the ego would have to keep a gap to in a lane: leaders, crossers, a light."""
    found = []
    for o in facts.obstacles:
        in_way = o.relation == lane or (
            lane == "same" and (o.in_ego_lane or o.time_to_collision <= _MEET)
        )
        if in_way and o.gap > 0.0 and not _can_be_passed(o):
            found.append(Ahead(o.gap, _along(o), f"{o.kind} {o.id}"))
    if facts.light_distance is not None and _must_stop(facts):
        found.append(Ahead(facts.light_distance, 0.0, f"{facts.light} light"))
    return found


def _can_be_passed(o: ObstacleFacts) -> bool:
    """Something static beside the ego's path, which the boxes never touch."""
    return o.is_static and o.lateral_gap != 0.0 and math.isinf(o.time_to_collision)


def _must_stop(facts: Situation) -> bool:
    distance = max(facts.light_distance or 0.0, 0.1)
    needed = facts.speed**2 / (2.0 * distance)
    if facts.light in ("red", "redYellow"):
        return True
    return facts.light == "yellow" and needed <= _YELLOW_BRAKING


def _along(o: ObstacleFacts) -> float:
    """Speed along the ego's lane [m/s]; 0 where unknown: the one to be careful about."""
    along = 0.0 if math.isnan(o.speed) else o.speed * math.cos(o.heading)
    return along if abs(along) > 0.05 else 0.0


def _hindrance(facts: Situation, lane: str, acceleration: float, time_gap: float) -> str | None:
    """Why the lane must not be entered now, None if nothing speaks against it."""
    if acceleration < _FRONT_BRAKING:
        return "the gap in front is too small"
    for o in facts.obstacles:
        if o.relation != lane:
            continue
        if o.gap == 0.0:
            return f"{o.kind} {o.id} is beside me"
        if o.gap < 0.0 and not o.is_static:
            speed = max(_along(o), 0.0)
            braking = idm(speed, max(speed, 0.1), time_gap, Ahead(-o.gap, facts.speed, ""))
            if braking < _REAR_BRAKING:
                return f"{o.kind} {o.id} behind would have to brake"
    return None


def _wanted(facts: Situation, option: Option, wish: Wish) -> float:
    """The acceleration to aim at on this lane [m/s^2]."""
    wanted = option.acceleration
    ahead = option.ahead
    if ahead is not None and facts.speed < _STANDING and ahead.speed < _STANDING:
        wanted = 0.0 if ahead.gap < _QUEUE_GAP else wanted
    if facts.speed_limit is not None and facts.speed > facts.speed_limit:
        wanted = min(wanted, -_MAX_ACCELERATION)
    return min(wanted, -_COMFORT) if wish.stop else wanted


def _longitudinal_score(
    longitudinal: Longitudinal, option: Option, facts: Situation, wish: Wish
) -> float:
    """Minus the distance between the acceleration wanted and the nearest of the action [m/s^2]."""
    wanted = _wanted(facts, option, wish)
    to_standstill = -facts.speed / facts.horizon
    if longitudinal is Longitudinal.KEEP:
        return -abs(wanted)
    if longitudinal is Longitudinal.ACCELERATE:
        return -abs(wanted - max(wanted, _CLEAR))
    if longitudinal is Longitudinal.DECELERATE:
        impossible = facts.speed < _CLEAR * facts.horizon / 2  # nothing left to lose
        return -abs(wanted - min(wanted, -_CLEAR)) - (_WISHED if impossible else 0.0)
    if to_standstill < -_DECENT_BRAKING:
        return _UNSAFE / 2
    score = -max(wanted - to_standstill, 0.0)
    halts = facts.speed < _STANDING and wanted <= 0.0
    return score + (_WISHED if wish.stop else _TIE if halts or _stops_there(facts, option) else 0.0)


def _stops_there(facts: Situation, option: Option) -> bool:
    """Whether standing at the end of the horizon is right before something that stands."""
    if option.ahead is None or option.ahead.speed >= _STANDING:
        return False
    return option.ahead.gap - facts.speed * facts.horizon / 2.0 < _QUEUE_GAP


def _reasons(facts: Situation, wish: Wish, best: Option, options: Sequence[Option]) -> str:
    desired = desired_speed(facts, wish)
    told = [f"I drive {facts.speed:.1f} m/s and want {desired:.1f} m/s."]
    if best.ahead is None:
        told.append("Nothing is in the way.")
    else:
        ahead = best.ahead
        told.append(
            f"The {ahead.name} is {ahead.gap:.1f} m ahead at {ahead.speed:.1f} m/s, which "
            f"asks for {best.acceleration:.1f} m/s²."
        )
    if best.lateral is not Lateral.FOLLOW_LANE:
        told.append(f"The {_SIDES[best.lateral]} lane is free and gets me further.")
    told += [f"Not to the {_SIDES[o.lateral]}: {o.why}." for o in options if o.why]
    if wish.stay:
        told.append("I was asked not to change lanes.")
    return " ".join(told)
