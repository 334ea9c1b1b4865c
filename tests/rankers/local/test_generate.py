"""Constrained decoding: only what the schema admits, and a memory that changes no answer."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from sandra.describe import describe, only
from sandra.rankers.bounded import Deadline
from sandra.rankers.endpoint import Exchange, Question
from sandra.rankers.local.folder import Folder, folder
from sandra.rankers.local.generate import Generating
from sandra.rankers.local.question import LONGEST_REASONING, MOST_TOKENS
from sandra.rankers.stream import Reply
from sandra.settings import Settings
from straight_road import Road

ROAD = Road()
PROMPT = describe(ROAD.scene(ROAD.obstacle(7, 60.0, 0.0, 8.0), lanes=ROAD.three_lanes()))
QUESTION = Question(PROMPT.system, (("user", PROMPT.user),), PROMPT.schema)


@pytest.fixture(scope="module")
def model(tiny: Path) -> Folder:
    return folder(tiny / "model", device="cpu")


def ask(asks: Generating, question: Question, seconds: float = 60.0) -> Reply:
    reply = asks.ask(question, Deadline(seconds), Exchange())
    assert isinstance(reply, Reply)
    return reply


@pytest.mark.parametrize("seed", range(6))
def test_whatever_is_drawn_fits_the_schema(model: Folder, seed: int) -> None:
    """At such a temperature it says anything, and still nothing that the schema does not admit."""
    hot = Generating(model, temperature=3.0, seed=seed)
    reply = ask(hot, QUESTION)
    assert reply.finish == "stop"
    answer = json.loads(reply.text)
    assert list(answer) == ["reasoning", "ranking"]
    assert len(answer["reasoning"]) <= LONGEST_REASONING
    feasible = {(p.longitudinal.value, p.lateral.value) for p in PROMPT.feasible}
    assert len(answer["ranking"]) == PROMPT.k
    assert len({(r["longitudinal"], r["lateral"]) for r in answer["ranking"]}) == PROMPT.k
    assert all((r["longitudinal"], r["lateral"]) in feasible for r in answer["ranking"])
    assert ask(Generating(model, temperature=3.0, seed=seed), QUESTION).text == reply.text


def test_seeds_differ(model: Folder) -> None:
    answers = {ask(Generating(model, 3.0, seed), QUESTION).text for seed in range(3)}
    assert len(answers) == 3


def test_without_a_schema_any_text_will_do(model: Folder) -> None:
    reply = ask(Generating(model), Question(PROMPT.system, (("user", PROMPT.user),), None))
    assert reply.text
    assert reply.finish in ("stop", "length")
    assert "<|im_end|>" not in reply.text


def test_where_the_grammar_gives_up_the_schema_holds(model: Folder) -> None:
    twelve = describe(
        ROAD.scene(lanes=ROAD.three_lanes()), settings=Settings(k=len(PROMPT.feasible))
    )
    question = Question(twelve.system, (("user", twelve.user),), twelve.schema)
    answer = json.loads(ask(Generating(model), question).text)
    assert len(answer["ranking"]) == 12


def test_half_a_ranking_is_asked_for(model: Folder) -> None:
    question = Question(PROMPT.system, QUESTION.turns, only(PROMPT.schema, "ranking"))
    assert list(json.loads(ask(Generating(model), question).text)) == ["ranking"]


def test_what_was_read_before_changes_nothing(model: Folder) -> None:
    """The logits after a text whose beginning was in memory are those of a fresh reading."""
    tokens = model.tokens_of(model.text_of([{"role": "user", "content": PROMPT.user}]))
    memory = model.read(tokens, Deadline(60.0))
    assert memory is not None
    first = memory.logits.numpy().copy()
    memory.feed(model.tokens_of('{"reasoning": "'))
    model.read(model.tokens_of("something else"), Deadline(60.0))
    for begun in (tokens[:50], tokens[:-1], [*tokens, *tokens[:9]], tokens):
        assert model.read(begun, Deadline(60.0)) is not None
        again = model.read(tokens, Deadline(60.0))
        assert again is not None
        assert again.tokens == tokens
        assert again.cache.get_seq_length() == len(tokens)
        assert np.abs(again.logits.numpy() - first).max() < 1e-3


def test_a_question_that_nobody_waits_for_is_not_read_to_its_end(model: Folder) -> None:
    model.read(model.tokens_of("nothing"), Deadline(60.0))
    long = model.tokens_of(PROMPT.user * 20)
    over = Deadline(60.0)
    over.end()
    assert model.read(long, over) is None
    reply = ask(Generating(model), QUESTION, 60.0)
    assert not reply.ended_early


def test_an_answer_has_an_end(model: Folder, monkeypatch: pytest.MonkeyPatch) -> None:
    assert MOST_TOKENS > LONGEST_REASONING / 4
    monkeypatch.setattr("sandra.rankers.local.generate.MOST_TOKENS", 5)
    assert ask(Generating(model), QUESTION).finish == "length"
