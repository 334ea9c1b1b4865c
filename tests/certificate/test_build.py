"""What the builder keeps of what it is given."""

from __future__ import annotations

import platform
from dataclasses import replace
from importlib import metadata
from typing import Any

import numpy as np
import pytest

from certified import constant, drive, initial
from reach_scenes import Course
from sandra.actions import ActionPair
from sandra.certificate import FORMAT, Certificate, certificate
from sandra.certificate.build import _array, _near, _occupancies, _own, _trajectory, versions
from sandra.certificate.types import RELATIONS, Body, LaneOf
from sandra.logic import Vocabulary, specification
from sandra.planning.types import Trajectory
from sandra.prediction.types import PredictedObstacle, Prediction
from sandra.scene.types import Lanelet, Obstacle, Region, Scene, State
from sandra.settings import Settings

PAIR = ActionPair.parse("keep,follow-lane")
RULES = ("R_G2", "G(!in_lanelet(900))")
SETTINGS = Settings(t_d=0.7)
STEPS = 25


def scene() -> Scene:
    """Own lanes with signs of their own, an incoming lane, one far off, an oncoming one."""
    course = Course(step=5.0)
    own = course.lanes(left=1, right=0)
    signed = (replace(own[0], speed_limits=(8.0,)), replace(own[1], speed_limits=(None,)))
    oncoming = course.lane("opposite", 200, 5.25, 8.75)
    incoming = course.lane("incoming-left", 300, 9.0, 12.0)
    further = course.lane("other", 900, 500.0, 504.0)
    other = course.lane("other", 901, 600.0, 604.0)
    found = course.scene((*signed, oncoming, incoming), more_lanelets=[further, other], speed=10.0)
    lanelets = tuple(replace(x, speed_limit=x.id / 10) for x in found.lanelets)
    return replace(found, ego=replace(found.ego, wheelbase=2.4), lanelets=lanelets)


SCENE = scene()
WITNESS = drive(initial(SCENE), constant(0.0, 30))
FAIL_SAFE = drive(WITNESS.states[4], constant(-5.0, 40), 0.2)
SPECIFICATION = specification(PAIR, RULES, SETTINGS, dt=0.1)


def predicted(id: int, *assumptions: str, dropped: tuple[str, ...] = ()) -> PredictedObstacle:
    """A pedestrian whose regions tell the interval."""
    obstacle = Obstacle(id, "pedestrian", Region.disc(0.5), State(50.0, 9.0, 0.1, 1.0))
    states = np.full((STEPS + 1, 5), float(id))
    regions = tuple((Region(np.array([[float(k), float(id)]]), 0.5),) for k in range(STEPS))
    return PredictedObstacle(
        obstacle,
        at=(*regions, regions[-1]),
        between=regions,
        states=states,
        assumptions=assumptions,
        dropped=dropped,
    )


LIKELY = Prediction(
    "recorded",
    0.1,
    STEPS,
    (predicted(5, "as recorded"), predicted(3, "as guessed")),
    notes=("one", "two"),
)
POSSIBLE = Prediction(
    "set-based",
    0.1,
    STEPS,
    (predicted(3, "walks", dropped=("stays",)), predicted(5, "runs")),
    notes=("two", "three"),
)


def build(**options: Any) -> Certificate:
    given = (SCENE, SPECIFICATION, list(RULES), LIKELY, POSSIBLE, WITNESS, 0.2, FAIL_SAFE, SETTINGS)
    return certificate(*given, **options)


def test_what_is_kept_of_a_decision() -> None:
    built = build()
    assert built.format == FORMAT == "sandra-certificate/1"
    assert built.scenario == SCENE.name
    assert (built.dt, built.horizon, built.t_dec) == (0.1, STEPS, 0.2)
    ego = SCENE.ego
    assert built.ego == Body(ego.id, ego.length, ego.width, 2.4)
    assert built.initial.tolist() == initial(SCENE)
    assert (built.pair, built.rules, built.settings) == (PAIR, RULES, SETTINGS)
    assert built.formula == str(SPECIFICATION.formula)
    assert built.parts == tuple((p.name, p.text) for p in SPECIFICATION.parts)
    assert len(built.parts) == 4
    assert (built.prediction, built.set_based) == ("recorded", "set-based")
    assert built.notes == ("one", "two", "three")
    assert np.array_equal(built.reference, SCENE.frame.line)
    assert (built.vocabulary, built.note) == (None, "")
    assert build(note="by hand").note == "by hand"


def test_defaults_of_a_certificate() -> None:
    built = build()
    lean = replace(built)
    names = ("vocabulary", "note", "versions", "format")
    given = {name: getattr(lean, name) for name in lean.__slots__ if name not in names}
    bare = Certificate(**given)
    assert (bare.vocabulary, bare.note, dict(bare.versions)) == (None, "", {})
    assert bare.format == FORMAT


def test_lanes_and_the_lanelets_that_are_kept() -> None:
    built = build()
    assert RELATIONS == ("current", "left", "right", "opposite")
    assert built.lanes == (
        LaneOf("current", (100,)),
        LaneOf("left", (101,)),
        LaneOf("opposite", (200,)),
    )
    # The formula speaks of 900, which is far; 300 is near; 901 is neither.
    assert [x.id for x in built.lanelets] == [100, 101, 200, 300, 900]
    assert [x.id for x in built.conflicts] == [300]
    by_id = {x.id: x for x in SCENE.lanelets}
    for kept in (*built.lanelets, *built.conflicts):
        assert np.array_equal(kept.left, by_id[kept.id].left)
        assert np.array_equal(kept.right, by_id[kept.id].right)


