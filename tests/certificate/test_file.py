"""Files: bit for bit, strict, and never a crash."""

from __future__ import annotations

import gzip
import json
import math
import random
from collections.abc import Iterator
from dataclasses import fields, is_dataclass, replace
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from certified import made, turning_scene
from sandra.certificate import Certificate, Report, check, check_file, load, save
from sandra.certificate.file import LARGEST_FILE
from sandra.certificate.reading import from_json
from sandra.certificate.writing import to_json
from sandra.errors import CertificateError
from sandra.logic import Vocabulary
from sandra.scene.types import Region
from sandra.settings import Settings

CERTIFICATE = made(turning_scene(0.02))
SMALL = made(turning_scene())
TREE = to_json(SMALL)
TEXT = json.dumps(TREE)


def same(a: Any, b: Any) -> bool:
    """Equal in every bit of every array."""
    if isinstance(a, np.ndarray):
        return a.dtype == b.dtype and a.shape == b.shape and a.tobytes() == b.tobytes()
    if is_dataclass(a):
        return type(a) is type(b) and all(
            same(getattr(a, f.name), getattr(b, f.name)) for f in fields(a)
        )
    if isinstance(a, tuple):
        return len(a) == len(b) and all(same(x, y) for x, y in zip(a, b, strict=True))
    return bool(a == b)


def absent(c: Certificate) -> Certificate:
    """The first obstacle is not there at the last step."""
    states = c.obstacles[0].states.copy()
    states[-1] = math.nan
    return replace(c, obstacles=(replace(c.obstacles[0], states=states), *c.obstacles[1:]))


def own_words(c: Certificate) -> Certificate:
    words = Vocabulary.default()
    texts = {"actions": words.actions, "rules": words.rules, "predicates": words.predicates}
    return replace(c, vocabulary=MappingProxyType(texts))


@pytest.mark.parametrize("name", ["c.json", "c.json.gz"])
@pytest.mark.parametrize("change", [lambda c: c, absent, own_words])
def test_it_comes_back_bit_for_bit(tmp_path: Path, name: str, change: Any) -> None:
    certificate = change(CERTIFICATE)
    path = save(certificate, tmp_path / name)
    assert same(load(path), certificate)
    assert check_file(path) == check(certificate)


@given(st.lists(st.floats(-1e7, 1e7), min_size=5, max_size=5))
def test_every_double_comes_back(values: list[float]) -> None:
    certificate = replace(SMALL, obstacles=(), initial=np.array(values))
    text = json.dumps(to_json(certificate))
    assert same(from_json(json.loads(text)).initial, certificate.initial)


def test_equal_certificates_are_equal_files(tmp_path: Path) -> None:
    one, two = save(CERTIFICATE, tmp_path / "a.gz"), save(CERTIFICATE, tmp_path / "b.gz")
    assert one.read_bytes()[10:] == two.read_bytes()[10:]


def test_an_infinite_speed_limit_of_the_type_comes_back(tmp_path: Path) -> None:
    assert CERTIFICATE.settings.v_type == math.inf
    assert load(save(CERTIFICATE, tmp_path / "c")).settings == Settings()


def test_it_cannot_be_written_where_there_is_no_folder(tmp_path: Path) -> None:
    with pytest.raises(CertificateError, match="cannot be written"):
        save(CERTIFICATE, tmp_path / "absent" / "c.json")


def test_an_infinite_coordinate_is_not_written(tmp_path: Path) -> None:
    broken = replace(CERTIFICATE, reference=np.array([[0.0, 0.0], [math.inf, 0.0]]))
    with pytest.raises(CertificateError, match="infinite"):
        save(broken, tmp_path / "c.json")


@pytest.mark.parametrize(
    ("content", "match"),
    [
        (b"", "not a JSON file"),
        (b"\xff\xfe\x00", "not a JSON file"),
        (b"[" * 100_000, "not a JSON file"),
        (b'{"dt": NaN}', "not a JSON file"),
        (b'{"dt": Infinity}', "not a JSON file"),
        (b'{"dt": ' + b"9" * 5000 + b"}", "not a JSON file"),
        (b"[]", "its format is 'None'"),
        (b"{}", "its format is 'None'"),
        (b'{"format": "sandra-certificate/2"}', "sandra-certificate/2"),
        (b'{"format": "sandra-certificate/1"}', "'certificate' lacks"),
    ],
)
def test_what_is_no_certificate_is_refused(tmp_path: Path, content: bytes, match: str) -> None:
    path = tmp_path / "c.json"
    path.write_bytes(content)
    with pytest.raises(CertificateError, match=match):
        check_file(path)


