"""How often a ranker that reads puts first what was driven, on rows with a label."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from sandra.actions import ActionPair
from sandra.describe.types import Prompt, Situation
from sandra.learn.rows import Row
from sandra.rankers.types import Ranker

LATEST = 300.0
"""Longer than this no ranking is waited for: what is measured is not speed [s]."""


@dataclass(frozen=True, slots=True)
class Measured:
    """For each row the place of its label in the ranking, from 1; None if it is not in it."""

    places: tuple[int | None, ...]
    failures: int
    """Rankings that failed; they count as wrong."""

    def top(self, k: int) -> float:
        """Share of the rows whose label is among the first k."""
        if not self.places:
            return math.nan
        return sum(place is not None and place <= k for place in self.places) / len(self.places)

    def to_dict(self) -> dict[str, Any]:
        shares = {f"top{k}": self.top(k) for k in (1, 3)}
        return {"rows": len(self.places), "failures": self.failures, **shares}


def prompt_of(row: Row) -> Prompt:
    """The prompt of a labelled row, for rankers that read its text.

    The facts behind it are not in a row: they are undefined here, but for the feasible pairs.
    """
    pairs = tuple(ActionPair.parse(pair) for pair in row.feasible)
    unknown = math.nan
    situation = Situation(
        row.scenario, "", None, None, unknown, unknown, unknown, unknown, None, (), None, None,
        pairs, None, (),
    )  # fmt: skip
    return Prompt(
        system=row.system or "",
        user=row.user or "",
        schema=row.schema or {},
        k=len(row.ranking),
        longitudinal=tuple(dict.fromkeys(pair.longitudinal for pair in pairs)),
        lateral=tuple(dict.fromkeys(pair.lateral for pair in pairs)),
        situation=situation,
    )


def measure(
    ranker: Ranker,
    rows: Sequence[Row],
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> Measured:
    """Ask for a ranking of each row."""
    places: list[int | None] = []
    failures = 0
    for row in rows:
        ranking = ranker.rank(prompt_of(row), LATEST)
        ranked = [str(pair) for pair in ranking.pairs]
        failures += ranking.failure is not None
        places.append(ranked.index(row.label) + 1 if row.label in ranked else None)
        progress(len(places), len(rows))
    return Measured(tuple(places), failures)


def spread(rows: Sequence[Row], most: int) -> list[Row]:
    """At most so many rows, evenly from all of them; 0: all."""
    if not most or len(rows) <= most:
        return list(rows)
    return [rows[i * len(rows) // most] for i in range(most)]
