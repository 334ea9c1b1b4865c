"""What an open-loop evaluation varies: ranker, driver's command, rule prompt, horizon."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any
from urllib.parse import urlsplit

from sandra.errors import SettingsError
from sandra.prediction import KINDS
from sandra.settings import Settings

TOLD_RULES = ("R_G1", "R_G2", "R_G3")
"""What the rule prompt tells where no rule is verified (paper, "Traffic Rule Prompt")."""
ACCEPT = ("reachable", "certified")
FACTORS = ("ranker", "command", "rule_prompt", "horizon")


@dataclass(frozen=True, slots=True)
class Setup:
    """One run: who is asked, how, and to which horizon its pairs are verified [steps]."""

    ranker: str
    command: str | None = None
    rule_prompt: bool = False
    horizon: int = 25

    @property
    def name(self) -> str:
        """What differs from the plainest question, in words."""
        told = [self.ranker, f"h = {self.horizon}"]
        if self.command is not None:
            told.append(f'"{self.command}"')
        if self.rule_prompt:
            told.append("rule prompt")
        return ", ".join(told)


@dataclass(frozen=True, slots=True)
class Conditions:
    """What all runs share.

    `accept` "reachable" counts as verified what has a reachable set (the paper), "certified" only
    what has a certificate. `rules` are verified; the paper's open loop verifies none.
    """

    k: int = 3
    prediction: str = "most-likely"
    rules: tuple[str, ...] = ()
    accept: str = "reachable"
    base_url: str | None = None
    deadline: float = 30.0
    settings: Settings = field(default_factory=Settings)

    def __post_init__(self) -> None:
        if self.prediction not in KINDS:
            raise SettingsError(
                f"unknown prediction '{self.prediction}': choose from {', '.join(KINDS)}"
            )
        if self.accept not in ACCEPT:
            raise SettingsError(f"accept = '{self.accept}': choose from {', '.join(ACCEPT)}")
        if not 0.0 < self.deadline < math.inf:
            raise SettingsError(f"deadline = {self.deadline} must be a number of seconds > 0")
        self.settings.replace(k=self.k)  # Says so if it is no number of pairs.

    def to_dict(self) -> dict[str, Any]:
        """For the journal."""
        return {
            "k": self.k,
            "prediction": self.prediction,
            "rules": list(self.rules),
            "accept": self.accept,
            "server": None if self.base_url is None else _place(self.base_url),
            "deadline": self.deadline,
            "settings": repr(self.settings),
        }


def _place(url: str) -> str:
    """Host, port and path of an address, without a password or a key that may be in it."""
    try:
        parts = urlsplit(url)
        return f"{parts.hostname}:{parts.port or ''}{parts.path}"
    except ValueError:
        raise SettingsError("the base URL is no address; write http://HOST:PORT/PATH") from None


def grid(
    rankers: Sequence[str],
    commands: Sequence[str | None] = (None,),
    rule_prompts: Sequence[bool] = (False,),
    horizons: Sequence[int] = (25,),
) -> tuple[Setup, ...]:
    """Every combination, the rankers outermost.

    Raises:
        SettingsError: a horizon below 1, or nothing to vary.
    """
    if any(h < 1 for h in horizons):
        raise SettingsError(f"horizon = {min(horizons)} must be at least 1")
    found = tuple(
        Setup(ranker, command, told, horizon)
        for ranker in rankers
        for command in commands
        for told in rule_prompts
        for horizon in horizons
    )
    if not found:
        raise SettingsError("an open-loop evaluation needs a ranker, a command and a horizon")
    return tuple(dict.fromkeys(found))


def ablations(setups: Sequence[Setup]) -> dict[str, tuple[Setup, ...]]:
    """For each factor that varies, the runs in which all others are as in the first run."""
    first, found = setups[0], {}
    for factor in FACTORS:
        others = [name for name in FACTORS if name != factor]
        alike = tuple(
            x for x in setups if all(getattr(x, name) == getattr(first, name) for name in others)
        )
        if len(alike) > 1:
            found[factor] = alike
    return found
