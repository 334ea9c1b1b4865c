"""The trainer of `transformers`, with a weight for each token and what we ask of a run."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from sandra.errors import SettingsError
from sandra.learn.tuning.checkpoints import last_checkpoint
from sandra.learn.tuning.curve import Curve
from sandra.rankers.local.packages import package

_POINTS, _CHECKPOINTS = 100, 10
"""Of a run: points of the curve of training; checkpoints and points of that of validation."""


@dataclass(frozen=True, slots=True)
class Pace:
    """How long and how fast: `epochs` over the data (`steps`, if > 0, instead), examples in a
    `batch`, the highest learning `rate`, after a rise over `warm_up` of all steps; then it falls as
    a cosine. `half`: products in 16 bits (bfloat16).

    Raises:
        SettingsError: a value out of range.
    """

    epochs: float = 4.0
    steps: int = 0
    batch: int = 16
    rate: float = 3e-3
    warm_up: float = 0.05
    decay: float = 0.05
    half: bool = True

    def __post_init__(self) -> None:
        if not (self.epochs > 0.0 and self.steps >= 0 and self.batch >= 1 and self.rate > 0.0):
            raise SettingsError("epochs and rate above 0, batch at least 1, steps at least 0")

    def total(self, examples: int) -> int:
        """Steps in all."""
        return self.steps or max(1, math.ceil(self.epochs * math.ceil(examples / self.batch)))


@dataclass(frozen=True, slots=True)
class Weighted:
    """A sequence, and how much each of its tokens counts as something to be said."""

    tokens: Sequence[int]
    weights: Sequence[float]


def trained(
    model: Any,
    train: Sequence[Weighted],
    validation: Sequence[Weighted],
    pace: Pace,
    seed: int,
    out: Path,
    progress: Callable[[int, int, str], None],
) -> Curve:
    """Train a model in place; goes on at the last of `out/checkpoints`, if there is one.

    `out/loss.csv` is written on the way.
    """
    checkpoints = out / "checkpoints"
    torch, transformers = package("torch"), package("transformers")
    transformers.utils.logging.set_verbosity_error()
    transformers.utils.logging.disable_progress_bar()
    total = pace.total(len(train))
    every = max(1, total // _CHECKPOINTS)

    def compute_loss(
        self: Any, model: Any, inputs: Any, return_outputs: bool = False, **_: Any
    ) -> Any:
        out = model(input_ids=inputs["input_ids"], use_cache=False)
        logits, tokens = out.logits[:, :-1].float(), inputs["input_ids"][:, 1:]
        losses = torch.nn.functional.cross_entropy(
            logits.flatten(0, 1), tokens.flatten(), reduction="none"
        )
        loss = (losses * inputs["labels"][:, 1:].flatten()).sum() / len(tokens)
        return (loss, out) if return_outputs else loss

    def on_log(self: Any, arguments: Any, state: Any, control: Any, **_: Any) -> None:
        curve = Curve.of(state.log_history)
        curve.write(out / "loss.csv")
        losses = [loss for _, loss in curve.training]
        progress(state.global_step, total, f"loss {losses[-1]:.3f}" if losses else "")

    def collate(rows: Sequence[dict[str, Any]]) -> dict[str, Any]:
        # On the right: nothing that counts looks at what follows it.
        length = max(len(row["input_ids"]) for row in rows)
        tokens = torch.zeros(len(rows), length, dtype=torch.long)
        weights = torch.zeros(len(rows), length)
        for i, row in enumerate(rows):
            tokens[i, : len(row["input_ids"])] = torch.tensor(row["input_ids"])
            weights[i, : len(row["input_ids"])] = torch.tensor(row["labels"])
        return {"input_ids": tokens, "labels": weights}

    cuda = torch.cuda.is_available()
    arguments = transformers.TrainingArguments(
        output_dir=str(checkpoints),
        max_steps=total,
        per_device_train_batch_size=pace.batch,
        per_device_eval_batch_size=pace.batch,
        learning_rate=pace.rate,
        lr_scheduler_type="cosine",
        warmup_steps=round(pace.warm_up * total),
        weight_decay=pace.decay,
        adam_beta2=0.95,
        max_grad_norm=1.0,
        bf16=pace.half,
        use_cpu=not cuda,
        train_sampling_strategy="group_by_length",
        logging_steps=max(1, total // _POINTS),
        eval_strategy="steps",
        eval_steps=every,
        prediction_loss_only=True,
        save_strategy="steps",
        save_steps=every,
        save_total_limit=1,
        dataloader_pin_memory=False,
        remove_unused_columns=False,
        report_to=[],
        disable_tqdm=True,
        seed=seed,
    )
    # The package is imported where it is used, so its classes have no name before.
    kind = type("Trainer", (transformers.Trainer,), {"compute_loss": compute_loss})
    teller = type("Teller", (transformers.TrainerCallback,), {"on_log": on_log})
    trainer = kind(
        model=model,
        args=arguments,
        data_collator=collate,
        train_dataset=[_row(each) for each in train],
        eval_dataset=[_row(each) for each in validation],
        callbacks=[teller()],
    )
    trainer.remove_callback(transformers.PrinterCallback)
    trainer.train(resume_from_checkpoint=last_checkpoint(checkpoints))
    return Curve.of(trainer.state.log_history)


def _row(each: Weighted) -> dict[str, Any]:
    return {"input_ids": list(each.tokens), "labels": list(each.weights)}
