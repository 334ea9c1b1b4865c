"""A Hugging Face folder of a Qwen3 model, written as one GGUF file for llama.cpp; adapters merged.

Only this architecture, unquantised: enough for what is trained here. For other models llama.cpp
has a converter of its own.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from sandra.errors import RankerError
from sandra.rankers.local.folder import Folder
from sandra.rankers.local.packages import package

ARCHITECTURE = "qwen3"
_NORMAL, _CONTROL, _USER = 1, 3, 4
"""Kinds of tokens in a GGUF file: text, never text (`<|im_end|>`), text that is never split."""


def to_gguf(folder: str | Path, path: str | Path) -> Path:
    """Write the model in `folder` to the file `path`, in 32-bit floats; returns `path`.

    The tokenizer must be a byte-level BPE that splits texts as Qwen's does, or as SuperBPE's, which
    `sandra finetune scratch` makes. The chat template goes along.

    Raises:
        RankerError: no such folder, another architecture, or a package that is not installed.
    """
    folder, path = Path(folder), Path(path)
    try:
        config = json.loads((folder / "config.json").read_text(encoding="utf-8"))
        tokenizer = json.loads((folder / "tokenizer.json").read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise RankerError(f"{folder} holds no model that can be read ({error})") from None
    if config.get("model_type") != ARCHITECTURE or tokenizer["model"]["type"] != "BPE":
        raise RankerError(
            f"{folder} is a '{config.get('model_type')}' model: only {ARCHITECTURE} with a BPE "
            f"tokenizer is written; for others use llama.cpp's convert_hf_to_gguf.py"
        )
    gguf = package("gguf")
    writer = gguf.GGUFWriter(path, ARCHITECTURE)
    _add_shape(writer, config)
    _add_tokens(writer, config, tokenizer, folder)
    _add_tensors(writer, gguf, config, folder)
    writer.write_header_to_file()
    writer.write_kv_data_to_file()
    writer.write_tensors_to_file()
    writer.close()
    return path


def merge(model: str | Path, adapter: str | Path, folder: str | Path) -> Path:
    """Write a model with an adapter added to its weights, as a folder of its own; returns it.

    Raises:
        RankerError: a missing package, or a folder that cannot be loaded or written.
    """
    folder = Path(folder)
    both = Folder(Path(model).expanduser(), Path(adapter).expanduser(), "cpu")
    try:
        both.model.save_pretrained(folder)
        both.tokenizer.save_pretrained(folder)
    except OSError as error:
        raise RankerError(
            f"{folder}: cannot be written ({error.strerror}); choose another place"
        ) from None
    return folder


def _add_shape(writer: Any, config: dict[str, Any]) -> None:
    rope = config.get("rope_parameters") or config
    heads = config["num_attention_heads"]
    head_dim = config.get("head_dim") or config["hidden_size"] // heads
    writer.add_name("sandra")
    writer.add_block_count(config["num_hidden_layers"])
    writer.add_context_length(config["max_position_embeddings"])
    writer.add_embedding_length(config["hidden_size"])
    writer.add_feed_forward_length(config["intermediate_size"])
    writer.add_head_count(heads)
    writer.add_head_count_kv(config["num_key_value_heads"])
    writer.add_key_length(head_dim)
    writer.add_value_length(head_dim)
    writer.add_rope_freq_base(float(rope.get("rope_theta", 10000.0)))
    writer.add_layer_norm_rms_eps(float(config["rms_norm_eps"]))
    writer.add_file_type(0)  # all in 32-bit floats


def _add_tokens(
    writer: Any, config: dict[str, Any], tokenizer: dict[str, Any], folder: Path
) -> None:
    added = {t["id"]: t for t in tokenizer["added_tokens"]}
    names = {number: text for text, number in tokenizer["model"]["vocab"].items()}
    names |= {number: t["content"] for number, t in added.items()}
    texts, kinds = [], []
    for number in range(config["vocab_size"]):
        texts.append(names.get(number, f"[PAD{number}]"))
        special = added.get(number, {}).get("special", number not in names)
        kinds.append(_CONTROL if special else _USER if number in added else _NORMAL)
    merges = tokenizer["model"]["merges"]
    writer.add_tokenizer_model("gpt2")
    writer.add_tokenizer_pre("superbpe" if _spans_spaces(tokenizer) else "qwen2")
    writer.add_token_list(texts)
    writer.add_token_types(kinds)
    writer.add_token_merges([m if isinstance(m, str) else " ".join(m) for m in merges])
    writer.add_add_bos_token(False)
    for name, add in (
        ("eos_token_id", writer.add_eos_token_id),
        ("bos_token_id", writer.add_bos_token_id),
        ("pad_token_id", writer.add_pad_token_id),
    ):
        if isinstance(config.get(name), int):
            add(config[name])
    template = folder / "chat_template.jinja"
    if template.is_file():
        writer.add_chat_template(template.read_text(encoding="utf-8"))


def _spans_spaces(tokenizer: dict[str, Any]) -> bool:
    """Whether numbers are all that texts are split at: that is how llama.cpp splits "superbpe"."""
    steps = (tokenizer.get("pre_tokenizer") or {}).get("pretokenizers", ())
    return [step.get("pattern") for step in steps if step["type"] == "Split"] == [
        {"Regex": r"\p{N}+"},
        {"Regex": r"(?=(\d{3})+(?!\d))"},
    ]


def _add_tensors(writer: Any, gguf: Any, config: dict[str, Any], folder: Path) -> None:
    open_file, torch = package("safetensors").safe_open, package("torch")
    name_of = gguf.get_tensor_name_map(gguf.MODEL_ARCH.QWEN3, config["num_hidden_layers"]).get_name
    files = sorted(folder.glob("*.safetensors"))
    if not files:
        raise RankerError(f"{folder} holds no weights (*.safetensors)")
    for file in files:
        with open_file(file, "pt") as tensors:
            for name in tensors.keys():  # noqa: SIM118, it is no dict
                new = name_of(name, try_suffixes=(".weight", ".bias"))
                if new is None:
                    raise RankerError(f"{file}: no place for the weights '{name}' in a GGUF file")
                if name == "lm_head.weight" and config.get("tie_word_embeddings"):
                    continue
                writer.add_tensor(new, tensors.get_tensor(name).to(torch.float32).numpy())