def test_signs_of_lanes_go_before_those_of_lanelets() -> None:
    built = build()
    limits = {x.id: x.speed_limit for x in built.lanelets}
    assert limits == {100: 8.0, 101: None, 200: 30.0, 300: 30.0, 900: 90.0}
    assert built.conflicts[0].speed_limit == 30.0


def test_both_predictions_of_each_participant() -> None:
    built = build()
    first, second = built.obstacles
    assert (first.id, first.kind, first.is_static) == (5, "pedestrian", False)
    assert (first.assumptions, first.dropped, first.basis) == (("runs",), (), ("as recorded",))
    assert (second.assumptions, second.dropped) == (("walks",), ("stays",))
    assert second.basis == ("as guessed",)
    assert first.outline.radius == 0.5
    assert first.outline.vertices.tolist() == [[0.0, 0.0]]
    assert np.array_equal(first.states, np.full((STEPS + 1, 5), 5.0))
    assert first.likely == LIKELY.obstacles[0].between
    # The fail-safe ends at 2.2 s.
    assert first.possible == POSSIBLE.obstacles[1].between[:22]


@pytest.mark.parametrize(("steps", "kept"), [(40, 22), (39, 22), (38, 21), (1, 3), (0, 2)])
def test_the_set_based_prediction_covers_the_fail_safe(steps: int, kept: int) -> None:
    t = Trajectory(FAIL_SAFE.states[: steps + 1], FAIL_SAFE.inputs[:steps], 0.05, 0.2)
    given = (SCENE, SPECIFICATION, RULES, LIKELY, POSSIBLE, WITNESS, 0.2, t, SETTINGS)
    c = certificate(*given)
    assert {len(o.possible) for o in c.obstacles} == {kept}
    at_once = replace(t, states=t.states[:1], inputs=t.inputs[:0], start=0.0)
    c = certificate(*(*given[:-2], at_once, SETTINGS))
    assert {len(o.possible) for o in c.obstacles} == {1}
    assert c.fail_safe.inputs.shape == (0, 2)


def test_versions_of_what_made_it() -> None:
    built = build()
    wanted = {name: metadata.version(name) for name in ("sandra", "numpy", "shapely")}
    assert dict(versions()) == {"python": platform.python_version(), **wanted}
    assert built.versions == versions()


def test_what_is_near() -> None:
    """Points from (100, -30) to (140, -20); a square of 10 m beside their box."""
    points = np.array([[100.0, -20.0], [140.0, -30.0], [120.0, -25.0]])
    for x, y, ok in (
        (40.0, -25.0, True),
        (39.9, -25.0, False),
        (190.0, -25.0, True),
        (190.1, -25.0, False),
        (120.0, -90.0, True),
        (120.0, -90.1, False),
        (120.0, 30.0, True),
        (120.0, 30.1, False),
        (190.0, 30.0, True),
    ):
        left, right = (np.array([[x, y + w], [x + 10.0, y + w]]) for w in (10.0, 0.0))
        assert _near(Lanelet(1, left, right, (), (), (), None, None, None), points) == ok, (x, y)
        assert _near(Lanelet(1, right, left, (), (), (), None, None, None), points) == ok, (x, y)


# Copies


def test_arrays_are_read_only_copies_without_rounding() -> None:
    given = np.array([1.0, 1e-31, -1e-31, 1e-30, 0.0, np.nan])
    found = _array(given)
    assert np.array_equal(found, [1.0, 0.0, 0.0, 1e-30, 0.0, np.nan], equal_nan=True)
    assert not found.flags.writeable
    assert given[1] == 1e-31
    assert _array([1, 2]).dtype == np.float64


def test_trajectories_are_copied() -> None:
    t = Trajectory(np.ones((2, 5)), np.ones((1, 2)), 1, 2)  # type: ignore[arg-type]
    found = _trajectory(t)
    assert found.states is not t.states
    assert found.inputs is not t.inputs
    assert (found.tau, found.start) == (1.0, 2.0)
    assert isinstance(found.tau, float)
    assert isinstance(found.start, float)
    assert not found.states.flags.writeable
    assert not found.inputs.flags.writeable
    assert np.array_equal(found.states, t.states)
    assert np.array_equal(found.inputs, t.inputs)


def test_regions_are_copied_only_where_rounding_is_taken_off() -> None:
    plain = ((Region(np.ones((3, 2)), 0.25),), ())
    assert _occupancies(plain) is plain
    assert _occupancies(((), ())) == ((), ())
    tiny = (plain[0], (), (Region(np.array([[1.0, 1e-40]]), 2), Region(np.ones((1, 2)), 3.0)))
    found = _occupancies(tiny)
    assert [len(step) for step in found] == [1, 0, 2]
    assert found[2][0].vertices.tolist() == [[1.0, 0.0]]
    assert [r.radius for step in found for r in step] == [0.25, 2.0, 3.0]
    assert not found[0][0].vertices.flags.writeable


def test_only_own_words_are_kept() -> None:
    words = Vocabulary.default()
    assert _own(None) is None
    assert _own(words) is None
    own = Vocabulary({**words.actions, "x": "1"}, {"y": "2"}, {"z": "3"}, {"x": "none"})
    kept = _own(own)
    assert kept is not None
    assert {k: dict(v) for k, v in kept.items()} == {
        "actions": dict(own.actions),
        "rules": {"y": "2"},
        "predicates": {"z": "3"},
    }
    assert build(vocabulary=own).vocabulary == kept
