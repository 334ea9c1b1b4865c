"""LoRA (Hu et al., ICLR 2022): a small adapter is trained beside a model that stays as it is.

By PEFT and TRL's `SFTTrainer`. The rows are turned into tokens here, exactly as a ranker in this
process reads and writes them (`sandra.learn.tuning.examples`); the loss counts tokens of the answer
alone.

    OUT/adapter_model.safetensors, adapter_config.json   for `hf:MODEL+OUT`
    OUT/recipe.json   what is asked for; a run is only gone on with under the same recipe
    OUT/checkpoints/  of the trainer: an interrupted run goes on at the last whole one
"""

from __future__ import annotations

import hashlib
import json
import math
import time
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from sandra.errors import SandraError, SettingsError
from sandra.learn.rows import Row
from sandra.learn.tuning.checkpoints import last_checkpoint
from sandra.learn.tuning.curve import Curve
from sandra.learn.tuning.examples import Example, example
from sandra.rankers.local.folder import Folder
from sandra.rankers.local.packages import package

Progress = Callable[[int, int, str], None]
LOSSES = ("answer", "label")
"""What counts: all tokens of the answer, or those of its first pair, which a recording tells."""
RECIPE, CHECKPOINTS, ADAPTER = "recipe.json", "checkpoints", "adapter_model.safetensors"
_IGNORED = -100
_EVERY = 20
"""So many checkpoints of a run, roughly; at least `_LEAST` steps apart."""
_LEAST = 10
_LOOKS = 5
"""So often the loss on validation is measured, roughly."""


@dataclass(frozen=True, slots=True)
class Recipe:
    """All that an adapter depends on, beside model, data and the versions of packages.

    Args:
        rank, alpha: of the adapter: what is added to a weight is B A alpha / rank.
        rate: of learning, at its highest; it falls to 0 as a cosine, after a warm-up of 3 %.
        epochs: passes over the rows. batch: rows of a step; at_once: so many of them are in
            memory at once, None for all. max_length: rows of more tokens are left out.
        loss: one of `LOSSES`.

    Raises:
        SettingsError: a value out of range.
    """

    rank: int = 16
    alpha: float = 32.0
    dropout: float = 0.0
    rate: float = 5e-4
    epochs: float = 3.0
    batch: int = 8
    at_once: int | None = None
    max_length: int = 4096
    loss: str = "answer"
    seed: int = 0

    def __post_init__(self) -> None:
        for name in ("rank", "alpha", "rate", "epochs", "batch", "max_length"):
            value = getattr(self, name)
            if not 0.0 < value < math.inf:
                raise SettingsError(f"{name} = {value}: must be greater than 0")
        if not 0.0 <= self.dropout < 1.0 or self.seed < 0:
            raise SettingsError(f"dropout = {self.dropout}, seed = {self.seed}: [0, 1), at least 0")
        if self.at_once is not None and (self.at_once < 1 or self.batch % self.at_once):
            raise SettingsError(f"at_once = {self.at_once}: must divide batch = {self.batch}")
        if self.loss not in LOSSES:
            raise SettingsError(f"loss '{self.loss}' is unknown; known are {', '.join(LOSSES)}")


@dataclass(frozen=True, slots=True)
class Tuned:
    """What came out: the adapter in `folder`, and how its loss went."""

    folder: Path
    model: Path
    curve: Curve
    examples: int
    validation: int
    too_long: int
    """Rows left out for their length."""
    trainable: int
    """Parameters of the adapter."""
    parameters: int
    """Of the model."""
    steps: int
    seconds: float
    """Of training, since it was last gone on with."""
    device: str

    @property
    def ranker(self) -> str:
        """How to rank with it."""
        return f"hf:{self.model}+{self.folder}"


def tune(
    model: Path,
    train: Sequence[Row],
    validation: Sequence[Row],
    data: dict[str, str],
    out: Path,
    recipe: Recipe,
    *,
    device: str | None = None,
    progress: Progress = lambda done, total, words: None,
) -> Tuned:
    """Train an adapter for the model in a folder.

    Args:
        data: SHA-256 of the files that the rows are from, by name.
        device: "cpu", "cuda", ...; default: a GPU if there is one, then in 16 bits (bf16).
        progress: is told (steps done, all steps, the loss).

    Raises:
        SandraError: a missing package, a folder of another recipe or without a model, no row that
            is short enough.
    """
    for name in ("torch", "transformers", "peft", "datasets", "trl"):
        package(name)
    _begin(out, {"recipe": asdict(recipe), "data": data, "model": fingerprint(model)})
    with _quiet():
        folder = Folder(model, device=device)
        examples, too_long = fitting(train, folder.tokenizer, recipe)
        held, _ = fitting(validation, folder.tokenizer, recipe)
        if not examples:
            raise SandraError(
                f"all {too_long} rows have more than {recipe.max_length} tokens; raise --max-length"
            )
        trainer = _trainer(folder, examples, held, out, recipe, progress)
        begin = time.monotonic()
        trainer.train(resume_from_checkpoint=last_checkpoint(out / CHECKPOINTS))
        seconds = time.monotonic() - begin
        trainer.model.save_pretrained(out)
    # PEFT writes one that is a form to be filled in; ours is card.md.
    (out / "README.md").unlink(missing_ok=True)
    sizes = [(p.numel(), p.requires_grad) for p in trainer.model.parameters()]
    return Tuned(
        folder=out,
        model=model,
        curve=Curve.of(trainer.state.log_history),
        examples=len(examples),
        validation=len(held),
        too_long=too_long,
        trainable=sum(n for n, trained in sizes if trained),
        parameters=sum(n for n, trained in sizes if not trained),
        steps=trainer.state.global_step,
        seconds=seconds,
        device=folder.device,
    )


