"""DiLu as a baseline: a language model drives by meta-actions, with few-shot memory, unverified.

`scene` puts the traffic into words, `memory` and `embedding` find like situations, `driver` asks
and reads the answer. See docs/dilu.md for what is as in the paper and what is not.
"""

from sandra.simulation.dilu.driver import Choice, DiLu
from sandra.simulation.dilu.embedding import Embedding, EmbeddingEndpoint, HashedWords
from sandra.simulation.dilu.memory import Experience, Memory, load
from sandra.simulation.dilu.named import located, named
from sandra.simulation.dilu.scene import View, view

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
