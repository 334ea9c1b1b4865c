"""A model from nothing: tokenizer, what counts in the loss, a run that goes on, what comes out."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from sandra.cli import main
from sandra.errors import SandraError, SettingsError
from sandra.learn.export import answer
from sandra.learn.rows import Row, RowStatus
from sandra.learn.tuning.curve import Curve
from sandra.learn.tuning.examples import conversation, example
from sandra.learn.tuning.model import Shape
from sandra.learn.tuning.scratch import Recipe, from_scratch
from sandra.learn.tuning.tokenizer import ACTIONS, tokenizer_of
from sandra.learn.tuning.trainer import Pace
from sandra.rankers import create
from sandra.rankers.local import llama
from sandra.rankers.local.export import to_gguf
from sandra.rankers.local.folder import folder
from tiny_model import prompts

SHAPE = Shape(width=64, layers=1, inner=64, vocabulary=700)
RECIPE = Recipe(SHAPE, Pace(steps=8, batch=4, rate=1e-2))


def row(number: int, split: str) -> Row:
    prompt = prompts(number, 1)[0]
    ranking = tuple(map(str, create("rules").rank(prompt).pairs))
    return Row(
        status=RowStatus.LABELLED.value,
        split=split,
        scenario=f"{number}.xml",
        ego=1,
        step=0,
        label=ranking[0],
        system=prompt.system,
        user=prompt.user,
        schema=prompt.schema,
        feasible=tuple(map(str, prompt.feasible)),
        ranking=ranking,
    )


ROWS = [row(i, "validation" if i % 4 == 3 else "train") for i in range(16)]


@pytest.fixture(scope="module")
def data(tmp_path_factory: pytest.TempPathFactory) -> Path:
    file = tmp_path_factory.mktemp("rows") / "data.jsonl"
    file.write_text("".join(each.line() for each in ROWS), encoding="utf-8")
    return file


@pytest.fixture(scope="module")
def tokenizer() -> Any:
    return tokenizer_of(map(conversation, ROWS), 700)


@pytest.fixture(scope="module")
def made(data: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """By the command line."""
    out = tmp_path_factory.mktemp("scratch") / "run"
    words = ["--width", "64", "--layers", "1", "--inner", "64", "--vocabulary", "700"]
    words += ["--steps", "8", "--batch", "4", "--rate", "0.01"]
    assert main(["finetune", "scratch", str(data), "--out", str(out), *words]) == 0
    return out


def test_any_text_survives_the_tokenizer(tokenizer: Any) -> None:
    for text in (conversation(ROWS[0]), "é🚗 12,5 km/h\n\n  stopkeep\x00 1234567", ""):
        tokens = tokenizer(text, add_special_tokens=False)["input_ids"]
        assert tokenizer.decode(tokens) == text


def test_an_action_is_one_piece_wherever_it_stands(tokenizer: Any) -> None:
    for word in ACTIONS:
        (number,) = tokenizer(word, add_special_tokens=False)["input_ids"]
        for text in (f'"{word}"}}', f"  - {word}: hold", f"{word},{word}"):
            assert number in tokenizer(text, add_special_tokens=False)["input_ids"]


def test_pieces_span_spaces_and_split_numbers(tokenizer: Any) -> None:
    text = conversation(ROWS[0])
    pieces = [tokenizer.decode([n]) for n in tokenizer(text, add_special_tokens=False)["input_ids"]]
    assert len(text) / len(pieces) > 5  # a general tokenizer reads 3.6 characters at once
    assert any(" " in piece.strip() for piece in pieces)
    assert all(piece.isdigit() for piece in pieces if any(c.isdigit() for c in piece))


def test_what_counts_is_the_first_pair(tokenizer: Any) -> None:
    one = example(ROWS[0], tokenizer)
    text = tokenizer.decode(one.tokens)
    assert text.endswith(answer(ROWS[0]) + "<|im_end|>")
    weights = one.weights(0.25)
    said = [n for n, weight in zip(one.tokens, weights, strict=True) if weight == 1.0]
    first = tokenizer.decode(said)
    assert first.startswith('{"reasoning": ""')
    assert ROWS[0].label is not None
    assert all(part in first for part in ROWS[0].label.split(","))
    assert set(weights[: one.answer]) == {0.25}
    assert set(weights[one.chosen :]) == {0.05}


def test_a_folder_that_everything_of_ours_can_use(made: Path) -> None:
    prompt = prompts(20, 1)[0]
    for mode in ("score", "generate"):
        ranking = create(f"hf:{made}/model#mode={mode}&device=cpu").rank(prompt, 60.0)
        assert ranking.failure is None
        assert len(ranking.pairs) == prompt.k


def test_llama_cpp_splits_texts_alike(made: Path) -> None:
    file = to_gguf(made / "model", made / "model.gguf")
    assert create(f"gguf:{file}#threads=1").rank(prompts(20, 1)[0], 60.0).failure is None
    model, server = folder(made / "model", device="cpu"), llama.llama(str(file), threads=1)._server
    for prompt in prompts(21, 3):
        messages = [{"role": "system", "content": prompt.system}]
        messages += [{"role": "user", "content": prompt.user + " é🚗 12,5 km/h 1234567\n\n"}]
        told = server.handle_chat_completions({"messages": messages, "max_tokens": 1})["usage"]
        assert told["prompt_tokens"] == len(model.tokens_of(model.text_of(messages)))


def test_card_and_curve(made: Path, data: Path) -> None:
    card = json.loads((made / "card.json").read_text(encoding="utf-8"))
    assert card["rows"] == 12
    assert list(card["sha256 of the rows"]) == [data.name]
    assert "torch" in card["versions"]
    lines = (made / "loss.csv").read_text(encoding="utf-8").splitlines()
    losses = [float(line.split(",")[2]) for line in lines if ",training," in line]
    assert losses[-1] < 0.8 * losses[0]
    assert any(",validation," in line for line in lines)
    assert (made / "loss.png").read_bytes().startswith(b"\x89PNG")


def test_a_run_goes_on_where_it_stopped(data: Path, made: Path, tmp_path: Path) -> None:
    """Broken off after five of eight steps, it ends as a run in one piece does.

    Not to the last bit: what is left of the epoch is read in another order.
    """
    out = tmp_path / "broken"

    def stop(done: int, total: int, name: str) -> None:
        if done == 5:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        from_scratch([data], out, RECIPE, progress=stop)
    begun = (out / "loss.csv").read_text(encoding="utf-8")
    steps: list[int] = []
    again = from_scratch([data], out, RECIPE, progress=lambda done, total, name: steps.append(done))
    assert min(steps) > 3
    assert set(begun.splitlines()[:5]) <= set((out / "loss.csv").read_text().splitlines())
    whole = (made / "loss.csv").read_text(encoding="utf-8").splitlines()
    assert again.curve.validation[-1][0] == 8
    assert again.curve.validation[-1][1] == pytest.approx(float(whole[-1].split(",")[2]), rel=0.02)


def test_a_trained_model_is_gone_on_with(data: Path, made: Path, tmp_path: Path) -> None:
    """The loss begins about where it had ended, with the same tokenizer."""
    slow = replace(RECIPE, pace=Pace(steps=2, batch=4, rate=1e-5))
    more = from_scratch([data], tmp_path / "more", slow, made / "model")
    whole = (made / "loss.csv").read_text(encoding="utf-8").splitlines()
    assert more.curve.validation[-1][1] == pytest.approx(float(whole[-1].split(",")[2]), rel=0.02)
    old, new = (x / "tokenizer.json" for x in (made / "model", more.folder))
    assert json.loads(old.read_text())["model"] == json.loads(new.read_text())["model"]
    with pytest.raises(SandraError, match=r"no model\.safetensors"):
        from_scratch([data], tmp_path / "none", slow, tmp_path)


def test_another_recipe_needs_another_folder(data: Path, made: Path) -> None:
    with pytest.raises(SandraError, match="another recipe"):
        from_scratch([data], made, replace(RECIPE, seed=1))


def test_what_cannot_be_trained_is_said(tmp_path: Path, data: Path) -> None:
    with pytest.raises(SettingsError, match="multiple of"):
        Shape(width=100)
    with pytest.raises(SettingsError, match="epochs"):
        Pace(epochs=0.0)
    only = tmp_path / "only.jsonl"
    only.write_text(ROWS[0].line(), encoding="utf-8")
    with pytest.raises(SandraError, match="no labelled row in split 'validation'"):
        from_scratch([only], tmp_path / "out", RECIPE)


def test_a_curve_is_of_what_was_logged() -> None:
    log = [{"step": 2, "loss": 1.5}, {"step": 2, "eval_loss": 1.25}, {"step": 4, "train_loss": 9.0}]
    assert Curve.of(log) == Curve(((2, 1.5),), ((2, 1.25),))
