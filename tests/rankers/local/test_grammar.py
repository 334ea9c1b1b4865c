"""The grammar of an answer: what it admits, and what it does not."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from sandra.describe import Prompt, describe, narrow, only
from sandra.rankers.local.grammar import grammar_of, spoken_pairs
from sandra.settings import Settings
from straight_road import Road

ROAD = Road()
SCENE = ROAD.scene(lanes=ROAD.three_lanes())
PROMPT = describe(SCENE)
KEEP, STOP, LEFT = (
    {"longitudinal": lon, "lateral": lat}
    for lon, lat in (("keep", "follow-lane"), ("stop", "follow-lane"), ("keep", "left-lane"))
)


@pytest.fixture(scope="module")
def admits(tiny: Path) -> Any:
    """Whether a whole text fits the grammar of a schema."""
    import llguidance
    import llguidance.hf
    from transformers import AutoTokenizer

    tokenizer = AutoTokenizer.from_pretrained(tiny / "model")
    tokens = llguidance.hf.from_tokenizer(tokenizer)

    def check(schema: dict[str, Any], text: str) -> bool:
        rules = grammar_of(schema)
        assert rules is not None
        matcher = llguidance.LLMatcher(tokens, llguidance.LLMatcher.grammar_from_lark(rules))
        assert not matcher.is_error()
        ids = tokenizer(text)["input_ids"]
        return bool(matcher.try_consume_tokens(ids) == len(ids) and matcher.is_accepting())

    return check


def answer(*pairs: dict[str, str], reasoning: str = 'a "free" road\n \u00e9') -> str:
    return json.dumps({"reasoning": reasoning, "ranking": list(pairs)}, ensure_ascii=False)


def test_the_pairs_of_a_schema_are_the_feasible_ones() -> None:
    some = [p for p in PROMPT.feasible if str(p) not in ("keep,left-lane", "stop,follow-lane")]
    for prompt in (PROMPT, narrow(PROMPT, some), describe(ROAD.scene())):
        items = prompt.schema["properties"]["ranking"]["items"]
        spoken = [(p["longitudinal"], p["lateral"]) for p in spoken_pairs(items)]
        assert len(spoken) == len(set(spoken))
        assert set(spoken) == {(p.longitudinal.value, p.lateral.value) for p in prompt.feasible}


def test_distinct_pairs_and_exactly_k(admits: Any) -> None:
    assert admits(PROMPT.schema, answer(KEEP, STOP, LEFT))
    assert admits(PROMPT.schema, answer(LEFT, STOP, KEEP))
    for pairs in [(KEEP, KEEP, STOP), (KEEP, STOP, KEEP), (KEEP, STOP), (KEEP, STOP, LEFT, KEEP)]:
        assert not admits(PROMPT.schema, answer(*pairs))
    hover = {"longitudinal": "hover", "lateral": "follow-lane"}
    assert not admits(PROMPT.schema, answer(KEEP, STOP, hover))
    one_lane = describe(ROAD.scene())
    assert not admits(one_lane.schema, answer(KEEP, STOP, LEFT))


def test_the_reasoning_has_an_end(admits: Any) -> None:
    assert admits(PROMPT.schema, answer(KEEP, STOP, LEFT, reasoning="a" * 1500))
    assert not admits(PROMPT.schema, answer(KEEP, STOP, LEFT, reasoning="a" * 1501))


def test_halves_of_an_answer(admits: Any) -> None:
    assert admits(only(PROMPT.schema, "reasoning"), '{"reasoning": "free"}')
    ranking = json.dumps({"ranking": [KEEP, STOP, LEFT]})
    assert admits(only(PROMPT.schema, "ranking"), ranking)
    assert not admits(only(PROMPT.schema, "ranking"), answer(KEEP, STOP, LEFT))


def asking_for(k: int) -> Prompt:
    return describe(SCENE, settings=Settings(k=k))


def test_what_it_cannot_say_is_left_to_the_schema() -> None:
    assert grammar_of(asking_for(4).schema) is not None
    assert grammar_of(asking_for(12).schema) is None  # thousands of rules
    assert grammar_of({"type": "object", "properties": {"action": {"type": "integer"}}}) is None
