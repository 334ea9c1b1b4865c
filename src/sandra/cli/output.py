"""What commands print: progress, JSON, and where pictures went."""

from __future__ import annotations

import json
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from sandra.errors import SandraError

if TYPE_CHECKING:
    from sandra.evaluation.sheet import Sheet


def figure_of(subject: Any, path: str | None) -> str | None:
    if path is None:
        return None
    progress("draw")
    drawn = str(subject.figure(path))
    progress("")
    return drawn


def tables_in(out: Path, sheets: Mapping[str, Sheet]) -> dict[Path, str]:
    """By file in a folder, the text of each sheet in each format."""
    from sandra.evaluation.sheet import FORMATS

    return {
        out / f"{name}.{ending}": sheet.text(form)
        for form, ending in FORMATS.items()
        for name, sheet in sheets.items()
    }


def write_files(out: Path, files: Mapping[Path, str]) -> list[Path]:
    """Write texts into a folder, which is made if need be.

    Raises:
        SandraError: if one cannot be written.
    """
    try:
        out.mkdir(parents=True, exist_ok=True)
        for file, text in files.items():
            file.write_text(text, encoding="utf-8")
    except OSError as error:
        raise SandraError(
            f"{out}: cannot be written ({error.strerror}); choose another --out"
        ) from None
    return list(files)


def tell_written(files: Sequence[Path]) -> None:
    """On stderr, if there are any."""
    if files:
        print("written: " + ", ".join(map(str, files)), file=sys.stderr)


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
