"""What a provider is asked to train, and what that will cost."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from sandra.errors import SandraError
from sandra.learn.export import Exported
from sandra.rankers.usage import Price

LONGEST_SUFFIX = 64
_USUAL_PASSES, _LEAST_SEEN, _MOST_SEEN, _MOST_PASSES = 3, 100, 25_000, 25
"""How OpenAI's cookbook estimates the passes that a server chooses by itself."""


@dataclass(frozen=True, slots=True)
class Order:
    """What the provider is asked for; None leaves it to the provider."""

    model: str
    epochs: int | None = None
    batch: int | None = None
    learning_rate: float | None = None
    """A multiplier of the provider's own."""
    suffix: str | None = None
    """Part of the name of the tuned model."""
    seed: int | None = None

    def __post_init__(self) -> None:
        if not self.model.strip():
            raise SandraError("--model: name a model of the provider")
        for name in ("epochs", "batch", "learning_rate"):
            value = getattr(self, name)
            if value is not None and not 0 < value < 1e9:
                raise SandraError(f"--{name.replace('_', '-')} {value}: must be greater than 0")
        if self.suffix is not None and not 1 <= len(self.suffix) <= LONGEST_SUFFIX:
            raise SandraError(f"--suffix: at most {LONGEST_SUFFIX} characters")

    def request(self, training: str, validation: str | None) -> dict[str, Any]:
        """As `fine_tuning.jobs.create` takes it, for two uploaded files."""
        chosen = {
            "n_epochs": self.epochs,
            "batch_size": self.batch,
            "learning_rate_multiplier": self.learning_rate,
        }
        chosen = {name: value for name, value in chosen.items() if value is not None}
        method = {"type": "supervised", "supervised": {"hyperparameters": chosen}}
        found = {
            "model": self.model,
            "training_file": training,
            "validation_file": validation,
            "suffix": self.suffix,
            "seed": self.seed,
            "method": method if chosen else None,
        }
        return {name: value for name, value in found.items() if value is not None}


@dataclass(frozen=True, slots=True)
class Estimate:
    """What a job will read, and cost, roughly: tokens are estimated (`sandra.learn.export`)."""

    train: Exported
    validation: Exported | None
    epochs: int
    epochs_are_ours: bool
    """Whether so many were ordered; else the provider chooses, and this is a guess."""
    price: Price | None = None

    @property
    def tokens(self) -> int:
        """Read while training."""
        return self.train.tokens * self.epochs

    @property
    def money(self) -> float | None:
        """None where no price of training is known."""
        if self.price is None or self.price.training is None:
            return None
        return self.tokens * self.price.training / 1e6

    def to_dict(self) -> dict[str, Any]:
        return {
            "examples": self.train.examples,
            "validation_examples": 0 if self.validation is None else self.validation.examples,
            "tokens_per_epoch": self.train.tokens,
            "epochs": self.epochs,
            "epochs_ordered": self.epochs_are_ours,
            "tokens": self.tokens,
            "money": self.money,
            "currency": None if self.price is None else self.price.currency,
        }

    def __str__(self) -> str:
        passes = f"{self.epochs} passes" + ("" if self.epochs_are_ours else " (a guess)")
        known = 0 if self.validation is None else self.validation.examples
        cost = "no price of its training is known (--prices FILE, training = ...)"
        if self.money is not None and self.price is not None:
            cost = f"about {self.money:.2f} {self.price.currency}"
        return (
            f"{self.train.examples} examples for training, {known} for validation; about "
            f"{self.train.tokens} tokens a pass, {passes}, {self.tokens} tokens in all; {cost}"
        )


def usual_passes(examples: int) -> int:
    """What a server chooses by itself, as OpenAI's cookbook estimates it.

    https://cookbook.openai.com/examples/chat_finetuning_data_prep
    """
    if examples * _USUAL_PASSES < _LEAST_SEEN:
        return min(_MOST_PASSES, _LEAST_SEEN // examples)
    if examples * _USUAL_PASSES > _MOST_SEEN:
        return max(1, _MOST_SEEN // examples)
    return _USUAL_PASSES
