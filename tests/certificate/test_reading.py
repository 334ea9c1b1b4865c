"""Reading and writing, entry by entry: what each becomes, and what is said where it cannot."""

from __future__ import annotations

import base64
import gzip
import json
import math
import struct
from dataclasses import fields, is_dataclass, replace
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
import pytest

from certified import TAU, constant, made
from sandra.actions import ActionPair
from sandra.certificate import Certificate, Checked, Violation, cut_in, file, load, reading, save
from sandra.certificate import timing as times
from sandra.certificate.file import LARGEST_FILE
from sandra.certificate.reading import (
    _array,
    _body,
    _count,
    _lane,
    _number,
    _occupancies,
    _pair,
    _parameter,
    _participant,
    _pavement,
    _region,
    _settings,
    _several,
    _texts_by_name,
    _trajectory,
    _truth,
    _two_texts,
    _unpacked,
    _vocabulary,
    _WrongKindError,
    from_json,
)
from sandra.certificate.types import UNLIMITED, Body, LaneOf
from sandra.certificate.writing import PARAMETERS, _listed, _of_number, _packed, names_of, to_json
from sandra.errors import CertificateError
from sandra.settings import Assumptions, Settings

BASE = made()
BORDERS = ([[0.0, 1.0], [5.0, 1.0]], [[0.0, -1.0], [5.0, -1.0]])


def packed(*values: float) -> str:
    return base64.b64encode(struct.pack(f"<{len(values)}d", *values)).decode()


def tree() -> Any:
    """All that a file holds, with something in every list."""
    c = replace(BASE, conflicts=BASE.lanelets, notes=("a note",))
    return json.loads(json.dumps(to_json(c)))


# What becomes of each


def test_an_array_of_numbers() -> None:
    line, rows = _array(1)([1, None, 2.5]), _array(2)([[1, 2], [None, 4.5]])
    assert np.array_equal(line, [1.0, math.nan, 2.5], equal_nan=True)
    assert np.array_equal(rows, [[1.0, 2.0], [math.nan, 4.5]], equal_nan=True)
    assert _array(2)([]).shape == (0, 2)
    assert _array(1)([]).shape == (0,)
    assert _array(2)([[]]).shape == (1, 0)
    for found in (line, rows, _array(2)([])):
        assert found.dtype == np.float64
        assert not found.flags.writeable
    for bad in (None, 3, {}, "ab", [1.0], [[1.0], 2.0]):
        with pytest.raises(_WrongKindError, match="is no array of 2 dimensions"):
            _array(2)(bad)
    with pytest.raises(_WrongKindError, match="is no array of 1 dimensions"):
        _array(1)(3.0)
    for bad in ([[1.0], [1.0, 2.0]], [[1.0, 2.0], []]):
        with pytest.raises(_WrongKindError, match="has rows of different lengths"):
            _array(2)(bad)


def test_numbers_and_parameters() -> None:
    assert _number(3) == 3.0
    assert isinstance(_number(3), float)
    assert _number(-9.9e299) == -9.9e299
    for bad in (True, None, "1", 1e300, -1e300, 10**400, math.inf, math.nan):
        with pytest.raises(_WrongKindError, match="is no finite number"):
            _number(bad)
    for value in (3, 2.5, True, False, 0):
        assert _parameter(value) == value
        assert type(_parameter(value)) is type(value)
    assert _parameter("inf") == math.inf
    for bad in ("-inf", None, [], 10**400):
        with pytest.raises(_WrongKindError):
            _parameter(bad)
    assert _truth(False) is False
    assert [_count(x) for x in (0, 7, 1 << 30)] == [0, 7, 1 << 30]
    for bad in (-1, (1 << 30) + 1):
        with pytest.raises(_WrongKindError, match="is no number of things"):
            _count(bad)


def test_packed_numbers() -> None:
    values = np.array([1.0, -2.5, 1e-300, math.nan])
    assert _packed(values) == packed(*values)
    found = _unpacked(packed(*values))
    assert np.array_equal(found, values, equal_nan=True)
    assert found.dtype == np.float64
    assert not found.flags.writeable
    # Seven bytes are no double, and what is between the letters is no base64.
    for bad in ("AAAAAAAAAA==", packed(1.0)[:-1] + "!", packed(1.0)[:4] + " " + packed(1.0)[4:]):
        with pytest.raises(_WrongKindError, match="is no base64 of doubles"):
            _unpacked(bad)