def fingerprint(model: Path) -> str:
    """SHA-256 over configuration, tokenizer and weights of a folder.

    Raises:
        SandraError: if it holds no model, or cannot be read.
    """
    found = hashlib.sha256()
    if not (model / "config.json").is_file():
        raise SandraError(f"{model} is no folder with a file config.json; name a model in a folder")
    names = ("config.json", "tokenizer.json", "chat_template.jinja")
    try:
        for file in [*(model / name for name in names), *sorted(model.glob("*.safetensors"))]:
            if file.is_file():
                with file.open("rb") as content:
                    found.update(hashlib.file_digest(content, "sha256").digest())
    except OSError as error:
        raise SandraError(f"{model}: cannot be read ({error.strerror})") from None
    return found.hexdigest()


def _begin(out: Path, wanted: dict[str, Any]) -> None:
    """Make the folder, or see that it is of the same run, and not over."""
    file = out / RECIPE
    wanted = json.loads(json.dumps(wanted))
    try:
        if not file.exists():
            out.mkdir(parents=True, exist_ok=True)
            if any(out.iterdir()):
                raise SandraError(f"{out}: is not empty, and no run of ours; choose another --out")
            file.write_text(json.dumps(wanted, indent=1) + "\n", encoding="utf-8")
            return
        known = json.loads(file.read_text(encoding="utf-8"))
        flat = [{**{k: v for k, v in w.items() if k != "recipe"}, **w["recipe"]}
                for w in (known, wanted)]  # fmt: skip
    except OSError as error:
        raise SandraError(
            f"{out}: cannot be written ({error.strerror}); choose another --out"
        ) from None
    except (ValueError, KeyError, TypeError, AttributeError):
        raise SandraError(f"{file}: is no recipe of ours; choose another --out") from None
    differs = [name for name in flat[1] if flat[0].get(name) != flat[1][name]]
    if differs:
        raise SandraError(
            f"{out}: holds a run that differs in {', '.join(differs)}; choose another --out"
        )


def fitting(rows: Sequence[Row], tokenizer: Any, recipe: Recipe) -> tuple[list[Example], int]:
    """Those that are short enough, and how many are not: a cut prompt is another prompt."""
    found = [example(row, tokenizer) for row in rows]
    short = [each for each in found if len(each.tokens) <= recipe.max_length]
    return short, len(found) - len(short)


def columns(examples: Sequence[Example], loss: str) -> dict[str, list[list[int]]]:
    """As TRL takes tokens: what is read, and what is to be said."""
    labels = []
    for each in examples:
        end = len(each.tokens) if loss == "answer" else each.chosen
        before, after = [_IGNORED] * each.answer, [_IGNORED] * (len(each.tokens) - end)
        labels.append([*before, *each.tokens[each.answer : end], *after])
    return {"input_ids": [list(each.tokens) for each in examples], "labels": labels}


def _trainer(
    folder: Folder,
    examples: Sequence[Example],
    held: Sequence[Example],
    out: Path,
    recipe: Recipe,
    progress: Progress,
) -> Any:
    trl, peft, datasets = package("trl"), package("peft"), package("datasets")
    transformers = package("transformers")
    on_gpu = folder.device.startswith("cuda")
    at_once = recipe.at_once or recipe.batch
    steps = math.ceil(math.ceil(len(examples) / recipe.batch) * recipe.epochs)
    every = max(_LEAST, steps // _EVERY)
    settings = trl.SFTConfig(
        output_dir=str(out / CHECKPOINTS),
        num_train_epochs=recipe.epochs,
        per_device_train_batch_size=at_once,
        per_device_eval_batch_size=at_once,
        gradient_accumulation_steps=recipe.batch // at_once,
        learning_rate=recipe.rate,
        lr_scheduler_type="cosine",
        warmup_steps=max(1, round(0.03 * steps)),
        max_length=None,
        seed=recipe.seed,
        data_seed=recipe.seed,
        logging_steps=1,
        eval_strategy="steps" if held else "no",
        eval_steps=max(1, steps // _LOOKS),
        save_strategy="steps",
        save_steps=every,
        save_total_limit=2,
        bf16=on_gpu,
        use_cpu=folder.device == "cpu",
        gradient_checkpointing=on_gpu,
        report_to="none",
        disable_tqdm=True,
        dataloader_pin_memory=on_gpu,
    )
    adapter = peft.LoraConfig(
        r=recipe.rank,
        lora_alpha=recipe.alpha,
        lora_dropout=recipe.dropout,
        target_modules="all-linear",
        task_type="CAUSAL_LM",
    )
    folder.torch.manual_seed(recipe.seed)
    trainer = trl.SFTTrainer(
        model=folder.model,
        args=settings,
        train_dataset=datasets.Dataset.from_dict(columns(examples, recipe.loss)),
        eval_dataset=datasets.Dataset.from_dict(columns(held, recipe.loss)) if held else None,
        processing_class=folder.tokenizer,
        peft_config=adapter,
    )
    trainer.remove_callback(transformers.PrinterCallback)

    class Told(transformers.TrainerCallback):  # type: ignore[misc, name-defined, unused-ignore]
        def on_log(self, args: Any, state: Any, control: Any, logs: Any, **rest: Any) -> None:
            if "loss" in logs:
                progress(state.global_step, state.max_steps, f"loss {float(logs['loss']):.4f}")

    trainer.add_callback(Told())
    return trainer


@contextmanager
def _quiet() -> Iterator[None]:
    """The libraries warn of each other, and tell a lot."""
    logging = package("transformers").utils.logging
    datasets = package("datasets")
    level = logging.get_verbosity()
    logging.set_verbosity_error()
    datasets.disable_progress_bars()
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            yield
    finally:
        logging.set_verbosity(level)
