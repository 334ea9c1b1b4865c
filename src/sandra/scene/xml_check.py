"""What is looked at in a CommonRoad XML file before commonroad-io reads it.

commonroad-io fills values in where they are absent, ignores where a shape lies in the body, no
longer supports groups of shapes, and needs parts that the format does not. Here such values are
noted, such shapes and parts put into a form that it reads, and malformed states named.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import IO
from xml.etree import ElementTree

import numpy as np
from numpy.typing import NDArray

from sandra.errors import ScenarioError
from sandra.scene.convex import hull

Array = NDArray[np.float64]
Element = ElementTree.Element

_VERSIONS = ("2018b", "2020a")
_OBSTACLES = ("obstacle", "staticObstacle", "dynamicObstacle")
_PLACES = ("point", "rectangle", "circle", "polygon", "lanelet")
_CORNERS = 32
"""Corners of the polygon around a disc that is part of a group of shapes."""


@dataclass(frozen=True, slots=True, eq=False)
class Facts:
    """What commonroad-io's objects do not tell of a file."""

    initial: Mapping[int, Mapping[str, float]] | None = None
    """Per obstacle and planning problem: the numbers of its initial state by XML name (centres of
    intervals); None where it is not known which ones the file gives."""
    weather: str | None = None
    time_of_day: str | None = None


def checked(path: Path, head: bytes, rest: IO[bytes]) -> tuple[Facts, bytes]:
    """Check an XML file; return its facts and the XML text that commonroad-io is to read.

    Args:
        path: for messages. head: its first bytes, which decide whether the rest is read at all.
        rest: the open file after `head`.

    Raises:
        ScenarioError: not XML, truncated, no CommonRoad file, or a malformed state.
    """
    tags: list[str] = []
    try:
        beginning = ElementTree.XMLParser(target=_Tags(tags))
        beginning.feed(head)
        if tags and tags[0] != "commonRoad":
            raise ScenarioError(
                f"{path}: not a CommonRoad file (its root is <{tags[0]}>, not <commonRoad>)"
            )
        data = head + rest.read()
        root = ElementTree.fromstring(data)
    except (ElementTree.ParseError, LookupError, ValueError) as error:
        raise ScenarioError(
            f"{path}: not well-formed XML or truncated ({error}); get the complete file"
        ) from None
    _check_header(path, root)
    initial = {}
    for node in root:
        if node.tag in (*_OBSTACLES, "planningProblem"):
            initial[_id(path, node)] = _check_states(path, node)
        elif node.tag == "lanelet":
            _check_borders(path, node)
    _check_problems(path, root)
    location = root.find("location")
    environment = location.find("environment") if location is not None else None
    facts = Facts(initial, _text(environment, "weather"), _text(environment, "timeOfDay"))
    changed = _mended(path, root)
    if location is not None and environment is not None:
        location.remove(environment)
        changed = True
    return facts, ElementTree.tostring(root) if changed else data


class _Tags:
    """A parser target that only notes the names of the elements."""

    def __init__(self, tags: list[str]) -> None:
        self._tags = tags

    def start(self, tag: str, _attributes: dict[str, str]) -> None:
        self._tags.append(tag)


def _check_header(path: Path, root: Element) -> None:
    version = root.get("commonRoadVersion")
    if version not in _VERSIONS:
        raise ScenarioError(
            f"{path}: commonRoadVersion '{version}' is not supported; use {' or '.join(_VERSIONS)}"
        )
    dt = _float(root.get("timeStepSize"))
    if not (math.isfinite(dt) and dt > 0):
        raise ScenarioError(
            f"{path}: the time step dt = {root.get('timeStepSize')} must be a number > 0; "
            "set timeStepSize"
        )
    if root.find("lanelet") is None:
        raise ScenarioError(f"{path}: no lanelets; the scenario needs a map")
    if root.find("planningProblem") is None:
        raise ScenarioError(
            f"{path}: no planning problem; add one that tells the ego's initial state"
        )


def _check_borders(path: Path, node: Element) -> None:
    borders = [
        [[_float(p.findtext(axis)) for axis in "xy"] for p in node.iterfind(f"{side}Bound/point")]
        for side in ("left", "right")
    ]
    same = len(borders[0]) == len(borders[1]) >= 2
    if not same or not np.isfinite(borders).all():
        raise ScenarioError(
            f"{path}: lanelet {node.get('id')} needs two borders with the same number (>= 2) of "
            "finite points; mend it"
        )


def _check_problems(path: Path, root: Element) -> None:
    for node in root.iter("planningProblem"):
        state = node.find("initialState")
        for name in ("time", "position", "orientation", "velocity"):
            if state is None or state.find(name) is None:
                raise ScenarioError(
                    f"{path}: planning problem {node.get('id')} has no initial {name}; add it"
                )


