"""The facts in words: one function per paragraph of the paper's figure "LLM prompt design"."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence

from sandra.actions import ActionPair, Lateral, Longitudinal
from sandra.describe.criticality import criticality_text, explanation
from sandra.describe.facts import AHEAD, BEHIND
from sandra.describe.options import PromptOptions
from sandra.describe.outside import NAME_LENGTH, in_words, one_line
from sandra.describe.templates import Templates
from sandra.describe.types import ObstacleFacts, Picture, Situation
from sandra.scene.types import Scene, TrafficLight, TrafficSign
from sandra.settings import Settings

MOST_SIGNS = 5
"""At most this many signs are told, nearest first."""
SIGN_RANGE = 150.0
"""Signs and lights are told up to this distance [m]."""
_OFF_CENTRE = 0.3
"""The ego's place in its lane is told from this offset on [m]."""
_LONG = 60.0
"""Beyond this a time-to-collision is told as "more than" [s]."""

_TOLD_AS_LIMIT = "max speed"


def system_text(
    words: Templates,
    facts: Situation,
    longitudinal: Sequence[Longitudinal],
    lateral: Sequence[Lateral],
    k: int,
    settings: Settings,
) -> str:
    """Task, command, kappa, feasible actions and past pairs (paper: System)."""

    def action(name: str) -> str:
        meaning = words.say("meaning", name, a_lim=settings.a_lim)
        return words.say("system", "action", name=name, meaning=meaning)

    lines = [words.say("system", "task")]
    if facts.command:
        lines.append(words.say("system", "command", command=facts.command.replace('"', "'")))
    lines.append(words.say("system", "steps", k=k))
    lines.append(words.say("system", "horizon", seconds=facts.horizon))
    lines += [words.say("system", "longitudinal"), *(action(a.value) for a in longitudinal)]
    lines += [words.say("system", "lateral"), *(action(a.value) for a in lateral)]
    if facts.past:
        pairs = "; ".join(str(pair) for pair in facts.past)
        lines.append(words.say("system", "past", pairs=pairs))
    else:
        lines.append(words.say("system", "no_past"))
    lines.append(words.say("system", "answer", k=k))
    return "\n".join(lines)


def ego_text(words: Templates, scene: Scene, facts: Situation) -> str:
    """Road, weather, lanes, the ego's state, speed limit, lights and signs (paper: Ego vehicle)."""
    lines = [
        words.say("ego", "opening"),
        _road(words, scene, facts),
        _lanes(words, scene),
        _ego_state(words, facts),
    ]
    limit = facts.speed_limit
    lines.append(
        words.say("ego", "no_limit")
        if limit is None
        else words.say("ego", "limit", limit=limit, kmh=3.6 * limit)
    )
    lines += _lights(words, scene.lights)
    lines += _signs(words, scene.signs)
    return "\n".join(lines)


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


def picture_text(words: Templates, picture: Picture) -> str:
    """What the attached picture shows (not in the paper)."""
    return words.say("picture", picture.up, metres=picture.width * picture.scale)


def rules_text(words: Templates, facts: Situation, rules: Iterable[str], settings: Settings) -> str:
    """The traffic rules with the country (paper: Traffic rules).

    A name without a sentence of its own, such as a formula of the user, is told as it stands.
    """
    code = facts.country
    country = (
        words.say("rules", "unknown_country")
        if code is None
        else words.tables["country"].get(code, code)
    )
    limit = facts.speed_limit
    lines = [words.say("rules", "opening", country=country)]
    for rule in rules:
        name = one_line(rule, 200)
        if name == "R_G1":
            text = words.say("rules", "R_G1")
        elif name == "R_G2":
            text = words.say("rules", "R_G2", a_abrupt=settings.a_abrupt)
        elif name == "R_G3" and limit is None:
            text = words.say("rules", "R_G3_unknown")
        elif name == "R_G3" and limit is not None:
            v = min(limit, settings.v_fov, settings.v_braking, settings.v_type)
            text = words.say("rules", "R_G3", limit=v, kmh=3.6 * v)
        else:
            lines.append(f"  - {name}")
            continue
        lines.append(words.say("rules", "line", name=name, text=text))
    return "\n".join(lines)


