"""Rankers that do not do their job, on purpose."""

import threading
import time

import pytest

from sandra.actions import ActionPair
from sandra.decision import decide
from sandra.describe import describe
from sandra.errors import RankerError
from sandra.rankers import Failure, as_ranker, create, parse_answer
from sandra.rankers.misbehaving import ANSWERS
from straight_road import Road

ROAD = Road()
SCENE = ROAD.scene(lanes=(ROAD.lane("current", 0), ROAD.lane("left", 1)))
PROMPT = describe(SCENE)


@pytest.mark.parametrize("spec", ["always:keep,follow-lane", "always: Keep, follow_lane "])
def test_always_the_same_pair_and_no_other(spec: str) -> None:
    ranker = create(spec)
    assert ranker.name == "always:keep,follow-lane"
    assert as_ranker(ranker) is ranker
    ranking = ranker.rank(PROMPT)
    assert ranking.pairs == (ActionPair.parse("keep,follow-lane"),)
    assert ranking.failure is None


def test_always_a_pair_that_is_not_feasible_is_a_failure() -> None:
    ranking = create("always:accelerate,right-lane").rank(PROMPT)
    assert (ranking.pairs, ranking.failure) == ((), Failure.INFEASIBLE)
    assert "accelerate,right-lane is not feasible" in (ranking.detail or "")


@pytest.mark.parametrize("text", ANSWERS)
def test_no_pair_can_be_read_from_garbage(text: str) -> None:
    ranking = parse_answer(text, PROMPT, "garbage")
    assert ranking.pairs == ()
    assert ranking.failure is not None


def test_garbage_is_of_all_kinds_and_the_same_for_the_same_prompt() -> None:
    ranker = create("garbage")
    assert as_ranker(ranker) is ranker
    assert ranker.rank(PROMPT) == ranker.rank(PROMPT)
    prompts = [describe(ROAD.scene(speed=v / 7)) for v in range(1, 150)]
    rankings = [ranker.rank(prompt) for prompt in prompts]
    assert {r.failure for r in rankings} == {
        Failure.EMPTY,
        Failure.MALFORMED,
        Failure.TRUNCATED,
        Failure.INFEASIBLE,
    }
    assert not any(r.pairs for r in rankings)


@pytest.mark.parametrize(("own", "deadline", "waits"), [(0.2, None, 0.2), (60.0, 0.2, 0.2)])
def test_late_keeps_nobody_longer_than_the_deadline(
    own: float, deadline: float | None, waits: float
) -> None:
    ranker = create(f"late:{own}")
    assert as_ranker(ranker) is ranker
    begin = time.monotonic()
    ranking = ranker.rank(PROMPT, deadline)
    assert waits <= time.monotonic() - begin < waits + 0.3
    assert (ranking.pairs, ranking.failure) == ((), Failure.TIMEOUT)
    assert ranking.detail == f"no answer within {waits:g} s"


def test_late_leaves_no_thread_behind() -> None:
    create("late:0.05").rank(PROMPT)
    time.sleep(0.05)
    assert not [t for t in threading.enumerate() if t.name.startswith("late")]


@pytest.mark.parametrize(
    ("spec", "message"),
    [
        ("late:soon", "late:0.5"),
        ("late:0", "late:0.5"),
        ("late:-1", "late:0.5"),
        ("late:nan", "late:0.5"),
        ("late:inf", "late:0.5"),
        ("always:fly,upwards", "always: unknown action pair"),
        ("always:keep", "always: 'keep' is not an action pair"),
        ("late", "choose from"),
        ("always", "choose from"),
        ("always:", "choose from"),
        ("garbage:1", "choose from"),
        ("adversarial:x", "choose from"),
    ],
)
def test_a_bad_name(spec: str, message: str) -> None:
    with pytest.raises(RankerError, match=message) as caught:
        create(spec)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("mode", ["rank", "verify-first"])
@pytest.mark.parametrize("spec", ["garbage", "late:0.1", "always:accelerate,right-lane"])
def test_the_decision_goes_on(spec: str, mode: str) -> None:
    decision = decide(SCENE, ranker=spec, horizon=5, mode=mode)
    assert decision.ranking.ranker == create(spec).name
    assert decision.ranking.failure is not None
    assert decision.maneuver.pair is None
    assert decision.maneuver.kind == "fail-safe"
