"""Safe@k and Top-k, defined here and nowhere else (paper, Sec. "Ablation Study").

Safe@k: the share of all scenarios in which at least one of the first k pairs is verified. Top-k:
the share in which the label is one of the first k pairs. The denominator is every scenario: where
an answer failed, a verdict is missing or a label is unknown, nothing is won, and it is counted.
"""

from __future__ import annotations

import statistics
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from sandra.actions import ActionPair, Lateral, Longitudinal
from sandra.evaluation.closed_loop.metrics import wilson

KS = (1, 2, 3)
ACTIONS = tuple(a.value for a in (*Longitudinal, *Lateral))
UNKNOWN = "unknown"


@dataclass(frozen=True, slots=True)
class Case:
    """One scenario, as one run answered it.

    `label` None is an unknown label. `safe[k - 1]` says whether one of the first k pairs is
    verified, None where nobody knows. `seconds` are durations by name [s].
    """

    scenario: str
    label: ActionPair | None
    ranking: tuple[ActionPair, ...]
    safe: tuple[bool | None, ...] = (None,) * len(KS)
    failure: str | None = None
    """What was wrong with the answer, or with the scenario."""
    seconds: Mapping[str, float] = field(default_factory=dict)

    def matches(self, k: int) -> bool:
        """Whether the label is one of the first k pairs."""
        return self.label is not None and self.label in self.ranking[:k]


@dataclass(frozen=True, slots=True)
class Rate:
    """`hits` of `n`, and Wilson's 95 % interval."""

    hits: int
    n: int

    @property
    def percent(self) -> float:
        """Of all; 0 of none is 0."""
        return 100.0 * self.hits / self.n if self.n else 0.0

    @property
    def interval(self) -> tuple[float, float]:
        """(low, high) in per cent; everything is possible where nothing was seen."""
        if not self.n:
            return 0.0, 100.0
        low, high = wilson(self.hits, self.n)
        return 100.0 * low, 100.0 * high


@dataclass(frozen=True, slots=True)
class Timing:
    """Durations [s]; the standard deviation is that of the sample, 0 of a single one."""

    mean: float
    deviation: float
    median: float
    most: float
    n: int

    @staticmethod
    def of(values: Sequence[float]) -> Timing:
        """Of at least one duration."""
        deviation = statistics.stdev(values) if len(values) > 1 else 0.0
        return Timing(
            statistics.fmean(values),
            deviation,
            statistics.median(values),
            max(values),
            len(values),
        )


@dataclass(frozen=True, slots=True)
class Score:
    """What a run scored: `safe[k - 1]` (None where no verdict is known at all) and `top[k - 1]`."""

    run: str
    n: int
    safe: tuple[Rate | None, ...]
    top: tuple[Rate, ...]
    unknown_labels: int = 0
    unknown_verdicts: int = 0
    """Scenarios in which it is not known of some k whether one of the first k is verified."""
    failures: Mapping[str, int] = field(default_factory=dict)
    repeated: int = 0
    """Rows that were left out because their scenario was there already."""
    seconds: Mapping[str, Timing] = field(default_factory=dict)
    baseline: bool = False

    def to_dict(self) -> dict[str, Any]:
        """safe1 ... top3 in per cent, and their intervals as safe1_interval ... [low, high]."""
        told: dict[str, Any] = {"run": self.run, "n": self.n}
        rates = [("safe", k, r) for k, r in zip(KS, self.safe, strict=True)]
        rates += [("top", k, r) for k, r in zip(KS, self.top, strict=True)]
        for name, k, rate in rates:
            told[f"{name}{k}"] = None if rate is None else rate.percent
        for name, k, rate in rates:
            told[f"{name}{k}_interval"] = None if rate is None else list(rate.interval)
        return told | {
            "unknown_labels": self.unknown_labels,
            "unknown_verdicts": self.unknown_verdicts,
            "failures": dict(self.failures),
            "repeated": self.repeated,
            "seconds": {
                name: {"mean": t.mean, "deviation": t.deviation, "median": t.median, "max": t.most}
                for name, t in self.seconds.items()
            },
            "baseline": self.baseline,
        }


def score(run: str, cases: Sequence[Case], *, repeated: int = 0, baseline: bool = False) -> Score:
    """What the cases of one run score."""
    n = len(cases)
    failures: dict[str, int] = {}
    for case in cases:
        if case.failure is not None:
            failures[case.failure] = failures.get(case.failure, 0) + 1
    names = dict.fromkeys(name for case in cases for name in case.seconds)
    known = [any(case.safe[k - 1] is not None for case in cases) for k in KS]
    return Score(
        run,
        n,
        tuple(
            Rate(sum(case.safe[k - 1] is True for case in cases), n) if some else None
            for k, some in zip(KS, known, strict=True)
        ),
        tuple(Rate(sum(case.matches(k) for case in cases), n) for k in KS),
        sum(case.label is None for case in cases),
        sum(
            any(safe is None for safe, some in zip(case.safe, known, strict=True) if some)
            for case in cases
        ),
        failures,
        repeated,
        {
            name: Timing.of([case.seconds[name] for case in cases if name in case.seconds])
            for name in names
        },
        baseline,
    )


def by_action(cases: Iterable[Case]) -> dict[str, Score]:
    """Scores of the cases whose label holds an action, by its name; those without a label last.

    A case with a label counts twice: for its longitudinal and for its lateral action.
    """
    found: dict[str, list[Case]] = {}
    for case in cases:
        pair = case.label
        names = (UNKNOWN,) if pair is None else (pair.longitudinal.value, pair.lateral.value)
        for name in names:
            found.setdefault(name, []).append(case)
    order = (*ACTIONS, UNKNOWN)
    return {name: score(name, found[name]) for name in order if name in found}
