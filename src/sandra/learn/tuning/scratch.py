"""A model from nothing: tokenizer, weights by chance, training, a Hugging Face folder.

    OUT/model/        config.json, model.safetensors, tokenizer.json, chat_template.jinja, ...
    OUT/recipe.json   what is asked for; a run is only gone on with under the same recipe
    OUT/checkpoints/  of the trainer: an interrupted run goes on at the last one
    OUT/loss.csv      step, split (training, validation), loss

The loss is the cross-entropy of every token under a weight (`sandra.learn.tuning.examples`).
"""

from __future__ import annotations

import json
import time
import warnings
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from sandra.errors import SandraError, SettingsError
from sandra.learn.rows import Row
from sandra.learn.tuning.curve import Curve
from sandra.learn.tuning.examples import conversation, digest, example, labelled
from sandra.learn.tuning.model import Shape, new_model, old_model
from sandra.learn.tuning.tokenizer import tokenizer_of
from sandra.learn.tuning.trainer import Pace, Weighted, trained

_MOST_READ, _MOST_HELD = 4000, 256
"""Conversations that the tokenizer is made from; of validation, that are measured beside."""
_MOST_TIMES = 5
"""That a row is read in an epoch."""


@dataclass(frozen=True, slots=True)
class Recipe:
    """All that the weights depend on, beside the data and the versions of packages.

    `prompt_weight` is how much a token of a prompt counts, beside 1 for one of the answer's first
    pair: to foresee the prompt teaches what its numbers mean.
    """

    shape: Shape = field(default_factory=Shape)
    pace: Pace = field(default_factory=Pace)
    prompt_weight: float = 0.02
    evenness: float = 0.5
    seed: int = 0

    def __post_init__(self) -> None:
        shares = {"prompt_weight": self.prompt_weight, "evenness": self.evenness}
        for name, share in shares.items():
            if not 0.0 <= share <= 1.0:
                raise SettingsError(f"{name} = {share}: from 0 to 1")
        if self.seed < 0:
            raise SettingsError(f"seed = {self.seed}: at least 0")

    def to_dict(self) -> dict[str, Any]:
        return asdict(self)


@dataclass(frozen=True, slots=True)
class Trained:
    """What came out. `data` holds the SHA-256 of each file of rows."""

    folder: Path
    parameters: int
    rows: int
    examples: int
    """In an epoch: rows, with those that are read several times."""
    tokens: float
    """Of an example, in the mean."""
    seconds: float
    curve: Curve
    data: dict[str, str]


def from_scratch(
    files: Sequence[Path],
    out: Path,
    recipe: Recipe,
    base: Path | None = None,
    progress: Callable[[int, int, str], None] = lambda done, total, name: None,
) -> Trained:
    """Train a new model on the rows of split "train"; "validation" is measured beside.

    Args:
        files: of `sandra dataset build`.
        base: a folder that an earlier run has written: its tokenizer, shape and weights are gone on
            with, and `recipe.shape` does not count.
        progress: is told (steps done, all steps, the loss).

    Raises:
        SandraError: no labelled row, a folder of another recipe, or a missing package.
    """
    weights = None if base is None else base / "model.safetensors"
    if weights is not None and not weights.is_file():
        raise SandraError(f"{base}: there is no model.safetensors; name a folder of an earlier run")
    data = digest([*files, *([] if weights is None else [weights])])
    rows, held = labelled(files, "train"), labelled(files, "validation")
    _begin(out, {"recipe": recipe.to_dict(), "data": data})
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # the libraries warn of each other
        if base is None:
            read = map(conversation, _some(rows, _MOST_READ))
            tokenizer = tokenizer_of(read, recipe.shape.vocabulary)
            model = new_model(recipe.shape, tokenizer, recipe.seed)
        else:
            tokenizer, model = old_model(base)
        train = [example(row, tokenizer) for row in _evened(rows, recipe.evenness)]
        validation = [example(row, tokenizer) for row in _some(held, _MOST_HELD)]
        begin = time.monotonic()
        curve = trained(
            model,
            [Weighted(e.tokens, e.weights(recipe.prompt_weight)) for e in train],
            [Weighted(e.tokens, e.weights(0.0)) for e in validation],
            recipe.pace,
            recipe.seed,
            out,
            progress,
        )
        seconds = time.monotonic() - begin
        folder = out / "model"
        model.half().save_pretrained(folder)
        tokenizer.save_pretrained(folder)
    return Trained(
        folder=folder,
        parameters=sum(p.numel() for p in model.parameters()),
        rows=len(rows),
        examples=len(train),
        tokens=sum(len(e.tokens) for e in train) / len(train),
        seconds=seconds,
        curve=curve,
        data=data,
    )


def _some(rows: Sequence[Row], most: int) -> Sequence[Row]:
    """Evenly spread."""
    return rows[:: max(1, -(-len(rows) // most))]


def _evened(rows: Sequence[Row], evenness: float) -> list[Row]:
    counts = Counter(row.label for row in rows)
    most = max(counts.values())
    times = {x: min(round((most / n) ** evenness), _MOST_TIMES) for x, n in counts.items()}
    return [row for row in rows for _ in range(times[row.label])]


def _begin(out: Path, about: dict[str, Any]) -> None:
    """Make the folder, or see that it holds a run of the same."""
    file, text = out / "recipe.json", json.dumps(about, indent=1) + "\n"
    try:
        out.mkdir(parents=True, exist_ok=True)
        if file.exists() and file.read_text(encoding="utf-8") != text:
            raise SandraError(
                f"{out} holds a run with another recipe or other data; choose another --out"
            )
        file.write_text(text, encoding="utf-8")
    except OSError as error:
        raise SandraError(
            f"{out}: cannot be written ({error.strerror}); choose another --out"
        ) from None
