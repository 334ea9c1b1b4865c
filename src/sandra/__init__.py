"""SanDRA: safe decisions of large language models for automated vehicles, by reachability analysis.

import sandra

scene = sandra.load("scenario.xml")
decision = sandra.decide(scene, ranker="rules", command="drive faster")
print(decision)
decision.figure("decision.png")
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from sandra.actions import ALL_PAIRS, ActionPair, Lateral, Longitudinal
    from sandra.certify import certify_trajectory
    from sandra.decider import Decider
    from sandra.decision import Decision, decide
    from sandra.describe import Prompt, PromptOptions, prompt
    from sandra.errors import SandraError
    from sandra.logic import Vocabulary, parse, specification
    from sandra.monitor import Robustness, robustness
    from sandra.prediction import Prediction, predict
    from sandra.rankers import Ranking
    from sandra.reach import ReachableSet, Status, Verdict, Verdicts, verify
    from sandra.scenarios import example, examples
    from sandra.scene import Scene, load
    from sandra.settings import Assumptions, Settings

__version__ = "0.1.0"

# Names are imported when first used, so that `import sandra` and `sandra --help` stay fast.
# `prompt` is the function `describe`, whose name the room of that name has already taken;
# `robustness` is `sandra.monitor.monitor`, for the same reason.
_HOME = {
    "ALL_PAIRS": "sandra.actions",
    "ActionPair": "sandra.actions",
    "Assumptions": "sandra.settings",
    "Decider": "sandra.decider",
    "Decision": "sandra.decision",
    "Lateral": "sandra.actions",
    "Longitudinal": "sandra.actions",
    "Prediction": "sandra.prediction",
    "Prompt": "sandra.describe",
    "PromptOptions": "sandra.describe",
    "Ranking": "sandra.rankers",
    "ReachableSet": "sandra.reach",
    "SandraError": "sandra.errors",
    "Robustness": "sandra.monitor",
    "Scene": "sandra.scene",
    "Settings": "sandra.settings",
    "Status": "sandra.reach",
    "Verdict": "sandra.reach",
    "Verdicts": "sandra.reach",
    "Vocabulary": "sandra.logic",
    "certify_trajectory": "sandra.certify",
    "decide": "sandra.decision",
    "example": "sandra.scenarios",
    "examples": "sandra.scenarios",
    "load": "sandra.scene",
    "parse": "sandra.logic",
    "predict": "sandra.prediction",
    "prompt": "sandra.describe",
    "robustness": "sandra.monitor",
    "specification": "sandra.logic",
    "verify": "sandra.reach",
}

__all__ = [
    "ALL_PAIRS",
    "ActionPair",
    "Assumptions",
    "Decider",
    "Decision",
    "Lateral",
    "Longitudinal",
    "Prediction",
    "Prompt",
    "PromptOptions",
    "Ranking",
    "ReachableSet",
    "Robustness",
    "SandraError",
    "Scene",
    "Settings",
    "Status",
    "Verdict",
    "Verdicts",
    "Vocabulary",
    "__version__",
    "certify_trajectory",
    "decide",
    "example",
    "examples",
    "load",
    "parse",
    "predict",
    "prompt",
    "robustness",
    "specification",
    "verify",
]


def __getattr__(name: str) -> Any:
    home = _HOME.get(name)
    if home is None:
        raise AttributeError(f"module 'sandra' has no attribute {name!r}")
    value = getattr(importlib.import_module(home), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted(__all__)
