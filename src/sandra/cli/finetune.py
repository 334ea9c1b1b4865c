"""`sandra finetune`: models learn from rows of prompt and ranking."""

from __future__ import annotations

from typing import Any

from sandra.cli import finetune_lora, finetune_openai
from sandra.cli.options import command


def add(commands: Any) -> None:
    parser = command(
        commands,
        "finetune",
        "tune a model on rows of prompt and ranking",
        "sandra finetune openai data.jsonl --model MODEL --out runs/tuned",
    )
    actions = parser.add_subparsers(dest="action", metavar="ACTION", required=True)
    finetune_lora.add(actions)
    finetune_openai.add(actions)
