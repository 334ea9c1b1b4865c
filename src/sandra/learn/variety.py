"""What a prompt may hold in the loop and a recording does not: a wish, a past, rules, a choice.

Who learns from prompts without them is at a loss before the first that has one. Past pairs are
drawn by chance, so that nobody learns to go on as before only because it was so before. A wish
fits what was driven, as if the driver had followed it, or has nothing to do with driving.

And what a recording may lack and a simulation has: accelerations and steering, which many converted
recordings tell as 0; the type of the road and its limits (`bare`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from sandra.actions import ActionPair, Lateral, Longitudinal
from sandra.scene.types import Scene, State

LONGITUDINAL_WISHES = {
    Longitudinal.ACCELERATE: (
        "drive faster",
        "drive aggressively",
        "speed up, please",
        "hurry up",
        "I am late",
    ),
    Longitudinal.KEEP: ("keep your speed", "keep calm", "drive comfortably", "go on like this"),
    Longitudinal.DECELERATE: (
        "slow down",
        "drive slower",
        "drive cautiously",
        "drive carefully",
        "not so fast",
    ),
    Longitudinal.STOP: ("stop", "please stop here", "pull over"),
}
LATERAL_WISHES = {
    Lateral.FOLLOW_LANE: ("stay in your lane", "do not change lanes", "keep your lane"),
    Lateral.LEFT_LANE: ("change to the left lane", "overtake on the left", "go left"),
    Lateral.RIGHT_LANE: ("change to the right lane", "go back to the right", "go right"),
}
OTHER_WISHES = ("play some music", "take me home", "how long will it take?", "mind the others")
LONGEST_PAST = 5
_NEUTRAL, _REPEATED, _FOLLOWED = 0.25, 0.7, 0.85
"""Chances: a wish about something else; a past pair like the one before; a pair that stays."""


@dataclass(frozen=True, slots=True)
class Variety:
    """What one prompt tells beside the scene."""

    command: str | None = None
    past: tuple[ActionPair, ...] = ()
    rule_prompt: bool = False
    narrowed: bool = False
    """Only some of the pairs may be ranked, the label among them."""


def drawn(share: float, label: ActionPair, rng: np.random.Generator) -> Variety:
    """Each part is there with this chance, whatever the others are."""
    wished, remembered, ruled, narrowed = (rng.random(4) < share).tolist()
    return Variety(
        command=_wish(label, rng) if wished else None,
        past=_past(rng) if remembered else (),
        rule_prompt=ruled,
        narrowed=narrowed,
    )


def some(
    feasible: Sequence[ActionPair], label: ActionPair, rng: np.random.Generator
) -> tuple[ActionPair, ...]:
    """The label and others by chance, in their order."""
    count = int(rng.integers(1, len(feasible) + 1))
    kept = {feasible[i] for i in rng.permutation(len(feasible))[:count]} | {label}
    return tuple(pair for pair in feasible if pair in kept)


def bare(scene: Scene, share: float, rng: np.random.Generator) -> Scene:
    """Without accelerations and steering, with this chance; without the road's type and limits."""
    unmeasured, unmapped = (rng.random(2) < share).tolist()
    if unmeasured:
        scene = replace(
            scene,
            ego=replace(scene.ego, state=_unmeasured(scene.ego.state)),
            obstacles=tuple(replace(o, state=_unmeasured(o.state)) for o in scene.obstacles),
        )
    if unmapped:
        lanes = tuple(replace(x, speed_limits=(None,) * len(x.speed_limits)) for x in scene.lanes)
        scene = replace(scene, road_type="unknown", lanes=lanes)
    return scene


def _unmeasured(state: State) -> State:
    return replace(state, acceleration=0.0, steering_angle=0.0)


def _wish(label: ActionPair, rng: np.random.Generator) -> str:
    if rng.random() < _NEUTRAL:
        return _one(OTHER_WISHES, rng)
    if rng.random() < 0.5:
        return _one(LONGITUDINAL_WISHES[label.longitudinal], rng)
    return _one(LATERAL_WISHES[label.lateral], rng)


def _past(rng: np.random.Generator) -> tuple[ActionPair, ...]:
    pairs: list[ActionPair] = []
    for _ in range(int(rng.integers(1, LONGEST_PAST + 1))):
        if pairs and rng.random() < _REPEATED:
            pairs.append(pairs[-1])
            continue
        stays = rng.random() < _FOLLOWED
        sides = (Lateral.FOLLOW_LANE,) if stays else (Lateral.LEFT_LANE, Lateral.RIGHT_LANE)
        longitudinal = tuple(Longitudinal)[int(rng.integers(len(Longitudinal)))]
        pairs.append(ActionPair(longitudinal, sides[int(rng.integers(len(sides)))]))
    return tuple(pairs)


def _one(words: Sequence[str], rng: np.random.Generator) -> str:
    return words[int(rng.integers(len(words)))]
