"""Every mode with every kind of ranker, and what mode repair asks."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path

import pytest

import sandra
from sandra.actions import ALL_PAIRS, ActionPair
from sandra.cli import main
from sandra.decision.modes import MODES
from sandra.describe import Prompt, answered, describe
from sandra.rankers import Failure, Ranking
from sandra.rankers.registry import CHOICES
from sandra.reach import Status
from slow_server import Pace, SlowServer, slow_server
from straight_road import Road

ROAD = Road()
SCENE = ROAD.scene(ROAD.obstacle(7, 60.0, 0.0, 8.0), lanes=ROAD.three_lanes())
"""A leader who is slower, free lanes on both sides: at 6 steps a change of lane has no witness."""
HOLD = {ActionPair.parse(f"{lon},follow-lane") for lon in ("keep", "accelerate", "decelerate")}
LEFT = [("keep", "left-lane"), ("accelerate", "left-lane"), ("stop", "left-lane")]
PLUG_IN = """
from sandra.actions import ALL_PAIRS

class Mine:
    name = "mine"
    def rank(self, prompt, deadline=None):
        from sandra.rankers import Ranking
        return Ranking(tuple(reversed(prompt.feasible))[:prompt.k], self.name)

def breaks(prompt):
    raise ZeroDivisionError

def unheeding(prompt):
    return ALL_PAIRS
