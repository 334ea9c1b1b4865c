"""Letters of a trajectory: each atom at its boundary, with room to both sides."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from reach_scenes import Course, prediction
from sandra.actions import ActionPair
from sandra.errors import FormulaError
from sandra.logic import Comparison, Formula, Part, Predicate, Specification, parse
from sandra.planning.limits import MARGIN
from sandra.planning.trace import (
    DISTANCE_MARGIN,
    TOUCH_MARGIN,
    Lanes,
    Steps,
    satisfies,
    steps_of,
)
from sandra.planning.tracking import advance
from sandra.planning.validity import corners
from sandra.reach import Ground, ground
from sandra.reach.bands import Leader
from sandra.settings import Settings

COURSE = Course()
PAIR = ActionPair.parse("keep,follow-lane")
HALF = 4.5 / 2
"""Half of the body's length [m]."""


def made(course: Course = COURSE, **options: float) -> Ground:
    scene = course.scene(**options)  # type: ignore[arg-type]
    return ground(scene, prediction(scene, 2), Settings(horizon=2))


GROUND = made()
LANES = Lanes.of(GROUND)


def steps(
    v: list[float] | float = 10.0,
    *,
    along: list[float] | None = None,
    s: float = 0.0,
    d: float = 0.0,
    a: tuple[float, float] = (0.0, 0.0),
) -> Steps:
    """Two steps with the body at (s, d), parallel to the road."""
    speed = np.broadcast_to(np.asarray(v, dtype=float), (2,))
    states = np.array([[s, d, 0.0, 0.0, 0.0]] * 2)
    return Steps(
        corners(states, GROUND.scene.ego)[None],
        speed[None],
        speed[None] if along is None else np.array([along]),
        states[None, :, :2],
        np.array([[a, a]]),
    )


def holds(formula: str | Formula, at: Steps, base: Ground = GROUND) -> bool:
    parsed = parse(formula) if isinstance(formula, str) else formula
    spec = Specification(PAIR, (Part("r", str(formula), parsed),))
    return bool(satisfies(base, LANES, spec, at)[0])


@pytest.mark.parametrize(
    ("formula", "good", "bad"),
    [
        ("G(v <= 10)", 10.0 - 0.6 * MARGIN, 10.0 - 0.4 * MARGIN),
        ("G(v < 10)", 10.0 - 0.6 * MARGIN, 10.0 - 0.4 * MARGIN),
        ("G(v > 10)", 10.0 + 0.6 * MARGIN, 10.0 + 0.4 * MARGIN),
        ("G(v >= 10)", 10.0 + 0.6 * MARGIN, 10.0 + 0.4 * MARGIN),
    ],
)
def test_comparisons_hold_with_half_a_margin(formula: str, good: float, bad: float) -> None:
    assert holds(formula, steps(good))
    assert not holds(formula, steps(bad))
    assert not holds(formula, steps([good, bad]))
    assert not holds(formula, steps([bad, good]))


@pytest.mark.parametrize(("op", "expected"), [("<=", True), ("<", False)])
def test_exactly_at_the_shifted_bound(op: str, expected: bool) -> None:
    atom = Comparison("v", op, 10.0 + MARGIN / 2)
    assert holds(atom, steps(10.0)) is expected


def test_trajectories_are_judged_one_by_one() -> None:
    """Many at once are judged as each is alone, in their order."""
    both = (steps(10.0, a=(1.0, 1.0)), steps(9.0), steps(10.0, d=3.6), steps(9.0, a=(2.0, 2.0)))
    many = Steps(*(np.concatenate([getattr(x, n) for x in both]) for n in Steps.__slots__))
    for formula in ("G(v > 9.5)", "F(a > 0.5)", "G(in_lane(left))", "G(v < 9.5) | F(a > 0.5)"):
        spec = Specification(PAIR, (Part("r", formula, parse(formula)),))
        alone = [holds(formula, one) for one in both]
        assert satisfies(GROUND, LANES, spec, many).tolist() == alone
        assert 0 < sum(alone) < len(alone)


def test_each_variable_is_the_one_it_names() -> None:
    at = steps(3.0, s=7.0, d=-2.0, a=(1.0, 1.0))
    for name, value in (("v", 3.0), ("s", 7.0), ("d", -2.0), ("a", 1.0)):
        assert holds(f"G({name} > {value - 0.1} & {name} < {value + 0.1})", at)
        assert not holds(f"F({name} > {value + 0.1})", at)
        assert not holds(f"F({name} < {value - 0.1})", at)


def test_the_lowest_and_the_highest_input_both_count() -> None:
    at = steps(a=(-1.0, 1.0))
    assert holds("G(a > -1.1 & a < 1.1)", at)
    assert not holds("G(a > -0.9)", at)
    assert not holds("G(a < 0.9)", at)


