"""Scoring against a plain computation, and what calibration is for."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from sandra.actions import ActionPair
from sandra.describe import describe, narrow
from sandra.rankers import create
from sandra.rankers.bounded import Deadline
from sandra.rankers.local.folder import Folder, folder
from sandra.rankers.local.score import OPENING, ScoreRanker, _among_alternatives, _sums
from straight_road import Road
from tiny_model import prompts

ROAD = Road()
PROMPT = describe(ROAD.scene(ROAD.obstacle(7, 60.0, 0.0, 8.0), lanes=ROAD.three_lanes()))


@pytest.fixture(scope="module")
def model(tiny: Path) -> Folder:
    return folder(tiny / "model", device="cpu")


def scores(model: Folder, calibrate: str, prompt: object = PROMPT) -> dict[ActionPair, float]:
    found = ScoreRanker("score", model, 60.0, calibrate).scores(prompt, Deadline(60.0))  # type: ignore[arg-type]
    assert found is not None
    return found


def slowly(model: Folder, pair: ActionPair) -> float:
    """The log-likelihood of a pair, from one pass over the whole text without any memory."""
    torch = model.torch
    messages = [
        {"role": "system", "content": PROMPT.system},
        {"role": "user", "content": PROMPT.user},
    ]
    text = f'{{"longitudinal": "{pair.longitudinal.value}", "lateral": "{pair.lateral.value}"}}'
    before = model.tokens_of(model.text_of(messages))
    tokens = before + model.tokens_of(OPENING + text)
    with torch.inference_mode():
        logits = model.model(input_ids=torch.tensor([tokens])).logits[0]
    likely = torch.log_softmax(logits.double(), dim=-1)
    shared = len(before) + len(model.tokens_of(OPENING + '{"longitudinal": "'))
    return sum(float(likely[i - 1, tokens[i]]) for i in range(shared, len(tokens)))


def test_one_pass_for_all_agrees_with_one_pass_for_each(model: Folder) -> None:
    found = scores(model, "none")
    assert list(found) == list(PROMPT.feasible)
    assert len(found) == 12
    truth = {pair: slowly(model, pair) for pair in found}
    differences = [found[pair] - truth[pair] for pair in found]
    # What all pairs share is no part of a score.
    assert np.ptp(differences) < 1e-3
    assert sorted(found, key=lambda p: -found[p])[:3] == sorted(truth, key=lambda p: -truth[p])[:3]


def test_length_gives_probabilities_of_the_feasible_pairs(model: Folder) -> None:
    for prompt in (PROMPT, *prompts(3, 4)):
        assert np.exp(list(scores(model, "length", prompt).values())).sum() == pytest.approx(1.0)


def test_a_word_with_one_ending_costs_nothing_however_long_it_is() -> None:
    """A model that doubts every token: the sum favours the short way, alternatives do not."""
    ways = [(1, 9), (2, 3, 4, 5, 6, 9)]
    even = {way[:i]: np.zeros(10) for way in ways for i in range(len(way))}
    short, long = _sums(ways, even)
    assert short - long == pytest.approx(4 * np.log(10.0))
    assert _among_alternatives(ways, even) == pytest.approx(np.log([0.5, 0.5]))
    # Where it is sure that is kept: the first token decides, and no other has an alternative.
    sure = {**even, (): np.where(np.arange(10) == 2, np.log(3.0), 0.0)}
    assert np.exp(_among_alternatives(ways, sure)) == pytest.approx([0.25, 0.75])


def test_neutral_takes_off_what_is_preferred_whatever_is_told(model: Folder) -> None:
    ranker = ScoreRanker("score", model, 60.0, "neutral")
    corrected, plain = ranker.scores(PROMPT, Deadline(60.0)), scores(model, "length")
    assert corrected is not None
    (bias,) = ranker._of_neutral.values()
    assert np.exp(bias).sum() == pytest.approx(1.0)
    for pair, prior in zip(PROMPT.feasible, bias, strict=True):
        assert corrected[pair] == pytest.approx(plain[pair] - prior, abs=1e-4)


def test_it_ranks_what_is_left_without_reading_again(model: Folder) -> None:
    ranker = ScoreRanker("score", model, 60.0, "length")
    ahead = ranker.begin(PROMPT, 60.0)
    best = ahead.finish(PROMPT)
    took = ahead.duration
    left = [pair for pair in PROMPT.feasible if pair not in best.pairs][:5]
    narrowed = ahead.finish(narrow(PROMPT, left))
    assert ahead.duration == took
    assert set(narrowed.pairs) <= set(left)
    assert len(narrowed.pairs) == 3
    likely = scores(model, "length")
    assert list(narrowed.pairs) == sorted(left, key=lambda pair: -likely[pair])[:3]


def test_an_adapter_changes_what_is_likely(tiny: Path, model: Folder) -> None:
    stop = ActionPair.parse("stop,follow-lane")
    adapted = folder(tiny / "model", tiny / "adapter", "cpu")
    for prompt in prompts(3, 4):
        if stop in prompt.feasible:
            assert scores(adapted, "length", prompt)[stop] > scores(model, "length", prompt)[stop]
    # A ranker with an adapter is taken at its word; without, it is calibrated.
    spec = f"hf:{tiny}/model+{tiny}/adapter#mode=score&device=cpu"
    ranker = create(spec)
    assert isinstance(ranker, ScoreRanker)
    assert ranker.calibrate == "length"
    other = create(f"hf:{tiny}/model#mode=score&device=cpu")
    assert isinstance(other, ScoreRanker)
    assert other.calibrate == "neutral"
