"""What the page may choose from. Nothing else can be asked for, whatever a request says."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from sandra.decision.modes import MODES
from sandra.errors import SandraError
from sandra.logic import Vocabulary
from sandra.rankers import Ranker, create
from sandra.scenarios import examples
from sandra.settings import Settings

KEYLESS = ("embedded", "rules", "exhaustive", "random:0", "adversarial", "garbage")
"""Rankers that ask nobody."""
PREDICTIONS = ("most-likely", "set-based", "recorded", "constant-velocity")
LONGEST_HORIZON = 100
ENDINGS = (".xml", ".pb")
MOST_FILES = 2000

LIMITS = {
    "a_lon_min": ("Lowest acceleration of the ego", "m/s²"),
    "a_lon_max": ("Highest acceleration of the ego", "m/s²"),
    "a_lat_max": ("Lateral acceleration of the ego", "m/s²"),
    "v_max": ("Highest speed of the ego", "m/s"),
    "a_lim": ("Keep, accelerate, decelerate: threshold", "m/s²"),
    "t_d": ("R_G1: reaction time", "s"),
    "a_min": ("R_G1: strongest braking of the ego", "m/s²"),
    "a_obs_min": ("R_G1: strongest braking of the one ahead", "m/s²"),
    "a_abrupt": ("R_G2: braking below this is abrupt", "m/s²"),
    "max_acceleration": ("Others: acceleration in any direction", "m/s²"),
    "max_speed": ("Others: highest speed", "m/s"),
    "max_lateral_speed": ("Others: speed while changing lanes", "m/s"),
}
"""Parameters that the page may change, the last ones those of the set-based prediction."""


@dataclass(frozen=True, slots=True)
class Offer:
    """Scenarios by name, rankers by name, and what everything is at first."""

    scenarios: Mapping[str, Path]
    rankers: Mapping[str, Ranker]
    settings: Settings
    first: str
    """The scenario that is chosen at first."""

    @staticmethod
    def of(
        scenario: str | None = None,
        folder: Path | None = None,
        rankers: Sequence[str] = (),
        *,
        base_url: str | None = None,
        deadline: float = 30.0,
        settings: Settings | None = None,
    ) -> Offer:
        """The shipped scenarios, those of a folder, and rankers that the user has named.

        Args:
            scenario: a file or a shipped name, chosen at first. rankers: beside `KEYLESS`; a key
                they need comes from the environment, never through the page.

        Raises:
            SandraError: for a folder without scenarios, or a ranker that cannot be made.
        """
        known: dict[str, Path] = dict(examples())
        first = "intersection"
        if folder is not None:
            found = sorted(x for x in folder.rglob("*") if x.suffix in ENDINGS)[:MOST_FILES]
            if not found:
                raise SandraError(f"{folder}: holds no CommonRoad file (.xml, .pb)")
            known |= {str(x.relative_to(folder)): x for x in found}
            first = str(found[0].relative_to(folder))
        if scenario is not None:
            if scenario not in known:
                if not Path(scenario).is_file():
                    raise SandraError(
                        f"{scenario}: no such file, and no name of 'sandra scenarios'"
                    )
                known[scenario] = Path(scenario)
            first = scenario
        made = {
            name: create(name, base_url=base_url, deadline=deadline)
            for name in dict.fromkeys((*KEYLESS, *rankers))
        }
        return Offer(known, made, settings or Settings(), first)

    def to_dict(self) -> dict[str, Any]:
        """For the page."""
        words = Vocabulary.default()
        return {
            "scenarios": list(self.scenarios),
            "first": self.first,
            "rankers": list(self.rankers),
            "predictions": list(PREDICTIONS),
            "modes": list(MODES),
            "rules": dict(words.rules),
            "actions": dict(words.actions),
            "horizon": self.settings.horizon,
            "longest_horizon": LONGEST_HORIZON,
            "limits": [
                {"name": name, "text": text, "unit": unit, "value": value_of(self.settings, name)}
                for name, (text, unit) in LIMITS.items()
            ],
        }


def value_of(settings: Settings, name: str) -> float:
    """The value of one of `LIMITS`."""
    owner = settings if hasattr(settings, name) else settings.assumptions
    return float(getattr(owner, name))
