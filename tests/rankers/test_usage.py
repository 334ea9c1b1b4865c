"""What rankings cost, from the wire to the bill."""

import json
from pathlib import Path
from typing import Any

import pytest

import sandra
from chat_server import chat_server
from hostile_server import GOOD, Handler, Play, answer, body, error, stall, stream, whole
from sandra.cli import main
from sandra.describe import describe
from sandra.errors import SettingsError
from sandra.rankers import Usage, create, total
from sandra.rankers.usage import Price, cost, load_prices, told, told_by_server
from straight_road import Road

SCENE = Road().scene()
PROMPT = describe(SCENE)
TOLD = {
    "prompt_tokens": 900,
    "completion_tokens": 80,
    "total_tokens": 980,
    "prompt_tokens_details": {"cached_tokens": 512},
}
FULL = Usage(requests=1, input=900, cached_input=512, output=80)
ALL = answer(*GOOD)


pytestmark = pytest.mark.usefixtures("no_openai_key")


def in_one_body(usage: object) -> Play:
    choice = {"index": 0, "message": {"content": ALL}, "finish_reason": "stop"}
    return body({"choices": [choice], "usage": usage})


def late(handler: Handler) -> None:
    handler.begin()
    handler.chunk(ALL[:-40])
    handler.wfile.flush()
    stall(handler)


@pytest.mark.parametrize(
    ("plays", "usage"),
    [
        ([stream(ALL, usage=TOLD)], FULL),
        ([in_one_body(TOLD)], FULL),
        ([whole(ALL)], Usage(requests=1, unknown=1)),
        ([error(429), error(503), stream(ALL, usage=TOLD)], FULL + Usage(requests=2)),
        ([error(401)], Usage(requests=1)),
        ([late], Usage(requests=1, unknown=1)),
        ([stall], Usage(requests=1, unknown=1)),
        ([stream("no ranking", usage=TOLD)], FULL),
    ],
)
def test_a_ranking_tells_what_it_cost(plays: list[Play], usage: Usage) -> None:
    with chat_server(*plays) as server:
        ranking = create("openai:m", base_url=server.url).rank(PROMPT, 1.5)
    assert ranking.usage == usage
    assert not ranking.cached


def test_both_turns_of_verify_first_are_on_the_bill() -> None:
    with chat_server(
        stream(json.dumps({"reasoning": "free"}), usage=TOLD), stream(ALL, usage=TOLD)
    ) as server:
        decision = sandra.decide(
            SCENE, "openai:m", base_url=server.url, mode="verify-first", horizon=4
        )
    assert decision.ranking.usage == FULL + FULL
    assert decision.to_dict()["usage"]["output"] == 160


def test_rankers_without_a_server_have_no_bill() -> None:
    for spec in ("rules", "exhaustive", "random:1", "garbage"):
        assert create(spec).rank(PROMPT).usage is None
    assert total([None, None]) is None
    assert total([None, FULL, FULL]) == FULL + FULL


@pytest.mark.parametrize(
    ("data", "usage"),
    [
        (TOLD, Usage(input=900, cached_input=512, output=80)),
        ({"input_tokens": 3, "output_tokens": 4}, Usage(input=3, output=4)),
        (
            {"prompt_tokens": 3, "completion_tokens": 4, "prompt_tokens_details": 5},
            Usage(input=3, output=4),
        ),
        ({"prompt_tokens": -3, "completion_tokens": 10**12}, Usage()),
        ({"prompt_tokens": True, "completion_tokens": "4"}, Usage()),
        ({"total_tokens": 7}, None),
        ({}, None),
        ([1], None),
        (None, None),
    ],
)
def test_what_a_server_tells(data: object, usage: Usage | None) -> None:
    assert told_by_server(data) == usage


def test_usage_survives_json() -> None:
    assert Usage.of_dict(json.loads(json.dumps(FULL.to_dict()))) == FULL
    assert Usage.of_dict(None) == Usage.of_dict({"input": "x"}) == Usage()


PRICES = """
["openai:m"]
input = 2.0
cached_input = 0.5
output = 10.0

["vllm:n"]
input = 1
output = 1
currency = "EUR"
"""


@pytest.fixture
def prices(tmp_path: Path) -> Path:
    path = tmp_path / "prices.toml"
    path.write_text(PRICES, encoding="utf-8")
    return path


