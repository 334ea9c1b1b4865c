"""Every parameter, once, frozen, with its unit and its source.

The same values serve the verifier, the planner, the certificate and the monitor. Sources: "Tab."
is the paper's table "General parameters for the evaluations"; the others are named.
"""

from __future__ import annotations

import math
import tomllib
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import Any

from sandra.errors import SettingsError


@dataclass(frozen=True, slots=True)
class Assumptions:
    """What the set-based prediction assumes of other traffic (after Koschi & Althoff 2020).

    Each switch can be turned off; an assumption that an observation already violates is dropped
    for that participant alone.
    """

    max_acceleration: float = 12.0
    """|a| of other vehicles in any direction (friction circle) [m/s^2] (Tab.)."""
    max_braking: float = math.inf
    """The speed of a vehicle falls no faster [m/s^2]; above `max_acceleration`: no further bound.

    Dropped for a vehicle whose observed acceleration is below minus this; counted on in lanes."""
    max_driving: float = math.inf
    """The speed of a vehicle grows no faster [m/s^2]; above `max_acceleration`: no further bound.

    Dropped for a vehicle whose observed acceleration is above this."""
    max_speed: float = 50.0
    """Highest speed of other vehicles [m/s]; a vehicle already faster keeps its own speed."""
    no_reversing: bool = True
    """Others do not start to drive backwards."""
    stay_on_carriageway: bool = True
    """Others stay on lanes of their own direction of travel."""
    follow_lanes: bool = True
    """Others follow lanes; they change lanes no faster than `max_lateral_speed`."""
    max_lateral_speed: float = 4.0
    """Speed across the lane while changing it [m/s]; above it, the observed one is used."""
    no_rear_end: bool = True
    """Traffic behind the ego in its lane does not drive into it (StVO 4)."""
    legal_cut_in: bool = True
    """Others cut in before the ego only where the distance for safety remains (StVO 7(5))."""
    max_overhang: float = 0.3
    """How far a body may stick out over the edge of its carriageway [m]; more if observed."""
    bounded_heading: bool = True
    """Bodies point along their motion and turn no tighter than the two bounds below."""
    min_turning_radius: float = 3.5
    """Arc length that a vehicle needs for turning its body by one rad [m]."""
    max_slip_angle: float = 0.1
    """Change of the angle between a body and its motion [rad]."""
    pedestrian_max_speed: float = 2.5
    """Highest speed of pedestrians [m/s]."""
    pedestrian_max_acceleration: float = 3.0
    """|a| of pedestrians in any direction [m/s^2]."""

    @staticmethod
    def load(path: str | Path) -> Assumptions:
        """Read a TOML file with a table `[assumptions]`; what it leaves out keeps its default.

        A table `[conformance]`, which says where the bounds come from, may stand beside it.

        Raises:
            SettingsError: if the file is missing, is not TOML, or holds a bad value.
        """
        data = _read(path)
        data.pop("conformance", None)
        if set(data) != {"assumptions"}:
            raise SettingsError(
                f"{path}: no set of assumptions; write one with 'sandra conformance --out FILE'"
            )
        return _validated(data, path).assumptions

    @staticmethod
    def named(text: str) -> Assumptions:
        """`"paper"`, or `"conformant:FILE"` with a file that `load` reads.

        Raises:
            SettingsError: any other text, or as `load`.
        """
        kind, _, path = text.partition(":")
        if text == "paper":
            return Assumptions()
        if kind == "conformant" and path:
            return Assumptions.load(path)
        raise SettingsError(f"assumptions '{text}': write paper or conformant:FILE")


PRECISIONS = ("quick", "tight")


