"""Mode verify-first: verification overlaps the answer, and only what holds is ranked."""

from __future__ import annotations

import json
import threading
import time
from collections.abc import Sequence

import pytest

import sandra
from sandra.describe import Prompt
from sandra.prediction import Prediction, PredictionSource
from sandra.rankers import Failure, Ranking
from sandra.reach import Status
from slow_server import Pace, SlowServer, slow_server
from straight_road import Road

ROAD = Road()
SCENE = ROAD.scene(ROAD.obstacle(7, 60.0, 0.0, 8.0), lanes=ROAD.three_lanes())
"""A leader who is slower, free lanes on both sides: at 6 steps a change of lane has no witness."""
ONE_LANE = ROAD.scene(ROAD.obstacle(7, 60.0, 0.0, 8.0))
"""Quickly verified: of the four pairs three hold."""
SHORT = {"horizon": 6, "mode": "verify-first"}
HOLD = {(lon, "follow-lane") for lon in ("keep", "accelerate", "decelerate")}
BUSY = 1.5
"""What a busy machine may take in addition [s]: connections, threads, the choice at the end."""


pytestmark = pytest.mark.usefixtures("no_openai_key")


def names(pairs: Sequence[sandra.ActionPair]) -> set[tuple[str, str]]:
    return {(p.longitudinal.value, p.lateral.value) for p in pairs}


def decide(server: SlowServer, **changes: object) -> tuple[sandra.Decision, float]:
    """The decision, and how long it took [s]."""
    options = {"ranker": "openai:slow", "base_url": server.url, **SHORT, **changes}
    scene = options.pop("scene", SCENE)
    begin = time.monotonic()
    decision = sandra.decide(scene, **options)
    return decision, time.monotonic() - begin


def test_the_schema_of_the_ranking_admits_only_pairs_that_hold() -> None:
    wish = [("accelerate", "left-lane"), ("decelerate", "follow-lane")]
    with slow_server(Pace(preference=wish)) as server:
        decision, _ = decide(server)
    first, second = server.requests
    assert list(first.schema["properties"]) == ["reasoning"]
    assert list(second.schema["properties"]) == ["ranking"]
    assert second.admitted == HOLD
    certified = [v.pair for v in decision.verdicts if v.status is Status.CERTIFIED]
    assert names(certified) == HOLD
    assert len(decision.verdicts) == 12
    assert [v.pair for v in decision.verdicts][:3] == list(decision.ranking.pairs)
    assert decision.ranking.failure is None
    # What it likes best does not hold and cannot be said; the second of its wishes is driven.
    assert str(decision.maneuver.pair) == "decelerate,follow-lane"
    assert decision.certificate is not None
    assert decision.ranking.reasoning == "The road ahead is free."
    assert decision.mode == decision.to_dict()["mode"] == "verify-first"


def test_the_second_turn_goes_on_where_the_first_ended() -> None:
    with slow_server(Pace()) as server:
        decision, _ = decide(server, scene=ONE_LANE)
    first, second = ([m["content"] for m in r.body["messages"]] for r in server.requests)
    assert second[:2] == first
    assert json.loads(second[2]) == {"reasoning": "The road ahead is free."}
    assert second[3] == decision.prompt.narrowing
    assert [m["role"] for m in server.requests[1].body["messages"]][2:] == ["assistant", "user"]
    # So a server that remembers has nothing to read again.
    assert server.requests[1].read == len(decision.prompt.narrowing)
    with slow_server(Pace(remembers=False)) as forgetful:
        decide(forgetful, scene=ONE_LANE)
    assert forgetful.requests[1].read > forgetful.requests[0].read


def slow_prediction(seconds: float) -> PredictionSource:
    """The most likely prediction, which takes some time more."""

    def source(scene: sandra.Scene, horizon: int, settings: sandra.Settings) -> Prediction:
        time.sleep(seconds)
        return sandra.predict(scene, "most-likely", horizon, settings)

    return source


