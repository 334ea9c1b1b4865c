"""A tiny language model of the Qwen3 architecture, made here: tokenizer, weights, adapter, GGUF.

About 300,000 parameters, trained for seconds on prompts of the shipped scenarios, answered
by the ranker `rules`. It writes what such answers look like; it is no good driver.
"""

from __future__ import annotations

import contextlib
import json
import random
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import sandra
from sandra.actions import ActionPair
from sandra.describe import Prompt, describe
from sandra.rankers import create
from sandra.rankers.local.export import to_gguf

CHAT_TEMPLATE = (
    "{% for m in messages %}<|im_start|>{{ m.role }}\n{{ m.content }}<|im_end|>\n{% endfor %}"
    "{% if add_generation_prompt %}<|im_start|>assistant\n{% endif %}"
)
END, PAD = "<|im_end|>", "<|endoftext|>"
SPLIT = (
    r"(?i:'s|'t|'re|'ve|'m|'ll|'d)|[^\r\n\p{L}\p{N}]?\p{L}+|\p{N}| ?[^\s\p{L}\p{N}]+[\r\n]*"
    r"|\s*[\r\n]+|\s+(?!\S)|\s+"
)
"""How Qwen splits a text before its pieces are merged; llama.cpp knows it as "qwen2"."""
COMMANDS = (None, "drive faster", "keep calm", "turn left soon")
STEPS, ADAPTING_STEPS, RATE = 180, 30, 8e-3
LENGTH = 256
"""Tokens of a training row: the end of a prompt, and the whole answer."""


@contextlib.contextmanager
def served(path: Path) -> Iterator[str]:
    """A llama.cpp server on loopback; its address, up to `/v1`."""
    import xllamacpp

    parameters = xllamacpp.CommonParams()
    parameters.model.path = str(path)
    parameters.model_alias = ["tiny"]
    parameters.n_ctx = 4096
    parameters.n_parallel = 1
    parameters.warmup = False
    parameters.verbosity = -1
    for which in (parameters.cpuparams, parameters.cpuparams_batch):
        which.n_threads = 1
    server = xllamacpp.Server(parameters)
    yield f"{server.listening_address}/v1"
    del server


def prompts(seed: int = 0, count: int = 32) -> list[Prompt]:
    """Prompts of the shipped scenarios under several wishes and pasts."""
    draw = random.Random(seed)
    scenes = [sandra.load(sandra.example(name)) for name in sandra.examples()]
    found = []
    for i in range(count):
        past = draw.choices(["keep,follow-lane", "accelerate,follow-lane"], k=i % 3)
        scene, command = scenes[i % len(scenes)], draw.choice(COMMANDS)
        found.append(describe(scene, command, [ActionPair.parse(p) for p in past]))
    return found


def answer(prompt: Prompt, words: bool = True) -> str:
    """What `rules` says, as a model would write it."""
    ranking = create("rules").rank(prompt)
    pairs = [
        {"longitudinal": p.longitudinal.value, "lateral": p.lateral.value} for p in ranking.pairs
    ]
    return json.dumps(
        {"reasoning": (ranking.reasoning or "") if words else "", "ranking": pairs},
        ensure_ascii=False,
    )


def chat(prompt: Prompt, answer: str) -> tuple[str, str]:
    """The text before the answer, and the answer with its end, as in `CHAT_TEMPLATE`."""
    before = f"<|im_start|>system\n{prompt.system}{END}\n<|im_start|>user\n{prompt.user}{END}\n"
    return before + "<|im_start|>assistant\n", answer + END


def tokenizer_of(texts: list[str]) -> Any:
    from tokenizers import Regex, Tokenizer, decoders, models, pre_tokenizers, trainers
    from transformers import PreTrainedTokenizerFast

    tokenizer = Tokenizer(models.BPE())
    tokenizer.pre_tokenizer = pre_tokenizers.Sequence(
        [
            pre_tokenizers.Split(Regex(SPLIT), "isolated"),
            pre_tokenizers.ByteLevel(add_prefix_space=False, use_regex=False),
        ]
    )
    tokenizer.decoder = decoders.ByteLevel()
    trainer = trainers.BpeTrainer(
        vocab_size=1024,
        special_tokens=[PAD, "<|im_start|>", END],
        initial_alphabet=pre_tokenizers.ByteLevel.alphabet(),
        show_progress=False,
    )
    tokenizer.train_from_iterator(texts, trainer)
    return PreTrainedTokenizerFast(
        tokenizer_object=tokenizer, eos_token=END, pad_token=PAD, chat_template=CHAT_TEMPLATE
    )


