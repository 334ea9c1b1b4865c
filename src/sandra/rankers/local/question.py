"""What every model in this process is asked with."""

from __future__ import annotations

from typing import Any

from sandra.rankers.client import Problem
from sandra.rankers.endpoint import Content, Question
from sandra.rankers.types import Failure

MOST_TOKENS = 1024
"""An answer is cut after so many."""
LONGEST_REASONING = 1500
"""Characters; small models repeat themselves, and would never come to the ranking."""
BUSY = Problem(Failure.TIMEOUT, "the model was busy with an earlier question")


def messages_of(question: Question) -> list[dict[str, str]]:
    """System text and turns, as chat templates take them; the models here look at no pictures."""
    turns = [{"role": role, "content": text_of(content)} for role, content in question.turns]
    return [{"role": "system", "content": question.system}, *turns]


def text_of(content: Content) -> str:
    """A turn without its picture."""
    if isinstance(content, str):
        return content
    return "\n".join(part["text"] for part in content if part["type"] == "text")


def schema_of(question: Question) -> dict[str, Any] | None:
    """The schema of the answer, with a limit on its free text; a grammar can keep that."""
    schema = question.schema
    if schema is None or "reasoning" not in schema["properties"]:
        return schema
    reasoning = {**schema["properties"]["reasoning"], "maxLength": LONGEST_REASONING}
    return {**schema, "properties": {**schema["properties"], "reasoning": reasoning}}