def test_packed_regions() -> None:
    found = _occupancies(
        {
            "regions": [1, 0, 2],
            "vertices": [1, 2, 1],
            "radii": packed(0.5, 0.25, 3.0),
            "points": packed(1, 2, 3, 4, 5, 6, 7, 8),
        }
    )
    assert [[r.vertices.tolist() for r in step] for step in found] == [
        [[[1.0, 2.0]]],
        [],
        [[[3.0, 4.0], [5.0, 6.0]], [[7.0, 8.0]]],
    ]
    assert [r.radius for step in found for r in step] == [0.5, 0.25, 3.0]
    assert not found[0][0].vertices.flags.writeable
    assert _occupancies({"regions": [0, 0], "vertices": [], "radii": "", "points": ""}) == ((), ())


def test_small_things() -> None:
    body = {"id": 3, "length": 4, "width": 2, "wheelbase": 2.5}
    assert _body(body) == Body(3, 4.0, 2.0, 2.5)
    assert _lane({"relation": "left", "lanelets": [4, 5]}) == LaneOf("left", (4, 5))
    lanelet = {"id": 4, "left": BORDERS[0], "right": BORDERS[1], "speed_limit": 9}
    found = _pavement(lanelet)
    assert (found.id, found.speed_limit) == (4, 9.0)
    assert (found.left.tolist(), found.right.tolist()) == BORDERS
    assert _pavement({**lanelet, "speed_limit": None}).speed_limit is None
    region = _region({"vertices": [[1, 2]], "radius": 3})
    assert (region.vertices.tolist(), region.radius) == ([[1.0, 2.0]], 3.0)
    driven = _trajectory({"start": 1, "tau": 2, "states": [[1] * 5], "inputs": []})
    assert (driven.start, driven.tau) == (1.0, 2.0)
    assert (driven.states.shape, driven.inputs.shape) == ((1, 5), (0, 2))
    assert _pair("keep,left-lane") == ActionPair.parse("keep,left-lane")
    assert _two_texts(["a", "b"]) == ("a", "b")
    assert _several(_truth)([True, False]) == (True, False)
    texts = _texts_by_name({"a": "b"})
    assert isinstance(texts, MappingProxyType)
    assert texts == {"a": "b"}
    words = _vocabulary({"actions": {"a": "1"}, "rules": {}, "predicates": {"p": "q"}})
    assert isinstance(words, MappingProxyType)
    assert words == {"actions": {"a": "1"}, "rules": {}, "predicates": {"p": "q"}}
    assert _vocabulary(None) is None


def test_a_participant() -> None:
    c = BASE.obstacles[0]
    c = replace(c, assumptions=("a",), dropped=("b", "c"), basis=("d",), is_static=True)
    written = json.loads(json.dumps(to_json(replace(BASE, obstacles=(c,)))))["obstacles"][0]
    found = _participant(written)
    assert (found.id, found.kind, found.is_static) == (7, "car", True)
    assert (found.assumptions, found.dropped, found.basis) == (("a",), ("b", "c"), ("d",))
    assert len(found.likely) == 15
    assert len(found.possible) == 21


NEEDED = {
    *("a_lon_min", "a_lon_max", "a_lat_max", "v_max", "steering_angle_max", "steering_rate_max"),
    *("a_lim", "v_err", "t_d", "a_min", "a_obs_min", "cut_in_exception", "t_c"),
    *("a_abrupt", "v_fov", "v_braking", "v_type", "assumptions"),
}


def test_parameters_that_must_be_there() -> None:
    written = json.loads(json.dumps(to_json(replace(BASE, obstacles=()))["settings"]))
    for name in (*PARAMETERS, "assumptions"):
        less = {key: value for key, value in written.items() if key != name}
        if name in NEEDED:
            with pytest.raises(CertificateError, match=f"^'settings' lacks '{name}'$"):
                _settings(less)
        else:
            assert getattr(_settings(less), name) == getattr(Settings(), name)
    assert _settings({**written, "t_d": 0.75, "horizon": 12}) == Settings(t_d=0.75, horizon=12)
    assert _settings({**written, "precision": "tight"}) == Settings(precision="tight")
    for wrong, said in ((1.0, "is no text"), ("exact", "choose quick or tight")):
        with pytest.raises(CertificateError, match=said):
            _settings({**written, "precision": wrong})
    assumed = {**written["assumptions"], "max_speed": 30}
    loose = _settings({**written, "assumptions": assumed})
    assert loose.assumptions == Assumptions(max_speed=30)
    for name in names_of(Assumptions):
        less = {key: value for key, value in assumed.items() if key != name}
        if name in UNLIMITED:
            assert (
                getattr(_settings({**written, "assumptions": less}).assumptions, name) == math.inf
            )
            continue
        with pytest.raises(CertificateError, match=f"^'assumptions' lacks '{name}'$"):
            _settings({**written, "assumptions": less})


