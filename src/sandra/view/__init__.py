"""Pictures of scenes, verdicts and decisions as files (.png, .pdf, .svg), films of recordings."""

from sandra.view.decision import decision_figure, verdict_figure
from sandra.view.film import film, film_frame
from sandra.view.robustness import robustness_figure
from sandra.view.scenario import scene_figure

__all__ = [
    "decision_figure",
    "film",
    "film_frame",
    "robustness_figure",
    "scene_figure",
    "verdict_figure",
]
