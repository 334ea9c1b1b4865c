"""The obstacles in words: one line each (paper: figure "LLM prompt design", Obstacles)."""

from __future__ import annotations

import math

from sandra.describe.criticality import criticality_text, explanation
from sandra.describe.facts import AHEAD, BEHIND
from sandra.describe.options import PromptOptions
from sandra.describe.templates import Templates
from sandra.describe.types import ObstacleFacts, Situation
from sandra.settings import Settings

_LONG = 60.0
"""Beyond this a time-to-collision is told as "more than" [s]."""


def obstacles_text(
    words: Templates, facts: Situation, settings: Settings, options: PromptOptions
) -> str:
    """One line per obstacle (paper: Obstacles), with the measures asked for."""
    beams, measures, braking = options.beams, options.measures, -settings.a_lon_min
    if not facts.obstacles:
        if beams is not None:
            return words.say("obstacles", "none_in_sight", range=beams.range)
        return words.say("obstacles", "none", ahead=AHEAD, behind=BEHIND)
    opening = "opening" if beams is None else "opening_in_sight"
    lines = [words.say("obstacles", opening), words.say("obstacles", "units")]
    if measures:
        lines.append(explanation(words, measures, braking))
    for o in facts.obstacles:
        told = criticality_text(words, o, measures, braking)
        lines.append(_obstacle(words, o, settings.v_err) + (f" {told}" if told else ""))
    return "\n".join(lines)


def _obstacle(words: Templates, o: ObstacleFacts, v_err: float) -> str:
    line = words.say(
        "obstacles",
        "line",
        kind=o.kind,
        id=o.id,
        doing=_doing(words, o, v_err),
        place=_place(words, o),
        reach=words.say("place", "reach") if o.in_ego_lane and o.relation != "same" else "",
        distance=_where(words, o),
    )
    return " ".join([line, _state(words, o), _collision(words, o)])


def _doing(words: Templates, o: ObstacleFacts, v_err: float) -> str:
    if o.is_static:
        return words.say("doing", "static")
    if abs(o.speed) <= v_err:
        return words.say("doing", "standing")
    return words.say("doing", o.kind if o.kind in ("pedestrian", "bicycle") else "driving")


def _place(words: Templates, o: ObstacleFacts) -> str:
    has_direction = not o.is_static and o.kind != "pedestrian"
    variant = o.relation
    if variant == "same" and has_direction and not o.same_direction:
        variant = "same_against"
    elif variant in ("left", "right"):
        if not has_direction:
            variant += "_nothing"
        elif not o.same_direction:
            variant += "_against"
    elif variant == "opposite":
        if not has_direction:
            variant = "opposite_nothing"
        elif o.same_direction:
            variant = "opposite_along"
    return words.say("place", variant)


def _where(words: Templates, o: ObstacleFacts) -> str:
    aside = words.say("distance", "aside", gap=abs(o.lateral_gap), side=side_of(o.lateral_gap))
    if o.gap == 0.0:
        if o.lateral_gap == 0.0:
            return words.say("distance", "touching")
        return words.say("distance", "beside") + ", " + aside
    along = words.say("distance", "front" if o.gap > 0.0 else "behind", gap=abs(o.gap))
    in_lane = o.relation in ("same", "left", "right") and _lane_says_enough(o)
    return along if in_lane or o.lateral_gap == 0.0 else f"{along} and {aside}"


def _lane_says_enough(o: ObstacleFacts) -> bool:
    """Whether the lane says well enough where the obstacle is across the road."""
    return not o.is_static and o.kind not in ("pedestrian", "bicycle")


def _state(words: Templates, o: ObstacleFacts) -> str:
    if o.is_static:
        return words.say("obstacles", "state_static")
    if math.isnan(o.speed):
        return words.say("obstacles", "state_unknown", heading=o.heading)
    values = {"speed": o.speed, "heading": o.heading, "acceleration": o.acceleration}
    if o.steering_angle is None:
        return words.say("obstacles", "state", **values)
    return words.say("obstacles", "state_steering", steering=o.steering_angle, **values)


def _collision(words: Templates, o: ObstacleFacts) -> str:
    if math.isnan(o.time_to_collision):
        return words.say("obstacles", "collision_unknown")
    if math.isinf(o.time_to_collision):
        in_path = o.relation == "same" and o.lateral_gap == 0.0
        return words.say("obstacles", "collision_never" if in_path else "collision_never_path")
    if o.time_to_collision > _LONG:
        return words.say("obstacles", "collision_late", time=_LONG)
    return words.say("obstacles", "collision", time=o.time_to_collision)


def side_of(offset: float) -> str:
    """Of the lane's frame: left is d > 0."""
    return "left" if offset > 0.0 else "right"
