"""Parameters: one set, frozen, checked."""

import dataclasses
import math
from pathlib import Path

import pytest

from sandra.errors import SettingsError
from sandra.settings import Assumptions, Settings


def test_the_paper_s_parameters() -> None:
    s = Settings()
    assert (s.a_lim, s.v_err) == (0.2, 0.1)
    assert (s.a_lon_min, s.a_lon_max, s.a_lat_max, s.v_max) == (-6.0, 6.0, 4.0, 30.0)
    assert (s.t_d, s.a_min, s.a_obs_min) == (0.4, -6.0, -12.0)
    assert (s.v_fov, s.v_braking, s.a_abrupt) == (50.0, 43.0, -2.0)
    assert (s.k, s.history, s.horizon) == (3, 5, 25)
    assert s.assumptions.max_acceleration == 12.0


def test_frozen() -> None:
    with pytest.raises(dataclasses.FrozenInstanceError):
        Settings().a_lim = 1.0  # type: ignore[misc]


def test_load(tmp_path: Path) -> None:
    path = tmp_path / "s.toml"
    path.write_text(
        "a_lon_min = -8\nv_type = 22.22\nprecision = 'tight'\n[assumptions]\nno_rear_end = false\n"
    )
    s = Settings.load(path)
    assert s.a_lon_min == -8.0
    assert s.v_type == 22.22
    assert s.assumptions == dataclasses.replace(Assumptions(), no_rear_end=False)
    assert s.a_lim == Settings().a_lim
    assert (s.precision, Settings().precision) == ("tight", "quick")


@pytest.mark.parametrize(
    "change",
    [
        {"a_lim": -0.1},
        {"a_lim": math.nan},
        {"a_lim": True},
        {"v_max": 0.0},
        {"v_max": math.inf},
        {"a_lon_min": 7.0},
        {"a_min": 0.0},
        {"a_obs_min": math.nan},
        {"a_abrupt": 1.0},
        {"k": 0},
        {"k": 2.5},
        {"horizon": 0},
        {"history": -1},
        {"cell_s": 0.0},
        {"v_fov": math.nan},
        {"precision": "exact"},
        {"nonsense": 1},
    ],
)
def test_bad_values(change: dict[str, object]) -> None:
    with pytest.raises(SettingsError):
        Settings().replace(**change)


@pytest.mark.parametrize(
    "text",
    [
        "a_lim = [",
        "a_lim = 'big'",
        "nonsense = 1",
        "assumptions = 3",
        "[assumptions]\nnonsense = 1",
        "[assumptions]\nmax_acceleration = 'x'",
    ],
)
def test_bad_files(text: str, tmp_path: Path) -> None:
    path = tmp_path / "s.toml"
    path.write_text(text)
    with pytest.raises(SettingsError, match=r"s\.toml"):
        Settings.load(path)
