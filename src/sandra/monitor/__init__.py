"""The monitor: how well a driven trajectory keeps the traffic rules, and by how much."""

from sandra.monitor.monitor import monitor
from sandra.monitor.types import Robustness, RuleRobustness

__all__ = ["Robustness", "RuleRobustness", "monitor"]
