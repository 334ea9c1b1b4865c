"""DiLu: a language model drives by meta-actions, with few-shot memory.

`situation` reads a prompt's facts, `view` puts the traffic into words, `memory` and `embedding`
find like situations, `loop` asks and reads the answer, `ranker` makes a ranking of it. As a driver
without a verifier it is in `sandra.simulation.dilu`; docs/dilu.md says what is as in the paper.
"""

from sandra.rankers.dilu.embedding import Embedding, EmbeddingEndpoint, HashedWords
from sandra.rankers.dilu.loop import Choice
from sandra.rankers.dilu.memory import Experience, Memory, load
from sandra.rankers.dilu.ranker import DiLuRanker
from sandra.rankers.dilu.view import Car, LaneView, View

__all__ = [
    "Car",
    "Choice",
    "DiLuRanker",
    "Embedding",
    "EmbeddingEndpoint",
    "Experience",
    "HashedWords",
    "LaneView",
    "Memory",
    "View",
    "load",
]
