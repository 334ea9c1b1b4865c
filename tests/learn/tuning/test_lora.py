"""Adapters: they learn, go on where they stopped, and rank the same as one file."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

import pytest

import tiny_model
from sandra.actions import ActionPair
from sandra.cli import main
from sandra.describe import Prompt
from sandra.errors import SandraError, SettingsError
from sandra.learn.export import answer
from sandra.learn.rows import Row
from sandra.learn.tuning import lora
from sandra.learn.tuning.examples import Example, digest, example
from sandra.learn.tuning.lora import Recipe, tune
from sandra.learn.tuning.measure import measure, prompt_of
from sandra.rankers import Ranking, create
from sandra.rankers.local.folder import folder
from tuning_rows import LABEL, row

HOW = [
    "--rank",
    "8",
    "--alpha",
    "16",
    "--rate",
    "0.02",
    "--batch",
    "3",
    "--epochs",
    "8",
    "--loss",
    "label",
]


@pytest.fixture(scope="module")
def rows() -> list[Row]:
    return [row(i, "train" if i % 3 else "validation") for i in range(18)]


@pytest.fixture(scope="module")
def data(rows: list[Row], tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("rows") / "data.jsonl"
    path.write_text("".join(each.line() for each in rows))
    return path


@pytest.fixture(scope="module")
def adapter(tiny: Path, data: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("tuned") / "adapter"
    words = ["finetune", "lora", str(data), "--model", f"hf:{tiny}/model", "--out", str(out)]
    assert main([*words, *HOW]) == 0
    return out


def test_it_learns_what_was_driven_and_a_card_tells(adapter: Path, tiny: Path, data: Path) -> None:
    card = json.loads((adapter / "card.json").read_text())
    before, after = card["validation, before"], card["validation, after"]
    assert (before["rows"], before["failures"], after["failures"]) == (6, 0, 0)
    assert before["top1"] < 0.5
    assert after["top1"] > 0.8
    assert card["sha256 of the rows"] == digest([data])
    assert card["recipe"]["rank"] == 8
    assert card["rows"] == 12
    assert card["parameters of the adapter"] < 0.2 * card["parameters of the model"]
    assert card["loss of validation, at the end"] < 0.5
    assert {"peft", "trl", "torch"} <= set(card["versions"])
    assert f"hf:{tiny}/model+{adapter}" in (adapter / "card.md").read_text()
    steps = [line.split(",") for line in (adapter / "loss.csv").read_text().splitlines()[1:]]
    training = [float(loss) for _, split, loss in steps if split == "training"]
    assert len(training) == 32
    assert sum(training[-3:]) < 0.5 * sum(training[:3])
    assert (adapter / "loss.png").stat().st_size > 1000


def test_a_run_that_is_over_is_over(
    adapter: Path, tiny: Path, data: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    weights = (adapter / lora.ADAPTER).read_bytes()
    words = ["finetune", "lora", str(data), "--model", f"hf:{tiny}/model", "--out", str(adapter)]
    assert main([*words, *HOW, "--measure", "1", "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["validation, after"]["rows"] == 1
    assert told["ranker"] == f"hf:{tiny}/model+{adapter}"
    assert (adapter / lora.ADAPTER).read_bytes() == weights


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["--rank", "4"], "differs in rank; choose another --out"),
        (["--seed", "1", "--rate", "0.03"], "differs in rate, seed"),
        (["--model", "hf:{tiny}/model+{tiny}/adapter"], "no folder with a file config.json"),
        (["--model", "gguf:x"], "write hf:FOLDER"),
        (["--out", "{data}"], "choose another --out"),
        (["--out", "{tiny}"], "is not empty, and no run of ours"),
        (["--batch", "3", "--at-once", "2"], "at_once = 2: must divide batch = 3"),
        (["--epochs", "nan"], "epochs = nan"),
        (["--out", "{new}", "--max-length", "50"], "raise --max-length"),
        (["--out", "{new}", "--max-length", "50", "--model", "embedded"], "raise --max-length"),
    ],
)
def test_what_cannot_be_done_is_said_in_one_line(
    words: list[str], told: str, adapter: Path, tiny: Path, data: Path, tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    places = {"tiny": tiny, "data": data, "new": tmp_path / "new"}
    given = [word.format(**places) for word in words]
    always = ["--model", f"hf:{tiny}/model", "--out", str(adapter)]
    assert main(["finetune", "lora", str(data), *always, *HOW, *given]) == 2
    lines = capsys.readouterr().err.strip().splitlines()
    assert len(lines) == 1
    assert told in lines[0]


def test_other_rows_are_another_run(
    adapter: Path, tiny: Path, rows: list[Row], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    other = tmp_path / "data.jsonl"
    other.write_text("".join(each.line() for each in rows[1:]))
    words = ["finetune", "lora", str(other), "--model", f"hf:{tiny}/model", "--out", str(adapter)]
    assert main([*words, *HOW]) == 2
    assert "differs in data" in capsys.readouterr().err


def test_a_missing_package_is_named(
    tiny: Path, data: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    monkeypatch.setitem(sys.modules, "trl", None)
    words = ["finetune", "lora", str(data), "--model", f"hf:{tiny}/model"]
    assert main([*words, "--out", str(tmp_path / "new")]) == 2
    assert "pip install 'sandra[local,finetune]'" in capsys.readouterr().err
    assert not (tmp_path / "new").exists()


def test_an_interrupted_run_goes_on_and_ends_the_same(
    tiny: Path, rows: list[Row], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(lora, "_LEAST", 2)
    recipe = Recipe(rank=2, rate=0.01, epochs=2.0, batch=2, dropout=0.1, loss="label")
    seen: list[int] = []

    def run(name: str, stop: int = 0) -> Any:
        def progress(done: int, total: int, words: str) -> None:
            seen.append(done)
            if done == stop:
                raise KeyboardInterrupt

        return tune(
            tiny / "model", rows[1:7], rows[12:14], {}, tmp_path / name, recipe, progress=progress
        )

    whole = run("whole")
    seen.clear()
    with pytest.raises(KeyboardInterrupt):
        run("parts", 5)
    # Cut short while it was written: not gone on with.
    broken = tmp_path / "parts" / "checkpoints" / "checkpoint-5"
    broken.mkdir()
    (broken / "trainer_state.json").write_text('{"global_')
    parts = run("parts")
    assert seen == [1, 2, 3, 4, 5, 5, 6]
    assert parts.curve == whole.curve
    weights = [(tmp_path / name / lora.ADAPTER).read_bytes() for name in ("whole", "parts")]
    assert weights[0] == weights[1]


def test_the_loss_counts_the_answer_alone(tiny: Path, rows: list[Row]) -> None:
    """And with "label" its first pair; both as the tokens stand in what a ranker reads."""
    model = folder(tiny / "model", device="cpu")
    one: Example = example(rows[0], model.tokenizer)
    text = model.text_of(
        [{"role": "system", "content": rows[0].system}, {"role": "user", "content": rows[0].user}]  # type: ignore[dict-item]
    )
    assert list(one.tokens[: one.answer]) == model.tokens_of(text)

    def counted(loss: str) -> str:
        labels = lora.columns([one], loss)["labels"][0]
        assert len(labels) == len(one.tokens)
        counts = [i for i, label in enumerate(labels) if label != -100]
        assert [labels[i] for i in counts] == [one.tokens[i] for i in counts]
        return str(model.tokenizer.decode([one.tokens[i] for i in counts]))

    assert counted("answer") == answer(rows[0]) + tiny_model.END
    pair = ActionPair.parse(LABEL).to_dict()
    words = f'{{"reasoning": "", "ranking": [{json.dumps(pair)}'
    assert counted("label").removesuffix(",") == words  # of some tokenizers in one piece


def test_rows_that_are_too_long_are_left_out_and_counted(tiny: Path, rows: list[Row]) -> None:
    model = folder(tiny / "model", device="cpu")
    sizes = sorted(len(example(each, model.tokenizer).tokens) for each in rows)
    short, left_out = lora.fitting(rows, model.tokenizer, Recipe(max_length=sizes[0]))
    assert [len(short), left_out] == [sizes.count(sizes[0]), len(rows) - sizes.count(sizes[0])]
    assert left_out > 0


def test_the_merged_model_in_one_file_ranks_as_the_adapter_does(
    adapter: Path, tiny: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    spec = f"hf:{tiny}/model+{adapter}"
    for out in ("tuned.gguf", "merged"):
        assert main(["finetune", "export", spec, "--out", str(tmp_path / out), "--json"]) == 0
        told = json.loads(capsys.readouterr().out)
    assert told["ranker"] == f"hf:{tmp_path}/merged"
    asked = [prompt_of(row(i, "test")) for i in range(40, 45)]
    named = (f"{spec}#device=cpu", f"gguf:{tmp_path}/tuned.gguf#threads=1", told["ranker"])
    tuned, in_a_file, in_a_folder = (
        [create(ranker).rank(prompt, 60.0).pairs for prompt in asked] for ranker in named
    )
    assert tuned == in_a_folder
    assert sum(a == b for a, b in zip(tuned, in_a_file, strict=True)) >= 4  # rounding, near ties
    untuned = [create(f"hf:{tiny}/model").rank(prompt, 60.0).pairs for prompt in asked]
    assert sum(a == b for a, b in zip(tuned, untuned, strict=True)) <= 1
    assert [path.name for path in tmp_path.glob(".merged*")] == []


@pytest.mark.parametrize(
    ("model", "out", "told"),
    [
        ("gguf:x", "y.gguf", "write hf:FOLDER"),
        ("hf:{tiny}/model", "folder", "is such a folder already"),
        ("hf:{tiny}/model+{tiny}/adapter", "taken", "is there already"),
        ("hf:{tiny}/model", "none/x.gguf", "make it first"),
        ("hf:{tiny}/none", "x.gguf", "no model that can be read"),
    ],
)
def test_what_cannot_be_exported(
    model: str, out: str, told: str, tiny: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "taken").mkdir()
    words = ["finetune", "export", model.format(tiny=tiny), "--out", str(tmp_path / out)]
    assert main(words) == 2
    assert told in capsys.readouterr().err


class Constant:
    name = "constant"

    def rank(self, prompt: Prompt, deadline: float | None = None) -> Ranking:
        return Ranking(pairs=prompt.feasible[:3], ranker=self.name)


def test_measuring_finds_the_place_of_the_label(rows: list[Row]) -> None:
    found = measure(Constant(), rows)
    places = [r.feasible.index(r.label or "") + 1 for r in rows]
    assert found.places == tuple(p if p <= 3 else None for p in places)
    assert found.top(3) == sum(p <= 3 for p in places) / len(rows)
    assert found.top(1) == sum(p == 1 for p in places) / len(rows)
    assert tuple(map(str, prompt_of(rows[0]).feasible)) == rows[0].feasible


@pytest.mark.parametrize("change", [{"rank": 0}, {"loss": "x"}, {"dropout": 1.0}, {"seed": -1}])
def test_recipes_out_of_range(change: dict[str, Any]) -> None:
    with pytest.raises(SettingsError):
        Recipe(**change)


def test_a_recipe_that_is_none_of_ours(tiny: Path, tmp_path: Path) -> None:
    (tmp_path / "recipe.json").write_text("[]")
    with pytest.raises(SandraError, match="no recipe of ours"):
        tune(tiny / "model", [], [], {}, tmp_path, Recipe())
