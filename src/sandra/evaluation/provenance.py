"""What made a result: versions and commit, for the files that keep it."""

from __future__ import annotations

import platform
import subprocess
from collections.abc import Sequence
from importlib import metadata
from pathlib import Path

PACKAGES = ("sandra", "highway-env", "gymnasium", "numpy", "shapely", "commonroad-io")


def versions(more: Sequence[str] = ()) -> dict[str, str]:
    """Of Python and of the packages that what is simulated and computed depends on; and `more`."""
    found = {"python": platform.python_version()}
    for name in (*PACKAGES, *more):
        try:
            found[name] = metadata.version(name)
        except metadata.PackageNotFoundError:
            found[name] = "absent"
    return found


def commit() -> str | None:
    """Of the checkout that this package is run from, with "+changes"; None if there is none."""
    here = Path(__file__).parent
    try:
        words = ["git", "-C", str(here), "describe", "--always", "--abbrev=40", "--dirty=+changes"]
        found = subprocess.run(words, capture_output=True, text=True, timeout=10, check=True)
    except (OSError, subprocess.SubprocessError):
        return None
    return found.stdout.strip() or None
