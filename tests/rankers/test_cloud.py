"""The formats of cloud providers, from cassettes in `cassettes/test_cloud/`.

No provider was reached: the cassettes are written by hand after the public descriptions of the
interfaces, and say so. What they hold us to is the format: a request is answered only if its body
is, field by field, the one that is written there.
"""

from __future__ import annotations

import socket

import pytest

from sandra.actions import ALL_PAIRS, ActionPair, Lateral, Longitudinal
from sandra.describe import Prompt, Situation
from sandra.describe.schema import answer_schema
from sandra.rankers import Failure, Ranking, create

PAIRS = tuple(pair for pair in ALL_PAIRS if pair.lateral is Lateral.FOLLOW_LANE)
SITUATION = Situation(
    "cassette", "highway", None, None, 20.0, 0.0, 0.0, 0.0, 33.3, (), None, None, PAIRS, None, ()
)
PROMPT = Prompt(
    "Rank 2 pairs.",
    "The road is free.",
    answer_schema(PAIRS, 2),
    2,
    tuple(Longitudinal),
    (Lateral.FOLLOW_LANE,),
    SITUATION,
)
BEST = tuple(ActionPair.parse(f"{action},follow-lane") for action in ("accelerate", "keep"))


@pytest.fixture(autouse=True)
def _key(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("OPENAI_BASE_URL", raising=False)
    monkeypatch.setenv("OPENAI_API_KEY", "sk-nobody")


def rank(spec: str, base_url: str | None = None) -> Ranking:
    return create(spec, base_url=base_url).rank(PROMPT, 10.0)


CHAT, RESPONSES = "openai:gpt-x", "openai:gpt-x#api=responses"


@pytest.mark.vcr
@pytest.mark.parametrize(
    "spec",
    [
        pytest.param(CHAT, marks=pytest.mark.default_cassette("chat.yaml")),
        pytest.param(RESPONSES, marks=pytest.mark.default_cassette("responses.yaml")),
    ],
)
def test_a_streamed_answer(spec: str) -> None:
    ranking = rank(spec)
    assert ranking.failure is None, ranking
    assert ranking.pairs == BEST
    assert ranking.reasoning == "Nobody is ahead. – Go."


@pytest.mark.vcr
@pytest.mark.default_cassette("responses_whole.yaml")
def test_a_response_that_is_not_streamed() -> None:
    assert rank(RESPONSES).pairs == BEST


@pytest.mark.vcr
@pytest.mark.default_cassette("openrouter.yaml")
def test_a_provider_that_sends_comments_to_keep_the_connection() -> None:
    assert rank("openai:vendor/model", "https://openrouter.ai/api/v1").pairs == BEST


@pytest.mark.vcr
@pytest.mark.parametrize(
    ("spec", "failure", "words"),
    [
        pytest.param(
            CHAT,
            Failure.REFUSED,
            "I can't help",
            marks=pytest.mark.default_cassette("chat_refusal.yaml"),
        ),
        pytest.param(
            CHAT,
            Failure.REJECTED,
            "does not exist",
            marks=pytest.mark.default_cassette("chat_no_model.yaml"),
        ),
        pytest.param(
            RESPONSES,
            Failure.REFUSED,
            "I can't help",
            marks=pytest.mark.default_cassette("responses_refusal.yaml"),
        ),
        pytest.param(
            RESPONSES,
            Failure.TRUNCATED,
            "1 pairs kept",
            marks=pytest.mark.default_cassette("responses_incomplete.yaml"),
        ),
        pytest.param(
            RESPONSES,
            Failure.SERVER_ERROR,
            "overloaded",
            marks=pytest.mark.default_cassette("responses_failed.yaml"),
        ),
    ],
)
def test_what_goes_wrong_is_named(spec: str, failure: Failure, words: str) -> None:
    ranking = rank(spec)
    assert ranking.failure is failure, ranking
    assert words in (ranking.detail or "")
    assert ranking.pairs == (BEST[:1] if failure is Failure.TRUNCATED else ())


@pytest.mark.vcr
@pytest.mark.default_cassette("chat_rate_limit.yaml")
def test_a_pause_that_is_longer_than_the_deadline_is_not_waited_for() -> None:
    """From a host of its own: nobody else is to be kept waiting by it."""
    ranking = rank(CHAT, "https://limited.example/v1")
    assert ranking.failure is Failure.RATE_LIMITED
    assert "Rate limit reached" in (ranking.detail or "")


@pytest.mark.vcr
@pytest.mark.default_cassette("chat.yaml")
def test_another_body_is_not_answered() -> None:
    """The cassettes can fail: one more field, and there is no recorded answer."""
    ranking = rank(CHAT + "#temperature=0")
    assert ranking.failure in (Failure.INTERNAL, Failure.UNREACHABLE)
    assert not ranking.pairs


def test_no_test_reaches_outside() -> None:
    with socket.socket() as there, pytest.raises(RuntimeError, match="Network is disabled"):
        there.connect(("192.0.2.1", 80))
