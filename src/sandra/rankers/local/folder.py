"""A Hugging Face folder in this process, and what its model has read already."""

from __future__ import annotations

import copy
import threading
import warnings
from collections.abc import Sequence
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sandra.errors import RankerError
from sandra.rankers.bounded import Deadline
from sandra.rankers.endpoint import Question
from sandra.rankers.local.packages import package
from sandra.rankers.local.question import messages_of
from sandra.rankers.local.turns import Turns

BATCH, BATCH_OF_GPU = 128, 1024
"""Tokens that are read at once; between two batches a question can be given up."""


class Folder:
    """Model and tokenizer of a folder, an adapter merged into it. Loaded once, used in turns.

    Only what lies in the folder is used: nothing is downloaded, no code of the folder is run.

    Args:
        path: a folder as `save_pretrained` writes it.
        adapter: a folder of PEFT, for instance LoRA weights.
        device: "cpu", "cuda", ...; default: a GPU if there is one.

    Raises:
        RankerError: no package, no such folder, or one that cannot be loaded.
    """

    def __init__(self, path: Path, adapter: Path | None = None, device: str | None = None) -> None:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # the libraries warn of each other
            self.torch = package("torch")
            self._transformers = package("transformers")
            self._transformers.utils.logging.disable_progress_bar()
            self.device = device or ("cuda" if self.torch.cuda.is_available() else "cpu")
            try:
                self.tokenizer, self.model = self._load(path, adapter)
            # AssertionError: how torch says that it was built without CUDA.
            except (OSError, ValueError, KeyError, RuntimeError, AssertionError) as error:
                words = f"{type(error).__name__}: {error}".splitlines()[0][:300]
                raise RankerError(f"hf: {path} cannot be loaded ({words})") from None
        if not self.tokenizer.chat_template or not self.tokenizer.is_fast:
            raise RankerError(f"hf: {path} needs a fast tokenizer with a chat template")
        self.batch = BATCH if self.device == "cpu" else BATCH_OF_GPU
        self.turns = Turns()
        self._memory = Memory(self)

    def _load(self, path: Path, adapter: Path | None) -> tuple[Any, Any]:
        # On a GPU as the folder says, mostly in 16 bits; most CPUs are slower with these.
        dtype = "auto" if self.device.startswith("cuda") else self.torch.float32
        tokenizer = self._transformers.AutoTokenizer.from_pretrained(path, local_files_only=True)
        model = self._transformers.AutoModelForCausalLM.from_pretrained(
            path, dtype=dtype, local_files_only=True
        )
        if adapter is not None:
            peft = package("peft")
            model = peft.PeftModel.from_pretrained(model, adapter).merge_and_unload()
        return tokenizer, model.to(self.device).eval()

    def new_cache(self) -> Any:
        """An empty memory of keys and values."""
        return self._transformers.DynamicCache(config=self.model.config)

    def text_of(self, messages: Sequence[dict[str, str]]) -> str:
        """The conversation as the model reads it, up to where its answer begins."""
        text: str = self.tokenizer.apply_chat_template(
            messages, tokenize=False, add_generation_prompt=True, enable_thinking=False
        )
        return text

    def tokens_of(self, text: str) -> list[int]:
        """The tokens of a text; nothing is put before or after it."""
        tokens: list[int] = self.tokenizer(text, add_special_tokens=False)["input_ids"]
        return tokens

    def tokens_of_question(self, question: Question) -> list[int]:
        """Those of a conversation, up to where the answer begins."""
        return self.tokens_of(self.text_of(messages_of(question)))

    def read(self, tokens: Sequence[int], deadline: Deadline) -> Memory | None:
        """The memory after these tokens; None if the deadline passed first. Needs the turn."""
        return self._memory if self._memory.read(tokens, deadline) else None

    def next_logits(self, memory: Memory) -> NDArray[np.float64]:
        """(vocabulary,) of the token that follows what was read."""
        logits: NDArray[np.float64] = memory.logits.cpu().numpy().astype(np.float64)
        return logits

    def branches(self, memory: Memory, rows: Sequence[Sequence[int]]) -> NDArray[np.float64]:
        """(rows, longest, vocabulary): logits after each token of each continuation."""
        cache = copy.deepcopy(memory.cache)
        cache.batch_repeat_interleave(len(rows))
        with self.torch.inference_mode():
            out = self.model(
                input_ids=self.torch.tensor(rows, device=self.device), cache=cache, use_cache=True
            )
        logits: NDArray[np.float64] = out.logits.float().cpu().numpy().astype(np.float64)
        return logits


class Memory:
    """What a model has read last: its keys and values, and the logits after the last token.

    A text that begins like the one before is read from where they part.
    """

    def __init__(self, folder: Folder) -> None:
        self._folder = folder
        self.tokens: list[int] = []
        self.cache: Any = folder.new_cache()
        self.logits: Any = None
        self.kept = 0
        """So many tokens of the last text had been read before it."""

    def read(self, tokens: Sequence[int], deadline: Deadline) -> bool:
        """Whether all was read before the deadline."""
        self._keep(_common(self.tokens, tokens[:-1]))
        self.kept = len(self.tokens)
        while len(self.tokens) < len(tokens):
            if self._folder.turns.over(deadline):
                return False
            self.feed(tokens[len(self.tokens) :][: self._folder.batch])
        return True

    def feed(self, tokens: Sequence[int]) -> None:
        """Read on."""
        torch = self._folder.torch
        known, self.tokens = self.tokens, []  # nothing is known if this breaks half-way
        with torch.inference_mode():
            out = self._folder.model(
                input_ids=torch.tensor([list(tokens)], device=self._folder.device),
                cache=self.cache,
                use_cache=True,
                logits_to_keep=1,
            )
        self.logits = out.logits[0, -1].float()
        self.tokens = [*known, *tokens]

    def _keep(self, length: int) -> None:
        """Forget what comes after the first `length` tokens, or all where that cannot be done."""
        if length == len(self.tokens) > 0:
            return
        if length and self.cache.is_croppable:
            self.cache.crop(length - len(self.tokens))
            self.tokens = self.tokens[:length]
        else:
            self.tokens, self.cache = [], self._folder.new_cache()


def _common(a: Sequence[int], b: Sequence[int]) -> int:
    """How many tokens at the beginning are the same."""
    for i, (x, y) in enumerate(zip(a, b, strict=False)):
        if x != y:
            return i
    return min(len(a), len(b))


@lru_cache(maxsize=2)
def _loaded(path: Path, adapter: Path | None, device: str | None, changed: float) -> Folder:
    return Folder(path, adapter, device)


_loading = threading.Lock()


def folder(path: Path, adapter: Path | None = None, device: str | None = None) -> Folder:
    """The model in a folder; the last two that were used stay loaded.

    Raises:
        RankerError: see `Folder`.
    """
    for part, needed in ((path, "config.json"), (adapter, "adapter_config.json")):
        if part is not None and not (part / needed).is_file():
            raise RankerError(f"hf: {part} is no folder with a file {needed}")
    files = [f for part in (path, adapter) if part is not None for f in part.iterdir()]
    changed = max(f.stat().st_mtime for f in files)
    with _loading:
        return _loaded(path, adapter, device, changed)
