"""A tokenizer of our own for our prompts: byte-level BPE whose merges may span spaces.

The sentences of a prompt are few and always the same, so that a piece may be a whole phrase, and a
prompt of 900 tokens of a general tokenizer is a third of that. Numbers are split from the words
around them, three digits at most in a piece. Texts are split as by SuperBPE (Liu et al., COLM
2025), which llama.cpp knows. The words of actions are pieces of their own wherever they stand.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from typing import Any

from sandra.actions import Lateral, Longitudinal
from sandra.rankers.local.packages import package

END, PAD, START = "<|im_end|>", "<|endoftext|>", "<|im_start|>"
SPECIAL = (PAD, START, END)
ACTIONS = tuple(action.value for kind in (Longitudinal, Lateral) for action in kind)
NUMBERS, THREES = r"\p{N}+", r"(?=(\d{3})+(?!\d))"
"""Texts are split at both, as llama.cpp does for "superbpe"."""
LONGEST = 160
"""Characters of a piece, at most."""
CHAT_TEMPLATE = (
    "{% for m in messages %}<|im_start|>{{ m.role }}\n{{ m.content }}<|im_end|>\n{% endfor %}"
    "{% if add_generation_prompt %}<|im_start|>assistant\n{% endif %}"
)
"""As of Qwen3 where thinking is switched off, but for the empty block of thoughts."""


def tokenizer_of(texts: Iterable[str], size: int) -> Any:
    """A `PreTrainedTokenizerFast` of at most `size` pieces that reads `texts` in few of them.

    Args:
        texts: prompts and answers as in `CHAT_TEMPLATE`; may be read once only.
        size: at least 300: every byte is a piece.
    """
    tokenizers, transformers = package("tokenizers"), package("transformers")
    found = tokenizers.Tokenizer(tokenizers.models.BPE())
    split = tokenizers.pre_tokenizers.Split
    found.pre_tokenizer = tokenizers.pre_tokenizers.Sequence(
        [
            split(tokenizers.Regex(NUMBERS), "isolated"),
            split(tokenizers.Regex(THREES), "isolated"),
            tokenizers.pre_tokenizers.ByteLevel(add_prefix_space=False, use_regex=False),
        ]
    )
    found.decoder = tokenizers.decoders.ByteLevel()
    trainer = tokenizers.trainers.BpeTrainer(
        vocab_size=size - len(ACTIONS),
        special_tokens=list(SPECIAL),
        initial_alphabet=sorted(tokenizers.pre_tokenizers.ByteLevel.alphabet()),
        max_token_length=LONGEST,
        show_progress=False,
    )
    found.train_from_iterator(_between(texts), trainer)
    found.add_tokens([tokenizers.AddedToken(word, normalized=False) for word in ACTIONS])
    return transformers.PreTrainedTokenizerFast(
        tokenizer_object=found, eos_token=END, pad_token=PAD, chat_template=CHAT_TEMPLATE
    )


def _between(texts: Iterable[str]) -> Iterator[str]:
    """What stands between pieces that no merge may reach over."""
    cut = re.compile("|".join(map(re.escape, (*SPECIAL, *ACTIONS))))
    for text in texts:
        yield from (part for part in cut.split(text) if part)
