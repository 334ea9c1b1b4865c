"""The checker as a whole, each condition alone, what it answers, and what it may import."""

from __future__ import annotations

import ast
import json
import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely

import sandra.certificate
from certified import DT, HORIZON, constant, made, turning_scene
from reach_scenes import Course
from sandra.certificate import CONDITIONS, Certificate, Violation, certificate, check
from sandra.certificate.types import Pavement
from sandra.errors import CertificateError
from sandra.logic import Vocabulary, specification
from sandra.prediction import predict
from sandra.scene.types import Region
from sandra.settings import Settings

ROOM = Path(sandra.certificate.__file__).parent
BASE = made()


@pytest.mark.parametrize("kappa", [0.0, 0.02, -0.02, 0.005])
@pytest.mark.parametrize("prediction", ["most-likely", "set-based"])
def test_keeping_the_lane_is_accepted(kappa: float, prediction: str) -> None:
    report = check(made(turning_scene(kappa), prediction=prediction))
    assert report.accepted, str(report)
    assert [x.condition for x in report.checked] == list(CONDITIONS)


def test_stopping_is_accepted() -> None:
    inputs = constant(-5.0, 2 * HORIZON)
    c = made(pair="decelerate,follow-lane", rules=(), inputs=inputs, stop=constant(-5.0, 38))
    assert check(c).accepted, str(check(c))
    slow = Course(step=5.0)
    scene = slow.scene(slow.lanes(left=1, right=0), [], speed=3.0)
    scene = replace(scene, ego=replace(scene.ego, wheelbase=2.6))
    inputs = np.vstack([constant(-3.0, 20), constant(0.0, 10)])
    c = made(scene, "stop,follow-lane", (), inputs=inputs, stop=constant(-3.0, 18))
    assert check(c).accepted, str(check(c))


def test_standing_still_needs_no_fail_safe_steps() -> None:
    scene = Course(step=5.0).scene(Course(step=5.0).lanes(left=1, right=0), [], speed=0.0)
    scene = replace(scene, ego=replace(scene.ego, wheelbase=2.6))
    c = made(scene, "stop,follow-lane", (), stop=np.zeros((0, 2)))
    assert c.fail_safe.states.shape == (1, 5)
    report = check(c)
    assert report.accepted, str(report)


def test_a_lane_change_is_accepted_as_one() -> None:
    swing = [constant(0.0, 6, 0.25), constant(0.0, 6, -0.25)]
    inputs = np.vstack([*swing, constant(0.0, 18)])
    scene = turning_scene(others=False)
    c = made(scene, "keep,left-lane", (), inputs=inputs, stop=constant(-5.0, 40))
    assert check(c).accepted, str(check(c))
    assert c.witness.states[-1, 1] > 0.9
    staying = made(scene, "keep,left-lane", (), inputs=constant(0.0, 30))
    assert check(staying).violation is not None


def test_margins_are_those_of_the_scene() -> None:
    margins = {x.condition: x.margin for x in check(BASE).checked}
    # The lanes' right border is 1.75 m from the centre line, the body reaches 0.9 m.
    assert margins["road"] == pytest.approx(0.85, abs=0.01)
    # Bumper to bumper 35.5 m; the car in the left lane is 3.5 m aside and 15.5 m ahead.
    assert margins["witness-collision"] == pytest.approx(math.hypot(15.5, 1.7) - 1.0, abs=0.05)
    assert margins["acceleration"] == pytest.approx(1.0)
    assert margins["speed"] == pytest.approx(0.0)
    assert margins["lateral-acceleration"] == pytest.approx(4.0)
    assert margins["trace"] == pytest.approx(35.5 - 100 / 12 + 100 / 24 - 4.0)
    assert margins["conflict-area"] == math.inf


def test_a_report_prints_and_becomes_json() -> None:
    report = check(BASE)
    assert str(report).startswith("accepted: keep,follow-lane in TST_Course-1_1_T-1")
    tree = json.loads(json.dumps(report.to_dict(), allow_nan=False))
    assert tree["accepted"] is True
    assert tree["violation"] is None
    assert [x["condition"] for x in tree["checked"]] == list(CONDITIONS)
    by_name = {x["condition"]: x for x in tree["checked"]}
    assert by_name["conflict-area"]["margin"] is None
    rejected = check(replace(BASE, t_dec=0.13))
    assert "FAILS grid" in str(rejected)
    tree = json.loads(json.dumps(rejected.to_dict(), allow_nan=False))
    assert tree["accepted"] is False
    assert tree["violation"]["condition"] == "grid"
    assert tree["violation"]["measured"] == pytest.approx(0.13)
    assert Violation("x", "y", time=math.nan).to_dict()["time"] is None


