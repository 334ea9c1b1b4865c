"""Why a REACHABLE pair has no certificate: reasons in words, sorted into a few kinds."""

from __future__ import annotations

import re

PREFIX = "no certificate: "
"""With what `certify` begins its reasons."""

STAGES = (
    ("need too much lateral acceleration", "every candidate needs too much lateral acceleration"),
    ("leave the corridor", "no candidate stays in the corridor"),
    ("leave the road with a part", "the full body leaves the road"),
    ("do not satisfy the formula", "no candidate in the corridor satisfies the formula"),
    ("collide with their full body", "the full body collides"),
    ("break a limit when driven", "driven with the single-track model, a limit is broken"),
    ("leave the corridor when driven", "driven with the single-track model, the corridor is left"),
    ("collide when driven", "driven with the single-track model, it collides"),
    ("leave the road when driven", "driven with the single-track model, the road is left"),
    ("the formula on their own trace", "driven with the single-track model, the formula fails"),
    ("no fail-safe continuation", "witnesses exist, none has a fail-safe continuation"),
)
"""Words in a reason and what kind it then is, in the order in which candidates are checked."""


def kind_of(reason: str) -> str:
    """The kind of a reason: how far the best of the candidates came, or the sentence itself."""
    reached = [kind for words, kind in STAGES if words in reason]
    if reached:
        return reached[-1]
    sentence = re.split(r"[:;(]", reason.removeprefix(PREFIX))[0].strip()
    return re.sub(r"-?\d+(\.\d+)?", "N", sentence)
