"""The facts in words: one function per paragraph of the paper's figure "LLM prompt design".

The obstacles have a module of their own, `obstacle_wording`.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

from sandra.actions import ActionPair, Lateral, Longitudinal
from sandra.describe.obstacle_wording import side_of
from sandra.describe.outside import NAME_LENGTH, in_words, one_line
from sandra.describe.templates import Templates
from sandra.describe.types import Picture, Situation
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


def answered_text(
    words: Templates,
    failed: Mapping[ActionPair, str],
    unusable: str,
    left: Sequence[ActionPair],
    k: int,
) -> str:
    """What was wrong with an answer, and which pairs are left (not in the paper)."""
    if failed:
        lines = [words.say("answered", "failed")]
        lines += [
            words.say("answered", "line", pair=pair, reason=one_line(why, REASON_LENGTH))
            for pair, why in failed.items()
        ]
    else:
        lines = [words.say("answered", "unusable", reason=one_line(unusable, REASON_LENGTH))]
    names = "; ".join(str(pair) for pair in left)
    return "\n".join([*lines, words.say("answered", "rank", k=k, pairs=names)])


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
        told += " " + words.say("ego", "offset", distance=abs(offset), side=side_of(offset))
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
