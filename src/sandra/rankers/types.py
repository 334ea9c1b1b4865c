"""The one protocol of all rankers, and what they return."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from typing import Protocol, runtime_checkable

from sandra.actions import ActionPair
from sandra.describe.types import Prompt
from sandra.rankers.usage import Usage


class Failure(Enum):
    """Everything that can go wrong with an answer."""

    TIMEOUT = "timeout"
    UNREACHABLE = "unreachable"
    RATE_LIMITED = "rate-limited"
    SERVER_ERROR = "server-error"
    REJECTED = "rejected"
    """The server refused the request (wrong model, wrong key, bad request)."""
    REFUSED = "refused"
    """The model refused to answer."""
    EMPTY = "empty"
    TRUNCATED = "truncated"
    MALFORMED = "malformed"
    """Not the JSON that was asked for."""
    INFEASIBLE = "infeasible"
    """Only pairs that are unknown or not feasible here."""
    NOT_RECORDED = "not-recorded"
    """A replay that holds no ranking of this scenario."""
    NOT_ASKED = "not-asked"
    """No pair holds, so there was nothing to ask (mode verify-first)."""
    INTERNAL = "internal"
    """The ranker itself broke: a bug or a broken plug-in, named in `detail`."""


@dataclass(frozen=True, slots=True)
class Ranking:
    """At most k distinct feasible pairs, best first, or a named failure.

    A ranking may hold both: pairs that could be used, and what was wrong with the rest of the
    answer (`failure` None means that nothing was wrong; `warnings` names small repairs such as
    "duplicate keep,follow-lane removed").
    """

    pairs: tuple[ActionPair, ...]
    ranker: str
    failure: Failure | None = None
    detail: str | None = None
    warnings: tuple[str, ...] = ()
    reasoning: str | None = None
    answer: str | None = None
    """The raw answer of a model, as far as it was read."""
    usage: Usage | None = None
    """What it cost; None where no server was asked."""
    recorded_s: float | None = None
    """The answer is from the cache on disk; so long the server had once taken for it [s]."""

    @property
    def cached(self) -> bool:
        """Whether the answer is from the cache on disk."""
        return self.recorded_s is not None


@runtime_checkable
class Ranker(Protocol):
    """Anything that ranks. It never raises for what goes wrong with an answer.

    Two more attributes are looked for: `takes_pictures`, true if it looks at `Prompt.picture`, and
    `count_tokens(text)`, the number of a text's tokens by its model's own tokenizer.
    """

    @property
    def name(self) -> str:
        """How the ranker is called in results, e.g. "openai:gpt-4o"; a plain attribute will do."""
        ...

    def rank(self, prompt: Prompt, deadline: float | None = None) -> Ranking:
        """Rank within `deadline` seconds (None: no limit of its own)."""
        ...
