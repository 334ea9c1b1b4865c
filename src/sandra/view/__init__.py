"""Pictures of scenes, verdicts and decisions as files (.png, .pdf, .svg), films of recordings."""

from sandra.view.decision import decision_figure, verdict_figure
from sandra.view.film import film, film_frame
from sandra.view.maneuver import maneuver_figure
from sandra.view.one_set import set_figure
from sandra.view.predictions import predictions_figure
from sandra.view.robustness import comparison_figure, robustness_figure
from sandra.view.scenario import scene_figure

__all__ = [
    "comparison_figure",
    "decision_figure",
    "film",
    "film_frame",
    "maneuver_figure",
    "predictions_figure",
    "robustness_figure",
    "scene_figure",
    "set_figure",
    "verdict_figure",
]
