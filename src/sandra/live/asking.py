"""One question of the page: checked, decided, and given back as a document.

A verdict comes from the verifier alone. Whatever is wrong with a question is an error in words, and
an exception is no answer at all.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from sandra.actions import ActionPair
from sandra.decision import Decision, decide
from sandra.errors import SandraError, SettingsError
from sandra.live.offer import LIMITS, LONGEST_HORIZON, PREDICTIONS, Offer
from sandra.logic import Vocabulary, parse_rules
from sandra.logic.specification import specification
from sandra.logic.vocabulary import ACTION_NAMES
from sandra.scene import load
from sandra.settings import Settings
from sandra.view.report import Document, decision_document

LONGEST = 2000
"""Of a formula, of a command [characters]."""


class Question(BaseModel):
    """What the page sends; unknown names are refused."""

    model_config = ConfigDict(extra="forbid", strict=True)

    scenario: str = Field(max_length=LONGEST)
    ranker: str = Field(default="rules", max_length=LONGEST)
    command: str = Field(default="", max_length=LONGEST)
    prediction: str = Field(default="most-likely", max_length=40)
    mode: str = Field(default="rank", max_length=40)
    rules: str = Field(default="", max_length=LONGEST)
    horizon: int = Field(default=25, ge=1, le=LONGEST_HORIZON)
    actions: dict[str, str] = Field(default_factory=dict, max_length=len(ACTION_NAMES))
    limits: dict[str, float] = Field(default_factory=dict, max_length=len(LIMITS))


def question_of(body: bytes) -> Question:
    """The question in a request. Raises `SandraError` in one line."""
    try:
        return Question.model_validate_json(body)
    except ValidationError as error:
        first = error.errors()[0]
        where = ".".join(map(str, first["loc"])) or "question"
        raise SandraError(f"{where}: {first['msg']}") from None


def answered(offer: Offer, question: Question) -> Document:
    """Decide, and describe the decision for the page.

    Raises:
        SandraError: for a choice that is not offered, a formula or a number that cannot be used.
    """
    for name, value, choices in (
        ("scenario", question.scenario, offer.scenarios),
        ("ranker", question.ranker, offer.rankers),
        ("prediction", question.prediction, PREDICTIONS),
    ):
        if value not in choices:
            raise SandraError(f"{name}: '{value[:60]}' is not offered here")
    settings = changed(offer.settings, question.limits).replace(horizon=question.horizon)
    vocabulary = words_of(question.actions, settings)
    scene = load(offer.scenarios[question.scenario], settings=settings)
    decision: Decision = decide(
        scene,
        offer.rankers[question.ranker],
        question.command.strip() or None,
        prediction=question.prediction,
        rules=parse_rules(question.rules),
        settings=settings,
        vocabulary=vocabulary,
        mode=question.mode,
        walk="all",
    )
    return decision_document(decision, vocabulary)


def changed(settings: Settings, limits: dict[str, float]) -> Settings:
    """The settings with some of `LIMITS` changed."""
    for name in limits:
        if name not in LIMITS:
            raise SettingsError(f"'{name[:60]}' cannot be changed here")
    own = {name: value for name, value in limits.items() if hasattr(settings, name)}
    others: dict[str, Any] = {name: value for name, value in limits.items() if name not in own}
    for name, value in others.items():
        if not 0.0 <= value < float("inf"):
            raise SettingsError(f"{name} = {value} must be a finite number >= 0")
    return settings.replace(**own, assumptions=replace(settings.assumptions, **others))


def words_of(actions: dict[str, str], settings: Settings) -> Vocabulary | None:
    """The packaged vocabulary with formulas of the page's own; None if nothing is changed."""
    words = Vocabulary.default()
    new = {name: " ".join(text.split()) for name, text in actions.items()}
    for name, text in new.items():
        if name not in words.actions:
            raise SettingsError(f"'{name[:60]}' is no action")
        if not text or len(text) > LONGEST:
            raise SettingsError(f"{name}: a formula of 1 to {LONGEST} characters")
    new = {name: text for name, text in new.items() if words.actions[name] != text}
    if not new:
        return None
    # A sentence about a formula that was replaced would no longer be true.
    kept = {name: text for name, text in words.descriptions.items() if name not in new}
    changed_words = replace(words, actions={**words.actions, **new}, descriptions=kept)
    specification(ActionPair.of("keep", "follow-lane"), (), settings, changed_words, dt=0.1)
    return changed_words
