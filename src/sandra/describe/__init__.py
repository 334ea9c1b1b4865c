"""Scene -> Prompt: what the ranker is told, and in which form it has to answer."""

from sandra.describe.describer import answered, describe, feasible_actions, narrow, render
from sandra.describe.schema import only
from sandra.describe.types import ObstacleFacts, Prompt, Situation

prompt = describe
"""`describe` under the name by which `sandra.prompt` offers it."""

__all__ = [
    "ObstacleFacts",
    "Prompt",
    "Situation",
    "answered",
    "describe",
    "feasible_actions",
    "narrow",
    "only",
    "prompt",
    "render",
]