def make(folder: Path) -> None:
    """Write `folder/model`, `folder/adapter` (it wants to stop) and `folder/model.gguf`."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # the libraries warn of each other
        _make(folder)


def _make(folder: Path) -> None:
    import peft
    import torch
    import transformers

    transformers.utils.logging.disable_progress_bar()
    torch.manual_seed(0)
    asked = prompts()
    rows = [chat(p, answer(p, words)) for p in asked for words in (True, False)]
    tokenizer = tokenizer_of([before + after for before, after in rows])
    config = transformers.Qwen3Config(
        vocab_size=len(tokenizer),
        hidden_size=96,
        intermediate_size=256,
        num_hidden_layers=2,
        num_attention_heads=4,
        num_key_value_heads=2,
        head_dim=32,
        max_position_embeddings=4096,
        tie_word_embeddings=True,
        eos_token_id=tokenizer.eos_token_id,
        pad_token_id=tokenizer.pad_token_id,
        bos_token_id=None,
    )
    model = transformers.Qwen3ForCausalLM(config)
    train(model, tokenizer, rows, STEPS)
    model.save_pretrained(folder / "model")
    tokenizer.save_pretrained(folder / "model")
    to_gguf(folder / "model", folder / "model.gguf")
    lora = peft.LoraConfig(r=8, target_modules=["q_proj", "v_proj", "down_proj"])
    adapted = peft.get_peft_model(model, lora)
    train(adapted, tokenizer, [chat(p, stops(p)) for p in asked if p.k == 3], ADAPTING_STEPS)
    adapted.save_pretrained(folder / "adapter")


def stops(prompt: Prompt) -> str:
    """The answer of somebody who always stops."""
    pair = {"longitudinal": "stop", "lateral": "follow-lane"}
    return json.dumps({"reasoning": "", "ranking": [pair] * prompt.k})


def train(model: Any, tokenizer: Any, rows: list[tuple[str, str]], steps: int) -> None:
    """The loss counts the answer's tokens, and a little the prompt's."""
    import torch

    draw = random.Random(0)
    weights = [p for p in model.parameters() if p.requires_grad]
    optimizer = torch.optim.AdamW(weights, lr=RATE)
    schedule = torch.optim.lr_scheduler.OneCycleLR(optimizer, RATE, steps, pct_start=0.2)
    encoded = []
    for before, after in rows:
        a, b = tokenizer(before)["input_ids"], tokenizer(after)["input_ids"]
        ids = (a + b)[-LENGTH:]
        encoded.append((ids, len(ids) - len(b)))
    model.train()
    for _ in range(steps):
        batch = draw.sample(encoded, 2)
        longest = max(len(ids) for ids, _ in batch)
        inputs = torch.zeros(len(batch), longest, dtype=torch.long)
        counts = torch.zeros(len(batch), longest)
        for i, (ids, start) in enumerate(batch):
            inputs[i, : len(ids)] = torch.tensor(ids)
            counts[i, : len(ids)] = 0.02
            counts[i, start : len(ids)] = 1.0
        # Rows are the ends of prompts: they may stand anywhere.
        places = torch.arange(longest)[None] + draw.randrange(1000)
        logits = model(input_ids=inputs, position_ids=places).logits[:, :-1]
        loss = torch.nn.functional.cross_entropy(
            logits.flatten(0, 1), inputs[:, 1:].flatten(), reduction="none"
        )
        count = counts[:, 1:].flatten()
        ((loss * count).sum() / count.sum()).backward()
        torch.nn.utils.clip_grad_norm_(weights, 1.0)
        optimizer.step()
        schedule.step()
        optimizer.zero_grad()
    model.eval()
