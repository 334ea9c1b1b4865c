"""Prompts that the paper's authors recorded, read for what they tell."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).resolve().parents[3] / "scripts"))

from recorded_prompts import CUT, prompts_of, recorded

from sandra.rankers import create

TEXT = f"""Feasible longitudinal actions:
  - accelerate
  - keep
Feasible lateral actions:
  - follow_lane
  - right
No past actions recorded. {CUT}
There is no left-adjacent lane. There is a right-adjacent lane with the same direction. 
Your velocity is 14.6 m/s, orientation is 2.000 rad, steering angle is 0.000 rad, and acceleration is 0.0 m/s².
Here is an overview of all relevant obstacles surrounding you:
    - truck 12: It is driving on the right-adjacent lane in the same direction and is 42.8 meters behind you. Its velocity is 15.2 m/s, orientation is 2.100 rad, steering angle is 0.000 rad, and acceleration is 0.0 m/s². The time-to-collision is inf sec.
    - car 7: It is driving on the same lane and is 22.5 meters in front of you. Its velocity is 10.8 m/s, orientation is 2.000 rad, steering angle is 0.000 rad, and acceleration is 0.0 m/s². The time-to-collision is 5.9 sec.
"""  # noqa: E501, W291


def test_the_same_facts_in_our_sentences() -> None:
    theirs, ours = prompts_of(TEXT)
    assert theirs.system + " " + theirs.user == TEXT
    assert theirs.feasible == ours.feasible
    assert {str(p.lateral.value) for p in ours.feasible} == {"follow-lane", "right-lane"}
    assert (
        "  - car 7: It is driving on the same lane and is 22.5 meters in front of you. Its "
        "velocity is 10.8 m/s, orientation is 0.000 rad, and acceleration is 0.0 m/s². The "
        "time-to-collision is 5.9 sec.\n"
        "  - truck 12: It is driving on the right-adjacent lane in the same direction and is 42.8 "
        "meters behind you. Its velocity is 15.2 m/s, orientation is 0.100 rad"
    ) in ours.user
    assert "Your velocity is 14.6 m/s, orientation is 0.000 rad" in ours.user
    for prompt in (theirs, ours):
        ranking = create("embedded").rank(prompt, 60.0)
        assert ranking.failure is None
        assert len(ranking.pairs) == 3


def test_nothing_is_lost_of_the_recorded_ones(shared: Path) -> None:
    """Six obstacles of 3,743 are "far away", without a distance: these are left out."""
    texts = recorded(shared / "data/mona/mona_prompts.parquet")
    assert len(texts) == 800
    told = sum(len(prompts_of(text)[1].situation.obstacles) for text in texts.values())
    assert (told, sum(text.count("\n    - ") for text in texts.values())) == (3737, 3743)


@pytest.mark.parametrize("missing", [CUT, "velocity"])
def test_another_text_is_no_such_prompt(missing: str) -> None:
    with pytest.raises((ValueError, AssertionError)):
        prompts_of(TEXT.replace(missing, ""))