def arrays(value: Any) -> list[np.ndarray]:
    if isinstance(value, np.ndarray):
        return [value]
    if is_dataclass(value):
        return [x for f in fields(value) for x in arrays(getattr(value, f.name))]
    return [x for each in value for x in arrays(each)] if isinstance(value, tuple) else []


def test_nothing_that_was_read_can_be_changed() -> None:
    c = from_json(tree())
    found = arrays(c)
    assert len(found) > 50
    assert not any(x.flags.writeable for x in found)
    assert isinstance(c.versions, MappingProxyType)


def test_what_is_written_of_numbers() -> None:
    assert _listed(np.array([[1.0, math.nan]])) == [[1.0, None]]
    assert _listed(np.array([1.0, 2.0])) == [1.0, 2.0]
    with pytest.raises(CertificateError, match="infinite number"):
        _listed(np.array([math.nan, math.inf]))
    assert [_of_number(x) for x in (math.inf, 2.5, True)] == ["inf", 2.5, True]
    assert names_of(Body) == ("id", "length", "width", "wheelbase")
    assert set(PARAMETERS) == {f.name for f in fields(Settings)} - {"assumptions"}


def test_what_is_written_of_a_certificate() -> None:
    found = tree()
    assert set(found) == {f.name for f in fields(Certificate)}
    for name in ("format", "note", "scenario", "dt", "horizon", "formula", "prediction"):
        assert found[name] == getattr(BASE, name)
    assert found["pair"] == "keep,follow-lane"
    assert found["ego"] == {"id": 1, "length": 4.5, "width": 1.8, "wheelbase": 2.6}
    assert found["rules"] == ["R_G1", "R_G2", "R_G3"]
    assert found["parts"] == [list(x) for x in BASE.parts]
    assert found["lanes"][0] == {"relation": "current", "lanelets": [100]}
    assert found["lanelets"][1] == {
        "id": 101,
        "left": BASE.lanelets[1].left.tolist(),
        "right": BASE.lanelets[1].right.tolist(),
        "speed_limit": 30.0,
    }
    car, c = found["obstacles"][0], BASE.obstacles[0]
    assert car["outline"] == {"vertices": c.outline.vertices.tolist(), "radius": 0.0}
    assert car["likely"]["regions"] == [len(step) for step in c.likely]
    assert car["likely"]["vertices"] == [len(r.vertices) for step in c.likely for r in step]
    assert car["assumptions"] == list(c.assumptions)
    assert found["fail_safe"]["start"] == 0.1
    assert found["fail_safe"]["tau"] == 0.05
    assert found["settings"]["v_type"] == "inf"
    assert found["settings"]["assumptions"]["max_speed"] == 50.0
    assert set(found["settings"]["assumptions"]) == {f.name for f in fields(Assumptions)}
    assert found["vocabulary"] is None
    own = {"actions": {"a": "b"}, "rules": {}, "predicates": {}}
    assert to_json(replace(BASE, vocabulary=own))["vocabulary"] == own


# What is said of what cannot be read


