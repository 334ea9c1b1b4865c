"""A new model of the Qwen3 architecture, small, with weights by chance."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from sandra.errors import SettingsError
from sandra.rankers.local.packages import package

HEAD = 32
"""Size of an attention head."""
CONTEXT = 4096
"""Tokens of the longest text."""


@dataclass(frozen=True, slots=True)
class Shape:
    """Of a model: `width` of its stream (a multiple of 32), `layers`, `inner` width of a layer's
    feed-forward part, heads of keys and values, pieces of its tokenizer.

    Raises:
        SettingsError: a value out of range.
    """

    width: int = 192
    layers: int = 4
    inner: int = 512
    kv_heads: int = 2
    vocabulary: int = 2048

    def __post_init__(self) -> None:
        if self.width < HEAD or self.width % HEAD or (self.width // HEAD) % self.kv_heads:
            raise SettingsError(
                f"width = {self.width}: a multiple of {HEAD * self.kv_heads}, heads are {HEAD} wide"
            )
        if self.layers < 1 or self.inner < 1 or self.kv_heads < 1 or self.vocabulary < 300:
            raise SettingsError("layers and inner at least 1, vocabulary at least 300")

    def to_dict(self) -> dict[str, Any]:
        return asdict(self)


def new_model(shape: Shape, tokenizer: Any, seed: int) -> Any:
    """A `Qwen3ForCausalLM`; the same seed gives the same weights."""
    torch, transformers = package("torch"), package("transformers")
    torch.manual_seed(seed)
    config = transformers.Qwen3Config(
        vocab_size=len(tokenizer),
        hidden_size=shape.width,
        intermediate_size=shape.inner,
        num_hidden_layers=shape.layers,
        num_attention_heads=shape.width // HEAD,
        num_key_value_heads=shape.kv_heads,
        head_dim=HEAD,
        max_position_embeddings=CONTEXT,
        tie_word_embeddings=True,
        bos_token_id=None,
        eos_token_id=tokenizer.eos_token_id,
        pad_token_id=tokenizer.pad_token_id,
    )
    return transformers.Qwen3ForCausalLM(config)


def old_model(folder: Path) -> tuple[Any, Any]:
    """Tokenizer and model of a folder, in 32-bit floats."""
    torch, transformers = package("torch"), package("transformers")
    tokenizer = transformers.AutoTokenizer.from_pretrained(folder, local_files_only=True)
    model = transformers.AutoModelForCausalLM.from_pretrained(
        folder, dtype=torch.float32, local_files_only=True
    )
    return tokenizer, model
