"""The edge to commonroad-io: from a file to its objects, or to one `ScenarioError`."""

from __future__ import annotations

import contextlib
import logging
import math
import threading
import warnings
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from sandra.errors import ScenarioError
from sandra.scene.sent import opened
from sandra.scene.xml_check import Facts, checked

_PEEK = 65536
"""Bytes looked at before the rest of a file is read."""
_BOMS = (b"\xef\xbb\xbf", b"\xff\xfe", b"\xfe\xff")
_MALFORMED = (ArithmeticError, AssertionError, AttributeError, LookupError, TypeError, ValueError)
"""What commonroad-io 2026.1 raises for malformed content that `xml_check` lets pass."""
_ONE_AT_A_TIME = threading.Lock()


@dataclass(frozen=True, slots=True, eq=False)
class Content:
    """What a file holds: commonroad-io's objects, and what those objects do not tell."""

    scenario: Any
    """commonroad.scenario.scenario.Scenario"""
    problems: Mapping[int, Any]
    """commonroad.planning.planning_problem.PlanningProblem by id, in ascending order."""
    facts: Facts


def read(path: Path) -> Content:
    """Read a CommonRoad file: XML 2018b or 2020a, or protobuf.

    A protobuf scenario consists of three files in one folder; give the one of the scenario
    (`...-SC.pb`), the map and the dynamic part are found by the names in it.

    Raises:
        ScenarioError: one line that says why the file cannot be used.
    """
    try:
        if path.is_dir():
            raise ScenarioError(f"{path}: is a directory; name a CommonRoad file in it")
        with opened(path) as file:
            head = file.read(_PEEK)
            kind = _kind(path, head)
            if kind == "xml":
                facts, data = checked(path, head, file)
    except FileNotFoundError:
        raise ScenarioError(f"{path}: no such file; check the path") from None
    except OSError as error:
        raise ScenarioError(f"{path}: cannot be read ({error.strerror}); check the path") from None
    if kind == "protobuf":
        return _read_protobuf(path)
    # The reader of all formats would load protobuf as well.
    from commonroad.common.reader.file_reader_xml import XMLFileReader

    with _quiet(), _malformed(path):
        scenario, problems = XMLFileReader(data).open()
    return _content(path, scenario, problems, facts)


def _kind(path: Path, head: bytes) -> str:
    start = head.lstrip()
    for mark in _BOMS:
        start = start.removeprefix(mark).lstrip()
    if start.startswith((b"<", b"\x00<")):
        return "xml"
    if path.suffix == ".pb":
        return "protobuf"
    what = "an empty file" if not head else "neither XML nor protobuf (.pb)"
    raise ScenarioError(f"{path}: not a CommonRoad file ({what}); give a scenario as .xml")


def _read_protobuf(path: Path) -> Content:
    from commonroad.common.file_reader import CommonRoadFileReader
    from google.protobuf.message import DecodeError  # type: ignore[import-untyped]

    try:
        _check_frame(path)
        with _quiet(), _malformed(path):
            described = CommonRoadFileReader(filename_scenario=path).open_scenario()
            parts = [path.parent / f"{i}.pb" for i in (described.map_id, described.dynamic_id)]
            if not (described.map_id and described.dynamic_id):
                raise ScenarioError(
                    f"{path}: names no map or dynamic part; give the file ...-SC.pb"
                )
            for part in parts:
                if not part.is_file():
                    raise ScenarioError(
                        f"{path}: its part {part.name} is missing; put it into the same folder"
                    )
                _check_frame(part)
            reader = CommonRoadFileReader(
                filename_scenario=path, filename_map=parts[0], filename_dynamic=parts[1]
            )
            scenario, problems, _ = reader.open_all()
            environment = reader.open_dynamic().environment
    except DecodeError:
        raise ScenarioError(
            f"{path}: not a CommonRoad protobuf file (cannot be decoded); write it anew"
        ) from None
    weather = getattr(getattr(environment, "weather", None), "value", None)
    time_of_day = getattr(getattr(environment, "time_of_day", None), "value", None)
    return _content(path, scenario, problems, Facts(weather=weather, time_of_day=time_of_day))


def _check_frame(path: Path) -> None:
    """Raises `DecodeError` unless the file is a row of fields that fills it.

    CommonRoad's messages hold numbers and what has a length. The decoder itself may go through
    hundreds of megabytes of something else, byte by byte.
    """
    from google.protobuf.message import DecodeError

    data = path.read_bytes()
    place = 0
    while place < len(data):
        tag, place = _varint(data, place)
        value, place = _varint(data, place)
        if tag & 7 == 2:
            place += value
        if tag & 7 not in (0, 2) or tag >> 3 == 0 or place > len(data):
            raise DecodeError("not a row of fields")


def _varint(data: bytes, place: int) -> tuple[int, int]:
    """A number of at most ten bytes, and the place after it, beyond the end where there is none."""
    value = 0
    for i, byte in enumerate(data[place : place + 10]):
        value |= (byte & 127) << (7 * i)
        if byte < 128:
            return value, place + i + 1
    return 0, len(data) + 1


def _content(path: Path, scenario: Any, problems: Any, facts: Facts) -> Content:
    if not scenario.lanelet_network.lanelets:
        raise ScenarioError(f"{path}: no lanelets; the scenario needs a map")
    if not math.isfinite(scenario.dt) or scenario.dt <= 0:
        raise ScenarioError(
            f"{path}: the time step dt = {scenario.dt} must be a number > 0; set timeStepSize"
        )
    found = problems.planning_problem_dict
    if not found:
        raise ScenarioError(
            f"{path}: no planning problem; add one that tells the ego's initial state"
        )
    return Content(scenario, {i: found[i] for i in sorted(found)}, facts)


@contextlib.contextmanager
def _malformed(path: Path) -> Iterator[None]:
    from shapely.errors import ShapelyError

    try:
        yield
    except (*_MALFORMED, ShapelyError) as error:
        detail = " ".join(str(error).split())[:200] or "no detail given"
        raise ScenarioError(
            f"{path}: malformed CommonRoad content ({type(error).__name__}: {detail}); "
            "check it against the CommonRoad schema"
        ) from None


@contextlib.contextmanager
def _quiet() -> Iterator[None]:
    """commonroad-io reports each deprecated element by log and by warning; none is for the user."""
    logger = logging.getLogger("commonroad")
    # Levels and filters belong to the whole process: one file after the other, or a thread would
    # take for the level before what another has set meanwhile.
    with _ONE_AT_A_TIME:
        level = logger.level
        logger.setLevel(logging.ERROR)
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                yield
        finally:
            logger.setLevel(level)