def test_both_speeds_count() -> None:
    """Along the body's path and along the lane: nobody says which one a rule means."""
    for speed, along in ((10.0, 9.0), (9.0, 10.0)):
        at = steps(speed, along=[along, along])
        assert holds("G(v > 8.9 & v < 10.1)", at)
        assert not holds("G(v < 9.9)", at)
        assert not holds("G(v > 9.1)", at)


# Lanes: the ego's is 3.5 m wide about d = 0, the body 1.8 m wide.


@pytest.mark.parametrize("lane", ["in_lane(left)", "in_lanelet(101)"])
def test_a_lane_is_touched_for_sure_or_left_for_sure(lane: str) -> None:
    touching = 1.75 - 0.9
    inside = steps(d=touching + 1.1 * TOUCH_MARGIN)
    assert holds(f"G({lane})", inside)
    assert not holds(f"G(!{lane})", inside)
    outside = steps(d=touching - 1.1 * TOUCH_MARGIN)
    assert holds(f"G(!{lane})", outside)
    assert not holds(f"G({lane})", outside)
    for between in (touching + 0.9 * TOUCH_MARGIN, touching - 0.9 * TOUCH_MARGIN):
        assert not holds(f"G({lane})", steps(d=between))
        assert not holds(f"G(!{lane})", steps(d=between))


def test_each_lane_by_its_relation() -> None:
    for d, there in ((0.0, "current"), (3.5, "left"), (-3.5, "right")):
        for relation in ("current", "left", "right", "opposite"):
            assert holds(f"G(in_lane({relation}))", steps(d=d)) is (relation == there)
            assert holds(f"G(!in_lane({relation}))", steps(d=d)) is (relation != there)


@pytest.mark.parametrize(
    "atom",
    [
        Predicate("in_lane", "nowhere"),
        Predicate("in_lane", None),
        Predicate("in_lanelet", "left"),
        Predicate("in_lanelet", None),
        Predicate("keeps_safe_distance", "following"),
        Predicate("keeps_safe_distance", None),
        Predicate("flies", None),
    ],
)
def test_what_is_not_known_is_refused(atom: Predicate) -> None:
    with pytest.raises(FormulaError, match="unknown predicate"):
        holds(atom, steps())


# The safe distance (paper eq. 5, 6): v^2 / 12 + 0.4 v, less v_other^2 / 24.


def behind(*leaders: Leader, relation: str = "current") -> Ground:
    """Vehicles in one lane, the nearest first, at both steps."""
    bands = tuple((name, ()) for name in ("current", "left", "right"))
    by_band = tuple((leaders if name == relation else (),) * 2 for name, _ in bands)
    return replace(GROUND, bands=bands, leaders=by_band)


SAFE = "G(keeps_safe_distance(preceding))"
UNSAFE = "G(!keeps_safe_distance(preceding))"


@pytest.mark.parametrize(("own", "other"), [(6.0, 0.0), (12.0, 0.0), (6.0, 6.0), (12.0, 6.0)])
def test_the_safe_distance_with_a_margin_to_both_sides(own: float, other: float) -> None:
    needed = own**2 / 12 + 0.4 * own - other**2 / 24

    def at(gap: float) -> Ground:
        return behind(Leader(HALF + gap, other))

    assert holds(SAFE, steps(own), at(needed + 1.1 * DISTANCE_MARGIN))
    assert not holds(SAFE, steps(own), at(needed + 0.9 * DISTANCE_MARGIN))
    assert holds(UNSAFE, steps(own), at(needed - 1.1 * DISTANCE_MARGIN))
    assert not holds(UNSAFE, steps(own), at(needed - 0.9 * DISTANCE_MARGIN))


def test_exactly_the_safe_distance_is_not_kept() -> None:
    at_it = 0.0 + HALF + DISTANCE_MARGIN
    assert not holds(SAFE, steps(0.0), behind(Leader(at_it, 0.0)))
    assert holds(SAFE, steps(0.0), behind(Leader(at_it + 1e-6, 0.0)))


def test_who_precedes() -> None:
    """Somebody level with the front, up to the margin, still does; who is further behind not."""
    last = 0.0 + HALF + DISTANCE_MARGIN - 2 * DISTANCE_MARGIN
    assert not holds(SAFE, steps(10.0), behind(Leader(last + 1e-6, 0.0)))
    assert holds(SAFE, steps(10.0), behind(Leader(last, 0.0)))
    assert holds(SAFE, steps(10.0), behind(Leader(last - 1.0, 0.0)))
    # Read the other way, the front is where it is: nobody at it or behind it is to be kept from.
    front = 0.0 + HALF - DISTANCE_MARGIN
    assert not holds(UNSAFE, steps(10.0), behind(Leader(front, 0.0)))


