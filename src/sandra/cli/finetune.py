"""`sandra finetune`: train language models on rows of `sandra dataset build`."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import Any

from sandra.cli import finetune_export, finetune_lora, finetune_openai
from sandra.cli.dataset import bar
from sandra.cli.options import command
from sandra.cli.output import print_json, progress


def add(commands: Any) -> None:
    parser = command(
        commands,
        "finetune",
        "train language models on recorded decisions",
        "sandra finetune scratch data.jsonl --out runs/small",
        "sandra finetune lora data.jsonl --model hf:my-model --out runs/adapter",
        "sandra finetune openai data.jsonl --model MODEL --out runs/tuned",
    )
    actions = parser.add_subparsers(dest="action", metavar="ACTION", required=True)
    _add_scratch(actions)
    finetune_lora.add(actions)
    finetune_openai.add(actions)
    finetune_export.add(actions)


def _add_scratch(actions: Any) -> None:
    parser = command(
        actions,
        "scratch",
        "make a small model of the Qwen3 architecture from nothing, with a tokenizer of its own; "
        "goes on where it stopped; with a card and the curve of its loss",
        "sandra finetune scratch data.jsonl --out runs/small --epochs 6",
        "sandra decide merge --ranker hf:runs/small/model#mode=score",
    )
    parser.add_argument(
        "rows", nargs="+", metavar="FILE.jsonl", help="of 'sandra dataset build'; several are one"
    )
    parser.add_argument("--out", required=True, metavar="DIR", help="a new folder, or one begun")
    parser.add_argument(
        "--base",
        metavar="FOLDER",
        help="the model of an earlier run, to go on with; its shape and tokenizer stay",
    )
    parser.add_argument("--width", type=int, default=192, metavar="N", help="of the stream")
    parser.add_argument("--layers", type=int, default=4, metavar="N", help="of the model")
    parser.add_argument("--inner", type=int, default=512, metavar="N", help="width inside a layer")
    parser.add_argument(
        "--vocabulary", type=int, default=2048, metavar="N", help="pieces of the tokenizer, at most"
    )
    parser.add_argument("--epochs", type=float, default=4.0, metavar="N", help="over the data")
    parser.add_argument(
        "--steps", type=int, default=0, metavar="N", help="so many, whatever --epochs says; 0: not"
    )
    parser.add_argument("--batch", type=int, default=16, metavar="N", help="examples in a step")
    parser.add_argument("--rate", type=float, default=3e-3, metavar="R", help="of learning")
    parser.add_argument(
        "--prompt-weight",
        type=float,
        default=0.02,
        metavar="W",
        help="of a prompt's token in the loss; one of the answer's first pair has 1",
    )
    parser.add_argument(
        "--evenness",
        type=float,
        default=0.5,
        metavar="E",
        help="rows of a rare label are read more often: 0 as often as others, 1 until all labels "
        "have as many",
    )
    parser.add_argument("--seed", type=int, default=0, metavar="S", help="of weights and order")
    parser.add_argument("--json", action="store_true", help="print the card as one JSON object")
    parser.set_defaults(run=_scratch)


def _scratch(arguments: argparse.Namespace) -> int:
    from sandra.evaluation.dataset.card import Card, write_card
    from sandra.evaluation.provenance import versions
    from sandra.learn.tuning.model import Shape
    from sandra.learn.tuning.scratch import Recipe, from_scratch
    from sandra.learn.tuning.trainer import Pace
    from sandra.view.learning import learning_figure

    recipe = Recipe(
        shape=Shape(
            arguments.width,
            arguments.layers,
            arguments.inner,
            vocabulary=arguments.vocabulary,
        ),
        pace=Pace(arguments.epochs, arguments.steps, arguments.batch, arguments.rate),
        prompt_weight=arguments.prompt_weight,
        evenness=arguments.evenness,
        seed=arguments.seed,
    )
    out = Path(arguments.out)
    done = from_scratch(
        [Path(name) for name in arguments.rows],
        out,
        recipe,
        None if arguments.base is None else Path(arguments.base),
        lambda at, total, name: progress(bar(at, total, name)),
    )
    progress("")
    learning_figure(done.curve, out / "loss.png")
    packages = ("torch", "transformers", "tokenizers")
    card = Card(
        title="A model from scratch",
        about="Of the Qwen3 architecture, with a tokenizer of its own, trained on rows of prompt "
        "and ranking.",
        facts={
            "parameters": done.parameters,
            "rows": done.rows,
            "examples of an epoch": done.examples,
            "tokens of an example": round(done.tokens, 1),
            "seconds": round(done.seconds),
            "loss of training, at the end": done.curve.training[-1][1],
            "loss of validation, at the end": done.curve.validation[-1][1],
            "base": arguments.base or "none",
            "shape": recipe.shape.to_dict(),
            "pace": recipe.to_dict()["pace"],
            "weight of a prompt's token": recipe.prompt_weight,
            "evenness": recipe.evenness,
            "seed": recipe.seed,
            "sha256 of the rows": done.data,
        },
        tables={},
        command_line=("sandra", *sys.argv[1:]),
        versions=versions(packages),
    )
    write_card(card, out / "card.json", out / "card.md")
    if arguments.json:
        print_json(card.to_dict())
    else:
        print(card)
    return 0