def test_money(prices: Path) -> None:
    known = load_prices(prices)
    assert known["vllm:n"] == Price(1, 1, None, "EUR")
    by_hand = (388 * 2.0 + 512 * 0.5 + 80 * 10.0) / 1e6
    bill = cost(FULL, "openai:m#api=responses", known)
    assert bill == {"usage": FULL.to_dict(), "money": pytest.approx(by_hand), "currency": "USD"}
    assert known["vllm:n"].of(FULL) == pytest.approx(980 / 1e6)
    assert told(FULL, "openai:m", known) == (
        "1 requests; 900 tokens read, 80 written; 512 of those read from the server's cache; "
        "0.0018 USD"
    )
    unknown = FULL + Usage(requests=1, unknown=1)
    assert "1 requests of unknown size; at least 0.0018 USD" in (
        told(unknown, "openai:m", known) or ""
    )
    # Without a price there are tokens, and no money.
    assert cost(FULL, "openai:other", known) == {
        "usage": FULL.to_dict(),
        "money": None,
        "currency": None,
    }
    assert (told(FULL, "openai:other", known) or "").endswith("no price of openai:other is known")
    assert cost(None, "rules", known) is told(None, "rules", known) is None


@pytest.mark.parametrize(
    "text",
    [
        "x",
        "input = 1.0",
        '["openai:m"]\ninput = 1.0',
        '["openai:m"]\ninput = 1.0\noutput = -1.0',
        '["openai:m"]\ninput = nan\noutput = 1.0',
        '["openai:m"]\ninput = true\noutput = 1.0',
        '["openai:m"]\ninput = "1"\noutput = 1.0',
        '["openai:m"]\ninput = 1.0\noutput = 1.0\nperhaps = 3.0',
        '["openai:m"]\ninput = 1.0\noutput = 1.0\ncurrency = 3',
    ],
)
def test_a_file_of_prices_that_is_none(tmp_path: Path, text: str) -> None:
    path = tmp_path / "prices.toml"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(SettingsError, match=r"prices\.toml") as caught:
        load_prices(path)
    assert "\n" not in str(caught.value)
    with pytest.raises(SettingsError, match="cannot be read"):
        load_prices(tmp_path / "none.toml")


def test_the_prices_in_the_documents_are_ones(tmp_path: Path) -> None:
    text = (Path(__file__).parents[2] / "docs" / "rankers.md").read_text(encoding="utf-8")
    path = tmp_path / "prices.toml"
    path.write_text(text.partition("```toml\n")[2].partition("```")[0], encoding="utf-8")
    assert set(load_prices(path)) == {"openai:some-model", "vllm:other-model"}


def test_the_commands_tell_the_cost(
    prices: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip("highway_env")
    with chat_server(stream(ALL, usage=TOLD)) as server:
        asked = ["--ranker", "openai:m", "--base-url", server.url, "--prices", str(prices)]
        assert main(["decide", "rural-oncoming", *asked]) == 0
        assert "  cost: 1 requests; 900 tokens read, 80 written" in capsys.readouterr().out
        assert main(["decide", "rural-oncoming", *asked, "--json"]) == 0
        bill = json.loads(capsys.readouterr().out)["cost"]
        assert (bill["usage"], bill["currency"]) == (FULL.to_dict(), "USD")

        run = tmp_path / "run"
        words = ["drive", "--steps", "3", "--seeds", "1,2", "--out", str(run), *asked]
        main(words)
        printed = capsys.readouterr().out
        assert "cost: 6 requests; 5400 tokens read, 480 written" in printed
        metrics = json.loads((run / "seed-1" / "metrics.json").read_text(encoding="utf-8"))
        assert metrics["cost"]["usage"]["requests"] == 3
        assert metrics["cost"]["money"] == pytest.approx(3 * bill["money"])
        # A run that is there already is not paid again; its bill is still told.
        before = len(server.requests)
        main([*words, "--json"])
        again = json.loads(capsys.readouterr().out)["cost"]
        assert again["usage"]["requests"] == 6
        assert len(server.requests) == before


def test_the_table_tells_the_cost(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("highway_env")
    number = stream("so be it\n#### 4", usage=TOLD)

    def play(request: dict[str, Any]) -> Play:
        return stream(ALL, usage=TOLD) if request["model"] == "m" else number

    with chat_server() as server:
        server.answer = play
        words = ["--rows", "openai:m/set-based/no-rules/paper slower dilu*"]
        words += ["--ranker", "openai:m", "--driver", "dilu:n"]
        words += ["--base-url", server.url, "--out", str(tmp_path), "--settings", "1"]
        assert main(["evaluate", "closed-loop", *words]) == 0
    output = capsys.readouterr()
    models = [request["model"] for request in server.requests]
    asked, driven = models.count("m"), models.count("n")
    assert f"cost of openai:m: {asked} requests; {asked * 900} tokens read" in output.err
    assert f"cost of dilu:n: {driven} requests; {driven * 900} tokens read" in output.err
    rows = json.loads((tmp_path / "table.json").read_text(encoding="utf-8"))["rows"]
    usages = {row["row"]: row["usage"] for row in rows}
    assert usages["slower"] is None
    assert usages["openai:m/set-based/no-rules/paper"]["requests"] == asked
