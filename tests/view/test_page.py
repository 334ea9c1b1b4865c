"""Where a picture can be written, and what is said where it cannot."""

from pathlib import Path

import pytest

from sandra.errors import SandraError, SettingsError
from sandra.view.page import Page, checked


@pytest.mark.parametrize("name", ["a.bmp", "a", "a.png.txt", ".png"])
def test_unknown_suffix(tmp_path: Path, name: str) -> None:
    with pytest.raises(SettingsError, match=r"\.png, \.pdf or \.svg"):
        checked(tmp_path / name, 100)


@pytest.mark.parametrize("dpi", [0, -1, 10_000, 1.5, True])
def test_a_resolution_that_cannot_be_used(tmp_path: Path, dpi: int) -> None:
    with pytest.raises(SettingsError, match="dpi"):
        checked(tmp_path / "a.png", dpi)


def test_places_that_cannot_be_written(tmp_path: Path) -> None:
    with pytest.raises(SandraError, match="no folder") as error:
        checked(tmp_path / "absent" / "a.png", 100)
    assert "\n" not in str(error.value)
    (tmp_path / "b.png").mkdir()
    with pytest.raises(SandraError, match="is a folder"):
        checked(tmp_path / "b.png", 100)


def test_a_write_that_fails_is_one_line(tmp_path: Path) -> None:
    # A folder in the place of the file appears after the check: the write itself fails.
    (tmp_path / "c.png").mkdir()
    with pytest.raises(SandraError, match="cannot be written") as error:
        Page(1.0, 1.0).save(tmp_path / "c.png", 50)
    assert "\n" not in str(error.value)


def test_suffixes_in_capitals(tmp_path: Path) -> None:
    path = checked(str(tmp_path / "A.PNG"), 50)
    assert Page(1.0, 1.0).save(path, 50).read_bytes().startswith(b"\x89PNG")
