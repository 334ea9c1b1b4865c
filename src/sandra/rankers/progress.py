"""How far a pair of actions may bring the ego: the stated cost of the exhaustive ranker.

A pair is driven ahead for `HORIZON` seconds among others who keep their acceleration for a second
and then their speed: the action for `HOLD` seconds, then as fast as the limit and the distance for
safety to the leader allow (R_G1 with the paper's parameters). While a change of lane lasts, the
leaders of both lanes count. What a change costs is taken off, more where somebody is beside the ego
or close behind in the other lane; a change that is under way is worth going on with.

An estimate and no more: it orders pairs, the verifier decides about them.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from sandra.actions import ActionPair, Lateral, Longitudinal
from sandra.describe.types import ObstacleFacts, Situation

HORIZON = 6.0
"""Time that is looked ahead [s]."""
STEP = 0.2
"""[s]"""
HOLD = 0.8
"""For so long the action is kept [s]."""
CHANGE = 2.0
"""Duration of a change of lane [s]."""
ACROSS = 3.5
"""Way across the lanes until it is done [m]."""
BRAKES = 1.0
"""For so long others go on braking or accelerating [s]."""
RATES = {
    Longitudinal.ACCELERATE: 2.5,
    Longitudinal.KEEP: 0.0,
    Longitudinal.DECELERATE: -2.0,
    Longitudinal.STOP: -5.0,
}
"""Acceleration while an action is kept [m/s^2]."""
SPEED_UP, BRAKE = 2.5, -5.0
"""Accelerations afterwards [m/s^2]."""
REACTION, OWN_BRAKING, THEIR_BRAKING = 0.4, 6.0, 12.0
"""Of the distance for safety (paper Tab. "General parameters") [s, m/s^2, m/s^2]."""
FASTEST = 30.0
"""Where no limit is known [m/s]."""
COST_OF_CHANGE = 4.0
"""What a change of lane must gain [m]; going on with one that is under way gains as much."""
COST_OF_CONFLICT = 60.0
"""For a change to where somebody is beside the ego, or would have to brake hard [m]."""
REAR_BRAKING = 3.0
"""Harder than this nobody behind should have to brake [m/s^2]."""
_SIDES = {Lateral.LEFT_LANE: "left", Lateral.RIGHT_LANE: "right"}


Leader = tuple[float, float, float]
"""Gap [m], speed [m/s] and acceleration [m/s^2] along the lane."""


def progress(facts: Situation, pair: ActionPair) -> float:
    """Estimated distance within `HORIZON`, less what the change of lane costs [m]."""
    own = _ahead(facts.obstacles, "same")
    side = _SIDES.get(pair.lateral)
    if side is None:
        return _driven(facts, RATES[pair.longitudinal], own, own, 0.0)
    moved = facts.lateral_offset if side == "left" else -facts.lateral_offset
    lasts = CHANGE * (1.0 - min(max(moved / ACROSS, 0.0), 1.0))
    there = _ahead(facts.obstacles, side)
    way = _driven(facts, RATES[pair.longitudinal], own, there, lasts)
    under_way = bool(facts.past) and facts.past[-1].lateral is pair.lateral
    return way + (COST_OF_CHANGE if under_way else -COST_OF_CHANGE) - _conflict(facts, side)


def _driven(
    facts: Situation,
    rate: float,
    own: Sequence[Leader],
    there: Sequence[Leader],
    change: float,
) -> float:
    """Distance that is driven [m], `change` being the duration of the change of lane [s]."""
    top = FASTEST if facts.speed_limit is None else min(facts.speed_limit, FASTEST)
    speed, way = facts.speed, 0.0
    for i in range(round(HORIZON / STEP)):
        time = i * STEP
        wanted = speed + STEP * (rate if time < HOLD else SPEED_UP)
        if time >= HOLD:
            leaders = [*own, *there] if time < change else there
            for leader in leaders:
                ahead, pace = _later(leader, time)
                wanted = min(wanted, _safe_speed(ahead - way, pace))
        new = max(0.0, speed + STEP * BRAKE, min(wanted, max(top, speed)))
        way += STEP * (speed + new) / 2
        speed = new
    return way


def _later(leader: Leader, time: float) -> tuple[float, float]:
    """Where a leader is after some time, from the ego's front now on, and its speed [m, m/s]."""
    gap, speed, rate = leader
    lasts = min(time, BRAKES, speed / -rate if rate < 0.0 else BRAKES)
    pace = speed + rate * lasts
    return gap + (speed + pace) / 2 * lasts + pace * (time - lasts), pace


def _safe_speed(gap: float, leader: float) -> float:
    """The speed v with v^2 / (2 a) + v t = gap + v_leader^2 / (2 a_leader) [m/s]."""
    room = max(gap, 0.0) + leader**2 / (2 * THEIR_BRAKING)
    return OWN_BRAKING * (math.sqrt(REACTION**2 + 2 * room / OWN_BRAKING) - REACTION)


def _ahead(obstacles: Sequence[ObstacleFacts], lane: str) -> list[Leader]:
    """All ahead in a lane."""
    return [
        (o.gap, _along(o), 0.0 if math.isnan(o.acceleration) else o.acceleration)
        for o in obstacles
        if o.gap > 0.0 and (o.relation == lane or (lane == "same" and o.in_ego_lane))
    ]


def _along(o: ObstacleFacts) -> float:
    """Speed along the ego's lane, 0 where it is unknown or backwards [m/s]."""
    return 0.0 if math.isnan(o.speed) else max(0.0, o.speed * math.cos(o.heading))


def _conflict(facts: Situation, side: str) -> float:
    """What it costs that somebody in the other lane is in the way [m]."""
    for o in facts.obstacles:
        if o.relation != side or o.gap > 0.0:
            continue
        if o.gap == 0.0:
            return COST_OF_CONFLICT
        closing = _along(o) - facts.speed
        room = -o.gap - REACTION * max(_along(o), 0.0) / 2
        if room <= 0.0 or (closing > 0.0 and closing**2 / (2 * room) > REAR_BRAKING):
            return COST_OF_CONFLICT
    return 0.0
