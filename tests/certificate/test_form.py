"""Condition `format`: data that no file could hold, but a program could; what is said of each."""

from __future__ import annotations

import math
from dataclasses import fields, replace
from types import MappingProxyType
from typing import Any

import numpy as np
import pytest

from certified import made
from sandra.certificate import Certificate, check, form
from sandra.certificate.form import LONGEST, MOST_RULES, _array, _number, _problems, _regions
from sandra.certificate.types import Body, LaneOf, Participant
from sandra.logic import Vocabulary
from sandra.planning.types import Trajectory
from sandra.scene.types import Region
from sandra.settings import Settings

BASE = made()
LANELET, NEXT = BASE.lanelets
WITNESS = BASE.witness
OTHER = BASE.obstacles[0]
WORDS = {
    "actions": dict(Vocabulary.default().actions),
    "rules": {"mine": "G(v <= 9)"},
    "predicates": {},
}


def told(c: Certificate) -> list[str]:
    """All problems; the check names the first of them, and nothing else is checked."""
    found = list(_problems(c))
    report = check(c)
    assert report.violation is not None
    assert (report.violation.condition, report.violation.sentence) == ("format", found[0])
    assert report.checked == ()
    return found


WRONG: dict[str, tuple[Any, str]] = {
    "format": (1, "the format is 1, only 'sandra-certificate/1' is known"),
    "scenario": (5, "'scenario' is no text"),
    "dt": ("0.1", "'dt' = '0.1' is no finite number"),
    "horizon": (0, "'horizon' = 0 is no number of steps >= 1"),
    "ego": (None, "'ego' is no body with an id"),
    "initial": ([0.0] * 5, "'initial' is no array of 5 finite numbers"),
    "pair": ("keep,follow-lane", "'pair' is no action pair"),
    "rules": ("R_G1", "'rules' are no texts"),
    "formula": (None, "'formula' is no text"),
    "parts": ((("one",),), "'parts' are no pairs of texts"),
    "lanes": (None, "'lanes' are no lanes"),
    "lanelets": ((None,), "'lanelets' are no lanelets"),
    "reference": (np.zeros((3, 2)), "'reference' is no line of two or more points"),
    "conflicts": ([], "'conflicts' are no lanelets"),
    "obstacles": ((None,), "'obstacles' are no participants"),
    "prediction": (None, "'prediction' is no text"),
    "set_based": (None, "'set_based' is no text"),
    "notes": ((1,), "'notes' are no texts"),
    "witness": (None, "'witness' is no trajectory with finite times"),
    "t_dec": (True, "'t_dec' = True is no finite number"),
    "fail_safe": (
        Trajectory(np.zeros((3, 5)), np.zeros((3, 2)), 0.05),
        "fail_safe.states is no (4, 5) array of finite numbers",
    ),
    "settings": (None, "'settings' are no settings"),
    "vocabulary": ({}, "'vocabulary' has no texts of actions, rules and predicates"),
    "note": (None, "'note' is no text"),
    "versions": (None, "'versions' are no texts"),
}


def test_every_field_is_looked_at() -> None:
    assert set(WRONG) == {f.name for f in fields(Certificate)}


@pytest.mark.parametrize("name", WRONG)
def test_a_field_of_the_wrong_kind_is_no_certificate(name: str) -> None:
    value, sentence = WRONG[name]
    assert told(replace(BASE, **{name: value}))[0] == sentence


OF_KIND = "obstacle 7: its id, kind or is_static cannot be used"
OF_TEXTS = "obstacle 7: its assumptions are no texts"
OF_REGIONS = "obstacle 7: a predicted region is no region of finite numbers"
OF_OUTLINE = "obstacle 7: its outline is no region of finite numbers"
OF_STATES = "obstacle 7: its states are no (16, 5) array"
PARTLY = "obstacle 7: a state is partly NaN"


