"""Condition `format`: the data is what it says it is, so that nothing after it can stumble.

Types, shapes, finite numbers of a sensible size. Nothing here judges what is claimed.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import fields
from typing import TypeVar

import numpy as np

from sandra.actions import ActionPair
from sandra.certificate.report import Checked, Violation
from sandra.certificate.types import (
    FORMAT,
    RELATIONS,
    UNLIMITED,
    Body,
    Certificate,
    Participant,
    Pavement,
)
from sandra.logic.vocabulary import ACTION_NAMES
from sandra.planning.types import Trajectory
from sandra.scene.types import Region
from sandra.settings import Assumptions, Settings

T = TypeVar("T")

DOUBLE = np.dtype(np.float64)
LARGEST = 1e7
"""No number is larger than this: coordinates, angles, speeds, durations."""
SMALLEST = 1e-50
"""No number but 0 is smaller than this: its square would be no normal double any more."""
LONGEST = 100_000
"""No trajectory has more grid points, no prediction more steps."""
MOST_RULES = 50
"""No specification has more rules."""


def form(c: Certificate) -> Checked | Violation:
    """The format is known; all numbers are finite, all arrays have the shapes that they must."""
    for problem in _problems(c):
        return Violation("format", problem)
    return Checked("format", f"{FORMAT}, {len(c.obstacles)} others, {len(c.lanelets)} lanelets")


def _problems(c: Certificate) -> Iterator[str]:
    if c.format != FORMAT:
        yield f"the format is {c.format!r}, only {FORMAT!r} is known"
    for name in ("scenario", "formula", "prediction", "set_based", "note"):
        if not isinstance(getattr(c, name), str):
            yield f"'{name}' is no text"
    for name in ("dt", "t_dec"):
        if not _number(getattr(c, name)):
            yield f"'{name}' = {getattr(c, name)!r} is no finite number"
    if not _integer(c.horizon) or not 1 <= c.horizon <= LONGEST:
        yield f"'horizon' = {c.horizon!r} is no number of steps >= 1"
    if not isinstance(c.pair, ActionPair):
        yield "'pair' is no action pair"
    for name in ("rules", "notes"):
        if not _texts(getattr(c, name)):
            yield f"'{name}' are no texts"
    if isinstance(c.rules, tuple) and len(c.rules) > MOST_RULES:
        yield f"{len(c.rules)} rules are more than {MOST_RULES}"
    if not isinstance(c.parts, tuple) or not all(_texts(x) and len(x) == 2 for x in c.parts):
        yield "'parts' are no pairs of texts"
    if not _texts_by_name(c.versions):
        yield "'versions' are no texts"
    if c.vocabulary is not None and not (
        isinstance(c.vocabulary, Mapping)
        and set(c.vocabulary) == {"actions", "rules", "predicates"}
        and all(_texts_by_name(x) for x in c.vocabulary.values())
        and set(c.vocabulary["actions"]) == set(ACTION_NAMES)
    ):
        yield "'vocabulary' has no texts of actions, rules and predicates"
    yield from _ego(c)
    yield from _settings(c.settings)
    for name in ("witness", "fail_safe"):
        yield from _trajectory(name, getattr(c, name))
    yield from _road(c)
    for obstacle in _members(c.obstacles, Participant):
        yield from _obstacle(obstacle, c.horizon)
    if not isinstance(c.obstacles, tuple) or not all(
        isinstance(x, Participant) for x in c.obstacles
    ):
        yield "'obstacles' are no participants"
    elif len({x.id for x in c.obstacles}) != len(c.obstacles):
        yield "two of 'obstacles' have the same id"


def _ego(c: Certificate) -> Iterator[str]:
    if not isinstance(c.ego, Body) or not _integer(c.ego.id):
        yield "'ego' is no body with an id"
        return
    for name in ("length", "width", "wheelbase"):
        value = getattr(c.ego, name)
        if not _number(value) or not 0.01 <= value <= 100.0:
            yield f"ego.{name} = {value!r} is no length between 0.01 and 100 m"
    if not _array(c.initial, (5,)):
        yield "'initial' is no array of 5 finite numbers"


def _settings(settings: Settings) -> Iterator[str]:
    if not isinstance(settings, Settings) or not isinstance(settings.assumptions, Assumptions):
        yield "'settings' are no settings"
        return
    if not isinstance(settings.cut_in_exception, bool):
        yield f"cut_in_exception = {settings.cut_in_exception!r} is neither true nor false"
    for name in (f.name for f in fields(Settings)):
        value = getattr(settings, name)
        unlimited = name in ("v_fov", "v_braking", "v_type") and value == math.inf
        if isinstance(value, int | float) and not unlimited and not abs(value) <= LARGEST:
            yield f"{name} = {value!r} is larger than {LARGEST:g}"
    # A steering angle of pi/2 has no tangent.
    if not settings.steering_angle_max < math.pi / 2:
        yield f"steering_angle_max = {settings.steering_angle_max} rad is pi/2 or more"
    for entry in fields(Assumptions):
        value = getattr(settings.assumptions, entry.name)
        if isinstance(entry.default, bool):
            if not isinstance(value, bool):
                yield f"assumptions.{entry.name} = {value!r} is neither true nor false"
        elif entry.name in UNLIMITED and value == math.inf:
            continue
        elif not _number(value) or value < 0.0:
            yield f"assumptions.{entry.name} = {value!r} is no finite number >= 0"


def _trajectory(name: str, t: Trajectory) -> Iterator[str]:
    if not isinstance(t, Trajectory) or not _number(t.tau) or not _number(t.start):
        yield f"'{name}' is no trajectory with finite times"
        return
    if not _array(t.inputs, (None, 2)) or len(t.inputs) > LONGEST:
        yield f"{name}.inputs is no (n, 2) array of finite numbers"
    elif not _array(t.states, (len(t.inputs) + 1, 5)):
        yield f"{name}.states is no ({len(t.inputs) + 1}, 5) array of finite numbers"


def _road(c: Certificate) -> Iterator[str]:
    if not _array(c.reference, (None, 2)) or len(np.unique(c.reference, axis=0)) < 2:
        yield "'reference' is no line of two or more points"
    for name in ("lanelets", "conflicts"):
        several = getattr(c, name)
        found = _members(several, Pavement)
        if not isinstance(several, tuple) or len(found) != len(several):
            yield f"'{name}' are no lanelets"
        for lanelet in found:
            if not _integer(lanelet.id):
                yield f"a lanelet's id {lanelet.id!r} is no integer"
            for side in (lanelet.left, lanelet.right):
                if not _array(side, (None, 2)) or len(side) < 2:
                    yield f"lanelet {lanelet.id}: a border is no line of two or more points"
            limit = lanelet.speed_limit
            if limit is not None and (not _number(limit) or limit < 0.0):
                yield f"lanelet {lanelet.id}: its speed limit {limit!r} is no number >= 0"
        if len({x.id for x in found}) != len(found):
            yield f"two of '{name}' have the same id"
    known = {x.id for x in _members(c.lanelets, Pavement)}
    if not isinstance(c.lanes, tuple):
        yield "'lanes' are no lanes"
        return
    for lane in c.lanes:
        if getattr(lane, "relation", None) not in RELATIONS:
            yield f"a lane's relation is none of {', '.join(RELATIONS)}"
        elif not isinstance(lane.lanelets, tuple) or not set(lane.lanelets) <= known:
            yield f"lane '{lane.relation}' has lanelets that are not there"


def _obstacle(o: Participant, horizon: int) -> Iterator[str]:
    name = f"obstacle {o.id!r}"
    if not _integer(o.id) or not isinstance(o.kind, str) or not isinstance(o.is_static, bool):
        yield f"{name}: its id, kind or is_static cannot be used"
    if not (_texts(o.assumptions) and _texts(o.dropped) and _texts(o.basis)):
        yield f"{name}: its assumptions are no texts"
    if not _regions([o.outline]):
        yield f"{name}: its outline is no region of finite numbers"
    if not _array(o.states, (None, 5), nan=True) or len(o.states) != horizon + 1:
        yield f"{name}: its states are no ({horizon + 1}, 5) array"
    else:
        there = np.isfinite(o.states[:, :4])
        if (there.any(axis=1) & ~there.all(axis=1)).any() or np.isnan(o.states[there[:, 0]]).any():
            yield f"{name}: a state is partly NaN"
    for occupancies in (o.likely, o.possible):
        if (
            not isinstance(occupancies, tuple)
            or len(occupancies) > LONGEST
            or not all(isinstance(step, tuple) for step in occupancies)
            or not _regions([region for step in occupancies for region in step])
        ):
            yield f"{name}: a predicted region is no region of finite numbers"


def _members(several: object, kind: type[T]) -> tuple[T, ...]:
    """Those of a tuple that are of a kind."""
    return tuple(x for x in several if isinstance(x, kind)) if isinstance(several, tuple) else ()


def _number(value: object) -> bool:
    if isinstance(value, bool) or not isinstance(value, int | float):
        return False
    return value == 0 or SMALLEST <= abs(value) <= LARGEST


def _integer(value: object) -> bool:
    return isinstance(value, int) and not isinstance(value, bool)


def _texts(value: object) -> bool:
    return isinstance(value, tuple) and all(isinstance(x, str) for x in value)


def _texts_by_name(value: object) -> bool:
    return isinstance(value, Mapping) and all(
        isinstance(k, str) and isinstance(v, str) for k, v in value.items()
    )


def _array(value: object, shape: tuple[int | None, ...], nan: bool = False) -> bool:
    """Whether it is an array of doubles of that shape (None: any length) and sensible numbers."""
    if not isinstance(value, np.ndarray) or value.dtype != np.float64 or value.ndim != len(shape):
        return False
    if any(
        want is not None and have != want for have, want in zip(value.shape, shape, strict=True)
    ):
        return False
    # Comparisons with NaN are false, so that NaN fails unless it is allowed.
    size = np.abs(value)
    sensible = (size <= LARGEST) & ((size >= SMALLEST) | (size == 0.0))
    return bool((sensible | np.isnan(value)).all() if nan else sensible.all())


def _regions(values: list[object]) -> bool:
    """Whether all are regions of sensible numbers; there may be tens of thousands of them."""
    found = []
    for r in values:
        if not isinstance(r, Region) or not isinstance(r.vertices, np.ndarray):
            return False
        shape = r.vertices.shape
        if r.vertices.dtype != DOUBLE or len(shape) != 2 or shape[1] != 2 or shape[0] < 1:
            return False
        if not _number(r.radius) or not r.radius >= 0.0:
            return False
        found.append(r.vertices)
    return not found or _array(np.concatenate(found), (None, 2))
