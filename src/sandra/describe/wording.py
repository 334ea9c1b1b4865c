"""The facts in words: one function per paragraph of the paper's figure "LLM prompt design"."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence

from sandra.actions import ActionPair, Lateral, Longitudinal
from sandra.describe.facts import AHEAD, BEHIND
from sandra.describe.outside import NAME_LENGTH, in_words, one_line
from sandra.describe.templates import say, sentences
from sandra.describe.types import ObstacleFacts, Situation
from sandra.scene.types import Scene, TrafficLight, TrafficSign
from sandra.settings import Settings

MOST_SIGNS = 5
"""At most this many signs are told, nearest first."""
SIGN_RANGE = 150.0
"""Signs and lights are told up to this distance [m]."""
REASON_LENGTH = 300
"""So much of a reason why a pair does not hold is told [characters]."""
_OFF_CENTRE = 0.3
"""The ego's place in its lane is told from this offset on [m]."""
_LONG = 60.0
"""Beyond this a time-to-collision is told as "more than" [s]."""

_TOLD_AS_LIMIT = "max speed"


def system_text(
    facts: Situation,
    longitudinal: Sequence[Longitudinal],
    lateral: Sequence[Lateral],
    k: int,
    settings: Settings,
) -> str:
    """Task, command, kappa, feasible actions and past pairs (paper: System)."""

    def action(name: str) -> str:
        meaning = say("meaning", name, a_lim=settings.a_lim)
        return say("system", "action", name=name, meaning=meaning)

    lines = [say("system", "task")]
    if facts.command:
        lines.append(say("system", "command", command=facts.command.replace('"', "'")))
    lines.append(say("system", "steps", k=k))
    lines.append(say("system", "horizon", seconds=facts.horizon))
    lines += [say("system", "longitudinal"), *(action(a.value) for a in longitudinal)]
    lines += [say("system", "lateral"), *(action(a.value) for a in lateral)]
    if facts.past:
        pairs = "; ".join(str(pair) for pair in facts.past)
        lines.append(say("system", "past", pairs=pairs))
    else:
        lines.append(say("system", "no_past"))
    lines.append(say("system", "answer", k=k))
    return "\n".join(lines)


def ego_text(scene: Scene, facts: Situation) -> str:
    """Road, weather, lanes, the ego's state, speed limit, lights and signs (paper: Ego vehicle)."""
    lines = [say("ego", "opening"), _road(scene, facts), _lanes(scene), _ego_state(facts)]
    limit = facts.speed_limit
    lines.append(
        say("ego", "no_limit")
        if limit is None
        else say("ego", "limit", limit=limit, kmh=3.6 * limit)
    )
    lines += _lights(scene.lights)
    lines += _signs(scene.signs)
    return "\n".join(lines)


def obstacles_text(facts: Situation, settings: Settings) -> str:
    """One line per relevant obstacle (paper: Obstacles)."""
    if not facts.obstacles:
        return say("obstacles", "none", ahead=AHEAD, behind=BEHIND)
    lines = [say("obstacles", "opening"), say("obstacles", "units")]
    return "\n".join([*lines, *(_obstacle(o, settings.v_err) for o in facts.obstacles)])


def rules_text(facts: Situation, rules: Iterable[str], settings: Settings) -> str:
    """The traffic rules with the country (paper: Traffic rules).

    A name without a sentence of its own, such as a formula of the user, is told as it stands.
    """
    code = facts.country
    country = (
        say("rules", "unknown_country") if code is None else sentences()["country"].get(code, code)
    )
    limit = facts.speed_limit
    lines = [say("rules", "opening", country=country)]
    for rule in rules:
        name = one_line(rule, 200)
        if name == "R_G1":
            text = say("rules", "R_G1")
        elif name == "R_G2":
            text = say("rules", "R_G2", a_abrupt=settings.a_abrupt)
        elif name == "R_G3" and limit is None:
            text = say("rules", "R_G3_unknown")
        elif name == "R_G3" and limit is not None:
            v = min(limit, settings.v_fov, settings.v_braking, settings.v_type)
            text = say("rules", "R_G3", limit=v, kmh=3.6 * v)
        else:
            lines.append(f"  - {name}")
            continue
        lines.append(say("rules", "line", name=name, text=text))
    return "\n".join(lines)


def narrowed_text(pairs: Sequence[ActionPair], k: int) -> str:
    """Which pairs hold, and how many of them are to be ranked (not in the paper)."""
    names = "; ".join(str(pair) for pair in pairs)
    return say("narrowed", "holds", pairs=names) + " " + say("narrowed", "rank", k=k)


def answered_text(
    failed: Mapping[ActionPair, str], unusable: str, left: Sequence[ActionPair], k: int
) -> str:
    """What was wrong with an answer, and which pairs are left (not in the paper)."""
    if failed:
        lines = [say("answered", "failed")]
        lines += [
            say("answered", "line", pair=pair, reason=one_line(why, REASON_LENGTH))
            for pair, why in failed.items()
        ]
    else:
        lines = [say("answered", "unusable", reason=one_line(unusable, REASON_LENGTH))]
    names = "; ".join(str(pair) for pair in left)
    return "\n".join([*lines, say("answered", "rank", k=k, pairs=names)])


