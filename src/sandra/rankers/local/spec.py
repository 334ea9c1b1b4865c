"""`gguf:PATH` and `hf:PATH[+ADAPTER]`: from a text to a ranker with a model in this process."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

from sandra.rankers.chat import ChatRanker
from sandra.rankers.local.folder import folder
from sandra.rankers.local.generate import Generating
from sandra.rankers.local.llama import llama
from sandra.rankers.local.score import CALIBRATIONS, ScoreRanker
from sandra.rankers.spec import at_least, number, one_of, split
from sandra.rankers.types import Ranker

GGUF: dict[str, Callable[[str], Any]] = {
    "threads": at_least(1),
    "context": at_least(256),
    "temperature": number,
    "seed": at_least(0),
}
"""What may follow the path of a GGUF file, as in `gguf:model.gguf#threads=4&context=4096`."""
HF: dict[str, Callable[[str], Any]] = {
    "mode": one_of("generate", "score"),
    "calibrate": one_of(*CALIBRATIONS),
    "device": str,
    "temperature": number,
    "seed": at_least(0),
}
"""What may follow the path of a folder, as in `hf:my-model#mode=score&device=cpu`."""
LOCAL = ("gguf", "hf")


def local_ranker(
    kind: str, text: str, *, deadline: float, **sampling: float | int | None
) -> Ranker:
    """A ranker whose model runs in this process.

    Args:
        kind, text: of the spec `kind:text`.
        deadline: for one ranking if no other is given [s]; loading the model does not count.
        sampling: `temperature` and `seed`, where the spec names none.

    Raises:
        RankerError: an unknown option, a missing package, or a model that cannot be loaded.
    """
    name = f"{kind}:{text.strip()}"
    path, options = split(kind, text, GGUF if kind == "gguf" else HF)
    given: dict[str, Any] = {k: v for k, v in sampling.items() if v is not None}
    given |= {key: options.pop(key) for key in ("temperature", "seed") if key in options}
    if kind == "gguf":
        endpoint = llama(path, **options).asking(given)
        return ChatRanker(path, deadline=deadline, endpoint=endpoint, name=name)
    mode, calibrate = options.pop("mode", "generate"), options.pop("calibrate", None)
    where, adapter = folders(path)
    model = folder(where, adapter, **options)
    if mode == "score":
        # An adapter was trained for this task: it is taken at its word.
        usual = "neutral" if adapter is None else "length"
        return ScoreRanker(name, model, deadline, calibrate or usual)
    return ChatRanker(path, deadline=deadline, endpoint=Generating(model, **given), name=name)


def folders(text: str) -> tuple[Path, Path | None]:
    """The folders in `MODEL`, or in `MODEL+ADAPTER` where no folder has the whole name."""
    whole = Path(text).expanduser()
    model, plus, adapter = text.rpartition("+")
    if not plus or whole.is_dir():
        return whole.resolve(), None
    return Path(model).expanduser().resolve(), Path(adapter).expanduser().resolve()
