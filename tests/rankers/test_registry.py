import itertools
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from sandra.actions import ActionPair
from sandra.describe import Prompt, describe
from sandra.errors import RankerError
from sandra.rankers import Failure, Ranker, Ranking, as_ranker, ask, create
from straight_road import Road

ROAD = Road()
PROMPT = describe(ROAD.scene(lanes=(ROAD.lane("current", 0), ROAD.lane("left", 1))))
KEEP, STOP = ActionPair.parse("keep,follow-lane"), ActionPair.parse("stop,follow-lane")

PLUG_IN = """
from sandra.actions import ActionPair

class Mine:
    name = "mine"
    def rank(self, prompt, deadline=None):
        from sandra.rankers import Ranking
        return Ranking((ActionPair.parse("keep,follow-lane"),), self.name)

class Needs:
    def __init__(self, thing):
        pass

class Space:
    mine = Mine()

def function(prompt):
    return [ActionPair.parse("stop,follow-lane")]

number = 3
"""


@pytest.fixture
def module(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[str]:
    (tmp_path / "sandra_test_plug_in.py").write_text(PLUG_IN, encoding="utf-8")
    monkeypatch.syspath_prepend(tmp_path)
    yield "sandra_test_plug_in"
    sys.modules.pop("sandra_test_plug_in", None)


def test_random_depends_on_seed_and_prompt_alone() -> None:
    seven = create("random:7")
    assert seven.name == "random:7"
    first = seven.rank(PROMPT)
    assert len(set(first.pairs)) == len(first.pairs) == 3
    other = describe(ROAD.scene(speed=3.0))
    seven.rank(other)
    assert seven.rank(PROMPT) == first == create("random", seed=7).rank(PROMPT)
    assert create("random").name == "random:0"
    drawn = {create(f"random:{n}").rank(PROMPT).pairs for n in range(30)}
    assert len(drawn) > 15
    assert {pair for pairs in drawn for pair in pairs} == set(PROMPT.feasible)


def test_exhaustive_offers_every_feasible_pair_progress_first() -> None:
    pairs = create("exhaustive").rank(PROMPT).pairs
    assert set(pairs) == set(PROMPT.feasible)
    assert len(pairs) == len(PROMPT.feasible) == 8
    assert [str(p) for p in pairs[:3]] == [
        "accelerate,follow-lane",
        "keep,follow-lane",
        "accelerate,left-lane",
    ]


@pytest.mark.parametrize(
    "spec",
    ["", "rule", "Rules", "rules:3", "exhaustive:x", "replay:", "replay", "gpt-4o", "a b:c", ":"],
)
def test_an_unknown_ranker_is_answered_with_the_choices(spec: str) -> None:
    with pytest.raises(RankerError, match="openai:MODEL, ollama:MODEL") as caught:
        create(spec)
    assert "\n" not in str(caught.value)


def test_a_bad_seed() -> None:
    with pytest.raises(RankerError, match="random:7"):
        create("random:x")


@pytest.mark.parametrize(
    ("attribute", "pair"), [("Mine", KEEP), ("Space.mine", KEEP), ("function", STOP)]
)
def test_a_plug_in_is_named_by_module_and_attribute(
    module: str, attribute: str, pair: ActionPair
) -> None:
    ranker = create(f"{module}:{attribute}")
    assert ranker.name == f"{module}:{attribute}"
    ranking = ranker.rank(PROMPT)
    assert ranking.pairs == (pair,)
    assert ranking.failure is None


@pytest.mark.parametrize(
    ("spec", "message"),
    [
        ("sandra_test_plug_in:nobody", "cannot be imported"),
        ("no_such_module:Thing", "PYTHONPATH"),
        ("sandra_test_plug_in:Needs", "without arguments"),
        ("sandra_test_plug_in:number", "is a int"),
    ],
)
def test_a_plug_in_that_cannot_be_used(module: str, spec: str, message: str) -> None:
    with pytest.raises(RankerError, match=message):
        create(spec)


def test_whatever_a_plug_in_does_is_a_named_failure(caplog: pytest.LogCaptureFixture) -> None:
    def breaks(prompt: Prompt) -> list[ActionPair]:
        raise ZeroDivisionError("oh\nno")

    ranking = ask(breaks, PROMPT)
    assert (ranking.failure, ranking.pairs) == (Failure.INTERNAL, ())
    assert ranking.detail == "ZeroDivisionError: oh no"
    assert ranking.ranker == "breaks"
    assert "breaks broke" in caplog.text  # with its traceback, for whoever wrote it

    start = time.monotonic()
    late = ask(lambda prompt: time.sleep(1.0) or [KEEP], PROMPT, 0.2)
    assert time.monotonic() - start < 0.3
    assert late.failure is Failure.TIMEOUT

    for nonsense in (3, None, ["keep"]):
        assert ask(lambda p, n=nonsense: n, PROMPT).failure is Failure.INTERNAL  # type: ignore[arg-type, misc]
    assert ask(lambda prompt: [], PROMPT).failure is Failure.EMPTY
    right = ActionPair.parse("keep,right-lane")
    assert ask(lambda prompt: [right], PROMPT).failure is Failure.INFEASIBLE


def test_what_a_plug_in_returns_is_held_to_the_protocol() -> None:
    right = ActionPair.parse("keep,right-lane")
    answer = Ranking((KEEP, KEEP, right, STOP), "theirs", reasoning="so")
    ranking = ask(lambda prompt: answer, PROMPT)
    assert (ranking.pairs, ranking.reasoning, ranking.failure) == ((KEEP, STOP), "so", None)
    assert len(ranking.warnings) == 3
    endless = ask(lambda prompt: itertools.cycle(prompt.feasible), PROMPT)
    assert endless.pairs == PROMPT.feasible[:3]


def test_ours_are_rankers_and_stay_as_they_are() -> None:
    for spec in ("rules", "random:1", "exhaustive"):
        ranker = create(spec)
        assert isinstance(ranker, Ranker)
        assert as_ranker(ranker) is ranker
    with pytest.raises(RankerError, match="no ranker"):
        as_ranker(3)  # type: ignore[arg-type]
