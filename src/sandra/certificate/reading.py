"""A certificate from JSON, strictly; see `file` for the format."""

from __future__ import annotations

import base64
import math
from collections.abc import Callable, Mapping
from dataclasses import fields
from types import MappingProxyType
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from sandra.actions import ActionPair
from sandra.certificate.types import (
    FORMAT,
    UNLIMITED,
    Body,
    Certificate,
    LaneOf,
    Occupancies,
    Participant,
    Pavement,
)
from sandra.certificate.writing import PARAMETERS, WORDS, Json, names_of
from sandra.errors import ActionError, CertificateError, SettingsError
from sandra.planning.types import Trajectory
from sandra.scene.types import Region
from sandra.settings import Assumptions, Settings

Array = NDArray[np.float64]
T = TypeVar("T")

MOST = 1 << 30
"""No certificate has more regions, or vertices."""

NEEDED = (
    *("a_lon_min", "a_lon_max", "a_lat_max", "v_max", "steering_angle_max", "steering_rate_max"),
    *("a_lim", "v_err", "t_d", "a_min", "a_obs_min", "cut_in_exception", "t_c"),
    *("a_abrupt", "v_fov", "v_braking", "v_type"),
)
"""Parameters that a file must hold; formulas may name others, which are there if they exist."""


def from_json(tree: Json) -> Certificate:
    """A certificate from JSON.

    Raises:
        CertificateError: if it is no certificate of a known version.
    """
    if not isinstance(tree, dict) or tree.get("format") != FORMAT:
        found = tree.get("format") if isinstance(tree, dict) else None
        raise CertificateError(f"its format is {str(found)[:40]!r}, only {FORMAT!r} is known")
    at = _Place(tree, "certificate", {f.name for f in fields(Certificate)})
    return Certificate(
        format=FORMAT,
        versions=at.read("versions", _texts_by_name),
        note=at.read("note", _text),
        scenario=at.read("scenario", _text),
        dt=at.read("dt", _number),
        horizon=at.read("horizon", _integer),
        ego=at.read("ego", _body),
        initial=at.read("initial", _array(1)),
        pair=at.read("pair", _pair),
        rules=at.read("rules", _several(_text)),
        formula=at.read("formula", _text),
        parts=at.read("parts", _several(_two_texts)),
        vocabulary=at.read("vocabulary", _vocabulary),
        lanes=at.read("lanes", _several(_lane)),
        lanelets=at.read("lanelets", _several(_pavement)),
        reference=at.read("reference", _array(2)),
        conflicts=at.read("conflicts", _several(_pavement)),
        obstacles=at.read("obstacles", _several(_participant)),
        prediction=at.read("prediction", _text),
        set_based=at.read("set_based", _text),
        notes=at.read("notes", _several(_text)),
        witness=at.read("witness", _trajectory),
        t_dec=at.read("t_dec", _number),
        fail_safe=at.read("fail_safe", _trajectory),
        settings=at.read("settings", _settings),
    )


class _Place:
    """A JSON object of which every key must be there, and no other."""

    def __init__(
        self, tree: Json, name: str, keys: set[str], optional: frozenset[str] = frozenset()
    ) -> None:
        if not isinstance(tree, dict):
            raise CertificateError(f"'{name}' is no JSON object")
        missing, unknown = keys - optional - set(tree), set(tree) - keys
        if missing or unknown:
            what = f"lacks '{min(missing)}'" if missing else f"has unknown '{min(unknown)[:40]}'"
            raise CertificateError(f"'{name}' {what}")
        self.tree, self.name = tree, name

    def read(self, key: str, kind: Callable[[Json], T]) -> T:
        """The value of a key, if it is of a kind."""
        try:
            return kind(self.tree[key])
        except _WrongKindError as error:
            raise CertificateError(f"'{self.name}.{key}' {error}") from None


class _WrongKindError(Exception):
    """A value that is not what belongs there; its text completes "'key' ..."."""


def _text(value: Json) -> str:
    if not isinstance(value, str):
        raise _WrongKindError("is no text")
    return value


def _integer(value: Json) -> int:
    if not isinstance(value, int) or isinstance(value, bool):
        raise _WrongKindError("is no integer")
    return value


def _truth(value: Json) -> bool:
    if not isinstance(value, bool):
        raise _WrongKindError("is neither true nor false")
    return value


def _number(value: Json) -> float:
    # Numbers beyond the range of doubles come as huge integers, or as infinite floats.
    if isinstance(value, bool) or not isinstance(value, int | float) or not abs(value) < 1e300:
        raise _WrongKindError("is no finite number")
    return float(value)


def _several(kind: Callable[[Json], T]) -> Callable[[Json], tuple[T, ...]]:
    def read(value: Json) -> tuple[T, ...]:
        if not isinstance(value, list):
            raise _WrongKindError("is no list")
        return tuple(kind(x) for x in value)

    return read


def _array(dimensions: int) -> Callable[[Json], Array]:
    """An array of numbers; null stands for NaN."""

    def read(value: Json) -> Array:
        rows = value if dimensions == 2 else [value]
        if not isinstance(rows, list) or not all(isinstance(row, list) for row in rows):
            raise _WrongKindError(f"is no array of {dimensions} dimensions")
        if any(len(row) != len(rows[0]) for row in rows):
            raise _WrongKindError("has rows of different lengths")
        numbers = [[math.nan if x is None else _number(x) for x in row] for row in rows]
        found = np.array(numbers, dtype=np.float64)
        # An empty list has no columns to count: all empty arrays here are inputs, (0, 2).
        found = found.reshape(0, 2) if dimensions == 2 and not rows else found
        found = found if dimensions == 2 else found[0]
        found.setflags(write=False)
        return found

    return read


