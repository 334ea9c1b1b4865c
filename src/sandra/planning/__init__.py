"""Corridor -> trajectory; and the fail-safe maneuver."""

from sandra.planning.corridor import in_corridor
from sandra.planning.fail_safe import full_braking
from sandra.planning.types import Maneuver

__all__ = ["Maneuver", "full_braking", "in_corridor"]