def test_a_missing_file_and_broken_gzip_are_refused(tmp_path: Path) -> None:
    with pytest.raises(CertificateError, match="cannot be read"):
        load(tmp_path / "absent.json")
    path = tmp_path / "c.gz"
    good = gzip.compress(json.dumps(TREE).encode())
    for content in (b"no gzip", good[:-100], good[:20] + b"\x00\xff" * 40 + good[100:]):
        path.write_bytes(content)
        with pytest.raises(CertificateError, match=r"cannot be read|not a JSON file"):
            load(path)


def test_why_a_file_cannot_be_read_is_told(tmp_path: Path) -> None:
    with pytest.raises(CertificateError, match=r"cannot be read \(No such file or directory\)"):
        load(tmp_path / "none.json")


def test_a_huge_file_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert LARGEST_FILE > 1 << 20
    monkeypatch.setattr("sandra.certificate.file.LARGEST_FILE", 100)
    path = save(CERTIFICATE, tmp_path / "c.json")
    with pytest.raises(CertificateError, match="larger than 100 bytes"):
        load(path)


def put(path: tuple[str | int, ...], value: Any) -> Any:
    found = json.loads(TEXT)
    place = found
    for key in path[:-1]:
        place = place[key]
    place[path[-1]] = value
    return found


@pytest.mark.parametrize(
    ("path", "value", "match"),
    [
        (("extra",), 1, "unknown 'extra'"),
        (("dt",), "0.1", r"certificate\.dt' is no finite number"),
        (("dt",), True, "no finite number"),
        (("dt",), 10**400, "no finite number"),
        (("horizon",), 1.5, "no integer"),
        (("horizon",), True, "no integer"),
        (("pair",), "fly,away", "no action pair"),
        (("pair",), 3, "no text"),
        (("rules",), "R_G1", "no list"),
        (("parts",), [["one"]], "two texts"),
        (("versions",), [], "no JSON object"),
        (("versions",), {"numpy": 2}, "no text"),
        (("vocabulary",), {"actions": {}}, "lacks"),
        (("ego",), [], "no JSON object"),
        (("ego", "length"), None, "no finite number"),
        (("initial",), 3.0, "no array"),
        (("reference",), [1.0, 2.0], "no array"),
        (("reference",), [[1.0, 2.0], [3.0]], "different lengths"),
        (("reference",), [[1.0, "x"]], "no finite number"),
        (("obstacles", 0, "is_static"), 0, "neither true nor false"),
        (("obstacles", 0, "outline", "radius"), None, "no finite number"),
        (("obstacles", 0, "likely", "regions", 0), -1, "no number of things"),
        (("obstacles", 0, "likely", "regions", 0), 2, "as many numbers"),
        (("obstacles", 0, "likely", "vertices", 0), 3, "as many numbers"),
        (("obstacles", 0, "likely", "radii"), "", "as many numbers"),
        (("obstacles", 0, "likely", "points"), "AAAA", "no base64 of doubles"),
        (("obstacles", 0, "likely", "points"), "\u00e4", "no base64 of doubles"),
        (("obstacles", 0, "likely", "points"), [], "no text"),
        (("settings", "a_lon_min"), 100.0, "settings cannot be used"),
        (("settings", "v_max"), 10**400, "no finite number"),
        (("settings", "v_max"), None, "no finite number"),
        (("settings", "assumptions"), None, "no JSON object"),
        (("settings", "wings"), 2, "unknown 'wings'"),
    ],
)
def test_each_wrong_entry_is_named(path: tuple[str | int, ...], value: Any, match: str) -> None:
    with pytest.raises(CertificateError, match=match):
        from_json(put(path, value))


