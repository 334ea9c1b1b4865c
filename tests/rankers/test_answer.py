import json
from typing import Any

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from sandra.actions import ALL_PAIRS
from sandra.describe import describe
from sandra.rankers import Failure, Ranking, parse_answer
from sandra.rankers.answer import MAX_ANSWER
from straight_road import Road

ROAD = Road()
PROMPT = describe(ROAD.scene(lanes=(ROAD.lane("current", 0), ROAD.lane("left", 1))))
GOOD = [("keep", "follow-lane"), ("decelerate", "follow-lane"), ("keep", "left-lane")]


def text(*pairs: tuple[str, str], reasoning: str = "because") -> str:
    ranking = [{"longitudinal": lon, "lateral": lat} for lon, lat in pairs]
    return json.dumps({"reasoning": reasoning, "ranking": ranking})


def parse(answer: str, **options: Any) -> Ranking:
    return parse_answer(answer, PROMPT, "test", **options)


def names(ranking: Ranking) -> list[tuple[str, str]]:
    return [(p.longitudinal.value, p.lateral.value) for p in ranking.pairs]


@pytest.mark.parametrize(
    "answer",
    [
        text(*GOOD),
        "  \n" + text(*GOOD) + "\n\n",
        "```json\n" + text(*GOOD) + "\n```",
        '<think>Maybe {this} or {"a": 1}?</think>\nHere it is: ' + text(*GOOD) + " Drive safely!",
        text(("stop", "follow-lane")) + "\nNo, better:\n" + text(*GOOD),
        text(("KEEP", "follow_lane"), ("Decelerate", "FOLLOW-LANE"), ("keep", "left")),
    ],
)
def test_a_good_answer_is_found_wherever_it_stands(answer: str) -> None:
    ranking = parse(answer)
    assert names(ranking) == GOOD
    assert ranking.failure is None
    assert ranking.warnings == ()
    assert ranking.answer == answer
    assert ranking.reasoning == "because"


@pytest.mark.parametrize(
    ("answer", "failure", "kept"),
    [
        ("", Failure.EMPTY, 0),
        (" \n\t", Failure.EMPTY, 0),
        (text(), Failure.EMPTY, 0),
        ("I would rather not say.", Failure.MALFORMED, 0),
        ("{}", Failure.MALFORMED, 0),
        ("[1, 2]", Failure.MALFORMED, 0),
        ('{"ranking": "keep"}', Failure.MALFORMED, 0),
        ('{"actions": [{"longitudinal": "keep", "lateral": "follow-lane"}]}', Failure.MALFORMED, 0),
        ('{"reasoning": "x", ranking: [oops]}', Failure.MALFORMED, 0),
        (text(("fly", "up")), Failure.INFEASIBLE, 0),
        (text(("keep", "right-lane")), Failure.INFEASIBLE, 0),
        ('{"ranking": [1, null, [], {"longitudinal": 3, "lateral": {}}]}', Failure.INFEASIBLE, 0),
        ('{"reasoning": "I was just about to', Failure.TRUNCATED, 0),
        (text(*GOOD)[:-40], Failure.TRUNCATED, 2),
        (text(*GOOD)[:-2], Failure.TRUNCATED, 3),
        ("Well: " + text(*GOOD)[:-70], Failure.TRUNCATED, 1),
        (text(*GOOD).replace("}, {", "}, oops {", 1) + "!", Failure.MALFORMED, 1),
    ],
)
def test_what_is_wrong_is_named_and_what_is_good_is_kept(
    answer: str, failure: Failure, kept: int
) -> None:
    ranking = parse(answer)
    assert ranking.failure is failure
    assert names(ranking) == GOOD[:kept]
    assert ranking.detail


def test_small_faults_are_warnings() -> None:
    ranking = parse(text(GOOD[0], GOOD[0], ("fly", "up"), ("stop", "right-lane"), GOOD[1]))
    assert names(ranking) == GOOD[:2]
    assert ranking.failure is None
    assert ranking.warnings == (
        "unknown pair {'longitudinal': 'fly', 'lateral': 'up'} removed",
        "duplicate keep,follow-lane removed",
        "stop,right-lane is not feasible here, removed",
        "only 2 of 3 pairs",
    )
    ranking = parse(text(*GOOD, ("stop", "follow-lane")))
    assert names(ranking) == GOOD
    assert ranking.warnings == ("more than 3 pairs: stop,follow-lane removed",)


def test_an_answer_that_was_cut_off_says_so() -> None:
    assert parse("Let me think.", ended_early=True).failure is Failure.TRUNCATED
    assert parse("", ended_early=True).failure is Failure.TRUNCATED
    whole = parse(text(*GOOD), ended_early=True)
    assert (whole.failure, names(whole)) == (None, GOOD)


def test_hostile_answers_end_in_a_failure_and_in_time() -> None:
    for answer in (
        '{"a":' * 200_000,
        "[" * 1_000_000,
        '{"' * 400_000,
        '{"ranking": [' + "9" * 10_000 + "]}",
        '{"ranking": [' + '{"x": 1},' * 200_000,
        "x" * (10 * MAX_ANSWER),
    ):
        ranking = parse(answer)
        assert ranking.failure is not None
        assert ranking.pairs == ()
        assert len(ranking.answer or "") <= MAX_ANSWER
        assert len(ranking.warnings) < 200
        assert len(ranking.detail or "") < 500


def test_reasoning_is_safe_to_print() -> None:
    answer = '{"reasoning": "red \\ud800 \\u001b[2J light", "ranking": []}'
    ranking = parse(answer)
    assert ranking.reasoning is not None
    ranking.reasoning.encode("utf-8")
    assert "\x1b" not in ranking.reasoning
    parse("\ud800").answer.encode("utf-8")  # type: ignore[union-attr]


ITEMS = st.one_of(
    st.sampled_from([p.to_dict() for p in ALL_PAIRS]),
    st.fixed_dictionaries({"longitudinal": st.text(max_size=9), "lateral": st.text(max_size=9)}),
    st.none() | st.integers() | st.text(max_size=5) | st.dictionaries(st.text(), st.integers()),
)
ANSWERS = st.fixed_dictionaries(
    {"ranking": st.lists(ITEMS, max_size=16)}, optional={"reasoning": st.text()}
).map(json.dumps)


@st.composite
def damaged(draw: st.DrawFn) -> str:
    answer = draw(ANSWERS)
    start, end = sorted(draw(st.tuples(*[st.integers(0, len(answer))] * 2)))
    return draw(st.sampled_from([answer[:end], answer[:start] + answer[end:], answer * 2]))


@settings(max_examples=400)
@given(answer=st.one_of(st.text(), ANSWERS, damaged()), early=st.booleans())
@example(answer='{"ranking": [', early=False)
@example(answer='"ranking": [{"longitudinal"', early=True)
def test_no_answer_ever_raises_or_gives_more_than_was_asked_for(answer: str, early: bool) -> None:
    ranking = parse(answer, ended_early=early)
    assert set(ranking.pairs) <= set(PROMPT.feasible)
    assert len(set(ranking.pairs)) == len(ranking.pairs) <= PROMPT.k
    assert ranking.pairs or ranking.failure is not None
    assert (ranking.detail is None) == (ranking.failure is None)
