"""What is asked of a chat server. What it may do in return: tests/test_hostile.py."""

from __future__ import annotations

import json
from collections.abc import Iterator

import pytest

from chat_server import ChatServer, chat_server
from hostile_server import GOOD, answer, error, whole
from sandra.actions import ActionPair
from sandra.describe import describe
from sandra.errors import RankerError
from sandra.rankers import Failure, create
from sandra.rankers.chat import ChatRanker
from straight_road import Road

PROMPT = describe(Road().scene(), "drive faster")
PAIRS = [ActionPair.of(*pair) for pair in GOOD]

pytestmark = pytest.mark.usefixtures("no_openai_key")


@pytest.fixture
def server() -> Iterator[ChatServer]:
    with chat_server() as server:
        yield server


def test_what_is_sent(server: ChatServer) -> None:
    server.plays = [whole(answer(*GOOD))]
    create("openai:a:b", base_url=server.url).rank(PROMPT)
    (sent,) = server.requests
    assert sent["model"] == "a:b"
    assert [m["role"] for m in sent["messages"]] == ["system", "user"]
    assert [m["content"] for m in sent["messages"]] == [PROMPT.system, PROMPT.user]
    schema = sent["response_format"]["json_schema"]
    assert (schema["strict"], schema["schema"]) == (True, PROMPT.schema)
    assert sent["stream_options"] == {"include_usage": True}
    assert set(sent) == {"model", "messages", "response_format", "stream", "stream_options"}
    create("openai:m", base_url=server.url, temperature=0.0, seed=4).rank(PROMPT)
    assert (server.requests[-1]["temperature"], server.requests[-1]["seed"]) == (0.0, 4)


def test_a_server_without_structured_outputs_is_told_the_schema_in_words(
    server: ChatServer,
) -> None:
    server.plays = [error(400, "Unknown field: response_format"), whole(answer(*GOOD))]
    ranking = ChatRanker("m", base_url=server.url, deadline=3.0).rank(PROMPT)
    assert list(ranking.pairs) == PAIRS
    first, second = server.requests
    assert "response_format" in first
    assert "response_format" not in second
    assert json.dumps(PROMPT.schema, ensure_ascii=False) in second["messages"][0]["content"]
    server.requests.clear()
    server.plays = [error(400, "response_format again")]
    ranking = ChatRanker("m", base_url=server.url, deadline=3.0).rank(PROMPT)
    assert ranking.failure is Failure.REJECTED
    assert len(server.requests) == 2


def test_fields_that_a_server_refuses_are_not_sent_again(server: ChatServer) -> None:
    server.plays = [error(422, "stream_options: extra field"), whole(answer(*GOOD))]
    ranker = create("openai:m", base_url=server.url)
    assert list(ranker.rank(PROMPT).pairs) == PAIRS
    assert list(ranker.rank(PROMPT).pairs) == PAIRS
    assert ["stream_options" in r for r in server.requests] == [True, False, False]
    assert all("response_format" in r for r in server.requests)


def test_what_cannot_work_is_refused_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(RankerError, match="OPENAI_API_KEY"):
        create("openai:gpt-4o")
    with pytest.raises(RankerError, match="OPENAI_API_KEY"):
        create("openai:gpt-4o", base_url="https://api.openai.com/v1")
    with pytest.raises(RankerError, match="no model"):
        create("openai:", base_url="http://localhost:1/v1")
    for address in ("localhost:8000", "ftp://x/v1", "http://"):
        with pytest.raises(RankerError, match="http://localhost:8000/v1"):
            create("openai:m", base_url=address)
    for deadline in (0.0, -1.0, float("inf"), float("nan")):
        with pytest.raises(RankerError, match="deadline"):
            create("openai:m", base_url="http://localhost:1/v1", deadline=deadline)
    monkeypatch.setenv("OPENAI_API_KEY", "key")
    assert create("openai:gpt-4o").name == "openai:gpt-4o"
    monkeypatch.delenv("OPENAI_API_KEY")
    monkeypatch.setenv("OPENAI_BASE_URL", "http://localhost:1/v1")
    assert create("openai:m").name == "openai:m"
