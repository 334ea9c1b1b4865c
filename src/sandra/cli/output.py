"""What commands print: progress, JSON, and where pictures went."""

from __future__ import annotations

import json
import sys
from typing import Any


def figure_of(subject: Any, path: str | None) -> str | None:
    if path is None:
        return None
    progress("draw")
    drawn = str(subject.figure(path))
    progress("")
    return drawn


def progress(stage: str) -> None:
    """The current stage on one line of the terminal; nothing where stderr is no terminal."""
    if sys.stderr.isatty():
        print(f"\r\x1b[K{stage}..." if stage else "\r\x1b[K", end="", file=sys.stderr, flush=True)


def print_json(data: dict[str, Any]) -> None:
    """One JSON object; numbers that JSON lacks (infinite, undefined) become null."""
    print(json.dumps(finite(data), allow_nan=False))


def finite(value: Any) -> Any:
    if isinstance(value, float) and value - value != 0.0:
        return None
    if isinstance(value, dict):
        return {key: finite(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [finite(item) for item in value]
    return value
