"""Corridor -> witness; and the fail-safe that continues it."""

from sandra.planning.corridor import in_corridor
from sandra.planning.cost import Weights
from sandra.planning.emergency import emergency
from sandra.planning.fail_safe import full_braking
from sandra.planning.fail_safe_search import FailSafe, fail_safe, fail_safe_horizon
from sandra.planning.types import Maneuver, Trajectory
from sandra.planning.witness import Surroundings, witness

__all__ = [
    "FailSafe",
    "Maneuver",
    "Surroundings",
    "Trajectory",
    "Weights",
    "emergency",
    "fail_safe",
    "fail_safe_horizon",
    "full_braking",
    "in_corridor",
    "witness",
]