def test_a_shape_that_geometry_gives_up_on_proves_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    def raises(c: Certificate) -> None:
        raise shapely.errors.GEOSException("side location conflict")

    monkeypatch.setitem(CONDITIONS, "road", raises)
    report = check(BASE)
    assert report.violation is not None
    assert report.violation.condition == "road"
    assert "side location" in report.violation.sentence


def test_every_bound_counts_at_its_value() -> None:
    c = made(turning_scene(0.02))
    for name, value in {
        "a_lon_min": -5.0,
        "a_lon_max": 0.0,
        "v_max": 10.0,
        "a_lat_max": 2.0,
        "steering_angle_max": float(c.initial[4]),
    }.items():
        assert check(replace(c, settings=c.settings.replace(**{name: value}))).accepted, name


# Conflict areas and the road


def crossing(x0: float, x1: float) -> Pavement:
    return Pavement(
        500,
        np.array([[x0, -20.0], [x0, 20.0]]),
        np.array([[x1, -20.0], [x1, 20.0]]),
        None,
    )


def test_conflict_areas_beside_the_standing_body_do_no_harm() -> None:
    # The fail-safe stands at x = 11, its front is at 13.25.
    for x0, ok in ((13.3, True), (13.2, False), (8.7, False), (2.0, True)):
        report = check(replace(BASE, conflicts=(crossing(x0, x0 + 3.0),)))
        assert report.accepted == (ok or x0 + 3.0 < 8.75), (x0, str(report))
    near = check(replace(BASE, conflicts=(crossing(13.3, 16.0),)))
    assert {x.condition: x.margin for x in near.checked}["conflict-area"] == pytest.approx(0.05)


def test_slivers_of_the_map_are_no_conflict_areas() -> None:
    along = np.array([[-20.0, 0.0], [60.0, 0.0]])
    for depth, ok in ((0.15, True), (0.4, False)):
        # A lane beside, whose border lies a little within the own lane and under the body.
        wide = np.array([0.0, -0.9 + depth]), np.array([0.0, -1.0 - depth])
        lane = Pavement(500, along + wide[0], along + wide[0] - np.array([0.0, depth]), None)
        assert check(replace(BASE, conflicts=(lane,))).accepted == ok
    assert check(replace(BASE, conflicts=(lane,), lanes=())).violation is not None


def test_builder_takes_incoming_lanes_as_conflicts() -> None:
    course = Course(step=5.0)
    side = course.lane("incoming-right", 300, 8.0, 4.0)
    scene = course.scene((*course.lanes(left=1, right=0), side), speed=10.0)
    scene = replace(scene, ego=replace(scene.ego, wheelbase=2.6))
    c = made(scene)
    assert [x.id for x in c.conflicts] == [300]
    # After the merge it is the ego's own.
    merged = replace(side, lanelets=(100,))
    again = made(replace(scene, lanes=(*scene.lanes[:2], merged)))
    assert again.conflicts == ()


# The builder


def test_far_lanelets_are_left_out_named_ones_are_not() -> None:
    course = Course(step=5.0)
    far = course.lane("other", 900, 500.0, 504.0)
    scene = course.scene(course.lanes(left=1, right=0), more_lanelets=[far], speed=10.0)
    scene = replace(scene, ego=replace(scene.ego, wheelbase=2.6))
    assert [x.id for x in made(scene).lanelets] == [100, 101]
    named = made(scene, rules=("G(!in_lanelet(900))",))
    assert [x.id for x in named.lanelets] == [100, 101, 900]
    assert check(named).accepted


def test_it_is_made_of_copies_that_nobody_can_change() -> None:
    assert not BASE.witness.states.flags.writeable
    assert not BASE.obstacles[0].states.flags.writeable
    assert set(BASE.versions) == {"python", "sandra", "numpy", "shapely"}
    # What only rounding makes so small is 0.
    assert made(turning_scene(d=1e-40)).initial[1] == 0.0
    course = Course(step=5.0)
    speck = course.car(7, 60.0, 0.0, outline=Region(np.array([[0.0, 1e-40]]), 1.0))
    tiny = course.scene(course.lanes(left=1, right=0), [replace(speck, is_static=True)])
    tiny = replace(tiny, ego=replace(tiny.ego, wheelbase=2.6))
    assert made(tiny).obstacles[0].possible[0][0].vertices[0, 1] == 0.0
    assert made(note="by hand").note == "by hand"
    assert made(vocabulary=Vocabulary.default()).vocabulary is None
    words = Vocabulary.default()
    own = Vocabulary({**words.actions}, {"mine": "G(v <= 30)"}, words.predicates, {})
    assert made(vocabulary=own).vocabulary is not None


