"""The strict JSON schema of an answer."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from sandra.actions import Lateral, Longitudinal


def answer_schema(
    longitudinal: Sequence[Longitudinal], lateral: Sequence[Lateral], k: int
) -> dict[str, Any]:
    """Reasoning first, then exactly `k` pairs of feasible actions (method 7).

    Fits the "strict" mode of structured outputs: every property is required and none may be
    added. JSON schema has no affordable way to say that the pairs are distinct; that is checked
    when the answer is read.
    """
    pair = {
        "type": "object",
        "properties": {
            "longitudinal": {"type": "string", "enum": [a.value for a in longitudinal]},
            "lateral": {"type": "string", "enum": [a.value for a in lateral]},
        },
        "required": ["longitudinal", "lateral"],
        "additionalProperties": False,
    }
    return {
        "type": "object",
        "properties": {
            "reasoning": {
                "type": "string",
                "description": "Step-by-step reasoning about the situation, in a few sentences.",
            },
            "ranking": {
                "type": "array",
                "description": f"{k} distinct action pairs, ranked from best to worst.",
                "items": pair,
                "minItems": k,
                "maxItems": k,
            },
        },
        "required": ["reasoning", "ranking"],
        "additionalProperties": False,
    }
