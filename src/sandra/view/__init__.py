"""Pictures of scenes, verdicts and decisions, as files (.png, .pdf, .svg)."""

from sandra.view.decision import decision_figure, verdict_figure
from sandra.view.robustness import robustness_figure
from sandra.view.scenario import scene_figure

__all__ = ["decision_figure", "robustness_figure", "scene_figure", "verdict_figure"]
