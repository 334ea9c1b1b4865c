"""Whatever a server does: a decision, in time, and the failure has a name."""

from __future__ import annotations

import json
import threading
import time
from collections.abc import Iterator

import pytest

import sandra
from hostile_server import CASES, GOOD, LONGEST, Hostile, hostile_server
from sandra.actions import ActionPair
from sandra.cli import main
from sandra.describe import describe
from sandra.rankers import Failure, create
from straight_road import Road

SCENE = Road().scene()
PROMPT = describe(SCENE, "drive faster")
PAIRS = [ActionPair.of(*pair) for pair in GOOD]
OWN = 0.1
"""Our own work after the deadline [s of CPU time]."""
BUSY = 2.0
"""What a busy machine may take in addition [s]. Whoever waited for the server would be later."""
SHORT, LONG = 0.7, 6.0
"""Deadlines [s]: of those that take all of it; of those that must not."""

pytestmark = pytest.mark.usefixtures("no_openai_key")


@pytest.fixture(scope="module")
def server() -> Iterator[Hostile]:
    assert LONGEST > 4.0 + BUSY, "waiting for the server must be noticed"
    with hostile_server() as server:
        yield server


OTHERWISE = [name for i, name in enumerate(CASES) if i % 3 == 0 or not CASES[name].waits]
"""All cases but two in three of those that take their whole deadline."""


class Watch:
    """How long something took, and how much of our CPU time it took after the deadline."""

    def __init__(self, deadline: float) -> None:
        self.deadline = deadline
        self._at: list[float] = []
        self._timer = threading.Timer(deadline, lambda: self._at.append(time.process_time()))

    def __enter__(self) -> Watch:
        self._begin = time.monotonic()
        self._timer.start()
        return self

    def __exit__(self, *error: object) -> None:
        self.took = time.monotonic() - self._begin
        now = time.process_time()
        self._timer.cancel()
        self.own = now - self._at[0] if self._at else 0.0

    def check(self, waits: bool) -> None:
        """In time, and not before time if there was something to wait for."""
        assert self.own < OWN
        if waits:
            assert self.deadline < self.took < self.deadline + BUSY
        else:
            assert self.took < self.deadline


@pytest.mark.parametrize("name", CASES)
def test_a_ranking(server: Hostile, name: str) -> None:
    case, url = CASES[name], server.url(name)
    deadline = SHORT if case.waits else LONG
    ranker = create("openai:some-model", base_url=url)
    with Watch(deadline) as watch:
        ranking = ranker.rank(PROMPT, deadline)
    watch.check(case.waits)
    assert ranking.failure is (None if case.failure is None else Failure(case.failure)), ranking
    assert list(ranking.pairs) == PAIRS[: case.pairs]
    assert (ranking.detail is None) == (ranking.failure is None)
    assert len(ranking.detail or "") <= 300
    assert ranking.usage is not None
    assert ranking.usage.requests == server.asked(url)
    assert ranking.usage.tokens == 0
    if case.failure in ("rejected", "refused", "infeasible", "malformed", "empty"):
        assert server.asked(url) == 1  # asking again would not help


@pytest.mark.parametrize("name", CASES)
def test_a_decision(server: Hostile, name: str) -> None:
    case = CASES[name]
    deadline = SHORT if case.waits else LONG
    options = {"base_url": server.url(name), "deadline": deadline, "horizon": 4}
    decider = sandra.Decider("openai:some-model", "drive faster", **options)
    with Watch(deadline) as watch:
        decision = decider.decide(SCENE)
    watch.check(case.waits)
    told = json.loads(json.dumps(decision.to_dict(), allow_nan=False))
    assert told["failure"] == case.failure
    assert (told["failure_detail"] is None) == (case.failure is None)
    assert (f"no ranking: {case.failure}" in str(decision)) == (case.failure is not None)
    assert list(decision.ranking.pairs) == PAIRS[: case.pairs]
    assert [v.pair for v in decision.verdicts] == PAIRS[: case.pairs]
    if case.pairs:
        assert (decision.maneuver.kind, decision.maneuver.pair) == ("certified", PAIRS[0])
    else:
        assert (decision.maneuver.kind, decision.maneuver.pair) == ("fail-safe", None)
    assert decision.maneuver.states.shape[1] == 5


