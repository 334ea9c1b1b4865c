"""`embedded`: the language model that comes along ranks by likelihood."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path

from sandra.rankers.inside.reader import InsideReader
from sandra.rankers.local.score import ScoreRanker

NAME = "embedded"
WEIGHTS = Path(__file__).parent / "weights"


def embedded_ranker(deadline: float) -> ScoreRanker:
    """The ranker `embedded`; its model is loaded at the first call in a process.

    Raises:
        RankerError: see `InsideReader`.
    """
    return ScoreRanker(NAME, _reader(WEIGHTS), deadline, "length", answers=True)


@lru_cache(maxsize=2)
def _reader(folder: Path) -> InsideReader:
    return InsideReader(folder)