def test_the_nearest_that_precedes_counts() -> None:
    near, far = Leader(HALF + 3.0, 0.0), Leader(HALF + 100.0, 0.0)
    assert not holds(SAFE, steps(10.0), behind(near, far))
    assert holds(SAFE, steps(10.0), behind(far))
    # One that has been passed hides nobody.
    assert not holds(SAFE, steps(10.0), behind(Leader(-10.0, 0.0), near))
    # An infinite speed: no distance is asked to the one that has cut in.
    assert holds(SAFE, steps(10.0), behind(Leader(HALF + 1.0, np.inf), near))


def test_only_lanes_that_the_body_touches() -> None:
    near = Leader(HALF + 3.0, 0.0)
    for relation, d in (("left", 3.5), ("right", -3.5)):
        assert holds(SAFE, steps(10.0), behind(near, relation=relation))
        assert not holds(SAFE, steps(10.0, d=d), behind(near, relation=relation))
    # Perhaps touched is touched.
    nearly = 1.75 - 0.9 - 0.9 * TOUCH_MARGIN
    assert not holds(SAFE, steps(10.0, d=nearly), behind(near, relation="left"))
    assert holds(SAFE, steps(10.0, d=nearly - 0.2 * TOUCH_MARGIN), behind(near, relation="left"))


def test_one_step_without_the_distance_is_enough_to_break_it() -> None:
    near = Leader(HALF + 3.0, 0.0)
    base = behind(near)
    once = replace(base, leaders=(((), (near,)), ((), ()), ((), ())))
    assert not holds(SAFE, steps(10.0), once)
    assert holds("F(keeps_safe_distance(preceding))", steps(10.0), once)


# Speed limits.


def signed(*limits: tuple[float, float, float | None]) -> Ground:
    return replace(GROUND, limits=tuple((a, b, x, x) for a, b, x in limits))


LIMIT = "G(keeps_lane_speed_limit)"


def test_the_lowest_limit_where_the_ego_is() -> None:
    base = signed((-np.inf, 0.0, 12.0), (0.0, 10.0, 8.0), (10.0, 20.0, None), (20.0, np.inf, 5.0))
    for s, limit in ((-5.0, 12.0), (5.0, 8.0), (25.0, 5.0)):
        assert holds(LIMIT, steps(limit - 0.6 * MARGIN, s=s), base)
        assert not holds(LIMIT, steps(limit - 0.4 * MARGIN, s=s), base)
    assert holds(LIMIT, steps(29.0, s=15.0), base)  # unknown


def test_where_a_limit_begins_or_ends_it_applies() -> None:
    base = signed((0.0, 10.0, 8.0))
    for s in (0.0, 10.0):
        assert not holds(LIMIT, steps(9.0, s=s), base)
    for s in (-1e-6, 10.0 + 1e-6):
        assert holds(LIMIT, steps(9.0, s=s), base)


def test_exactly_the_limit() -> None:
    base = signed((0.0, 10.0, 9.0 + MARGIN / 2))
    assert holds(LIMIT, steps(9.0, s=5.0), base)


def test_a_reading_shifts_everything_to_one_side() -> None:
    """The bound and the limit are both 10: the strictest reading grants neither."""
    base = signed((-np.inf, np.inf, 10.0))
    assert not holds("G(v <= 10 | keeps_lane_speed_limit)", steps(10.0 - 0.4 * MARGIN), base)
    assert holds("G(v <= 10 | keeps_lane_speed_limit)", steps(10.0 - 0.6 * MARGIN), base)


# What is read off a trajectory.


@pytest.mark.parametrize("kappa", [0.0, 0.02, -0.02])
def test_steps_of_a_driven_trajectory(kappa: float) -> None:
    """Speed along the lane against the change of the foot point over a hundredth of a step."""
    course = Course(kappa, step=0.25)
    base = made(course, d=1.0, angle=0.1)
    ego = base.scene.ego
    state = [ego.state.x, ego.state.y, ego.state.heading, 10.0, 0.05]
    states, inputs = (
        [state],
        np.array([[1.0, 0.2], [-2.0, 0.1], [0.5, 0.0], [0.25, -0.1], [0.0, 0.0], [0.0, 0.1]]),
    )
    for u in inputs.tolist():
        states.append(advance(states[-1], tuple(u), 0.05, ego.wheelbase))
    found = steps_of(base, np.array(states), inputs, 2)
    at = np.array(states)[::2]
    assert np.array_equal(found.bodies[0], corners(at, ego))
    assert np.array_equal(found.speed[0], at[:, 3])
    assert found.inputs[0].tolist() == [[-2.0, 1.0], [0.25, 0.5], [0.0, 0.0], [0.0, 0.0]]
    frame = base.scene.frame
    assert np.array_equal(found.position[0], frame.to_curvilinear(at[:, :2]))
    later = np.array([advance(x, (0.0, 0.0), 1e-3, ego.wheelbase) for x in at.tolist()])
    moved = (frame.to_curvilinear(later[:, :2]) - found.position[0])[:, 0] / 1e-3
    assert found.along[0] == pytest.approx(moved, abs=0.03)
    assert np.abs(found.along - found.speed).max() > 0.04