@pytest.mark.parametrize(
    ("scene", "mode"),
    [("intersection", "rank"), ("roadworks", "repair"), ("recorded-ego", "rank")],
)
def test_pairs_are_verified_while_the_others_are_waited_for(
    server: Hostile, scene: str, mode: str
) -> None:
    """So that a ranking which is cut off leaves no work for after the deadline."""
    deadline = 4.0
    options = {"base_url": server.url("stalls-within-the-ranking"), "deadline": deadline}
    options |= {"prediction": "set-based", "rules": ["R_G1", "R_G2", "R_G3"], "mode": mode}
    loaded = sandra.load(sandra.example(scene))
    stages: list[tuple[str, float]] = []
    options["progress"] = lambda stage: stages.append((stage, time.monotonic()))
    decider = sandra.Decider("openai:m", None, **options)
    begin = time.monotonic()
    with Watch(deadline) as watch:
        decision = decider.decide(loaded)
    watch.check(True)
    assert ("verify", True) in [(stage, at < begin + deadline) for stage, at in stages]
    assert decision.ranking.failure is Failure.TIMEOUT
    assert [v.pair for v in decision.verdicts] == PAIRS[:2]


@pytest.mark.parametrize("name", OTHERWISE)
def test_the_other_interface(server: Hostile, name: str) -> None:
    """`/responses`: no play is an answer there, and each is one more way to be wrong."""
    ranker = create("openai:m#api=responses", base_url=server.url(name))
    deadline = SHORT if CASES[name].waits else LONG
    with Watch(deadline) as watch:
        ranking = ranker.rank(PROMPT, deadline)
    assert watch.own < OWN
    assert watch.took < (deadline + BUSY if CASES[name].waits else deadline)
    assert ranking.failure is not None
    assert ranking.failure is not Failure.INTERNAL
    assert ranking.pairs == ()


COMMANDS = (
    "good",
    "stalls",
    "a-token-each-second",
    "stalls-within-the-ranking",
    "hangs-up",
    "429",
    "500",
    "503",
    "invalid-json",
    "truncated",
    "essay",
    "refusal",
    "duplicates",
    "infeasible",
    "unknown-word",
    "empty-list",
    "ten-megabytes",
    "ten-megabytes-in-one-body",
    "other-schema",
)


@pytest.mark.parametrize("name", COMMANDS)
@pytest.mark.parametrize("mode", ["rank", "verify-first", "repair"])
def test_a_command(
    server: Hostile, name: str, mode: str, capsys: pytest.CaptureFixture[str]
) -> None:
    case = CASES[name]
    deadline = SHORT if case.waits else LONG
    words = ["--ranker", "openai:m", "--base-url", server.url(name), "--deadline", str(deadline)]
    words += ["--mode", mode, "--horizon", "5", "--command", "drive faster", "--json"]
    assert main(["decide", "rural-oncoming", *words]) == 0
    output = capsys.readouterr()
    told = json.loads(output.out)
    assert "Traceback" not in output.err
    assert told["executed"]["kind"] in ("certified", "fail-safe")
    assert told["durations_s"]["rank"] < deadline + BUSY
    if mode == "rank":
        assert told["failure"] == case.failure


def test_the_deadline_of_a_call_goes_before_the_one_of_the_ranker(server: Hostile) -> None:
    ranker = create("openai:m", base_url=server.url("stalls"), deadline=60.0)
    with Watch(0.3) as watch:
        ranking = ranker.rank(PROMPT, 0.3)
    watch.check(True)
    assert ranking.failure is Failure.TIMEOUT
    assert "0.3 s" in (ranking.detail or "")


def test_a_server_that_is_not_there() -> None:
    ranking = create("openai:m", base_url="http://127.0.0.1:9/v1").rank(PROMPT, LONG)
    assert ranking.failure is Failure.UNREACHABLE
    assert "127.0.0.1:9" in (ranking.detail or "")
    assert ranking.usage is not None
    assert ranking.usage.unknown == 0


def test_who_never_lets_go_of_a_connection_gathers_no_threads(server: Hostile) -> None:
    url = server.url("drips-its-head")
    ranker = create("openai:hangs", base_url=url, max_concurrent=2)
    details = [ranker.rank(PROMPT, 0.3).detail for _ in range(6)]
    assert server.asked(url) == 2
    hanging = [t for t in threading.enumerate() if t.name == "openai:hangs"]
    assert len(hanging) <= 3  # two that hang, and one that has waited for its place
    assert "too many other requests" in (details[-1] or "") or "0.3 s" in (details[-1] or "")