"""
BACKENDS = (
    "openai:m",
    "ollama:m",
    "vllm:m",
    "dilu:m",
    "embedded",
    "rules",
    "random:3",
    "exhaustive",
    "replay:{folder}/rankings.jsonl",
    "adversarial",
    "always:keep,left-lane",
    "always:keep,follow-lane",
    "garbage",
    "late:0.2",
    "sandra_test_modes:Mine",
    "sandra_test_modes:breaks",
    "sandra_test_modes:unheeding",
)


@pytest.fixture(autouse=True)
def _no_key(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("OPENAI", "OLLAMA", "VLLM"):
        monkeypatch.delenv(f"{name}_API_KEY", raising=False)
        monkeypatch.delenv(f"{name}_BASE_URL", raising=False)


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    (tmp_path / "sandra_test_modes.py").write_text(PLUG_IN, encoding="utf-8")
    monkeypatch.syspath_prepend(tmp_path)
    ranking = [{"longitudinal": lon, "lateral": lat} for lon, lat in LEFT]
    row = {"scenario": SCENE.name, "ranking": ranking}
    (tmp_path / "rankings.jsonl").write_text(json.dumps(row), encoding="utf-8")
    return tmp_path


@pytest.fixture(scope="module")
def server() -> Iterator[SlowServer]:
    with slow_server(Pace(preference=LEFT)) as server:
        yield server


@pytest.fixture(scope="module")
def truth() -> dict[ActionPair, Status]:
    """The status of every pair, found without any ranking that matters."""
    every = sandra.decide(SCENE, "rules", walk="all", horizon=6)
    return {v.pair: v.status for v in every.verdicts}


def decide(spec: str, server: SlowServer, **options: object) -> sandra.Decision:
    return sandra.decide(SCENE, spec, base_url=server.url, horizon=6, deadline=20.0, **options)


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("backend", BACKENDS)
def test_each_mode_with_each_ranker_decides(
    backend: str, mode: str, folder: Path, server: SlowServer, truth: dict[ActionPair, Status]
) -> None:
    decision = decide(backend.format(folder=folder), server, mode=mode)
    pairs = decision.ranking.pairs
    assert len(set(pairs)) == len(pairs)
    assert set(pairs) <= set(describe(SCENE).feasible)
    assert pairs or decision.ranking.failure is not None
    assert decision.mode == mode
    for verdict in decision.verdicts:
        # Who is not looked at for a certificate because an earlier one has it stays REACHABLE.
        same = verdict.status is truth[verdict.pair]
        assert same or (verdict.status, truth[verdict.pair]) == (
            Status.REACHABLE,
            Status.CERTIFIED,
        )
    first = next((pair for pair in pairs if truth[pair] is Status.CERTIFIED), None)
    assert decision.maneuver.pair == first
    assert decision.maneuver.kind == ("fail-safe" if first is None else "certified")
    assert (decision.certificate is None) == (first is None)
    json.dumps(decision.to_dict(), allow_nan=False)
    assert str(decision)


def test_all_kinds_of_rankers_are_looked_at_here() -> None:
    kinds = {words.strip().partition("[")[0].partition(":")[0] for words in CHOICES.split(", ")}
    ours = {backend.partition(":")[0] for backend in BACKENDS} | {"or module", "module"}
    assert kinds - ours <= {"gguf", "hf"}, "a new kind of ranker has no row in BACKENDS"


def test_a_ranking_in_which_nothing_holds_is_answered_with_the_reasons() -> None:
    with slow_server(Pace(preference=LEFT)) as server:
        decision = decide("openai:m", server, mode="repair")
        plain = decide("openai:m", server, mode="rank")
    assert plain.maneuver.kind == "fail-safe"
    first, second = (r.body["messages"] for r in server.requests[:2])
    assert second[0] == first[0]
    assert second[1]["content"].startswith(first[1]["content"])
    told = second[1]["content"][len(first[1]["content"]) :]
    assert "none of its action pairs holds here" in told
    reasons = {v.pair: v.reason for v in plain.verdicts}
    for lon, lat in LEFT:
        reason = reasons[ActionPair.of(lon, lat)]
        assert f"  - {lon},{lat}: {reason}" in told
    assert server.requests[1].admitted == server.requests[0].admitted - set(LEFT)
    assert decision.maneuver.pair in HOLD
    assert decision.ranking.failure is None
    warning = decision.ranking.warnings[0]
    assert warning.startswith("asked again: keep,left-lane; accelerate,left-lane; stop,left-lane:")
    # Both questions are on the bill, and both rankings have verdicts.
    assert decision.ranking.usage is not None
    assert decision.ranking.usage.requests == 2
    shown = [v.pair for v in decision.verdicts]
    assert shown == [*decision.ranking.pairs, *(ActionPair.of(*pair) for pair in LEFT)]


@pytest.mark.parametrize("mode", ["rank", "repair"])
@pytest.mark.parametrize("walk", ["ranked", "first", "all"])
def test_verdicts_found_while_the_ranking_is_written_are_those_found_afterwards(
    walk: str, mode: str
) -> None:
    wish = [*LEFT[:1], ("keep", "follow-lane"), ("decelerate", "follow-lane")]
    options = {"walk": walk, "mode": mode, "horizon": 6}
    with slow_server(Pace(rank=2.0, preference=wish)) as server:
        written = sandra.decide(SCENE, "openai:m", base_url=server.url, **options)
    at_once = sandra.decide(SCENE, Scripted([f"{lon},{lat}" for lon, lat in wish]), **options)
    assert written.ranking.pairs == at_once.ranking.pairs
    first, second = (
        [(v.pair, v.status, v.reason, v.first_empty_step) for v in decision.verdicts]
        for decision in (written, at_once)
    )
    assert first == second
    assert written.maneuver.pair == at_once.maneuver.pair
    assert written.maneuver.states.tolist() == at_once.maneuver.states.tolist()


class Scripted:
    """Answers one after the other; the last one is repeated."""

    name = "scripted"

    def __init__(self, *answers: Ranking | list[str]) -> None:
        self.answers = answers
        self.asked: list[Prompt] = []
        self.deadlines: list[float | None] = []

    def rank(self, prompt: Prompt, deadline: float | None = None) -> Ranking:
        self.asked.append(prompt)
        self.deadlines.append(deadline)
        answer = self.answers[min(len(self.asked), len(self.answers)) - 1]
        if isinstance(answer, Ranking):
            return answer
        return Ranking(tuple(map(ActionPair.parse, answer)), self.name)


def repair(ranker: Scripted, **options: object) -> sandra.Decision:
    return sandra.decide(SCENE, ranker, mode="repair", horizon=6, **options)


@pytest.mark.parametrize("walk", ["ranked", "first", "all"])
def test_what_holds_the_second_time_is_driven(walk: str) -> None:
    ranker = Scripted(["keep,left-lane", "stop,left-lane"], ["stop,right-lane", "keep,follow-lane"])
    decision = repair(ranker, walk=walk)
    assert str(decision.maneuver.pair) == "keep,follow-lane"
    assert len(ranker.asked) == 2
    assert ActionPair.parse("keep,left-lane") not in ranker.asked[1].feasible
    pairs = [v.pair for v in decision.verdicts]
    assert pairs[:2] == list(decision.ranking.pairs)
    assert set(pairs) == (set(ALL_PAIRS) if walk == "all" else set(pairs))
    assert len(set(pairs)) == len(pairs)
    # One number for both answers together.
    assert 0.0 < ranker.deadlines[1] <= ranker.deadlines[0] == 30.0  # type: ignore[operator]


def test_it_is_asked_once_more_and_not_twice() -> None:
    ranker = Scripted(["keep,left-lane"], ["keep,right-lane"], ["keep,follow-lane"])
    decision = repair(ranker)
    assert len(ranker.asked) == 2
    assert decision.maneuver.kind == "fail-safe"
    assert {str(v.pair) for v in decision.verdicts} == {"keep,left-lane", "keep,right-lane"}


def test_where_something_holds_nothing_is_asked_again() -> None:
    ranker = Scripted(["keep,left-lane", "keep,follow-lane"])
    decision = repair(ranker)
    assert len(ranker.asked) == 1
    assert str(decision.maneuver.pair) == "keep,follow-lane"
    assert not any("asked again" in words for words in decision.ranking.warnings)


@pytest.mark.parametrize(
    ("failure", "again"),
    [
        (Failure.MALFORMED, True),
        (Failure.EMPTY, True),
        (Failure.INFEASIBLE, True),
        (Failure.TRUNCATED, True),
        (Failure.TIMEOUT, False),
        (Failure.REFUSED, False),
        (Failure.RATE_LIMITED, False),
        (Failure.UNREACHABLE, False),
        (Failure.INTERNAL, False),
    ],
)
def test_an_answer_that_cannot_be_used(failure: Failure, again: bool) -> None:
    first = Ranking((), "scripted", failure, "it was like\nthat")
    ranker = Scripted(first, ["keep,follow-lane"])
    decision = repair(ranker)
    assert len(ranker.asked) == 1 + again
    if again:
        assert "could not be used: it was like that" in ranker.asked[1].user
        assert ranker.asked[1].feasible == ranker.asked[0].feasible
        assert str(decision.maneuver.pair) == "keep,follow-lane"
    else:
        assert decision.ranking.failure is failure
        assert decision.maneuver.kind == "fail-safe"


def test_a_second_answer_that_fails_leaves_the_first_one_and_says_so() -> None:
    ranker = Scripted(["keep,left-lane"], Ranking((), "scripted", Failure.TIMEOUT, "too slow"))
    decision = repair(ranker)
    assert list(map(str, decision.ranking.pairs)) == ["keep,left-lane"]
    assert "asked again without success: timeout (too slow)" in decision.ranking.warnings[-1]
    assert decision.maneuver.kind == "fail-safe"


def test_no_time_left_is_no_second_question() -> None:
    with slow_server(Pace(reason=0.4, preference=LEFT)) as server:
        sandra.decide(
            SCENE, "openai:m", base_url=server.url, mode="repair", horizon=6, deadline=0.2
        )
    assert len(server.requests) == 1


def test_where_all_have_failed_there_is_nothing_to_ask() -> None:
    prompt = describe(SCENE)
    every = dict.fromkeys(prompt.feasible, "no")
    with pytest.raises(ValueError, match="at least one"):
        answered(prompt, every)
    scene = sandra.load(sandra.example("nothing-safe"))
    ranker = Scripted(Ranking(describe(scene).feasible, "scripted"))
    decision = sandra.decide(scene, ranker, mode="repair", horizon=6, k=12)
    assert len(ranker.asked) == 1
    assert decision.maneuver.kind == "fail-safe"


def test_on_the_command_line(capsys: pytest.CaptureFixture[str]) -> None:
    with slow_server(Pace(preference=[("stop", "follow-lane")])) as server:
        words = ["--ranker", "openai:m", "--base-url", server.url, "--k", "1"]
        assert main(["decide", "intersection", "--mode", "repair", "--json", *words]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["mode"] == "repair"
    assert len(server.requests) in (1, 2)