def _road(scene: Scene, facts: Situation) -> str:
    weather = sentences()["weather"].get(facts.weather or "unknown", facts.weather or "")
    time = in_words(scene.time_of_day or "unknown")
    conditions = f" with {weather}" if weather else ""
    if time not in ("unknown", ""):
        conditions += f" at {time}" if time in ("night", "noon") else f" in the {time}"
    if facts.road_type in ("unknown", ""):
        return say("ego", "road_unknown", conditions=conditions)
    article = "an" if facts.road_type[0] in "aeiou" else "a"
    return say("ego", "road", road=f"{article} {facts.road_type}", conditions=conditions)


def _lanes(scene: Scene) -> str:
    told = []
    for side, same in (("left", scene.left), ("right", scene.right)):
        opposite = any(lane.side == side for lane in scene.opposite)
        if same is not None:
            told.append(say("ego", "adjacent_same", side=side))
            if opposite:
                told.append(say("ego", "beyond_opposite", side=side))
        else:
            told.append(say("ego", "adjacent_opposite" if opposite else "adjacent_none", side=side))
    sides = [
        side
        for side in ("left", "right")
        if any(lane.relation == f"incoming-{side}" for lane in scene.incoming)
    ]
    if sides:
        told.append(say("ego", "incoming", sides=" and the ".join(sides)))
    return " ".join(told)


def _ego_state(facts: Situation) -> str:
    told = say(
        "ego",
        "state",
        speed=facts.speed,
        heading=facts.heading,
        steering=facts.steering_angle,
        acceleration=facts.acceleration,
    )
    offset = facts.lateral_offset
    if abs(offset) >= _OFF_CENTRE:
        told += " " + say("ego", "offset", distance=abs(offset), side=_side(offset))
    return told


def _lights(lights: Sequence[TrafficLight]) -> list[str]:
    """Lights ahead, nearest first; several heads of one light are told once."""
    special = {"unknown": "light_unknown", "inactive": "light_inactive"}
    told: list[str] = []
    for light in sorted(lights, key=lambda light: light.distance):
        if 0.0 <= light.distance <= SIGN_RANGE:
            sentence = special.get(light.state, "light")
            state = "red and yellow" if light.state == "redYellow" else in_words(light.state)
            told.append(say("ego", sentence, distance=light.distance, state=state))
    return list(dict.fromkeys(told))


def _signs(signs: Sequence[TrafficSign]) -> list[str]:
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
        words = f"{name} {values}".strip()
        if sign.distance == 0.0:
            told.append(say("ego", "sign_here", sign=words))
        else:
            told.append(say("ego", "sign_ahead", sign=words, distance=sign.distance))
    return list(dict.fromkeys(told))[:MOST_SIGNS]


def _obstacle(o: ObstacleFacts, v_err: float) -> str:
    line = say(
        "obstacles",
        "line",
        kind=o.kind,
        id=o.id,
        doing=_doing(o, v_err),
        place=_place(o),
        reach=say("place", "reach") if o.in_ego_lane and o.relation != "same" else "",
        distance=_where(o),
    )
    return " ".join([line, _state(o), _collision(o)])


def _doing(o: ObstacleFacts, v_err: float) -> str:
    if o.is_static:
        return say("doing", "static")
    if abs(o.speed) <= v_err:
        return say("doing", "standing")
    return say("doing", o.kind if o.kind in ("pedestrian", "bicycle") else "driving")


def _place(o: ObstacleFacts) -> str:
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
    return say("place", variant)


def _where(o: ObstacleFacts) -> str:
    aside = say("distance", "aside", gap=abs(o.lateral_gap), side=_side(o.lateral_gap))
    if o.gap == 0.0:
        if o.lateral_gap == 0.0:
            return say("distance", "touching")
        return say("distance", "beside") + ", " + aside
    along = say("distance", "front" if o.gap > 0.0 else "behind", gap=abs(o.gap))
    in_lane = o.relation in ("same", "left", "right") and _lane_says_enough(o)
    return along if in_lane or o.lateral_gap == 0.0 else f"{along} and {aside}"


def _lane_says_enough(o: ObstacleFacts) -> bool:
    """Whether the lane says well enough where the obstacle is across the road."""
    return not o.is_static and o.kind not in ("pedestrian", "bicycle")


def _state(o: ObstacleFacts) -> str:
    if o.is_static:
        return say("obstacles", "state_static")
    if math.isnan(o.speed):
        return say("obstacles", "state_unknown", heading=o.heading)
    values = {"speed": o.speed, "heading": o.heading, "acceleration": o.acceleration}
    if o.steering_angle is None:
        return say("obstacles", "state", **values)
    return say("obstacles", "state_steering", steering=o.steering_angle, **values)


def _collision(o: ObstacleFacts) -> str:
    if math.isnan(o.time_to_collision):
        return say("obstacles", "collision_unknown")
    if math.isinf(o.time_to_collision):
        in_path = o.relation == "same" and o.lateral_gap == 0.0
        return say("obstacles", "collision_never" if in_path else "collision_never_path")
    if o.time_to_collision > _LONG:
        return say("obstacles", "collision_late", time=_LONG)
    return say("obstacles", "collision", time=o.time_to_collision)


def _side(offset: float) -> str:
    return "left" if offset > 0.0 else "right"
