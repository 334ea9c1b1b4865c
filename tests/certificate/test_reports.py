"""What a check tells, word for word and number for number: of each condition, held or violated."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from certificate.changes import (
    BASE,
    BENT,
    HARD,
    KEEP,
    MUTATIONS,
    STOP,
    Mutation,
    both,
    cut_at,
    driven,
    fail_safe,
    put,
    settings,
)
from certified import constant, made, turning_scene
from sandra.certificate import CONDITIONS, Certificate, Checked, Report, Violation, check
from sandra.certificate.types import Pavement
from sandra.logic import Vocabulary

TOLD = Path(__file__).with_name("told.txt")
"""Of each change: name | step | time | measured | allowed | sentence; "-": None."""
NUMBERS = ("step", "time", "measured", "allowed")


def nearer_the_end(t_stop: float) -> Mutation:
    """Coasting for a second, so that the fail-safe gets to x = 21 and the witness to x = 16."""
    return both(driven(KEEP, np.vstack([constant(0.0, 20), STOP])), cut_at(t_stop))


def relying(c: Certificate) -> Certificate:
    """As if the set-based prediction relied on legal cut-ins."""
    others = tuple(replace(o, assumptions=(*o.assumptions, "legal_cut_in")) for o in c.obstacles)
    return replace(c, obstacles=others)


def lane_across(x0: float, x1: float) -> Mutation:
    ends = np.array([-20.0, 20.0])
    left, right = (np.column_stack([np.full(2, x), ends]) for x in (x0, x1))
    return lambda c: replace(c, conflicts=(Pavement(500, left, right, None),))


MORE: dict[str, tuple[str, Certificate, Mutation]] = {
    "steering angle of the witness": (
        "steering-angle",
        BENT,
        settings(steering_angle_max=0.05),
    ),
    "steering angle of the fail-safe": (
        "steering-angle",
        BASE,
        fail_safe(put(7, 4, -1.2)),
    ),
    "steering rate of the fail-safe": (
        "steering-rate",
        BASE,
        driven(KEEP, np.vstack([constant(-5.0, 3), constant(-5.0, 2, -0.5), constant(-5.0, 35)])),
    ),
    "speed of the fail-safe": (
        "speed",
        BASE,
        both(settings(v_max=10.5), driven(KEEP, constant(4.0, 5))),
    ),
    "lateral acceleration of the witness": (
        "lateral-acceleration",
        BENT,
        settings(a_lat_max=1.5),
    ),
    "lateral acceleration of the fail-safe": (
        "lateral-acceleration",
        BENT,
        both(settings(a_lat_max=2.5), driven(constant(0.0, 30), constant(5.0, 6))),
    ),
    "the fail-safe leaves the road": ("road", BASE, nearer_the_end(21.0)),
    "the fail-safe comes too near to its end": ("road", BASE, nearer_the_end(23.251)),
    "stands on a lane": ("conflict-area", BASE, lane_across(13.0, 16.0)),
    "brakes too mildly for cut-ins": (
        "cut-in",
        made(stop=constant(-2.0, 100), rules=()),
        relying,
    ),
}
"""Condition that is violated, certificate, and change."""


ALL = {**{name: (c, BASE, change) for name, (c, change) in MUTATIONS.items()}, **MORE}


def lines() -> dict[str, list[str]]:
    rows = [line.split(" | ", 5) for line in TOLD.read_text("utf-8").splitlines()]
    return {name: rest for name, *rest in rows}


@pytest.mark.parametrize("name", ALL)
def test_what_is_told_of_a_violation(name: str) -> None:
    condition, certificate, change = ALL[name]
    answer = CONDITIONS[condition](change(certificate))
    assert isinstance(answer, Violation)
    *numbers, sentence = lines()[name]
    assert (answer.condition, answer.sentence) == (condition, sentence)
    for field, wanted in zip(NUMBERS, numbers, strict=True):
        found = getattr(answer, field)
        assert found == (None if wanted == "-" else close(float(wanted))), field


def close(wanted: float) -> Any:
    return pytest.approx(wanted, rel=1e-6, abs=1e-12, nan_ok=True)


def test_everything_that_is_told_is_tested() -> None:
    assert list(lines()) == list(ALL)


def own_words(c: Certificate) -> Certificate:
    words = Vocabulary.default()
    texts = {"actions": words.actions, "rules": words.rules, "predicates": words.predicates}
    return replace(c, vocabulary=texts)


SWING = np.vstack([constant(0.0, 6, 0.25), constant(0.0, 6, -0.25), constant(0.0, 18)])
SWUNG = made(turning_scene(others=False), "keep,left-lane", (), inputs=SWING)
HELD = Path(__file__).with_name("held.txt")
"""Of each certificate and condition: name | condition | margin | unit | sentence."""
CERTIFICATES: dict[str, Certificate] = {
    "straight on": BASE,
    "bent": HARD,
    "swung": SWUNG,
    "set-based": made(prediction="set-based"),
    "own words": own_words(BASE),
    "legal cut-ins": relying(BASE),
    "lane ahead": lane_across(14.0, 16.0)(BASE),
}
ROWS = [line.split(" | ", 4) for line in HELD.read_text("utf-8").splitlines()]


@pytest.mark.parametrize(
    ("name", "condition", "margin", "unit", "sentence"), ROWS, ids=[" ".join(r[:2]) for r in ROWS]
)
def test_what_is_told_of_what_holds(
    name: str, condition: str, margin: str, unit: str, sentence: str
) -> None:
    answer = CONDITIONS[condition](CERTIFICATES[name])
    assert isinstance(answer, Checked)
    assert (answer.condition, answer.sentence) == (condition, sentence)
    assert answer.unit == ("" if unit == "-" else unit)
    assert answer.margin == (None if margin == "-" else close(float(margin)))


def test_every_condition_is_told() -> None:
    assert {row[1] for row in ROWS} == set(CONDITIONS)


# The report


VIOLATION = Violation("road", "off it", 3, 0.25, 1.5, 2.5)
HOLDS = Checked("grid", "it does", 0.75, "m")


def test_each_entry_of_a_report_becomes_json() -> None:
    violation = {
        "condition": "road",
        "sentence": "off it",
        "step": 3,
        "time": 0.25,
        "measured": 1.5,
        "allowed": 2.5,
    }
    holds = {"condition": "grid", "sentence": "it does", "margin": 0.75, "unit": "m"}
    report = Report("scene", "pair", (HOLDS,), VIOLATION)
    assert VIOLATION.to_dict() == violation
    assert HOLDS.to_dict() == holds
    assert report.to_dict() == {
        "accepted": False,
        "scenario": "scene",
        "pair": "pair",
        "violation": violation,
        "checked": [holds],
    }
    assert Report("", "", (), None).to_dict()["violation"] is None


def test_what_is_no_finite_number_is_none_in_json() -> None:
    for bad in (math.nan, math.inf, -math.inf, None):
        found = Violation("road", "off it", None, bad, bad, bad).to_dict()
        assert list(found.values()) == ["road", "off it", None, None, None, None]
        assert Checked("grid", "it does", bad).to_dict()["margin"] is None
    assert Checked("grid", "it does").to_dict() == {
        "condition": "grid",
        "sentence": "it does",
        "margin": None,
        "unit": "",
    }


def test_a_report_in_words() -> None:
    assert str(Report("scene", "pair", (HOLDS,), VIOLATION)) == (
        "rejected: pair in scene\n"
        "  ok    grid                  it does\n"
        "  FAILS road                  off it"
    )
    assert str(Report("scene", "pair", (HOLDS, HOLDS), None)) == (
        "accepted: pair in scene\n"
        "  ok    grid                  it does\n"
        "  ok    grid                  it does"
    )


def test_a_check_reports_scenario_and_pair() -> None:
    report = check(BASE)
    assert (report.scenario, report.pair) == ("TST_Course-1_1_T-1", "keep,follow-lane")
    assert check(replace(BASE, scenario="Z", t_dec=0.13)).scenario == "Z"
