"""Closed loop: simulated traffic, vehicles that drive in it, and what is recorded of them.

highway-env is imported by this room alone, and only when an environment is made: it comes with
the extra `sandra[highway]`.
"""

from sandra.simulation.highway import ACTIONS, FAIL_SAFE, Environment, Traffic, highway

__all__ = ["ACTIONS", "FAIL_SAFE", "Environment", "Traffic", "highway"]
