"""Short rows of prompt and ranking, so that learning from them is quick."""

from __future__ import annotations

import random

from sandra.actions import ALL_PAIRS
from sandra.describe.schema import answer_schema
from sandra.learn.rows import Row

LABEL = "decelerate,left-lane"
PAIRS = tuple(map(str, ALL_PAIRS))
REST = tuple(pair for pair in PAIRS if pair != LABEL)


def row(number: int, split: str) -> Row:
    """Everybody goes left, slower: nothing that a model knows beforehand."""
    rest = random.Random(number).sample(REST, 2)
    return Row(
        status="labelled", split=split, scenario=f"{number}.xml", ego=1, step=number, label=LABEL,
        system="Rank 3 pairs.", user=f"Vehicle {number} drives {3 * number} m in front of the ego.",
        schema=answer_schema(ALL_PAIRS, 3), feasible=PAIRS, ranking=(LABEL, *rest),
    )  # fmt: skip
