"""What every model in this process is asked with."""

from __future__ import annotations

from typing import Any

from sandra.rankers.client import Problem
from sandra.rankers.endpoint import Question
from sandra.rankers.types import Failure

MOST_TOKENS = 1024
"""An answer is cut after so many."""
LONGEST_REASONING = 1500
"""Characters; small models repeat themselves, and would never come to the ranking."""
BUSY = Problem(Failure.TIMEOUT, "the model was busy with an earlier question")


def messages_of(question: Question) -> list[dict[str, str]]:
    """System text and turns, as chat templates take them."""
    turns = [{"role": role, "content": text} for role, text in question.turns]
    return [{"role": "system", "content": question.system}, *turns]


def schema_of(question: Question) -> dict[str, Any] | None:
    """The schema of the answer, with a limit on its free text; a grammar can keep that."""
    schema = question.schema
    if schema is None or "reasoning" not in schema["properties"]:
        return schema
    reasoning = {**schema["properties"]["reasoning"], "maxLength": LONGEST_REASONING}
    return {**schema, "properties": {**schema["properties"], "reasoning": reasoning}}