def _texts_by_name(value: Json) -> Mapping[str, str]:
    if not isinstance(value, dict):
        raise _WrongKindError("is no JSON object")
    return MappingProxyType({name: _text(text) for name, text in value.items()})


def _two_texts(value: Json) -> tuple[str, str]:
    found = _several(_text)(value)
    if len(found) != 2:
        raise _WrongKindError("has not two texts each")
    return found[0], found[1]


def _vocabulary(value: Json) -> Mapping[str, Mapping[str, str]] | None:
    if value is None:
        return None
    at = _Place(value, "vocabulary", {"actions", "rules", "predicates"})
    return MappingProxyType({section: at.read(section, _texts_by_name) for section in value})


def _pair(value: Json) -> ActionPair:
    try:
        return ActionPair.parse(_text(value))
    except ActionError:
        raise _WrongKindError("is no action pair") from None


def _body(value: Json) -> Body:
    at = _Place(value, "ego", set(names_of(Body)))
    lengths = [at.read(name, _number) for name in ("length", "width", "wheelbase")]
    return Body(at.read("id", _integer), *lengths)


def _lane(value: Json) -> LaneOf:
    at = _Place(value, "lanes", {"relation", "lanelets"})
    return LaneOf(at.read("relation", _text), at.read("lanelets", _several(_integer)))


def _pavement(value: Json) -> Pavement:
    at = _Place(value, "lanelets", {"id", "left", "right", "speed_limit"})
    limit = at.read("speed_limit", lambda x: None if x is None else _number(x))
    borders = at.read("left", _array(2)), at.read("right", _array(2))
    return Pavement(at.read("id", _integer), *borders, limit)


def _participant(value: Json) -> Participant:
    at = _Place(value, "obstacles", set(names_of(Participant)))
    return Participant(
        id=at.read("id", _integer),
        kind=at.read("kind", _text),
        outline=at.read("outline", _region),
        is_static=at.read("is_static", _truth),
        states=at.read("states", _array(2)),
        likely=at.read("likely", _occupancies),
        possible=at.read("possible", _occupancies),
        assumptions=at.read("assumptions", _several(_text)),
        dropped=at.read("dropped", _several(_text)),
        basis=at.read("basis", _several(_text)),
    )


def _region(value: Json) -> Region:
    at = _Place(value, "region", {"vertices", "radius"})
    return Region(at.read("vertices", _array(2)), at.read("radius", _number))


def _occupancies(value: Json) -> Occupancies:
    at = _Place(value, "occupancies", {"regions", "vertices", "radii", "points"})
    per_step, sizes = at.read("regions", _several(_count)), at.read("vertices", _several(_count))
    radii, points = at.read("radii", _unpacked), at.read("points", _unpacked)
    if not sum(per_step) == len(sizes) == len(radii) or 2 * sum(sizes) != len(points):
        raise CertificateError("'occupancies' has not as many numbers as it says")
    ends = np.cumsum(sizes).tolist()
    pairs = points.reshape(-1, 2)
    found = iter(
        Region(pairs[end - size : end], radius)
        for end, size, radius in zip(ends, sizes, radii.tolist(), strict=True)
    )
    return tuple(tuple(next(found) for _ in range(count)) for count in per_step)


def _count(value: Json) -> int:
    if not 0 <= _integer(value) <= MOST:
        raise _WrongKindError("is no number of things")
    return int(value)


def _unpacked(value: Json) -> Array:
    try:
        data = base64.b64decode(_text(value), validate=True)
        found = np.frombuffer(data, dtype="<f8").astype(np.float64)
    except ValueError:
        raise _WrongKindError("is no base64 of doubles") from None
    found.setflags(write=False)
    return found


def _trajectory(value: Json) -> Trajectory:
    at = _Place(value, "trajectory", {"start", "tau", "states", "inputs"})
    arrays = at.read("states", _array(2)), at.read("inputs", _array(2))
    return Trajectory(*arrays, at.read("tau", _number), at.read("start", _number))


def _settings(value: Json) -> Settings:
    names = set(PARAMETERS)
    at = _Place(value, "settings", {*names, "assumptions"}, frozenset(names - set(NEEDED)))
    kinds = {name: _text if name in WORDS else _parameter for name in PARAMETERS}
    given = {name: at.read(name, kind) for name, kind in kinds.items() if name in at.tree}
    return _made(Settings, {**given, "assumptions": at.read("assumptions", _assumptions)})


def _assumptions(value: Json) -> Assumptions:
    names = set(names_of(Assumptions))
    # One that the file does not know was not assumed: only who assumes nothing may leave it out.
    at = _Place(value, "assumptions", names, frozenset(UNLIMITED))
    return _made(Assumptions, {name: at.read(name, _parameter) for name in names & set(at.tree)})


def _parameter(value: Json) -> float | bool:
    if value == "inf":
        return math.inf
    if isinstance(value, bool):
        return value
    # Whole numbers stay whole: some parameters count something.
    return value if isinstance(value, int) and _number(value) == value else _number(value)


def _made(kind: Callable[..., T], values: dict[str, Any]) -> T:
    try:
        return kind(**values)
    except SettingsError as error:
        raise CertificateError(f"its settings cannot be used: {error}") from None
