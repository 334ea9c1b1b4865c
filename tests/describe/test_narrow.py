"""A prompt about some of its pairs only."""

from itertools import combinations
from typing import Any

import pytest

from sandra.actions import ALL_PAIRS, ActionPair
from sandra.describe import describe, narrow, only
from sandra.describe.schema import answer_schema
from sandra.rankers import ask
from straight_road import Road

ROAD = Road()
PROMPT = describe(ROAD.scene(lanes=ROAD.three_lanes()), "drive faster")
SOME = tuple(
    ActionPair.parse(p) for p in ("keep,follow-lane", "stop,follow-lane", "stop,left-lane")
)


def admitted(schema: dict[str, Any]) -> set[ActionPair]:
    """The pairs that the items of a ranking may be."""
    items = schema["properties"]["ranking"]["items"]
    branches = items.get("anyOf", [items])
    return {
        pair
        for pair in ALL_PAIRS
        for branch in branches
        if all(
            getattr(pair, name).value in branch["properties"][name]["enum"]
            for name in ("longitudinal", "lateral")
        )
    }


def test_the_schema_admits_each_set_of_pairs_and_nothing_else() -> None:
    for count in range(1, 13):
        for pairs in combinations(ALL_PAIRS, count):
            assert admitted(answer_schema(pairs, 1)) == set(pairs)


def test_strict_mode_finds_what_it_asks_for_in_every_branch() -> None:
    schema = narrow(PROMPT, SOME).schema
    branches = schema["properties"]["ranking"]["items"]["anyOf"]
    assert len(branches) == 2
    for each in (schema, only(schema, "ranking"), *branches):
        assert each["additionalProperties"] is False
        assert each["required"] == list(each["properties"])


def test_what_was_read_before_stays_word_for_word() -> None:
    narrowed = narrow(PROMPT, SOME)
    assert narrowed.system == PROMPT.system
    assert narrowed.user == f"{PROMPT.user}\n{narrowed.narrowing}"
    assert narrowed.narrowing == (
        "Meanwhile every action pair has been verified; only these hold here: keep,follow-lane; "
        "stop,follow-lane; stop,left-lane. Return the top 3 of them, ranked from best to worst, "
        "and no other pair."
    )
    assert PROMPT.narrowing == ""


def test_no_more_pairs_are_asked_for_than_there_are() -> None:
    for count, k in ((1, 1), (2, 2), (3, 3)):
        narrowed = narrow(PROMPT, SOME[:count])
        assert narrowed.feasible == SOME[:count]
        assert narrowed.k == k
        ranking = narrowed.schema["properties"]["ranking"]
        assert (ranking["minItems"], ranking["maxItems"]) == (k, k)
        assert f"top {k} of them" in narrowed.user
    assert narrow(PROMPT, SOME[:1]).longitudinal == (SOME[0].longitudinal,)
    assert narrow(PROMPT, SOME[:1]).lateral == (SOME[0].lateral,)


def test_only_one_property_is_left() -> None:
    schema = only(narrow(PROMPT, SOME).schema, "ranking")
    assert list(schema["properties"]) == schema["required"] == ["ranking"]
    assert admitted(schema) == set(SOME)
    assert list(only(PROMPT.schema, "reasoning")["properties"]) == ["reasoning"]


@pytest.mark.parametrize("spec", ["rules", "random:3", "exhaustive"])
def test_our_rankers_keep_to_the_pairs(spec: str) -> None:
    for count in (1, 2, 3):
        ranking = ask(spec, narrow(PROMPT, SOME[:count]))
        assert set(ranking.pairs) == set(SOME[:count])
        assert ranking.failure is None


def test_narrowing_does_not_widen() -> None:
    alone = describe(Road().scene())
    with pytest.raises(ValueError, match="at least one"):
        narrow(PROMPT, ())
    with pytest.raises(ValueError, match="its own pairs"):
        narrow(alone, SOME)
    with pytest.raises(ValueError, match="4 distinct pairs"):
        answer_schema(SOME, 4)
