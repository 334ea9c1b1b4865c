"""Names of the action space."""

import pytest

from sandra.actions import ALL_PAIRS, ActionPair, Lateral, Longitudinal, parse_pairs
from sandra.errors import ActionError


def test_twelve_pairs() -> None:
    assert len(set(ALL_PAIRS)) == 12


@pytest.mark.parametrize("pair", ALL_PAIRS)
def test_text_round_trip(pair: ActionPair) -> None:
    assert ActionPair.parse(str(pair)) == pair
    assert ActionPair.of(**pair.to_dict()) == pair


def test_spellings() -> None:
    expected = ActionPair(Longitudinal.KEEP, Lateral.FOLLOW_LANE)
    for text in ("keep,follow-lane", " KEEP , follow_lane ", "Keep,FOLLOW-LANE", "keep,follow"):
        assert ActionPair.parse(text) == expected


@pytest.mark.parametrize("text", ["", "keep", "fly,follow-lane", "keep,up", "keep,follow-lane,x"])
def test_unknown(text: str) -> None:
    with pytest.raises(ActionError, match="accelerate"):
        ActionPair.parse(text)


def test_parse_pairs() -> None:
    assert parse_pairs("all") == ALL_PAIRS
    assert parse_pairs("keep,left-lane") == (ActionPair.parse("keep,left-lane"),)
    assert parse_pairs([ALL_PAIRS[3], "stop,right-lane"])[1].longitudinal is Longitudinal.STOP
