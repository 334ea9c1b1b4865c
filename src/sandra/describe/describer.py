"""From a scene to a prompt: the paper's describer (Sec. III-B, figure "LLM prompt design")."""

from __future__ import annotations

import json
from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace

from sandra.actions import ActionPair, Lateral, Longitudinal
from sandra.describe.facts import present, situation
from sandra.describe.obstacle_wording import obstacles_text
from sandra.describe.options import PromptOptions
from sandra.describe.outside import one_line
from sandra.describe.picture import bird_eye
from sandra.describe.schema import answer_schema
from sandra.describe.types import Picture, Prompt, Situation
from sandra.describe.wording import (
    answered_text,
    ego_text,
    narrowed_text,
    picture_text,
    rules_text,
    system_text,
)
from sandra.scene.types import Scene
from sandra.settings import Settings


def describe(
    scene: Scene,
    command: str | None = None,
    past: Sequence[ActionPair] = (),
    rules: Sequence[str] = (),
    rule_prompt: bool = False,
    settings: Settings | None = None,
    options: PromptOptions | None = None,
) -> Prompt:
    """Describe a scene for a ranker.

    Args:
        scene: the decision problem.
        command: the driver's wish, e.g. "drive faster"; told as one line of at most 500
            characters. It can change a ranking, never a verdict.
        past: executed pairs, oldest first; the last `settings.history` are told.
        rules: names of the traffic rules that will be verified.
        rule_prompt: whether the rules are told as well (the paper found little use in it).
        settings: k, history, horizon and the thresholds that the actions' meanings name.
        options: what is told beyond the paper's figure; default: nothing.

    Returns:
        The prompt; `k` is the smaller of `settings.k` and the number of feasible pairs.
    """
    settings = settings or Settings()
    longitudinal, lateral = feasible_actions(scene)
    feasible = tuple(ActionPair(lon, lat) for lon in longitudinal for lat in lateral)
    k = min(settings.k, len(feasible))
    wish = one_line(command) if command else ""
    recent = tuple(past)[-settings.history :] if settings.history else ()
    options = options or PromptOptions()
    words = options.templates
    facts = situation(scene, feasible, wish or None, recent, settings.horizon * scene.dt, options)
    picture = _picture(scene, facts, options)
    paragraphs = [ego_text(words, scene, facts), obstacles_text(words, facts, settings, options)]
    if picture is not None:
        paragraphs.append(picture_text(words, picture))
    if rule_prompt and rules:
        paragraphs.append(rules_text(words, facts, rules, settings))
    return Prompt(
        system=system_text(words, facts, longitudinal, lateral, k, settings),
        user="\n".join(paragraphs),
        schema=answer_schema(feasible, k),
        k=k,
        longitudinal=longitudinal,
        lateral=lateral,
        situation=facts,
        picture=picture,
        templates=words,
    )


def _picture(scene: Scene, facts: Situation, options: PromptOptions) -> Picture | None:
    if options.picture is None:
        return None
    drawn = present(scene)
    if options.beams is not None:
        seen = options.beams.seen(scene, drawn)
        drawn = [o for o in drawn if o.id in seen]
    return bird_eye(scene, options.picture, drawn, {o.id for o in facts.obstacles})


def feasible_actions(scene: Scene) -> tuple[tuple[Longitudinal, ...], tuple[Lateral, ...]]:
    """The actions that make sense here (paper Sec. III-B).

    Every longitudinal action; a change of lanes only where there is an adjacent lane of the same
    direction. Whether an action is safe is not asked here: that is the verifier's question.
    """
    lateral = [Lateral.FOLLOW_LANE]
    if scene.left is not None:
        lateral.append(Lateral.LEFT_LANE)
    if scene.right is not None:
        lateral.append(Lateral.RIGHT_LANE)
    return tuple(Longitudinal), tuple(lateral)


def narrow(prompt: Prompt, pairs: Collection[ActionPair]) -> Prompt:
    """The same question about some of its pairs only: those that were found to hold.

    The system text and the user text stay word for word as they were, so that what a server has
    already read need not be read again; the user text goes on with `narrowing`. The schema admits
    `pairs` and no other, and `k` is at most their number.

    Raises:
        ValueError: if no pair is left, or one was not feasible.
    """
    left = tuple(pair for pair in prompt.feasible if pair in pairs)
    if not left or len(left) < len(set(pairs)):
        raise ValueError("a prompt can only be narrowed to some of its own pairs, at least one")
    return _about(prompt, left, narrowed_text(prompt.templates, left, min(prompt.k, len(left))))


def answered(prompt: Prompt, failed: Mapping[ActionPair, str], unusable: str = "") -> Prompt:
    """The question put once more, with what was wrong with the answer (mode repair).

    Args:
        prompt: the first question; its text stays word for word, and is gone on with.
        failed: the pairs that were ranked, and why each of them does not hold; they are not
            asked for again.
        unusable: why there is no ranked pair, where there is none.

    Raises:
        ValueError: if no pair is left, or one was not feasible.
    """
    left = tuple(pair for pair in prompt.feasible if pair not in failed)
    if not left or len(left) + len(failed) != len(prompt.feasible):
        raise ValueError("some of the prompt's own pairs must be left, at least one")
    return _about(
        prompt,
        left,
        answered_text(prompt.templates, failed, unusable, left, min(prompt.k, len(left))),
    )


def _about(prompt: Prompt, left: tuple[ActionPair, ...], narrowing: str) -> Prompt:
    """A question about some pairs; the text of another one, and how it goes on."""
    k = min(prompt.k, len(left))
    return replace(
        prompt,
        user=f"{prompt.user}\n{narrowing}",
        schema=answer_schema(left, k),
        k=k,
        longitudinal=tuple(
            a for a in prompt.longitudinal if any(p.longitudinal is a for p in left)
        ),
        lateral=tuple(a for a in prompt.lateral if any(p.lateral is a for p in left)),
        situation=replace(prompt.situation, feasible=left),
        narrowing=narrowing,
    )


def render(prompt: Prompt) -> str:
    """The whole prompt as a person reads it: system text, user text, schema."""
    schema = json.dumps(prompt.schema, indent=2, ensure_ascii=False)
    return f"<System>\n{prompt.system}\n\n<User>\n{prompt.user}\n\n<Schema>\n{schema}\n"
