"""What a check answers: accepted, or the first violated condition with its numbers."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True, slots=True)
class Violation:
    """The first condition that does not hold.

    `step` counts prediction steps k, or grid points of the trajectory that `sentence` names;
    `time` is in s. `measured` and `allowed` are the two numbers that do not fit, if it is numbers.
    """

    condition: str
    sentence: str
    step: int | None = None
    time: float | None = None
    measured: float | None = None
    allowed: float | None = None

    def to_dict(self) -> dict[str, Any]:
        """As JSON: a number that is not finite becomes None."""
        return {
            "condition": self.condition,
            "sentence": self.sentence,
            "step": self.step,
            "time": _finite(self.time),
            "measured": _finite(self.measured),
            "allowed": _finite(self.allowed),
        }


@dataclass(frozen=True, slots=True)
class Checked:
    """A condition that holds, with how much is left before it does not (None: no number)."""

    condition: str
    sentence: str
    margin: float | None = None
    unit: str = ""

    def to_dict(self) -> dict[str, Any]:
        """As JSON: a margin that is not finite becomes None."""
        return {
            "condition": self.condition,
            "sentence": self.sentence,
            "margin": _finite(self.margin),
            "unit": self.unit,
        }


@dataclass(frozen=True, slots=True)
class Report:
    """The answer of the checker. `accepted` exactly if every condition was checked and holds."""

    scenario: str
    pair: str
    checked: tuple[Checked, ...]
    violation: Violation | None

    @property
    def accepted(self) -> bool:
        """Whether every condition holds."""
        return self.violation is None

    def to_dict(self) -> dict[str, Any]:
        """The JSON contract of `sandra certificate check --json`."""
        return {
            "accepted": self.accepted,
            "scenario": self.scenario,
            "pair": self.pair,
            "violation": None if self.violation is None else self.violation.to_dict(),
            "checked": [each.to_dict() for each in self.checked],
        }

    def __str__(self) -> str:
        head = "accepted" if self.accepted else "rejected"
        lines = [f"{head}: {self.pair} in {self.scenario}"]
        for each in self.checked:
            lines.append(f"  ok    {each.condition:<21} {each.sentence}")
        if self.violation is not None:
            lines.append(f"  FAILS {self.violation.condition:<21} {self.violation.sentence}")
        return "\n".join(lines)


def _finite(value: float | None) -> float | None:
    return value if value is not None and math.isfinite(value) else None
