"""Open loop: how often a ranking holds a verified pair, and how often what was driven.

The paper's Sec. "Ablation Study".
"""

from sandra.evaluation.open_loop.scores import Case, Rate, Score, by_action, score

__all__ = ["Case", "Rate", "Score", "by_action", "score"]
