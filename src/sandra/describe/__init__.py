"""Scene -> Prompt: what the ranker is told, and in which form it has to answer."""

from sandra.describe.beams import Beams
from sandra.describe.describer import answered, describe, feasible_actions, narrow, render
from sandra.describe.options import PromptOptions
from sandra.describe.schema import only
from sandra.describe.templates import Templates
from sandra.describe.types import ObstacleFacts, Picture, Prompt, Situation

prompt = describe
"""`describe` under the name by which `sandra.prompt` offers it."""

__all__ = [
    "Beams",
    "ObstacleFacts",
    "Picture",
    "Prompt",
    "PromptOptions",
    "Situation",
    "Templates",
    "answered",
    "describe",
    "feasible_actions",
    "narrow",
    "only",
    "prompt",
    "render",
]
