"""What is read back from the folder of an episode."""

from __future__ import annotations

import json
from pathlib import Path

from sandra.errors import SandraError
from sandra.evaluation.closed_loop.driven import every
from sandra.monitor import Robustness, monitor
from sandra.scene import load
from sandra.scene.types import Scene
from sandra.settings import Settings


def recorded(episode: Path) -> Scene:
    """The recording of RUN/seed-N, with one row for each decision.

    Raises:
        SandraError: if it is no folder of an episode.
    """
    try:
        metrics = json.loads((episode / "metrics.json").read_text(encoding="utf-8"))
        stride = int(metrics["ticks_per_step"])
    except (OSError, ValueError, KeyError) as error:
        raise SandraError(f"{episode}: is no episode of a run ({error})") from None
    return every(load(episode / "scenario.xml"), stride)


def robustness_of(episode: Path, settings: Settings | None = None) -> Robustness:
    """Robustness of the three rules over an episode's decisions (paper's figure of it)."""
    return monitor(recorded(episode), settings=settings)
