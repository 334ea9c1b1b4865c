"""Closed loop: simulated traffic, vehicles that drive in it, and what is recorded of them.

highway-env is imported by this room alone, and only when an environment is made or `Shield` is
asked for: it comes with the extra `sandra[highway]`.
"""

from typing import TYPE_CHECKING, Any

from sandra.errors import SettingsError
from sandra.simulation.highway import ACTIONS, FAIL_SAFE, Environment, Traffic, highway

if TYPE_CHECKING:
    from sandra.simulation.shield import Shield

__all__ = ["ACTIONS", "FAIL_SAFE", "Environment", "Shield", "Traffic", "highway"]


def __getattr__(name: str) -> Any:
    """`Shield`, which is a class of Gymnasium."""
    if name != "Shield":
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    try:
        from sandra.simulation.shield import Shield
    except ImportError as error:
        raise SettingsError(
            f"highway-env is not installed ({error}); pip install 'sandra[highway]' brings it"
        ) from None
    return Shield