@pytest.mark.parametrize(
    ("path", "value", "sentence"),
    [
        (("dt",), None, "'certificate.dt' is no finite number"),
        (("note",), 1, "'certificate.note' is no text"),
        (("versions",), {"a": 1}, "'certificate.versions' is no text"),
        (("initial",), [[1.0]], "'certificate.initial' is no finite number"),
        (("rules",), [1], "'certificate.rules' is no text"),
        (("parts",), [["a", "b", "c"]], "'certificate.parts' has not two texts each"),
        (("vocabulary",), 1, "'vocabulary' is no JSON object"),
        (
            ("vocabulary",),
            {"actions": {}, "rules": 1, "predicates": {}},
            "'vocabulary.rules' is no JSON object",
        ),
        (("lanes", 0), 1, "'lanes' is no JSON object"),
        (("lanes", 0, "lanelets"), [1.5], "'lanes.lanelets' is no integer"),
        (("lanelets", 0), 1, "'lanelets' is no JSON object"),
        (("lanelets", 0, "speed_limit"), "a", "'lanelets.speed_limit' is no finite number"),
        (("conflicts", 0, "right"), 1, "'lanelets.right' is no array of 2 dimensions"),
        (("reference",), 1, "'certificate.reference' is no array of 2 dimensions"),
        (("obstacles", 0), 1, "'obstacles' is no JSON object"),
        (("obstacles", 0, "basis"), "a", "'obstacles.basis' is no list"),
        (("obstacles", 0, "dropped"), "a", "'obstacles.dropped' is no list"),
        (("obstacles", 0, "outline"), 1, "'region' is no JSON object"),
        (("obstacles", 0, "outline", "radius"), "a", "'region.radius' is no finite number"),
        (("obstacles", 0, "possible"), 1, "'occupancies' is no JSON object"),
        (("obstacles", 0, "possible", "radii"), 1, "'occupancies.radii' is no text"),
        (("witness",), 1, "'trajectory' is no JSON object"),
        (("witness", "inputs"), 1, "'trajectory.inputs' is no array of 2 dimensions"),
        (("ego", "id"), 1.0, "'ego.id' is no integer"),
        (("settings",), 1, "'settings' is no JSON object"),
        (("settings", "t_d"), "a", "'settings.t_d' is no finite number"),
        (("settings", "assumptions"), 1, "'assumptions' is no JSON object"),
        (
            ("settings", "assumptions", "no_rear_end"),
            "a",
            "'assumptions.no_rear_end' is no finite number",
        ),
        (("x" * 50,), 1, f"'certificate' has unknown '{'x' * 40}'"),
        (
            ("format",),
            "y" * 50,
            f"its format is '{'y' * 40}', only 'sandra-certificate/1' is known",
        ),
    ],
)
def test_what_is_said_of_a_wrong_entry(
    path: tuple[str | int, ...], value: Any, sentence: str
) -> None:
    whole = tree()
    place = whole
    for key in path[:-1]:
        place = place[key]
    place[path[-1]] = value
    with pytest.raises(CertificateError) as error:
        from_json(whole)
    assert str(error.value) == sentence


def test_of_several_missing_or_unknown_keys_the_first_is_named() -> None:
    less = tree()
    del less["dt"], less["ego"]
    with pytest.raises(CertificateError, match=r"^'certificate' lacks 'dt'$"):
        from_json({**less, "about": 1})
    with pytest.raises(CertificateError, match=r"^'certificate' has unknown 'a'$"):
        from_json({**tree(), "b": 1, "a": 1})
    strange = tree()
    strange["settings"]["more"] = 1
    with pytest.raises(CertificateError, match=r"^'settings' has unknown 'more'$"):
        from_json(strange)
    bad = tree()
    bad["settings"]["a_lon_min"] = 100.0
    with pytest.raises(CertificateError, match=r"^its settings cannot be used: "):
        from_json(bad)
    assert reading.MOST == 1 << 30


# Files


@pytest.mark.parametrize("name", ["c.json", "c.json.gz"])
def test_a_file_is_plain_json_without_spaces(tmp_path: Path, name: str) -> None:
    path = save(replace(BASE, scenario="Stra\u00dfe"), str(tmp_path / name))
    assert path == tmp_path / name
    data = path.read_bytes()
    text = gzip.decompress(data) if name.endswith("gz") else data
    expected = to_json(replace(BASE, scenario="Stra\u00dfe"))
    assert text == json.dumps(expected, separators=(",", ":")).encode("ascii")
    if name.endswith("gz"):
        # No time of writing.
        assert data[4:8] == b"\0\0\0\0"
    assert load(str(path)).scenario == "Stra\u00dfe"