@dataclass(frozen=True, slots=True)
class Settings:
    """All parameters. Change some with `settings.replace(a_lon_min=-8.0)`."""

    # Actions (Tab.)
    a_lim: float = 0.2
    """Threshold between KEEP, ACCELERATE and DECELERATE [m/s^2]."""
    v_err: float = 0.1
    """Speed up to which the ego counts as standing still [m/s]."""

    # Ego in the reachability analysis (Tab.)
    a_lon_min: float = -6.0
    """Lowest longitudinal acceleration [m/s^2]."""
    a_lon_max: float = 6.0
    """Highest longitudinal acceleration [m/s^2]."""
    a_lat_max: float = 4.0
    """|lateral acceleration| [m/s^2]."""
    v_max: float = 30.0
    """Highest longitudinal speed [m/s]."""
    v_lat_max: float = 30.0
    """Highest |speed| across the lane [m/s]; not bounded in the paper, here by v_max."""

    # Ego body, where the scenario does not give it (CommonRoad vehicle 2, BMW 320i)
    ego_length: float = 4.508
    """[m]"""
    ego_width: float = 1.610
    """[m]"""
    ego_wheelbase: float = 2.578
    """[m]"""

    # Steering of the ego (CommonRoad vehicle 2, BMW 320i)
    steering_angle_max: float = 1.066
    """|steering angle| [rad]."""
    steering_rate_max: float = 0.4
    """|steering rate| [rad/s]."""

    # Measurement uncertainty of the initial state
    s_uncertainty: float = 0.0
    """Half width of the initial longitudinal position [m]."""
    v_uncertainty: float = 0.0
    """Half width of the initial speeds [m/s]."""

    # R_G1, safe distance (Tab.)
    t_d: float = 0.4
    """Reaction time of the ego [s]."""
    a_min: float = -6.0
    """Strongest braking of the ego that R_G1 counts on [m/s^2]."""
    a_obs_min: float = -12.0
    """Strongest braking of the vehicle ahead [m/s^2]."""
    cut_in_exception: bool = False
    """R_G1 does not hold for t_c after the other cut in (Maierhofer 2020)."""
    t_c: float = 3.0
    """Duration of the exception after a cut-in [s]."""

    # R_G2, R_G3 (method: Maierhofer 2020)
    a_abrupt: float = -2.0
    """Braking below this is abrupt [m/s^2]."""
    v_fov: float = 50.0
    """Speed limit from the field of view [m/s]."""
    v_braking: float = 43.0
    """Speed limit from the braking capability [m/s]."""
    v_type: float = math.inf
    """Speed limit for the type of the ego [m/s]; trucks: 22.22."""

    # Decision (Tab.)
    k: int = 3
    """Number of ranked pairs kappa."""
    history: int = 5
    """Number of past pairs told to the ranker."""
    horizon: int = 25
    """Number of steps h that are verified."""

    # Resolution of the reachability analysis
    cell_s: float = 0.25
    """Length of a lattice cell along the lane [m]: sets only grow by rounding."""
    cell_d: float = 0.2
    """Width of a lattice cell across the lane [m]."""
    precision: str = "quick"
    """How closely a reachable set follows the true one: "quick", or "tight" for about twice the
    time (docs/benchmarks.md, Areas). Either holds all that can be reached."""

    assumptions: Assumptions = field(default_factory=Assumptions)
    """Of the set-based prediction."""

    def __post_init__(self) -> None:
        for name in ("a_lim", "v_err", "s_uncertainty", "v_uncertainty", "t_d", "t_c"):
            _require(self, name, lambda v: 0.0 <= v < math.inf, "a finite number >= 0")
        positive = (
            "steering_angle_max",
            "steering_rate_max",
            "a_lat_max",
            "v_max",
            "v_lat_max",
            "ego_length",
            "ego_width",
            "ego_wheelbase",
        )
        for name in (*positive, "cell_s", "cell_d"):
            _require(self, name, lambda v: 0.0 < v < math.inf, "a finite number > 0")
        for name in ("v_fov", "v_braking", "v_type"):
            _require(self, name, lambda v: v > 0.0, "a number > 0")
        for name in ("a_min", "a_obs_min"):
            _require(self, name, lambda v: -math.inf < v < 0.0, "a finite number < 0")
        _require(self, "a_abrupt", lambda v: -math.inf < v <= 0.0, "a finite number <= 0")
        for name in ("a_lon_min", "a_lon_max"):
            _require(self, name, math.isfinite, "a finite number")
        if self.a_lon_min > self.a_lon_max:
            raise SettingsError(
                f"a_lon_min = {self.a_lon_min} exceeds a_lon_max = {self.a_lon_max}: swap them"
            )
        if self.precision not in PRECISIONS:
            raise SettingsError(f"precision = {self.precision!r}: choose quick or tight")
        for name in ("k", "horizon"):
            _require(self, name, lambda v: isinstance(v, int) and v >= 1, "an integer >= 1")
        _require(self, "history", lambda v: isinstance(v, int) and v >= 0, "an integer >= 0")

    def replace(self, **changes: Any) -> Settings:
        """A copy with some parameters changed. Raises `SettingsError` on a bad value."""
        known = {f.name for f in fields(self)}
        for name in changes:
            if name not in known:
                raise SettingsError(f"unknown parameter '{name}': choose from {sorted(known)}")
        return replace(self, **changes)

    @staticmethod
    def load(path: str | Path) -> Settings:
        """Read a TOML file; names as above, assumptions in a table `[assumptions]`.

        Raises:
            SettingsError: if the file is missing, is not TOML, or holds a bad value.
        """
        return _validated(_read(path), path)


def _read(path: str | Path) -> dict[str, Any]:
    try:
        return tomllib.loads(Path(path).read_text(encoding="utf-8"))
    except OSError as error:
        raise SettingsError(f"{path}: cannot be read ({error.strerror}); check the path") from None
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise SettingsError(f"{path}: not a TOML file ({error})") from None


def _validated(data: dict[str, Any], path: str | Path) -> Settings:
    import pydantic

    try:
        adapter = pydantic.TypeAdapter(Settings)
        _reject_unknown(data, path)
        return adapter.validate_python(data)
    except pydantic.ValidationError as error:
        first = error.errors()[0]
        where = ".".join(str(part) for part in first["loc"]) or "settings"
        raise SettingsError(f"{path}: {where}: {first['msg']}") from None


def _reject_unknown(data: dict[str, Any], path: str | Path) -> None:
    tables = ((data, Settings, ""), (data.get("assumptions", {}), Assumptions, "assumptions."))
    for table, cls, prefix in tables:
        if not isinstance(table, dict):
            raise SettingsError(f"{path}: 'assumptions' must be a table, write [assumptions]")
        known = {f.name for f in fields(cls)}
        for name in table:
            if name not in known:
                raise SettingsError(
                    f"{path}: unknown parameter '{prefix}{name}'; choose from "
                    + ", ".join(sorted(known))
                )


def _require(settings: Settings, name: str, holds: Any, expected: str) -> None:
    value = getattr(settings, name)
    if isinstance(value, bool) or not isinstance(value, int | float) or not holds(value):
        raise SettingsError(f"{name} = {value!r} must be {expected}")
