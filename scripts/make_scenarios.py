"""Make the scenarios that are shipped in src/sandra/scenarios, and those for tests.

    python scripts/make_scenarios.py              # all, into the project
    python scripts/make_scenarios.py --out DIR    # all, into DIR

The same code gives the same bytes: a test compares them with what is shipped. Traffic is driven
by the intelligent driver model, so nobody collides; docs/scenarios.md says what each is for.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent))

from scenariomaker import SCENARIOS
from scenariomaker.files import protobuf, xml, xml_2018b

ROOT = Path(__file__).resolve().parents[1]


def shipped() -> dict[str, bytes]:
    """File name -> content of the scenarios in the package."""
    drafts = [make() for make in SCENARIOS.values()]
    return {f"{draft.benchmark_id}.xml": xml(draft) for draft in drafts}


def for_tests() -> dict[str, bytes]:
    """File name -> content of the same scenarios in CommonRoad's other formats."""
    draft = SCENARIOS["rural-oncoming"]()
    return {f"{draft.benchmark_id}-2018b.xml": xml_2018b(draft), **protobuf(draft)}


def main() -> None:
    """Write all files."""
    parser = argparse.ArgumentParser(description="Make the project's own scenarios.")
    parser.add_argument("--out", type=Path, help="write everything into this folder")
    out = parser.parse_args().out
    for folder, files in (
        (out or ROOT / "src" / "sandra" / "scenarios", shipped()),
        (out or ROOT / "tests" / "data", for_tests()),
    ):
        folder.mkdir(parents=True, exist_ok=True)
        for name, content in files.items():
            (folder / name).write_bytes(content)
            print(f"{folder / name} ({len(content) / 1000:.0f} kB)")


if __name__ == "__main__":
    main()