def narrowed_text(words: Templates, pairs: Sequence[ActionPair], k: int) -> str:
    """Which pairs hold, and how many of them are to be ranked (not in the paper)."""
    names = "; ".join(str(pair) for pair in pairs)
    return words.say("narrowed", "holds", pairs=names) + " " + words.say("narrowed", "rank", k=k)


def _road(words: Templates, scene: Scene, facts: Situation) -> str:
    weather = words.tables["weather"].get(facts.weather or "unknown", facts.weather or "")
    time = in_words(scene.time_of_day or "unknown")
    conditions = f" with {weather}" if weather else ""
    if time not in ("unknown", ""):
        conditions += f" at {time}" if time in ("night", "noon") else f" in the {time}"
    if facts.road_type in ("unknown", ""):
        return words.say("ego", "road_unknown", conditions=conditions)
    article = "an" if facts.road_type[0] in "aeiou" else "a"
    return words.say("ego", "road", road=f"{article} {facts.road_type}", conditions=conditions)


def _lanes(words: Templates, scene: Scene) -> str:
    told = []
    for side, same in (("left", scene.left), ("right", scene.right)):
        opposite = any(lane.side == side for lane in scene.opposite)
        if same is not None:
            told.append(words.say("ego", "adjacent_same", side=side))
            if opposite:
                told.append(words.say("ego", "beyond_opposite", side=side))
        else:
            told.append(
                words.say("ego", "adjacent_opposite" if opposite else "adjacent_none", side=side)
            )
    sides = [
        side
        for side in ("left", "right")
        if any(lane.relation == f"incoming-{side}" for lane in scene.incoming)
    ]
    if sides:
        told.append(words.say("ego", "incoming", sides=" and the ".join(sides)))
    return " ".join(told)


def _ego_state(words: Templates, facts: Situation) -> str:
    told = words.say(
        "ego",
        "state",
        speed=facts.speed,
        heading=facts.heading,
        steering=facts.steering_angle,
        acceleration=facts.acceleration,
    )
    offset = facts.lateral_offset
    if abs(offset) >= _OFF_CENTRE:
        told += " " + words.say("ego", "offset", distance=abs(offset), side=_side(offset))
    return told


def _lights(words: Templates, lights: Sequence[TrafficLight]) -> list[str]:
    """Lights ahead, nearest first; several heads of one light are told once."""
    special = {"unknown": "light_unknown", "inactive": "light_inactive"}
    told: list[str] = []
    for light in sorted(lights, key=lambda light: light.distance):
        if 0.0 <= light.distance <= SIGN_RANGE:
            sentence = special.get(light.state, "light")
            state = "red and yellow" if light.state == "redYellow" else in_words(light.state)
            told.append(words.say("ego", sentence, distance=light.distance, state=state))
    return list(dict.fromkeys(told))


def _signs(words: Templates, signs: Sequence[TrafficSign]) -> list[str]:
    told: list[str] = []
    for sign in sorted(signs, key=lambda sign: sign.distance):
        if not 0.0 <= sign.distance <= SIGN_RANGE:
            continue
        name = in_words(sign.name)
        if sign.distance == 0.0 and name == _TOLD_AS_LIMIT:
            continue
        values = " ".join(one_line(value, NAME_LENGTH) for value in sign.values)
        if name == _TOLD_AS_LIMIT and values:
            values += " m/s"
        told_as = f"{name} {values}".strip()
        if sign.distance == 0.0:
            told.append(words.say("ego", "sign_here", sign=told_as))
        else:
            told.append(words.say("ego", "sign_ahead", sign=told_as, distance=sign.distance))
    return list(dict.fromkeys(told))[:MOST_SIGNS]


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
    aside = words.say("distance", "aside", gap=abs(o.lateral_gap), side=_side(o.lateral_gap))
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


def _side(offset: float) -> str:
    return "left" if offset > 0.0 else "right"
