"""A fixture that writes scenario files."""

from collections.abc import Callable
from pathlib import Path

import pytest

from scene_xml import Scenario


@pytest.fixture
def write(tmp_path: Path) -> Callable[..., Path]:
    """Write a scenario file, by its parts or as text: `write(dt="0")`, `write("<commonRoad/>")`."""

    def write(text: str | None = None, name: str = "scenario.xml", **parts: object) -> Path:
        path = tmp_path / name
        path.write_text(Scenario(**parts).xml() if text is None else text)  # type: ignore[arg-type]
        return path

    return write
