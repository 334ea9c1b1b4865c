"""What a JSON schema has no affordable way to say: that the pairs of a ranking are distinct.

A model in this process is held to a grammar, which can: after each pair the rule that follows
admits only pairs that have not been written. Small models repeat themselves otherwise.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from itertools import combinations
from math import comb
from typing import Any

from sandra.rankers.local.question import LONGEST_REASONING

MOST_RULES = 1000
"""A grammar of more rules is not made: nobody asks for so many pairs."""

Spoken = dict[str, str]
"""A pair as it is written: longitudinal and lateral action."""


def grammar_of(schema: dict[str, Any]) -> str | None:
    """The answers that fit the schema, without repetition, as a grammar of llguidance (Lark).

    They are written as `json.dumps` writes them: where any white space will do, a small model
    writes nothing else. None for a schema that is no ranking's, or asks for too many pairs.
    """
    rules: list[str] = []
    members = []
    for name, part in schema["properties"].items():
        if name == "reasoning" and part.get("type") == "string":
            limited = json.dumps({"type": "string", "maxLength": LONGEST_REASONING})
            rules.append(f"reasoning: %json {limited}")
            members.append(f"{_text(json.dumps(name) + ': ')} reasoning")
        elif name == "ranking" and part.get("minItems") == part.get("maxItems"):
            pairs = list(spoken_pairs(part["items"]))
            count = part["maxItems"]
            if not 1 <= count <= len(pairs) or _size(len(pairs), count) > MOST_RULES:
                return None
            rules += _distinct(pairs, count)
            members.append(f'{_text(json.dumps(name) + ": [")} after_ "]"')
        else:
            return None
    start = ' ", " '.join(members)
    return "\n".join([f'start: "{{" {start} "}}"', *rules])


def spoken_pairs(items: dict[str, Any]) -> Iterator[Spoken]:
    """The pairs that the schema of a ranking's items admits."""
    for branch in items.get("anyOf", [items]):
        actions = branch["properties"]
        for lateral in actions["lateral"]["enum"]:
            for longitudinal in actions["longitudinal"]["enum"]:
                yield {"longitudinal": longitudinal, "lateral": lateral}


def _distinct(pairs: Sequence[Spoken], count: int) -> Iterator[str]:
    """One rule for each set of pairs that may have been written before."""
    for i, pair in enumerate(pairs):
        yield f"pair_{i}: {_text(json.dumps(pair))}"
    numbers = range(len(pairs))
    for written in range(count):
        for used in combinations(numbers, written):
            ways = []
            for i in numbers:
                if i in used:
                    continue
                rest = f' ", " {_after((*used, i))}' if written + 1 < count else ""
                ways.append(f"pair_{i}{rest}")
            yield f"{_after(used)}: {' | '.join(ways)}"


def _after(used: Sequence[int]) -> str:
    return "after_" + "_".join(map(str, sorted(used)))


def _size(pairs: int, count: int) -> int:
    return sum(comb(pairs, written) for written in range(count))


def _text(words: str) -> str:
    """As a literal of the grammar."""
    return json.dumps(words)
