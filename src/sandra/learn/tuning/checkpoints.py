"""Where an interrupted training goes on."""

from __future__ import annotations

import json
from pathlib import Path


def last_checkpoint(folder: Path) -> str | None:
    """The last one in the folder that was written to its end: the trainer's state comes last."""
    found = []
    for state in folder.glob("checkpoint-*/trainer_state.json"):
        try:
            found.append((json.loads(state.read_text(encoding="utf-8"))["global_step"], state))
        except (OSError, ValueError, KeyError):
            continue  # Cut short.
    return str(max(found)[1].parent) if found else None