@pytest.mark.parametrize(("reason", "verify"), [(6.0, 5.0), (5.0, 6.0)])
def test_the_slower_of_answer_and_verification_is_waited_for(reason: float, verify: float) -> None:
    pace = Pace(read=0.1, reason=reason, rank=0.3)
    with slow_server(pace) as server:
        decision, took = decide(server, scene=ONE_LANE, prediction=slow_prediction(verify))
    first, second = server.requests
    assert names(decision.ranking.pairs) == HOLD == second.admitted
    answer = pace.read * first.read / 1000 + pace.reason + pace.rank
    slower = max(answer, verify + pace.rank)  # The ranking can only be written after both.
    # One after the other would take all of the quicker one more; a busy machine takes some of it.
    assert slower < took < slower + min(answer, verify) / 2
    assert decision.durations_s["rank"] == pytest.approx(answer, abs=BUSY)


def test_a_ranking_at_once_is_followed_by_the_verification() -> None:
    """The paper's mode beside it: as long an answer, under a schema that admits everything."""
    pace = Pace(read=0.1, reason=0.5, rank=0.3)
    with slow_server(pace) as server:
        decision, took = decide(server, mode="rank")
    (only,) = server.requests
    assert took > pace.read * only.read / 1000 + pace.reason + pace.rank
    assert only.admitted > HOLD
    assert decision.mode == "rank"


def test_a_server_without_structured_outputs_is_asked_again_only_if_it_must() -> None:
    held = [("keep", "follow-lane"), ("decelerate", "follow-lane"), ("accelerate", "follow-lane")]
    with slow_server(Pace(structured=False, preference=held)) as server:
        decision, _ = decide(server)
    assert len(server.requests) == 1
    assert names(decision.ranking.pairs) == set(held)
    with slow_server(Pace(structured=False, preference=[("keep", "left-lane"), *held])) as server:
        decision, _ = decide(server)
    assert len(server.requests) == 2
    assert names(decision.ranking.pairs) <= HOLD
    assert any("keep,left-lane is not feasible here" in w for w in decision.ranking.warnings)


@pytest.mark.parametrize(("reason", "verify"), [(6.0, 5.0), (5.0, 6.0)])
def test_a_ranking_written_at_once_is_there_after_the_slower_of_the_two(
    reason: float, verify: float
) -> None:
    """Such a server writes the ranking unasked; where all of it holds, nothing is asked again."""
    pace = Pace(reason=reason, rank=0.3, structured=False, preference=sorted(HOLD))
    with slow_server(pace) as server:
        decision, took = decide(server, scene=ONE_LANE, prediction=slow_prediction(verify))
    assert len(server.requests) == 1
    assert names(decision.ranking.pairs) == HOLD
    slower = max(pace.reason + pace.rank, verify)
    assert slower < took < slower + min(reason, verify) / 2


def test_if_nothing_holds_no_ranking_is_asked_for_and_the_fail_safe_is_driven() -> None:
    scene = sandra.load(sandra.example("nothing-safe"))
    with slow_server(Pace(reason=30.0)) as server:
        decision, took = decide(server, scene=scene)
        assert took < 10.0
        assert decision.ranking.failure is Failure.NOT_ASKED
        assert decision.maneuver.kind == "fail-safe"
        assert "no ranking: not-asked (no feasible pair is CERTIFIED" in str(decision)
        assert all(verdict.reason for verdict in decision.verdicts)
        assert not server.requests or not server.requests[-1].admitted
        assert hung_up(server)


def hung_up(server: SlowServer) -> bool:
    """Whether the connection is closed while the server still writes."""
    end = time.monotonic() + 10.0
    while time.monotonic() < end:
        time.sleep(0.05)
        if not any(t.name.startswith("openai:") for t in threading.enumerate()):
            return all(request.end is None for request in server.requests)
    return False


def test_the_only_pair_that_holds_is_driven_without_a_ranking() -> None:
    road = Road()
    # 12 m behind somebody who stands, 1.2 s at 12 m/s: too far to stop, too near for all the rest.
    scene = road.scene(road.obstacle(7, 15.3, 0.0, 0.0), speed=12.0)
    with slow_server(Pace(reason=30.0)) as server:
        decision, took = decide(server, scene=scene, accept="reachable", horizon=12)
    assert took < 10.0
    assert [str(p) for p in decision.ranking.pairs] == ["decelerate,follow-lane"]
    assert decision.maneuver.pair == decision.ranking.pairs[0]
    assert "only decelerate,follow-lane is REACHABLE" in str(decision)
    assert decision.ranking.failure is None