@pytest.mark.parametrize("name", ["c.json", "c.json.gz"])
def test_a_file_may_be_as_large_as_allowed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    assert LARGEST_FILE == 1 << 30
    path = save(BASE, tmp_path / name)
    size = len(json.dumps(to_json(BASE), separators=(",", ":")))
    monkeypatch.setattr(file, "LARGEST_FILE", size)
    assert load(path).scenario == BASE.scenario
    monkeypatch.setattr(file, "LARGEST_FILE", size - 1)
    with pytest.raises(CertificateError) as error:
        load(path)
    assert str(error.value) == f"{path}: larger than {size - 1} bytes, no certificate"


def test_what_is_no_number_is_not_written(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="not JSON compliant"):
        save(replace(BASE, dt=math.nan), tmp_path / "c.json")


def test_why_a_file_cannot_be_used(tmp_path: Path) -> None:
    path = tmp_path / "c.gz"
    good = gzip.compress(json.dumps(tree()).encode())
    for content, why in (
        (good[:-100], "cannot be read (Compressed file ended before the end-of-stream marker"),
        (b"no gzip", "cannot be read (Not a gzipped file (b'no'))"),
        (good[:20] + b"\xff" * 40 + good[60:], "cannot be read (Error -3 while decompressing data"),
        (gzip.compress(b'{"dt": NaN}'), "not a JSON file (NaN is no JSON)"),
        (gzip.compress(b"{"), "not a JSON file (Expecting property name"),
        (gzip.compress(b"{}"), "its format is 'None', only 'sandra-certificate/1' is known"),
    ):
        path.write_bytes(content)
        with pytest.raises(CertificateError) as error:
            load(path)
        assert str(error.value).startswith(f"{path}: {why}")


# Times and ways


def test_the_constants_of_times() -> None:
    assert (times.LONGEST_TAU, times.SHORTEST_TAU) == (0.05, 1e-4)
    assert (times.ROUNDING, times.SAME, cut_in.SLACK) == (1e-9, 1e-9, 1e-3)
    assert times.steps_per_dt(BASE) == 2
    assert times.decision_point(replace(BASE, t_dec=0.7)) == 14


@pytest.mark.parametrize("column", range(5))
def test_how_far_first_states_are_apart_is_told(column: int) -> None:
    apart = np.zeros(5)
    apart[column] = 0.4e-9
    near = times.initial_state(replace(BASE, initial=BASE.initial + apart))
    assert isinstance(near, Checked)
    # Numbers of the size of 10 are known to 1e-15.
    assert near.margin == pytest.approx(0.6e-9, rel=1e-4)
    apart[column] = -0.25
    entry = ("x", "y", "heading", "speed", "steering angle")[column]
    unit = ("m", "m", "rad", "m/s", "rad")[column]
    found, wanted = BASE.initial[column], BASE.initial[column] - 0.25
    assert times.initial_state(replace(BASE, initial=BASE.initial + apart)) == Violation(
        "initial-state",
        f"the witness's first state has {entry} {found:.6f} {unit} at 0.00 s, it must be "
        f"{wanted:.6f}",
        0,
        0.0,
        found,
        wanted,
    )


def test_who_may_cut_in_and_how_much_it_must_leave() -> None:
    """The second car alone may; the ego brakes hard, and then mildly for 5 m/s / (1 m/s^2)."""
    stop = np.vstack([constant(-6.0, 10), constant(-1.0, 140)])
    c = made(stop=stop, rules=())
    first, second = c.obstacles
    relying = replace(second, assumptions=("legal_cut_in",))
    c = replace(c, obstacles=(replace(first, assumptions=()), relying))
    # At 7 m/s it still goes 24.5 m, and needs 49 / 12 + 2.8 m: the most is missing there.
    v = 7.0
    found = cut_in.cut_in(c)
    assert found == Violation(
        "cut-in",
        "0.60 s from now the ego still goes 24.50 m; who cuts in legally, like obstacle 8, need "
        "only leave 6.88 m",
        12,
        pytest.approx(12 * TAU),
        pytest.approx(v**2 / 2),
        pytest.approx(v**2 / 12 + v * 0.4),
    )
    looser = replace(c, settings=c.settings.replace(a_min=-4.0, t_d=0.8))
    answer = cut_in.cut_in(looser)
    assert isinstance(answer, Violation)
    assert answer.allowed == pytest.approx(v**2 / 8 + v * 0.8)
    assert isinstance(cut_in.cut_in(replace(c, obstacles=c.obstacles[:1])), Checked)
