"""DiLu as a baseline: a language model drives by meta-actions, with few-shot memory, unverified.

Its decision loop is that of the ranker in `sandra.rankers.dilu`; `scene` is what it sees of an
environment, `driver` drives. See docs/dilu.md for what is as in the paper and what is not.
"""

from sandra.rankers.dilu import (
    Choice,
    Embedding,
    EmbeddingEndpoint,
    Experience,
    HashedWords,
    Memory,
    View,
    load,
)
from sandra.simulation.dilu.driver import DiLu
from sandra.simulation.dilu.named import located, named
from sandra.simulation.dilu.scene import view

__all__ = [
    "Choice",
    "DiLu",
    "Embedding",
    "EmbeddingEndpoint",
    "Experience",
    "HashedWords",
    "Memory",
    "View",
    "load",
    "located",
    "named",
    "view",
]