def test_where_reachable_is_enough_what_is_reachable_may_be_ranked() -> None:
    with slow_server(Pace()) as server:
        decision, _ = decide(server, accept="reachable")
    reachable = [v.pair for v in decision.verdicts if v.status is Status.REACHABLE]
    assert server.requests[-1].admitted == names(reachable) > HOLD
    assert decision.maneuver.kind == "reachable"


def test_the_deadline_counts_the_time_of_the_model_and_not_that_of_the_verification() -> None:
    quick = Pace(reason=0.2, rank=0.1)
    with slow_server(quick) as server:
        decision, _ = decide(server, scene=ONE_LANE, deadline=1.0, prediction=slow_prediction(1.5))
    assert decision.ranking.failure is None
    for slow in (Pace(reason=30.0), Pace(rank=30.0)):
        with slow_server(slow) as server:
            decision, took = decide(server, scene=ONE_LANE, deadline=1.0)
        assert decision.ranking.failure is Failure.TIMEOUT
        assert decision.maneuver.kind == "fail-safe"
        assert took < 8.0


def test_a_server_that_is_not_there() -> None:
    decision = sandra.decide(
        SCENE, "openai:none", base_url="http://127.0.0.1:9/v1", deadline=1.0, **SHORT
    )
    assert decision.ranking.failure is Failure.UNREACHABLE
    assert decision.maneuver.kind == "fail-safe"
    assert Status.CERTIFIED in {v.status for v in decision.verdicts}


class Curious:
    """A ranker of somebody's own, which cannot think ahead."""

    name = "curious"

    def __init__(self) -> None:
        self.asked: list[Prompt] = []

    def rank(self, prompt: Prompt, deadline: float | None = None) -> Ranking:
        self.asked.append(prompt)
        return Ranking(sandra.ALL_PAIRS, self.name)


def test_other_rankers_are_asked_once_about_the_pairs_that_hold() -> None:
    ranker = Curious()
    decision = sandra.decide(SCENE, ranker, **SHORT)
    (prompt,) = ranker.asked
    assert names(prompt.feasible) == HOLD
    assert prompt.user.endswith(prompt.narrowing)
    assert names(decision.ranking.pairs) == HOLD


def test_the_verdicts_are_those_of_the_other_modes() -> None:
    options = {"horizon": 6, "prediction": "set-based", "rules": ["R_G1"]}
    first = sandra.decide(SCENE, "rules", mode="verify-first", **options)
    every = sandra.decide(SCENE, "rules", walk="all", **options)
    of_all = {v.pair: (v.status, v.reason, v.first_empty_step) for v in every.verdicts}
    assert {v.pair: (v.status, v.reason, v.first_empty_step) for v in first.verdicts} == of_all


def test_nobody_is_asked_in_mode_exhaustive() -> None:
    ranker = Curious()
    decision = sandra.decide(SCENE, ranker, mode="exhaustive", horizon=6)
    assert ranker.asked == []
    assert decision.ranking.ranker == "exhaustive"
    assert decision.maneuver.kind == "certified"


def test_what_breaks_while_the_model_thinks_ends_the_question() -> None:
    def broken(scene: sandra.Scene, horizon: int, settings: sandra.Settings) -> Prediction:
        time.sleep(0.3)
        raise sandra.SandraError("no prediction today")

    with slow_server(Pace(reason=30.0)) as server:
        with pytest.raises(sandra.SandraError, match="no prediction today"):
            decide(server, prediction=broken)
        assert hung_up(server)


def test_an_unknown_mode_is_refused() -> None:
    with pytest.raises(sandra.SandraError, match=r"mode = 'ranked'.*verify-first, repair"):
        sandra.decide(SCENE, mode="ranked")
