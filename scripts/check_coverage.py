"""Coverage of the safety core, room by room, from the JSON report of a test run.

    python scripts/check_coverage.py coverage.json

Prints lines and branches; exit status 1 if a room stays below what is asked of it.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path

ASKED = {"logic": 100.0, "certificate": 100.0, "reach": 95.0, "prediction": 95.0, "planning": 95.0}
"""Least coverage of lines, and of branches [%]."""


def main(report: Path) -> int:
    """Print the table; returns the exit status."""
    files = json.loads(report.read_text(encoding="utf-8"))["files"]
    low = 0
    print(f"{'room':<12} {'lines':>8} {'branches':>9} {'asked':>6}")
    for room, asked in ASKED.items():
        mine = {name: found for name, found in files.items() if f"/sandra/{room}/" in name}
        lines = _share(mine, "covered_lines", "num_statements")
        branches = _share(mine, "covered_branches", "num_branches")
        print(f"{room:<12} {lines:7.2f}% {branches:8.2f}% {asked:5.0f}%")
        if min(lines, branches) < asked:
            low = 1
            for name, found in sorted(mine.items()):
                missing = found["missing_lines"] + found["missing_branches"]
                if missing:
                    print(f"    {name}: {missing}")
    return low


def _share(files: dict[str, dict[str, dict[str, int]]], covered: str, of: str) -> float:
    total = sum(found["summary"][of] for found in files.values())
    return 100.0 * sum(found["summary"][covered] for found in files.values()) / total


if __name__ == "__main__":
    if len(sys.argv) != 2:
        sys.exit(__doc__)
    sys.exit(main(Path(sys.argv[1])))
