"""Reasons: which cause is named, where several would do or none alone does."""

import pytest

from reach_scenes import Course, prediction
from sandra.actions import ActionPair
from sandra.logic import Specification, specification
from sandra.reach import Ground, compute, ground
from sandra.reach.explain import explain
from sandra.scene.types import Obstacle
from sandra.settings import Settings

H = 10
KEEP = ActionPair.parse("keep,follow-lane")


def on(*cars: Obstacle, left: int = 0, **scene: float) -> Ground:
    course = Course()
    found = course.scene(course.lanes(left=left, right=0), cars, **scene)
    return ground(found, prediction(found, H), Settings(horizon=H))


def formulas(base: Ground, *texts: str) -> Specification:
    """Nothing but these formulas."""
    whole = specification(KEEP, texts, base.settings, dt=base.scene.dt)
    return Specification(KEEP, tuple(p for p in whole.parts if p.name in texts))


def reason(base: Ground, *texts: str) -> str:
    spec = formulas(base, *texts)
    return explain(base, spec, compute(base, spec), compute)


def test_the_only_cause() -> None:
    text = reason(on(speed=10.0), "G(v <= 9)")
    assert text == (
        f"empty at step 0: action G(v <= 9) [G(v <= 9)] cannot be kept; without it the set "
        f"lasts through step {H}"
    )


def test_a_rule_is_called_a_rule() -> None:
    course = Course()
    base = on(course.car(2, 8.0, 0.0), speed=10.0)
    whole = specification(KEEP, ("R_G1",), base.settings, dt=base.scene.dt)
    spec = Specification(KEEP, tuple(p for p in whole.parts if p.name == "R_G1"))
    assert "rule R_G1 [" in explain(base, spec, compute(base, spec), compute)


def test_the_cause_without_which_the_set_lives_longest() -> None:
    """At most 11.2 m/s at step 2, and 12.4 m/s at step 4."""
    base = on(speed=10.0)
    first, later = "X X (v >= 11.5)", "X X X X (v >= 12.5)"
    assert reason(base, first, later) == (
        f"empty at step 2: action {first} [{first}] cannot be kept; "
        "without it the set lasts until step 4"
    )


def test_the_first_of_several_that_do_equally_well() -> None:
    """So fast it cannot be where the second asks it to be; the third asks too much at step 4."""
    base = on(speed=10.0)
    one, two, three = "X X (v >= 10.9)", "X X (s <= 42)", "X X X X (v >= 12.5)"
    assert reason(base, one, two, three) == (
        f"empty at step 2: action {one} [{one}] cannot be kept; "
        "without it the set lasts until step 4"
    )


def test_several_causes_of_which_none_alone_suffices() -> None:
    assert reason(on(speed=10.0), "G(v <= 9)", "G(v <= 8)") == (
        "empty at step 0: several causes at once, none alone: "
        "action G(v <= 9) [G(v <= 9)] cannot be kept, "
        "action G(v <= 8) [G(v <= 8)] cannot be kept"
    )


def test_one_obstacle_is_not_the_other_traffic_as_well() -> None:
    course = Course()
    collides = course.car(7, 1.0, 0.0)
    text = reason(on(collides, speed=10.0), "G(v <= 9)")
    assert text == (
        "empty at step 0: several causes at once, none alone: car 7 leaves no room, "
        "action G(v <= 9) [G(v <= 9)] cannot be kept"
    )
    # two of them, and each alone is enough
    other = course.car(8, 0.5, 0.0, kind="truck")
    text = reason(on(collides, other, speed=10.0))
    assert text == (
        f"empty at step 0: the other traffic leaves no room; without it the set lasts "
        f"through step {H}"
    )


def test_at_most_four_obstacles_are_left_out_those_with_most_cells_first() -> None:
    course = Course()
    cars = [course.car(i, 0.1 * i, 0.0) for i in range(2, 9)]
    text = reason(on(*cars, speed=10.0), "G(v <= 9)")
    assert text.count("leaves no room") == 5
    assert "the other traffic leaves no room" in text


def test_both_the_border_and_a_car() -> None:
    """A car in the own lane, and no other lane."""
    course = Course()
    base = on(course.car(7, 12.5, 0.0), speed=14.0)
    spec = Specification(KEEP, ())
    found = compute(base, spec)
    assert found.first_empty_step is not None
    text = explain(base, spec, found, compute)
    assert "car 7 leaves no room" in text


@pytest.mark.parametrize(("speed", "known"), [(30.0, False), (30.5, True)])
def test_the_highest_speed_itself_is_no_cause(speed: float, known: bool) -> None:
    text = reason(on(speed=speed), "G(v <= 5)")
    assert ("exceeds v_max" in text) == known
    if known:
        assert text == "empty at step 0: the initial speed 30.5 m/s exceeds v_max = 30 m/s"


def test_a_missing_lane_is_a_cause_only_for_those_that_go_there() -> None:
    base = on(left=1, speed=10.0)
    too_slow = ("G(v <= 9)",)
    for text, missing in (
        ("keep,left-lane", None),
        ("keep,right-lane", "right"),
        ("keep,follow-lane", None),
    ):
        pair = ActionPair.parse(text)
        spec = specification(pair, too_slow, base.settings, dt=base.scene.dt)
        found = explain(base, spec, compute(base, spec), compute)
        if missing:
            assert found == (
                f"empty at step {0 if 'empty at step 0' in found else H}: there is no "
                f"{missing}-adjacent lane in the same direction"
            )
        else:
            assert "G(v <= 9)" in found
