"""Who wants a collision: the pair that brings the ego nearest to anybody comes first.

A worst case for whoever verifies: nothing that this ranker likes best may be driven because it was
liked. Its measure of a pair is the smallest gap, bumper to bumper along the lane that the pair
leads to, within `HORIZON` seconds: the ego keeps the action's acceleration, the others keep theirs
for a second and then their speed. While a change of lane lasts, the lane that is left counts too.

An estimate and no more: somebody beside the ego counts as a collision, wherever it is going.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

from sandra.actions import ActionPair, Lateral, Longitudinal
from sandra.describe.types import ObstacleFacts, Prompt, Situation
from sandra.rankers.types import Ranking

HORIZON = 4.0
"""Time that is looked ahead [s]."""
STEP = 0.2
"""[s]"""
CHANGE = 2.0
"""Duration of a change of lane [s]."""
STEADY = 1.0
"""For so long others go on braking or accelerating [s]."""
RATES = {
    Longitudinal.ACCELERATE: 5.0,
    Longitudinal.KEEP: 0.0,
    Longitudinal.DECELERATE: -2.0,
    Longitudinal.STOP: -8.0,
}
"""Acceleration of the ego; a rash one, it does not care [m/s^2]."""
_SIDES = {Lateral.LEFT_LANE: "left", Lateral.RIGHT_LANE: "right"}
_LONGITUDINAL, _LATERAL = tuple(RATES), tuple(Lateral)


@dataclass(frozen=True, slots=True)
class AdversarialRanker:
    """k feasible pairs, worst first; of equally bad ones the faster, then by side. No model."""

    name: str = "adversarial"

    def rank(self, prompt: Prompt, deadline: float | None = None) -> Ranking:
        """See `Ranker`."""
        order = (ActionPair(lon, lat) for lon in _LONGITUDINAL for lat in _LATERAL)
        pairs = [pair for pair in order if pair in prompt.feasible]
        gaps = {pair: nearest(prompt.situation, pair) for pair in pairs}
        pairs.sort(key=lambda pair: tuple(round(value, 3) for value in gaps[pair]))
        told = ", ".join(_words(pair, *gaps[pair]) for pair in pairs[: prompt.k])
        reasoning = f"Nearest to a collision within {HORIZON:g} s first: {told}."
        return Ranking(tuple(pairs[: prompt.k]), self.name, reasoning=reasoning)


def nearest(facts: Situation, pair: ActionPair) -> tuple[float, float]:
    """The smallest gap to anybody [m], 0 for a collision, and when it is reached [s].

    (inf, inf) where nobody is in the lanes that the pair uses.
    """
    side = _SIDES.get(pair.lateral)
    rate = RATES[pair.longitudinal]
    gap, when = math.inf, math.inf
    for i in range(round(HORIZON / STEP) + 1):
        time = i * STEP
        way = _moved(facts.speed, rate, time, HORIZON)
        for o in _those_in(facts, side, time):
            there = max(0.0, _gap(o, way, time))
            if there < gap:
                gap, when = there, time
    return gap, when


def _those_in(facts: Situation, side: str | None, time: float) -> Iterator[ObstacleFacts]:
    """Who is in the lane that the ego goes to, or in the one that it has not left yet."""
    for o in facts.obstacles:
        own = o.relation == "same" or o.in_ego_lane
        if (own and (side is None or time < CHANGE)) or (side is not None and o.relation == side):
            yield o


def _gap(o: ObstacleFacts, way: float, time: float) -> float:
    """Bumper to bumper after the ego's way [m]; not positive where they have met."""
    if o.gap == 0.0:
        return 0.0
    speed = 0.0 if math.isnan(o.speed) else o.speed * math.cos(o.heading)
    known = speed > 0.0 and not math.isnan(o.acceleration)
    theirs = _moved(speed, o.acceleration if known else 0.0, time, STEADY)
    return (o.gap + theirs - way) * math.copysign(1.0, o.gap)


def _moved(speed: float, rate: float, time: float, lasts: float) -> float:
    """Way after some time, the acceleration lasting so long, never turning back [m]."""
    lasts = min(time, lasts)
    if rate < 0.0 < speed:
        lasts = min(lasts, speed / -rate)
    elif rate < 0.0:
        lasts = 0.0
    pace = speed + rate * lasts
    return (speed + pace) / 2 * lasts + pace * (time - lasts)


def _words(pair: ActionPair, gap: float, when: float) -> str:
    if math.isinf(gap):
        return f"{pair} nobody near"
    return f"{pair} {gap:.1f} m after {when:.1f} s"