def with_nan(row: int, *columns: int) -> np.ndarray:
    states = OTHER.states.copy()
    states[row, columns] = math.nan
    return states


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        ({"id": 1.5}, "obstacle 1.5: its id, kind or is_static cannot be used"),
        ({"id": True}, "obstacle True: its id, kind or is_static cannot be used"),
        ({"kind": 1.5}, OF_KIND),
        ({"is_static": 0}, OF_KIND),
        ({"assumptions": 1.5}, OF_TEXTS),
        ({"dropped": ("a", 2)}, OF_TEXTS),
        ({"basis": ["a"]}, OF_TEXTS),
        ({"outline": None}, OF_OUTLINE),
        ({"outline": Region(OTHER.outline.vertices * math.nan)}, OF_OUTLINE),
        ({"states": np.zeros((2, 5))}, OF_STATES),
        ({"states": np.zeros((16, 4))}, OF_STATES),
        ({"states": np.zeros((16, 5), dtype=int)}, OF_STATES),
        ({"states": np.full((16, 5), math.inf)}, OF_STATES),
        *(({"states": with_nan(3, column)}, PARTLY) for column in range(5)),
        ({"states": with_nan(3, 1, 2, 3, 4)}, PARTLY),
        ({"states": with_nan(3, 0, 1, 2)}, PARTLY),
        ({"likely": ((None,),)}, OF_REGIONS),
        ({"likely": [*OTHER.likely]}, OF_REGIONS),
        ({"possible": (None,)}, OF_REGIONS),
        ({"possible": ([OTHER.outline],)}, OF_REGIONS),
        ({"possible": ((),) * (LONGEST + 1)}, OF_REGIONS),
    ],
)
def test_a_participant_of_the_wrong_kind_is_no_certificate(
    change: dict[str, Any], sentence: str
) -> None:
    c = replace(BASE, obstacles=(replace(OTHER, **change),))
    assert told(c) == [sentence]
    # Whoever else is there is looked at all the same.
    assert told(replace(BASE, obstacles=(*BASE.obstacles[1:], *c.obstacles))) == [sentence]


def test_who_is_absent_has_a_row_of_nan() -> None:
    for columns in ((0, 1, 2, 3, 4), (0, 1, 2, 3)):
        absent = replace(OTHER, states=with_nan(3, *columns))
        assert not list(_problems(replace(BASE, obstacles=(absent,))))


def body(**changes: Any) -> dict[str, Any]:
    return {"ego": replace(BASE.ego, **changes)}


def pavement(**changes: Any) -> dict[str, Any]:
    return {"lanelets": (replace(LANELET, **changes), NEXT)}


def driven(name: str = "witness", **changes: Any) -> dict[str, Any]:
    return {name: replace(getattr(BASE, name), **changes)}


def assumed(**changes: Any) -> dict[str, Any]:
    """Assumptions that their own constructor would refuse."""
    loose = replace(BASE.settings.assumptions)
    for name, value in changes.items():
        object.__setattr__(loose, name, value)
    return {"settings": replace(BASE.settings, assumptions=loose)}


