"""Rankings that look at nothing: what a table of open-loop scores must be read beside.

98 % of recorded labels are follow-lane, so one constant ranking has more matches than most models.
"""

from __future__ import annotations

import random
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence

from sandra.actions import ALL_PAIRS, ActionPair, Lateral, Longitudinal
from sandra.evaluation.open_loop.scores import KS, Case

Verdicts = Mapping[str, Mapping[ActionPair, bool]]
"""By scenario and pair, whether it is verified; what is missing is not known."""

CONSTANT = ("keep", "decelerate", "accelerate")
CAUTIOUS = ("decelerate", "stop", "keep")
SEED = 0


def constant(names: Sequence[str]) -> tuple[ActionPair, ...]:
    """Longitudinal actions, each with follow-lane."""
    return tuple(ActionPair(Longitudinal(name), Lateral.FOLLOW_LANE) for name in names)


def majority(labels: Iterable[ActionPair | None]) -> tuple[ActionPair, ...]:
    """The most frequent labels, at equal numbers in the order of Tab. II."""
    counts = Counter(label for label in labels if label is not None)
    return tuple(sorted(counts, key=lambda p: (-counts[p], ALL_PAIRS.index(p)))[: max(KS)])


def answers(
    labels: Mapping[str, ActionPair | None], verdicts: Verdicts
) -> dict[str, tuple[Case, ...]]:
    """The cases of the trivial rankings, by their names.

    Args:
        labels: by scenario. verdicts: may be empty; then nothing is said of safety.
    """
    source = random.Random(SEED)
    fixed = {
        f"constant ranking ({', '.join(names)}) x follow-lane": constant(names)
        for names in (CONSTANT, CAUTIOUS)
    }
    fixed["constant ranking, most frequent labels of these scenarios"] = majority(labels.values())
    rankings = {name: dict.fromkeys(labels, ranking) for name, ranking in fixed.items()}
    rankings[f"random ranking of all twelve pairs (seed {SEED})"] = {
        scenario: tuple(source.sample(ALL_PAIRS, max(KS))) for scenario in labels
    }
    return {
        name: tuple(
            Case(scenario, labels[scenario], ranking, safe_of(ranking, verdicts.get(scenario)))
            for scenario, ranking in ranked.items()
        )
        for name, ranked in rankings.items()
    }


def safe_of(
    ranking: Sequence[ActionPair], verdicts: Mapping[ActionPair, bool] | None
) -> tuple[bool | None, ...]:
    """For each k whether one of the first k pairs is verified; None if that is not known."""
    known = [(verdicts or {}).get(pair) for pair in ranking]
    found: list[bool | None] = []
    for k in KS:
        first = known[:k]
        found.append(True if True in first else None if None in first else False)
    return tuple(found)
