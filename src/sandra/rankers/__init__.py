"""Prompt -> Ranking: who proposes, and in which order the verifier looks."""

from sandra.rankers.ahead import Ahead, begin
from sandra.rankers.answer import parse_answer
from sandra.rankers.registry import CHOICES, as_ranker, ask, create
from sandra.rankers.types import Failure, Ranker, Ranking
from sandra.rankers.usage import Usage, total

__all__ = [
    "CHOICES",
    "Ahead",
    "Failure",
    "Ranker",
    "Ranking",
    "Usage",
    "as_ranker",
    "ask",
    "begin",
    "create",
    "parse_answer",
    "total",
]
