"""Three verdicts, never two, and only the verifier's evidence makes a positive one."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from enum import Enum
from typing import TYPE_CHECKING, Any, Protocol

from sandra.actions import ActionPair
from sandra.logic import Specification
from sandra.reach.ground import Ground
from sandra.reach.sets import ReachableSet

if TYPE_CHECKING:
    from pathlib import Path


class Status(Enum):
    """What is known of a pair."""

    UNSAFE = "UNSAFE"
    """The over-approximated set is empty at some step: no compliant trajectory exists."""
    REACHABLE = "REACHABLE"
    """The set is non-empty through the horizon: necessary, not sufficient."""
    CERTIFIED = "CERTIFIED"
    """A trajectory with a fail-safe continuation was accepted by an independent checker."""


class Proof(Protocol):
    """A certificate with the answer of the independent checker (`sandra.certify.Proven`)."""

    @property
    def accepted(self) -> bool:
        """Whether the checker accepted it."""
        ...


@dataclass(frozen=True, slots=True, eq=False)
class Verdict:
    """What the verifier says of one pair, and why.

    `reason` says what emptied the set of an UNSAFE pair, or, where a certificate was asked for, why
    a REACHABLE pair has none.

    Raises:
        ValueError: if a positive status is claimed without the set, or the accepted certificate,
            that proves it.
    """

    pair: ActionPair
    status: Status
    specification: Specification
    reachable_set: ReachableSet
    reason: str | None
    duration_s: float
    proof: Proof | None = None

    def __post_init__(self) -> None:
        empty = self.reachable_set.first_empty_step
        if (self.status is Status.UNSAFE) != (empty is not None):
            raise ValueError(f"{self.pair}: {self.status.value} contradicts its reachable set")
        proven = self.proof is not None and self.proof.accepted is True
        if (self.status is Status.CERTIFIED) != proven:
            raise ValueError(f"{self.pair}: {self.status.value} contradicts its certificate")

    @property
    def first_empty_step(self) -> int | None:
        """The first step at which the set is empty; None if it never is."""
        return self.reachable_set.first_empty_step

    def to_dict(self) -> dict[str, Any]:
        """The entry of the JSON contract."""
        return {
            **self.pair.to_dict(),
            "status": self.status.value,
            "first_empty_step": self.first_empty_step,
            "reason": self.reason,
            "duration_s": self.duration_s,
        }

    def __str__(self) -> str:
        text = (
            f"{self.pair.longitudinal.value:>10}, {self.pair.lateral.value:<11} {self.status.value}"
        )
        return text if self.reason is None else f"{text}: {self.reason}"


@dataclass(frozen=True, slots=True, eq=False)
class Verdicts:
    """Verdicts over several pairs on the same ground, in the order in which they were asked."""

    verdicts: tuple[Verdict, ...]
    ground: Ground
    rules: tuple[str, ...]

    def __iter__(self) -> Iterator[Verdict]:
        return iter(self.verdicts)

    def __len__(self) -> int:
        return len(self.verdicts)

    def __getitem__(self, pair: ActionPair | str | int) -> Verdict:
        """The verdict of a pair, given as `ActionPair`, text, or position."""
        if isinstance(pair, int):
            return self.verdicts[pair]
        wanted = ActionPair.parse(pair) if isinstance(pair, str) else pair
        for verdict in self.verdicts:
            if verdict.pair == wanted:
                return verdict
        raise KeyError(f"{wanted} was not verified")

    def to_list(self) -> list[dict[str, Any]]:
        """The list of the JSON contract."""
        return [verdict.to_dict() for verdict in self.verdicts]

    def corridor(self, pair: ActionPair | str | int) -> dict[str, Any]:
        """The driving corridor of a pair as plain data, for a planner of the user's own.

        See `sandra.reach.export.corridor_data`.
        """
        from sandra.reach.export import corridor_data

        return corridor_data(self, pair)

    def figure(self, path: str | Path, **options: Any) -> Path:
        """Draw scenario, prediction, sets and table; see `sandra.view.verdict_figure`."""
        from sandra.view import verdict_figure

        return verdict_figure(self, path, **options)

    def __str__(self) -> str:
        return "\n".join(str(verdict) for verdict in self.verdicts)
