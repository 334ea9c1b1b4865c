"""A forward pass of the Qwen3 architecture in NumPy (Qwen3 Technical Report, 2025, Sec. 2).

A layer is x + attention(norm(x)), then x + mlp(norm(x)); norms are of the root mean square
(RMSNorm), positions are rotations of queries and keys (RoPE), several query heads share one head of
keys and values (GQA), and queries and keys are normalised head by head (QK-Norm). The feed-forward
part is down(silu(gate(x)) * up(x)). Input and output share one embedding.

Nothing is changed by reading: what was read is a value (`Memory`) that is handed on.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sandra.errors import RankerError

Array = NDArray[np.float32]


@dataclass(frozen=True, slots=True, eq=False)
class Layer:
    """Weights, as (out, in) matrices and as (n,) scales."""

    before: Array
    q: Array
    k: Array
    v: Array
    o: Array
    q_scale: Array
    k_scale: Array
    between: Array
    gate: Array
    up: Array
    down: Array


@dataclass(frozen=True, slots=True, eq=False)
class Memory:
    """Keys and values of what was read: for each layer (rows, heads, tokens, width of a head)."""

    keys: tuple[Array, ...] = ()
    values: tuple[Array, ...] = ()

    @property
    def length(self) -> int:
        """Tokens."""
        return self.keys[0].shape[2] if self.keys else 0


@dataclass(frozen=True, slots=True, eq=False)
class Qwen3:
    """Weights and shape; usable from several threads."""

    embedding: Array
    """(vocabulary, width)"""
    layers: tuple[Layer, ...]
    norm: Array
    heads: int
    kv_heads: int
    head: int
    """Width of a head."""
    theta: float
    epsilon: float

    @staticmethod
    def load(folder: Path) -> Qwen3:
        """Of a Hugging Face folder: `config.json` and `model.safetensors`.

        Raises:
            RankerError: a file that cannot be read, or another architecture.
        """
        from safetensors import SafetensorError
        from safetensors.numpy import load_file

        try:
            config = json.loads((folder / "config.json").read_text(encoding="utf-8"))
            tensors = load_file(folder / "model.safetensors")
            return _of(config, {name: t.astype(np.float32) for name, t in tensors.items()})
        except (OSError, ValueError, KeyError, SafetensorError) as error:
            words = f"{type(error).__name__}: {error}".splitlines()[0][:300]
            raise RankerError(f"{folder} holds no model that can be read ({words})") from None

    def read(self, tokens: NDArray[np.int64], memory: Memory) -> tuple[Array, Memory]:
        """Read on.

        Args:
            tokens: (rows, n), each row a continuation of what was read.
            memory: of what was read, in one row or as many.

        Returns:
            (rows, n, width) what the model has made of each token, for `logits`; and the memory.
        """
        rows, n = tokens.shape
        x = self.embedding[tokens]
        turn = self._turns(memory.length, n)
        # (n, all): a token looks at those before it and at itself.
        seen = np.tril(np.ones((n, memory.length + n), dtype=bool), memory.length)
        keys, values = [], []
        for i, layer in enumerate(self.layers):
            y = self._norm(x, layer.before)
            q = _turned(self._norm(_split(y @ layer.q.T, self.heads), layer.q_scale), turn)
            k = _turned(self._norm(_split(y @ layer.k.T, self.kv_heads), layer.k_scale), turn)
            v = _split(y @ layer.v.T, self.kv_heads)
            if memory.keys:
                k = np.concatenate([_rows(memory.keys[i], rows), k], axis=2)
                v = np.concatenate([_rows(memory.values[i], rows), v], axis=2)
            x = x + self._attend(q, k, v, seen) @ layer.o.T
            y = self._norm(x, layer.between)
            gate = y @ layer.gate.T
            x = x + (gate / (1.0 + np.exp(-gate)) * (y @ layer.up.T)) @ layer.down.T
            keys.append(k)
            values.append(v)
        return x, Memory(tuple(keys), tuple(values))

    def logits(self, x: Array) -> NDArray[np.float64]:
        """(..., width) of `read` to (..., vocabulary)."""
        found: NDArray[np.float64] = (self._norm(x, self.norm) @ self.embedding.T).astype(float)
        return found

    def _norm(self, x: Array, scale: Array) -> Array:
        mean = np.mean(x * x, axis=-1, keepdims=True)
        found: Array = x / np.sqrt(mean + np.float32(self.epsilon)) * scale
        return found

    def _turns(self, first: int, n: int) -> tuple[Array, Array]:
        """(n, head / 2) cosine and sine of the angles at positions from `first` on."""
        powers = np.arange(0, self.head, 2) / self.head
        angles = np.arange(first, first + n)[:, None] * self.theta**-powers
        return np.cos(angles).astype(np.float32), np.sin(angles).astype(np.float32)

    def _attend(self, q: Array, k: Array, v: Array, seen: NDArray[np.bool_]) -> Array:
        """(rows, n, heads * head)"""
        rows, heads, n, width = q.shape
        q = q.reshape(rows, self.kv_heads, heads // self.kv_heads * n, width)
        scores = q @ k.swapaxes(2, 3) / np.float32(np.sqrt(width))
        scores = scores.reshape(rows, heads, n, -1)
        scores = np.where(seen, scores, np.float32(-np.inf))
        weights = np.exp(scores - scores.max(axis=-1, keepdims=True))
        weights /= weights.sum(axis=-1, keepdims=True)
        mixed = weights.reshape(rows, self.kv_heads, heads // self.kv_heads * n, -1) @ v
        found: Array = mixed.reshape(rows, heads, n, width).swapaxes(1, 2).reshape(rows, n, -1)
        return found


def _of(config: Mapping[str, Any], tensors: Mapping[str, Array]) -> Qwen3:
    if config["model_type"] != "qwen3" or not config["tie_word_embeddings"]:
        raise ValueError(f"a '{config['model_type']}' model: only qwen3 with tied embeddings")

    def layer(i: int) -> Layer:
        def of(name: str) -> Array:
            return tensors[f"model.layers.{i}.{name}.weight"]

        return Layer(
            before=of("input_layernorm"),
            q=of("self_attn.q_proj"),
            k=of("self_attn.k_proj"),
            v=of("self_attn.v_proj"),
            o=of("self_attn.o_proj"),
            q_scale=of("self_attn.q_norm"),
            k_scale=of("self_attn.k_norm"),
            between=of("post_attention_layernorm"),
            gate=of("mlp.gate_proj"),
            up=of("mlp.up_proj"),
            down=of("mlp.down_proj"),
        )

    return Qwen3(
        embedding=tensors["model.embed_tokens.weight"],
        layers=tuple(layer(i) for i in range(config["num_hidden_layers"])),
        norm=tensors["model.norm.weight"],
        heads=config["num_attention_heads"],
        kv_heads=config["num_key_value_heads"],
        head=config["head_dim"],
        theta=float((config.get("rope_parameters") or config)["rope_theta"]),
        epsilon=float(config["rms_norm_eps"]),
    )


def _split(x: Array, heads: int) -> Array:
    """(rows, n, heads * head) to (rows, heads, n, head)."""
    return x.reshape(*x.shape[:2], heads, -1).swapaxes(1, 2)


def _turned(x: Array, turn: tuple[Array, Array]) -> Array:
    """Each half of a head is a coordinate of the pairs that are rotated."""
    cos, sin = turn
    a, b = np.split(x, 2, axis=-1)
    return np.concatenate([a * cos - b * sin, b * cos + a * sin], axis=-1)


def _rows(x: Array, rows: int) -> Array:
    return np.broadcast_to(x, (rows, *x.shape[1:]))