def _check_states(path: Path, node: Element) -> dict[str, float]:
    """The numbers of the initial state; every state of the node has values that can be read."""
    where = f"{path}: {node.tag} {node.get('id')}"
    numbers: dict[str, float] = {}
    for tag in ("initialState", "state", "goalState"):
        for state in node.iter(tag):
            values = _numbers(where, state)
            if tag == "initialState":
                numbers = values
            if tag != "goalState":
                for name, value in values.items():
                    if not math.isfinite(value):
                        kind = tag.replace("S", " s")
                        raise ScenarioError(f"{where}: {kind}: {name} is no finite number; mend it")
    return numbers


def _numbers(where: str, state: Element) -> dict[str, float]:
    """The numbers of a state by XML name, centres of intervals."""
    numbers: dict[str, float] = {}
    for value in state:
        if value.tag == "position":
            if not any(value.find(place) is not None for place in _PLACES):
                raise ScenarioError(f"{where}: a state has an empty position; mend it")
            if value.find("point") is not None:
                numbers["position x"] = _float(value.findtext("point/x"))
                numbers["position y"] = _float(value.findtext("point/y"))
            continue
        exact = value.findtext("exact")
        if exact is not None:
            numbers[value.tag] = _float(exact)
            continue
        bounds = value.findtext("intervalStart"), value.findtext("intervalEnd")
        if None in bounds:
            raise ScenarioError(f"{where}: a state has a <{value.tag}> without a value; mend it")
        numbers[value.tag] = (_float(bounds[0]) + _float(bounds[1])) / 2
    return numbers


def _mended(path: Path, root: Element) -> bool:
    """Put what commonroad-io cannot read into a form that it reads; whether anything changed."""
    changed = False
    if root.get("tags") is None and root.get("commonRoadVersion") == "2018b":
        root.set("tags", "")
        changed = True
    if root.find("scenarioTags") is None and root.get("commonRoadVersion") != "2018b":
        ElementTree.SubElement(root, "scenarioTags")
        changed = True
    for light in root.iter("trafficLight"):
        if light.find("cycle") is None:
            ElementTree.SubElement(light, "cycle")
            changed = True
    for node in (n for tag in _OBSTACLES for n in root.iter(tag)):
        shape = node.find("shape")
        parts = [] if shape is None else list(shape)
        if shape is None or not parts:
            raise ScenarioError(f"{path}: {node.tag} {node.get('id')} has no shape; add one")
        if len(parts) > 1 or any(_displaced(part) for part in parts):
            points = np.vstack([p for part in parts for p in _corners(path, node, part)])
            for part in parts:
                shape.remove(part)
            polygon = ElementTree.SubElement(shape, "polygon")
            for x, y in hull(points):
                point = ElementTree.SubElement(polygon, "point")
                ElementTree.SubElement(point, "x").text = repr(float(x))
                ElementTree.SubElement(point, "y").text = repr(float(y))
            changed = True
    return changed


def _displaced(part: Element) -> bool:
    """Whether a shape is not centred in the body, which commonroad-io ignores."""
    values = [part.findtext(tag) for tag in ("orientation", "center/x", "center/y")]
    return part.tag in ("rectangle", "circle") and any(
        text is not None and abs(_float(text)) > 1e-9 for text in values
    )


def _corners(path: Path, node: Element, part: Element) -> Iterator[Array]:
    center = np.array([_float(part.findtext(f"center/{axis}", "0")) for axis in "xy"])
    if part.tag == "rectangle":
        a, b = (_float(part.findtext(tag)) / 2 for tag in ("length", "width"))
        angle = _float(part.findtext("orientation", "0"))
        c, s = math.cos(angle), math.sin(angle)
        corners = np.array([[-a, -b], [a, -b], [a, b], [-a, b]])
        points = corners @ np.array([[c, s], [-s, c]]) + center
    elif part.tag == "circle":
        angles = np.arange(_CORNERS) * (2 * math.pi / _CORNERS)
        radius = _float(part.findtext("radius")) / math.cos(math.pi / _CORNERS)
        points = radius * np.stack([np.cos(angles), np.sin(angles)], axis=1) + center
    else:
        rows = [[_float(p.findtext("x")), _float(p.findtext("y"))] for p in part.iter("point")]
        points = np.array(rows).reshape(-1, 2)
    if len(points) < 3 or not np.isfinite(points).all():
        raise ScenarioError(
            f"{path}: {node.tag} {node.get('id')} has a shape <{part.tag}> that cannot be read "
            "in a group; write it as rectangles, circles and polygons"
        )
    yield points


def _id(path: Path, node: Element) -> int:
    try:
        return int(node.get("id", ""))
    except ValueError:
        raise ScenarioError(
            f"{path}: a {node.tag} has the id '{node.get('id')}', which is no integer; mend it"
        ) from None


def _float(text: str | None) -> float:
    try:
        return float(text or "nan")
    except ValueError:
        return math.nan


def _text(node: Element | None, tag: str) -> str | None:
    text = node.findtext(tag) if node is not None else None
    return text.strip() if text and text.strip() not in ("", "unknown") else None
