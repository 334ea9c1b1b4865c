"""The rooms of the safety core, and the tests that may kill a mutant in each."""

from __future__ import annotations

from pathlib import Path

ROOMS: dict[str, tuple[str, ...]] = {
    "logic": ("tests/logic",),
    "prediction": ("tests/prediction",),
    "reach": ("tests/reach",),
    "planning": ("tests/planning",),
    "certificate": ("tests/certificate",),
}


def sources(root: Path, room: str) -> list[Path]:
    return sorted((root / "src" / "sandra" / room).glob("*.py"))


def module_of(file: str) -> str:
    """ "src/sandra/logic/formula.py" -> "sandra.logic.formula"."""
    return ".".join(Path(file).relative_to("src").with_suffix("").parts).removesuffix(".__init__")