BORDER = "lanelet 100: a border is no line of two or more points"
TIMES = "is no trajectory with finite times"
RELATION = "a lane's relation is none of current, left, right, opposite"
ABSENT = "lane 'current' has lanelets that are not there"
NO_WORDS = "'vocabulary' has no texts of actions, rules and predicates"


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        ({"horizon": 1.0}, "'horizon' = 1.0 is no number of steps >= 1"),
        ({"horizon": LONGEST + 1}, "'horizon' = 100001 is no number of steps >= 1"),
        ({"t_dec": math.inf}, "'t_dec' = inf is no finite number"),
        ({"dt": 10**400}, f"'dt' = {10**400} is no finite number"),
        ({"rules": ("R_G1",) * (MOST_RULES + 1)}, "51 rules are more than 50"),
        ({"parts": [("a", "b")]}, "'parts' are no pairs of texts"),
        ({"parts": (("a", "b", "c"),)}, "'parts' are no pairs of texts"),
        ({"parts": (("a", 1),)}, "'parts' are no pairs of texts"),
        ({"parts": (["a", "b"],)}, "'parts' are no pairs of texts"),
        ({"obstacles": [*BASE.obstacles]}, "'obstacles' are no participants"),
        ({"obstacles": (OTHER, OTHER)}, "two of 'obstacles' have the same id"),
        ({"versions": {"numpy": 2}}, "'versions' are no texts"),
        ({"versions": {2: "numpy"}}, "'versions' are no texts"),
        ({"vocabulary": [*WORDS]}, NO_WORDS),
        ({"vocabulary": {**WORDS, "more": {}}}, NO_WORDS),
        ({"vocabulary": {**WORDS, "rules": {"mine": 1}}}, NO_WORDS),
        ({"vocabulary": {**WORDS, "actions": {}}}, NO_WORDS),
        ({"vocabulary": {**WORDS, "predicates": None}}, NO_WORDS),
        ({"ego": Body(True, 4.5, 1.8, 2.6)}, "'ego' is no body with an id"),
        (body(length=0.009), "ego.length = 0.009 is no length between 0.01 and 100 m"),
        (body(width=math.nan), "ego.width = nan is no length between 0.01 and 100 m"),
        (body(wheelbase=101), "ego.wheelbase = 101 is no length between 0.01 and 100 m"),
        ({"initial": np.zeros(4)}, "'initial' is no array of 5 finite numbers"),
        ({"reference": np.zeros((2, 3))}, "'reference' is no line of two or more points"),
        ({"lanes": (3,)}, RELATION),
        ({"lanes": (LaneOf("above", (100,)),)}, RELATION),
        ({"lanes": (LaneOf("current", (7,)),)}, ABSENT),
        ({"lanes": (LaneOf("current", [100]),)}, ABSENT),  # type: ignore[arg-type]
        ({"lanelets": BASE.lanelets * 2}, "two of 'lanelets' have the same id"),
        ({"conflicts": BASE.lanelets * 2}, "two of 'conflicts' have the same id"),
        ({"conflicts": (None,)}, "'conflicts' are no lanelets"),
        (
            {"lanelets": (replace(LANELET, id="x"), *BASE.lanelets)},
            "a lanelet's id 'x' is no integer",
        ),
        (pavement(left=np.zeros((1, 2))), BORDER),
        (pavement(right=np.zeros((1, 2))), BORDER),
        (pavement(right=np.zeros((4, 3))), BORDER),
        (pavement(speed_limit=-1.0), "lanelet 100: its speed limit -1.0 is no number >= 0"),
        (pavement(speed_limit="9"), "lanelet 100: its speed limit '9' is no number >= 0"),
        (driven(tau=math.nan), f"'witness' {TIMES}"),
        (driven(start=math.inf), f"'witness' {TIMES}"),
        (driven("fail_safe", start=math.inf), f"'fail_safe' {TIMES}"),
        (
            driven(inputs=np.zeros((LONGEST + 1, 2))),
            "witness.inputs is no (n, 2) array of finite numbers",
        ),
        (
            driven("fail_safe", inputs=np.zeros((40, 3))),
            "fail_safe.inputs is no (n, 2) array of finite numbers",
        ),
        *(
            (driven(states=states), "witness.states is no (31, 5) array of finite numbers")
            for states in (
                WITNESS.states[:, :4],
                WITNESS.states.astype(np.float32),
                WITNESS.states * 1e9,
                WITNESS.states * 1e-60,
                WITNESS.states.tolist(),
            )
        ),
        (
            {"settings": Settings(steering_angle_max=1.6)},
            "steering_angle_max = 1.6 rad is pi/2 or more",
        ),
        ({"settings": Settings(a_lon_min=-1e9)}, "a_lon_min = -1000000000.0 is larger than 1e+07"),
        (
            {"settings": replace(Settings(), cut_in_exception=1)},
            "cut_in_exception = 1 is neither true nor false",
        ),
        ({"settings": replace(Settings(), assumptions=None)}, "'settings' are no settings"),
        (assumed(no_reversing=1), "assumptions.no_reversing = 1 is neither true nor false"),
        (
            assumed(max_speed=math.nan),
            "assumptions.max_speed = nan is no finite number >= 0",
        ),
        (
            assumed(max_overhang=-0.5),
            "assumptions.max_overhang = -0.5 is no finite number >= 0",
        ),
        (
            assumed(max_overhang=True),
            "assumptions.max_overhang = True is no finite number >= 0",
        ),
    ],
)
def test_data_out_of_shape_is_no_certificate(change: dict[str, Any], sentence: str) -> None:
    assert told(replace(BASE, **change))[0] == sentence


