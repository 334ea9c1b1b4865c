"""Rows as what trainers read: OpenAI's chat format, and prompt and completion for TRL.

https://platform.openai.com/docs/guides/supervised-fine-tuning
https://huggingface.co/docs/trl/dataset_formats
"""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Iterable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from sandra.actions import ActionPair
from sandra.errors import SandraError
from sandra.learn.rows import Row

FORMATS = ("openai", "trl")
LEAST_EXAMPLES = 10
"""OpenAI's fine-tuning refuses files with fewer examples."""
MOST_TOKENS = 65_536
"""Of one example, for the models that take the most; what is beyond is cut off."""
CHARACTERS = 3.6
"""Of a token in our prompts, roughly: numbers are short; each model has a tokenizer of its own."""
_PER_MESSAGE = 4


@dataclass(frozen=True, slots=True)
class Exported:
    """What was written. Tokens are an estimate (`CHARACTERS`), per pass over the data."""

    file: str
    format: str
    split: str
    examples: int
    left_out: dict[str, int]
    """Rows of the split without a label, by status."""
    tokens: int
    longest: int
    """Tokens of the longest example."""
    warnings: tuple[str, ...]

    def to_dict(self) -> dict[str, Any]:
        return asdict(self)

    def __str__(self) -> str:
        left = ", ".join(f"{n} {status}" for status, n in self.left_out.items()) or "none"
        lines = [
            f"{self.file}: {self.examples} examples for {self.format}, split {self.split}",
            f"  left out for want of a label: {left}",
            f"  tokens, estimated: {self.tokens} in all, {self.longest} in the longest example",
            *(f"  warning: {words}" for words in self.warnings),
        ]
        return "\n".join(lines)


def answer(row: Row) -> str:
    """What a model should say: JSON that fits the schema of the row's prompt.

    The reasoning is empty: a recording does not tell why somebody drove as they did.
    """
    pairs = [ActionPair.parse(pair).to_dict() for pair in row.ranking]
    return json.dumps({"reasoning": "", "ranking": pairs})


def example(row: Row, form: str) -> dict[str, Any]:
    """One line of the exported file.

    For TRL, the loss is on the completion alone, and the chat template must not open a
    block for thinking that a completion does not close.
    """
    prompt = [
        {"role": "system", "content": row.system},
        {"role": "user", "content": row.user},
    ]
    said = {"role": "assistant", "content": answer(row)}
    if form == "openai":
        return {"messages": [*prompt, said]}
    return {
        "prompt": prompt,
        "completion": [said],
        "chat_template_kwargs": {"enable_thinking": False},
    }


def export(rows: Iterable[Row], form: str, out: Path, split: str = "train") -> Exported:
    """Write the labelled rows of a split, in their order.

    Args:
        form: one of `FORMATS`. split: train, validation, test, or all.

    Raises:
        SandraError: an unknown format, no labelled row, or a file that cannot be written.
    """
    if form not in FORMATS:
        raise SandraError(f"format '{form}' is unknown; known are {', '.join(FORMATS)}")
    left_out: Counter[str] = Counter()
    tokens = longest = count = 0
    draft = out.with_name(out.name + ".draft")
    try:
        with draft.open("w", encoding="utf-8") as file:
            for row in rows:
                if split not in ("all", row.split):
                    continue
                if not row.is_labelled:
                    left_out[row.status] += 1
                    continue
                file.write(json.dumps(example(row, form), ensure_ascii=False) + "\n")
                size = estimated_tokens(row)
                count, tokens, longest = count + 1, tokens + size, max(longest, size)
        if not count:
            draft.unlink()
            raise SandraError(f"there is no labelled row in split '{split}': nothing to export")
        draft.replace(out)
    except OSError as error:
        raise SandraError(
            f"{out}: cannot be written ({error.strerror}); choose another --out"
        ) from None
    warnings = []
    if form == "openai" and count < LEAST_EXAMPLES:
        warnings.append(f"OpenAI refuses files of fewer than {LEAST_EXAMPLES} examples")
    if form == "openai" and longest > MOST_TOKENS:
        warnings.append(f"examples of more than {MOST_TOKENS} tokens are cut off")
    return Exported(str(out), form, split, count, dict(left_out), tokens, longest, tuple(warnings))


def estimated_tokens(row: Row) -> int:
    """Of one example, roughly."""
    texts = (row.system or "", row.user or "", answer(row))
    return round(sum(map(len, texts)) / CHARACTERS) + _PER_MESSAGE * len(texts)