def test_predictions_of_different_participants_are_refused() -> None:
    scene = turning_scene()
    likely = predict(scene, "most-likely", HORIZON)
    possible = predict(scene, "set-based", 21)
    spec = specification(BASE.pair, (), Settings(), dt=DT)
    for one, two in (
        (replace(likely, obstacles=likely.obstacles[:1]), possible),
        (likely, replace(possible, obstacles=possible.obstacles[:1])),
        (
            replace(likely, obstacles=likely.obstacles[:1] * 2),
            replace(possible, obstacles=possible.obstacles[:1] * 2),
        ),
    ):
        with pytest.raises(CertificateError, match="same participants"):
            certificate(scene, spec, (), one, two, BASE.witness, DT, BASE.fail_safe, Settings())


# Others


def test_static_objects_must_stay_in_their_regions() -> None:
    course = Course(step=5.0)
    still = replace(course.car(7, 40.0, 0.0, kind="parkedVehicle"), is_static=True)
    scene = course.scene(course.lanes(left=1, right=0), [still], speed=10.0)
    scene = replace(scene, ego=replace(scene.ego, wheelbase=2.6))
    c = made(scene)
    assert check(c).accepted, str(check(c))
    (o,) = c.obstacles
    away = Region(o.possible[0][0].vertices + np.array([0.5, 0.0]))
    broken = replace(o, possible=(*o.possible[:-1], (away,)))
    report = check(replace(c, obstacles=(broken,)))
    assert report.violation is not None
    assert report.violation.condition == "occupancies"
    assert report.violation.step == len(o.possible) - 1


def test_who_is_absent_is_not_played() -> None:
    o = BASE.obstacles[0]
    states = np.full_like(o.states, math.nan)
    gone = replace(o, states=states, likely=((),) * HORIZON, possible=((),) * len(o.possible))
    assert check(replace(BASE, obstacles=(gone,))).accepted


@pytest.mark.parametrize(
    "change",
    [
        {"kind": "pedestrian"},
        {"assumptions": ("no_rear_end",)},
        {"states": BASE.obstacles[0].states + np.array([0.0, 2.0, 0.0, 0.0, 0.0])},
        {"states": BASE.obstacles[0].states + np.array([0.0, 0.0, 2.0, 0.0, 0.0])},
        {"states": BASE.obstacles[0].states - np.array([0.0, 0.0, 0.0, 20.0, 0.0])},
    ],
)
def test_who_may_do_anything_else_is_not_played(change: dict[str, Any]) -> None:
    """Only what is allowed for sure is demanded of the set-based prediction."""
    o = replace(BASE.obstacles[0], **change, basis=("recorded occupancies",))
    o = replace(o, possible=((),) * len(o.possible))
    answer = CONDITIONS["occupancies"](replace(BASE, obstacles=(o,)))
    assert not isinstance(answer, Violation)


def test_a_round_body_is_held_by_round_regions() -> None:
    o = replace(
        BASE.obstacles[0],
        outline=Region.disc(1.0),
        possible=tuple((Region(np.array([[30.0, 0.0], [90.0, 0.0]]), 1.0),) for _ in range(21)),
        likely=tuple(
            (Region(BASE.obstacles[0].states[k : k + 2, :2], 1.0),) for k in range(HORIZON)
        ),
    )
    answer = CONDITIONS["occupancies"](replace(BASE, obstacles=(o,)))
    assert not isinstance(answer, Violation)
    tight = replace(o, likely=tuple((Region(r[0].vertices, 0.9),) for r in o.likely))
    answer = CONDITIONS["occupancies"](replace(BASE, obstacles=(tight,)))
    assert isinstance(answer, Violation)


# Independence


def test_it_shares_no_code_with_what_it_checks() -> None:
    allowed = {
        "sandra.actions",
        "sandra.certificate",
        "sandra.errors",
        "sandra.logic",
        "sandra.planning.types",
        "sandra.prediction.types",
        "sandra.scene.types",
        "sandra.settings",
    }
    for path in ROOM.glob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            names = []
            if isinstance(node, ast.ImportFrom):
                names = [node.module or ""]
            elif isinstance(node, ast.Import):
                names = [x.name for x in node.names]
            for name in names:
                if name.startswith("sandra"):
                    assert any(name == x or name.startswith(x + ".") for x in allowed), (path, name)
