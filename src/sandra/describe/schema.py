"""The strict JSON schema of an answer."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

from sandra.actions import ActionPair, Lateral, Longitudinal


def answer_schema(pairs: Sequence[ActionPair], k: int) -> dict[str, Any]:
    """Reasoning first, then exactly `k` of `pairs` (method 7).

    Fits the "strict" mode of structured outputs: every property is required and none may be
    added. JSON schema has no affordable way to say that the pairs are distinct; that is checked
    when the answer is read.

    Raises:
        ValueError: unless 1 <= k <= len(pairs).
    """
    if not 1 <= k <= len(pairs):
        raise ValueError(f"{k} distinct pairs cannot be asked for where {len(pairs)} are admitted")
    return _object(
        {
            "reasoning": {
                "type": "string",
                "description": "Step-by-step reasoning about the situation, in a few sentences.",
            },
            "ranking": {
                "type": "array",
                "description": f"{k} distinct action pairs, ranked from best to worst.",
                "items": _pair(pairs),
                "minItems": k,
                "maxItems": k,
            },
        }
    )


def only(schema: dict[str, Any], name: str) -> dict[str, Any]:
    """The schema of an answer that holds one of its properties and no other."""
    return _object({name: schema["properties"][name]})


def _pair(pairs: Iterable[ActionPair]) -> dict[str, Any]:
    """Exactly these pairs: every product of actions that they fill, side by side."""
    of_lateral: dict[Lateral, tuple[Longitudinal, ...]] = {}
    for pair in pairs:
        of_lateral[pair.lateral] = (*of_lateral.get(pair.lateral, ()), pair.longitudinal)
    products: dict[tuple[Longitudinal, ...], tuple[Lateral, ...]] = {}
    for lateral, longitudinal in of_lateral.items():
        products[longitudinal] = (*products.get(longitudinal, ()), lateral)
    found = [
        _object(
            {
                "longitudinal": {"type": "string", "enum": [a.value for a in longitudinal]},
                "lateral": {"type": "string", "enum": [a.value for a in lateral]},
            }
        )
        for longitudinal, lateral in products.items()
    ]
    return found[0] if len(found) == 1 else {"anyOf": found}


def _object(properties: dict[str, Any]) -> dict[str, Any]:
    return {
        "type": "object",
        "properties": properties,
        "required": list(properties),
        "additionalProperties": False,
    }