def test_what_follows_from_one_problem_is_named_too() -> None:
    nowhere = told(replace(BASE, lanelets=(None,)))
    assert nowhere[1:] == [ABSENT, "lane 'left' has lanelets that are not there"]
    for horizon, rows in ((True, 2), (14, 15)):
        c = replace(BASE, horizon=horizon)
        assert told(c)[-1] == f"obstacle 8: its states are no ({rows}, 5) array"
    fresh = told(replace(BASE, ego=None, settings=None, witness=None, lanes=None, obstacles=None))
    assert fresh == [
        "'ego' is no body with an id",
        "'settings' are no settings",
        "'witness' is no trajectory with finite times",
        "'lanes' are no lanes",
        "'obstacles' are no participants",
    ]


def test_what_may_be_left_out_or_is_unlimited() -> None:
    for change in (
        {"vocabulary": MappingProxyType(WORDS)},
        {"versions": {}},
        {"rules": ()},
        {"parts": ()},
        {"obstacles": ()},
        {"lanes": (), "lanelets": ()},
        {"conflicts": BASE.lanelets},
        {"settings": Settings(v_fov=math.inf, v_braking=math.inf, v_type=math.inf)},
        {"lanelets": (replace(LANELET, speed_limit=None), NEXT)},
        {"initial": np.zeros(5)},
    ):
        assert not list(_problems(replace(BASE, **change))), change
    loose = replace(Settings())
    object.__setattr__(loose, "v_max", math.inf)
    assert list(_problems(replace(BASE, settings=loose))) == ["v_max = inf is larger than 1e+07"]


def test_the_limits_of_sensible_numbers() -> None:
    assert (form.LARGEST, form.SMALLEST) == (1e7, 1e-50)
    assert (form.LONGEST, form.MOST_RULES) == (100_000, 50)
    assert all(_number(x) for x in (0, 0.0, 1, -2.5, 1e7, -1e7, 1e-50))
    for bad in (True, None, "1", 1e7 + 1, 1e-51, -1e-51, math.nan, math.inf, 10**400, 1j):
        assert not _number(bad)


def test_the_shape_of_arrays() -> None:
    zeros = np.zeros((3, 2))
    assert _array(zeros, (3, 2))
    assert _array(zeros, (None, 2))
    assert _array(zeros, (None, None))
    for shape in ((2, 2), (3, 3), (3,), (3, 2, 1), (None,)):
        assert not _array(zeros, shape)
    holed = np.array([math.nan, 1.0])
    assert not _array(holed, (2,))
    assert _array(holed, (2,), nan=True)
    assert not _array(np.array([math.inf, 1.0]), (2,), nan=True)
    assert not _array(np.array([1e8, 1.0]), (2,), nan=True)
    assert not _array(np.array([1e-60, 1.0]), (2,), nan=True)
    assert not _array([0.0, 0.0], (2,))


def test_the_shape_of_regions() -> None:
    good = Region(np.zeros((1, 2)), 1.0)
    assert _regions([])
    assert _regions([good, Region(np.ones((4, 2)))])
    for vertices in (
        np.zeros((0, 2)),
        np.zeros((2, 3)),
        np.zeros(2),
        np.zeros((2, 2), dtype=int),
        np.array([[math.nan, 0.0]]),
        [[0.0, 0.0]],
    ):
        assert not _regions([good, Region(vertices, 1.0)])  # type: ignore[arg-type]
    for radius in (-1.0, math.nan, None, True):
        assert not _regions([good, replace(good, radius=radius)])
    assert not _regions([good, None])


def test_participants_have_nothing_that_they_are_not_given() -> None:
    bare = Participant(1, "car", OTHER.outline, False, OTHER.states, (), ())
    assert (bare.assumptions, bare.dropped, bare.basis) == ((), (), ())
