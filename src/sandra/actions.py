"""The action space of the paper's Tab. II: four longitudinal and three lateral actions."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from enum import Enum

from sandra.errors import ActionError


class Longitudinal(Enum):
    """Longitudinal actions; the value is the name in every prompt, file and command."""

    KEEP = "keep"
    ACCELERATE = "accelerate"
    DECELERATE = "decelerate"
    STOP = "stop"


class Lateral(Enum):
    """Lateral actions; the value is the name in every prompt, file and command."""

    FOLLOW_LANE = "follow-lane"
    LEFT_LANE = "left-lane"
    RIGHT_LANE = "right-lane"


_SYNONYMS = {"left": "left-lane", "right": "right-lane", "follow": "follow-lane"}


@dataclass(frozen=True, slots=True, order=False)
class ActionPair:
    """One longitudinal and one lateral action, e.g. `ActionPair.parse("keep,follow-lane")`."""

    longitudinal: Longitudinal
    lateral: Lateral

    @classmethod
    def parse(cls, text: str) -> ActionPair:
        """Read `"accelerate,right-lane"`; case, spaces and `_` do not matter.

        Raises:
            ActionError: if the text is not one longitudinal and one lateral action.
        """
        words = [w.strip() for w in text.lower().replace("_", "-").split(",")]
        if len(words) == 2:
            return cls.of(words[0], words[1])
        raise ActionError(
            f"'{text}' is not an action pair: write LONGITUDINAL,LATERAL such as "
            f"'accelerate,right-lane' ({_choices()})"
        )

    @classmethod
    def of(cls, longitudinal: str, lateral: str) -> ActionPair:
        """Build a pair from two names. Raises `ActionError` if one is unknown."""
        lon = longitudinal.strip().lower().replace("_", "-")
        lat = lateral.strip().lower().replace("_", "-")
        try:
            return cls(Longitudinal(lon), Lateral(_SYNONYMS.get(lat, lat)))
        except ValueError:
            raise ActionError(
                f"unknown action pair '{longitudinal},{lateral}': choose from {_choices()}"
            ) from None

    def to_dict(self) -> dict[str, str]:
        """`{"longitudinal": ..., "lateral": ...}` with the names of the JSON contract."""
        return {"longitudinal": self.longitudinal.value, "lateral": self.lateral.value}

    def __str__(self) -> str:
        return f"{self.longitudinal.value},{self.lateral.value}"


def _choices() -> str:
    lon = "/".join(a.value for a in Longitudinal)
    return f"{lon} and " + "/".join(a.value for a in Lateral)


ALL_PAIRS: tuple[ActionPair, ...] = tuple(
    ActionPair(lon, lat) for lon in Longitudinal for lat in Lateral
)
"""All twelve pairs, in the order of the paper's Tab. II."""

META_ACTIONS = ("LANE_LEFT", "IDLE", "LANE_RIGHT", "FASTER", "SLOWER")
"""What highway-env's ego can be told, in the order of its action space; DiLu answers with these."""


def parse_pairs(pairs: str | Iterable[str | ActionPair]) -> tuple[ActionPair, ...]:
    """`"all"`, one pair as text, or several pairs (text or `ActionPair`).

    Raises:
        ActionError: if one of them is unknown.
    """
    if isinstance(pairs, str):
        return ALL_PAIRS if pairs.strip().lower() == "all" else (ActionPair.parse(pairs),)
    return tuple(p if isinstance(p, ActionPair) else ActionPair.parse(p) for p in pairs)
