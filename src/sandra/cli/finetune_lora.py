"""`sandra finetune lora`: an adapter for a model in a folder."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

from sandra.cli.dataset import bar
from sandra.cli.options import command
from sandra.cli.output import print_json, progress
from sandra.errors import SandraError

if TYPE_CHECKING:
    from sandra.learn.rows import Row
    from sandra.learn.tuning.lora import Recipe, Tuned
    from sandra.learn.tuning.measure import Measured

PACKAGES = ("torch", "transformers", "peft", "trl", "datasets", "accelerate")


def add(actions: Any) -> None:
    parser = command(
        actions,
        "lora",
        "tune a model in a folder: a small adapter beside its weights, by PEFT and TRL; on a GPU "
        "if there is one; goes on where it stopped; with a card and the curve of its loss",
        "sandra finetune lora data.jsonl --model embedded --out runs/adapter",
        "sandra finetune lora data.jsonl --model hf:my-model --rank 16 --epochs 2 --out runs/other",
        "sandra decide merge --ranker hf:my-model+runs/other#mode=score",
    )
    parser.add_argument(
        "rows", nargs="+", metavar="DATA.jsonl", help="of 'sandra dataset build'; several are one"
    )
    parser.add_argument(
        "--model",
        required=True,
        metavar="hf:FOLDER",
        help="what is tuned; embedded: the model that comes along",
    )
    parser.add_argument("--out", required=True, metavar="DIR", help="a new folder, or one begun")
    parser.add_argument("--rank", type=int, default=16, metavar="R", help="of the adapter")
    parser.add_argument(
        "--alpha", type=float, default=32.0, metavar="A", help="over the rank: the adapter's weight"
    )
    parser.add_argument("--dropout", type=float, default=0.0, metavar="P", help="in training")
    parser.add_argument("--rate", type=float, default=5e-4, metavar="R", help="of learning")
    parser.add_argument("--epochs", type=float, default=3.0, metavar="N", help="over the data")
    parser.add_argument("--batch", type=int, default=8, metavar="N", help="rows in a step")
    parser.add_argument(
        "--at-once", type=int, metavar="N", help="rows in memory at once (default: --batch)"
    )
    parser.add_argument(
        "--max-length", type=int, default=4096, metavar="N", help="tokens; longer rows are left out"
    )
    parser.add_argument(
        "--loss",
        choices=("answer", "label"),
        default="answer",
        help="over the whole answer, or its first pair: what was driven",
    )
    parser.add_argument("--seed", type=int, default=0, metavar="S", help="of adapter and order")
    parser.add_argument(
        "--measure",
        type=int,
        default=200,
        metavar="N",
        help="rank so many rows of split validation, before and after; 0: all",
    )
    parser.add_argument("--device", metavar="NAME", help="cpu, cuda, ... (default: a GPU, if any)")
    parser.add_argument("--json", action="store_true", help="print the card as one JSON object")
    parser.set_defaults(run=_run)


def _run(arguments: argparse.Namespace) -> int:
    from sandra.learn.tuning.examples import digest, labelled
    from sandra.learn.tuning.lora import Recipe, tune
    from sandra.view.learning import learning_figure

    files = [Path(name) for name in arguments.rows]
    out, model = Path(arguments.out), _folder(arguments.model.strip())
    if arguments.measure < 0:
        raise SandraError(f"--measure {arguments.measure}: at least 0")
    recipe = Recipe(
        rank=arguments.rank,
        alpha=arguments.alpha,
        dropout=arguments.dropout,
        rate=arguments.rate,
        epochs=arguments.epochs,
        batch=arguments.batch,
        at_once=arguments.at_once,
        max_length=arguments.max_length,
        loss=arguments.loss,
        seed=arguments.seed,
    )
    validation = labelled(files, "validation")
    tuned = tune(
        model,
        labelled(files, "train"),
        validation,
        digest(files),
        out,
        recipe,
        device=arguments.device,
        progress=lambda at, total, words: progress(bar(at, total, words)),
    )
    progress("")
    tuned.curve.write(out / "loss.csv")
    learning_figure(tuned.curve, out / "loss.png", per="token")
    before, after = (
        _measured(ranker, validation, arguments) for ranker in (f"hf:{tuned.model}", tuned.ranker)
    )
    card = _card(tuned, recipe, digest(files), before, after)
    if arguments.json:
        print_json({**card.to_dict(), "ranker": tuned.ranker})
    else:
        print(card)
        print(f"use it: sandra decide merge --ranker '{tuned.ranker}#mode=score'")
    return 0


def _folder(spec: str) -> Path:
    """Of the model that is tuned."""
    from sandra.rankers.inside.ranker import NAME, WEIGHTS

    if spec == NAME:
        return WEIGHTS
    kind, colon, path = spec.partition(":")
    if kind != "hf" or not colon or "#" in path:
        raise SandraError(f"--model {spec}: write hf:FOLDER, or {NAME}, with a model to be tuned")
    return Path(path).expanduser()


def _measured(ranker: str, rows: list[Row], arguments: argparse.Namespace) -> Measured:
    """By likelihood and calibrated alike, so that both are measured by the same rule."""
    from sandra.learn.tuning.measure import measure, spread
    from sandra.rankers import create

    options = "#mode=score&calibrate=length"
    options += f"&device={arguments.device}" if arguments.device else ""
    chosen = spread(rows, arguments.measure)

    def told(done: int, total: int) -> None:
        progress(bar(done, total, f"rank with {ranker}"))

    found = measure(create(ranker + options), chosen, told)
    progress("")
    return found


def _card(
    tuned: Tuned, recipe: Recipe, data: dict[str, str], before: Measured, after: Measured
) -> Any:
    """Written beside the adapter, as JSON and as Markdown."""
    from dataclasses import asdict

    from sandra.evaluation.dataset.card import Card, write_card
    from sandra.evaluation.provenance import versions
    from sandra.learn.tuning.lora import fingerprint

    card = Card(
        title="An adapter",
        about="LoRA weights beside a model that stays as it is, trained on rows of prompt and "
        f"ranking. Use it as the ranker `{tuned.ranker}`. It was trained to say what was driven, "
        "not what is safe: whatever it ranks first is verified before it is driven.",
        facts={
            "model": str(tuned.model),
            "sha256 of the model": fingerprint(tuned.model),
            "sha256 of the rows": data,
            "parameters of the model": tuned.parameters,
            "parameters of the adapter": tuned.trainable,
            "rows": tuned.examples,
            "rows left out for their length": tuned.too_long,
            "recipe": asdict(recipe),
            "steps": tuned.steps,
            "device": tuned.device,
            "seconds": round(tuned.seconds),
            "loss of training, at the end": tuned.curve.training[-1][1],
            "loss of validation, at the end": tuned.curve.validation[-1][1],
            "validation, before": before.to_dict(),
            "validation, after": after.to_dict(),
        },
        tables={},
        command_line=("sandra", *sys.argv[1:]),
        versions=versions(PACKAGES),
    )
    write_card(card, tuned.folder / "card.json", tuned.folder / "card.md")
    return card