@pytest.mark.parametrize(
    ("path", "name"),
    [
        (("note",), "certificate"),
        (("ego", "width"), "ego"),
        (("lanes", 0, "relation"), "lanes"),
        (("lanelets", 0, "left"), "lanelets"),
        (("conflicts", 0, "left"), "lanelets"),
        (("obstacles", 0, "kind"), "obstacles"),
        (("obstacles", 0, "outline", "radius"), "region"),
        (("obstacles", 0, "likely", "radii"), "occupancies"),
        (("witness", "tau"), "trajectory"),
        (("settings", "t_d"), "settings"),
        (("settings", "assumptions", "max_speed"), "assumptions"),
    ],
)
def test_where_a_key_is_missing_is_told(path: tuple[str | int, ...], name: str) -> None:
    tree = json.loads(TEXT)
    tree["conflicts"] = tree["conflicts"] or tree["lanelets"]
    place = tree
    for key in path[:-1]:
        place = place[key]
    del place[path[-1]]
    with pytest.raises(CertificateError, match=f"'{name}' lacks '{path[-1]}'"):
        from_json(tree)


def test_needed_parameters_must_be_there_others_need_not() -> None:
    lean = json.loads(TEXT)
    del lean["settings"]["cell_s"]
    assert check(from_json(lean)).accepted
    bounds = "a_lon_min a_lon_max a_lat_max v_max steering_angle_max steering_rate_max"
    of_rules = "a_lim v_err t_d a_min a_obs_min cut_in_exception t_c"
    limits = "a_abrupt v_fov v_braking v_type"
    for name in f"{bounds} {of_rules} {limits} assumptions".split():
        less = json.loads(TEXT)
        del less["settings"][name]
        with pytest.raises(CertificateError, match=f"lacks '{name}'"):
            from_json(less)


def leaves(tree: Any, path: tuple[str | int, ...] = ()) -> Iterator[tuple[str | int, ...]]:
    if isinstance(tree, dict | list):
        for key, value in tree.items() if isinstance(tree, dict) else enumerate(tree):
            yield from leaves(value, (*path, key))
    else:
        yield path


LEAVES = list(leaves(TREE))
BRANCHES = sorted({path[:n] for path in LEAVES for n in range(1, len(path))}, key=str)
FEW = [p for p in LEAVES if p[0] not in ("lanelets", "reference", "obstacles")]

VERTEX = st.sampled_from([0.0, 1e-50, 12.0, -1e7, 1e7]) | st.floats(-1e7, 1e7) | st.floats(-30, 30)
VALUES = st.one_of(
    st.floats(allow_nan=False, allow_infinity=False),
    st.floats(-100.0, 100.0),
    st.integers(-(10**30), 10**30),
    st.sampled_from([None, True, False, "", "inf", "G(true)", [], {}, [[]], 0, -1, 1e7, 1e-300]),
    st.text(max_size=8),
)


@settings(max_examples=150, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(st.sampled_from(FEW) | st.sampled_from(LEAVES) | st.sampled_from(BRANCHES), VALUES)
def test_any_entry_may_be_anything(path: tuple[str | int, ...], value: Any) -> None:
    _survives(put(path, value))


@settings(max_examples=100, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(st.integers(0, 2**32), st.sampled_from([1e-9, 1e-3, 1.0, 1e3, 1e6, 1e12]))
def test_many_numbers_may_be_off(seed: int, size: float) -> None:
    chance = random.Random(seed)
    tree = json.loads(TEXT)
    for path in chance.sample(LEAVES, 10):
        place = tree
        for key in path[:-1]:
            place = place[key]
        if isinstance(place[path[-1]], float):
            place[path[-1]] += chance.gauss(0.0, size)
    _survives(tree)


@settings(max_examples=60, deadline=None)
@given(
    st.integers(0, 20),
    st.lists(st.tuples(VERTEX, VERTEX), min_size=1, max_size=6),
    st.just(0.0) | st.floats(1e-50, 1e7),
)
def test_a_region_may_be_anywhere(
    k: int, vertices: list[tuple[float, float]], radius: float
) -> None:
    region = Region(np.array(vertices), radius)
    obstacle = SMALL.obstacles[0]
    steps = list(obstacle.possible)
    steps[k] = (*steps[k], region)
    likely = ((region,), *obstacle.likely[1:])
    for changed in (replace(obstacle, possible=tuple(steps)), replace(obstacle, likely=likely)):
        _survives(to_json(replace(SMALL, obstacles=(changed,))))


def _survives(tree: Any) -> None:
    """Either it is no certificate, or the checker has an answer that can be written."""
    try:
        certificate = from_json(tree)
    except CertificateError:
        return
    report = check(certificate)
    assert isinstance(report, Report)
    assert str(report)
    json.dumps(report.to_dict(), allow_nan=False)
