"""What others are played to do, where predictions must be, and how near they come."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import shapely

from certified import made
from sandra.certificate import Certificate, Checked, Violation, others
from sandra.certificate.collision import (
    NEAR,
    Clearance,
    _box_gaps,
    _boxes,
    clearance,
    predictions,
    set_based_collision,
    witness_collision,
)
from sandra.certificate.geometry import Sweep
from sandra.certificate.others import (
    _held,
    _mean_heading,
    _placed,
    _standing_still,
    _straight_on,
    _travelled,
    _within,
    occupancies,
)
from sandra.certificate.types import Pavement
from sandra.scene.types import Region

BASE = made()
OTHER = BASE.obstacles[0]
EVERYWHERE = Region(np.array([[-500.0, -500.0], [500.0, -500.0], [500.0, 500.0], [-500.0, 500.0]]))
FAR = Region(EVERYWHERE.vertices * 0.001 + 300.0)


def wide(number: int = 1, low: float = -50.0, high: float = 50.0, turn: float = 0.0) -> Pavement:
    """A lanelet of a square, driven in the direction of `turn`."""
    c, s = math.cos(turn), math.sin(turn)
    ends = np.array([-50.0, 50.0])
    lines = [np.column_stack([c * ends - s * y, s * ends + c * y]) for y in (high, low)]
    return Pavement(number, lines[0], lines[1], None)


def alone(*lanelets: Pavement, **changes: Any) -> Certificate:
    """One round car of radius 1 m at the origin, at 4 m/s along x, that may be anywhere."""
    states = np.tile([0.0, 0.0, 0.0, 4.0, 0.0], (len(OTHER.states), 1))
    car = replace(
        OTHER,
        outline=Region.disc(1.0),
        states=states,
        likely=((EVERYWHERE,),) * 15,
        possible=((EVERYWHERE,),) * 21,
        assumptions=(),
        basis=(),
    )
    return replace(
        BASE, obstacles=(replace(car, **changes),), lanelets=lanelets or (wide(),), lanes=()
    )


# Ways


@pytest.mark.parametrize(
    ("speed", "acceleration", "top", "time", "way"),
    [
        (4.0, 0.0, 9.0, 3.0, 12.0),
        (4.0, 2.0, 9.0, 2.0, 12.0),
        # 2 s of gaining speed, 1 s at the top speed.
        (4.0, 2.0, 8.0, 3.0, 12.0 + 8.0),
        (4.0, -2.0, 8.0, 1.0, 3.0),
        (4.0, -2.0, 8.0, 7.0, 4.0),
        (8.0, 2.0, 8.0, 3.0, 24.0),
        (0.0, -2.0, 8.0, 3.0, 0.0),
    ],
)
def test_ways_at_constant_acceleration(
    speed: float, acceleration: float, top: float, time: float, way: float
) -> None:
    assert _travelled(speed, acceleration, top, time) == pytest.approx(way)


def test_the_course_of_a_line_is_that_from_end_to_end() -> None:
    line = np.array([[1.0, 1.0], [9.0, -7.0], [2.0, 3.0]])
    assert _mean_heading(line) == pytest.approx(math.atan2(2.0, 1.0))
    assert _mean_heading(line[::-1]) == pytest.approx(math.atan2(-2.0, -1.0))


def test_an_outline_is_turned_and_moved() -> None:
    box = Region(np.array([[0.0, 0.0], [4.0, 0.0], [4.0, 1.0], [0.0, 1.0]]))
    found = _placed(box, np.array([[10.0, 20.0, 0.0], [10.0, 20.0, math.pi / 2]]))
    assert shapely.bounds(found) == pytest.approx(
        np.array([[10.0, 20.0, 14.0, 21.0], [9.0, 20.0, 10.0, 24.0]])
    )
    (round_one,) = _placed(replace(box, radius=0.5), np.array([[10.0, 20.0, 0.0]]))
    assert shapely.bounds(round_one) == pytest.approx([9.5, 19.5, 14.5, 21.5])


# Who is played


def test_three_ways_of_going_straight_on_are_played() -> None:
    c = alone(wide())
    dt, a = c.dt, c.settings.assumptions.max_acceleration
    assert (dt, a, c.settings.assumptions.max_speed) == (0.1, 12.0, 50.0)
    expected = []
    for k in (0, 1, 2, 4, 8, 16, 20):
        t = (k + 1) * dt
        stop = min(t, 4.0 / a)
        fast = min(t, 46.0 / a)
        expected += [
            (k, 4.0 * stop - a * stop**2 / 2),
            (k, 4.0 * t),
            (k, 4.0 * fast + a * fast**2 / 2 + 50.0 * (t - fast)),
        ]
    found = _straight_on(c)
    where = [(x.interval, shapely.centroid(x.body).x) for x in found]
    assert np.array(where) == pytest.approx(np.array(expected))
    for each in found:
        assert (each.obstacle, each.kind) == (7, "set-based")
        assert each.regions is c.obstacles[0].possible[each.interval]
        assert shapely.bounds(each.within).tolist() == [-50.0, -50.0, 50.0, 50.0]
    # A vehicle that is faster than the limit keeps its speed.
    fast = alone(wide(), states=np.tile([0.0, 0.0, 0.0, 60.0, 0.0], (16, 1)))
    assert shapely.centroid(_straight_on(fast)[2].body).x == pytest.approx(6.0)


def test_bounds_on_braking_and_driving_are_played_where_they_are_listed() -> None:
    c = alone(wide())
    a = replace(c.settings.assumptions, max_braking=5.0, max_driving=3.0)
    c = replace(c, settings=replace(c.settings, assumptions=a))

    def played(*listed: str) -> list[float]:
        (o,) = c.obstacles
        found = _straight_on(replace(c, obstacles=(replace(o, assumptions=listed),)))
        return [shapely.centroid(x.body).x for x in found[:3]]

    t = c.dt
    for listed, (slower, faster) in {
        (): (12.0, 12.0),
        ("max_braking",): (5.0, 12.0),
        ("max_driving",): (12.0, 3.0),
        ("max_braking", "max_driving"): (5.0, 3.0),
    }.items():
        ways = [4.0 * t - slower * t**2 / 2, 4.0 * t, 4.0 * t + faster * t**2 / 2]
        assert played(*listed) == pytest.approx(ways)


def test_going_straight_on_follows_the_heading() -> None:
    turned = alone(wide(turn=0.6), states=np.tile([1.0, 2.0, 0.5, 4.0, 0.0], (16, 1)))
    where = shapely.centroid(_straight_on(turned)[1].body)
    assert (where.x, where.y) == pytest.approx(
        (1.0 + 0.4 * math.cos(0.5), 2.0 + 0.4 * math.sin(0.5))
    )


@pytest.mark.parametrize(
    ("change", "is_played"),
    [
        *(
            ({"kind": kind}, True)
            for kind in ("car", "truck", "bus", "taxi", "motorcycle", "priorityVehicle")
        ),
        *(({"kind": kind}, False) for kind in ("pedestrian", "bicycle", "train", "unknown")),
        ({"is_static": True}, False),
        ({"assumptions": ("no_rear_end",)}, False),
        ({"assumptions": ("follow_lanes", "legal_cut_in")}, False),
        ({"assumptions": ("follow_lanes",)}, True),
        ({"states": np.full((16, 5), math.nan)}, False),
        ({"states": np.tile([0.0, 0.0, 0.0, -1.0, 0.0], (16, 1))}, False),
        ({"states": np.tile([0.0, 49.5, 0.0, 1.0, 0.0], (16, 1))}, False),
        *(
            ({"states": np.tile([0.0, 0.0, heading, 4.0, 0.0], (16, 1))}, ok)
            for heading, ok in (
                (math.radians(29.9), True),
                (math.radians(-29.9), True),
                (math.radians(30.1), False),
                (math.radians(-30.1), False),
                (4 * math.pi + 0.1, True),
                (math.pi, False),
                (-math.pi, False),
            )
        ),
    ],
)
def test_who_is_played(change: dict[str, Any], is_played: bool) -> None:
    assert bool(_straight_on(alone(**change))) == is_played


def test_of_several_lanelets_the_one_along_the_heading_is_taken() -> None:
    across, along = wide(1, turn=math.pi / 2), wide(2, -20.0, 20.0)
    homes = {x.within.bounds for x in _straight_on(alone(across, along))}
    assert homes == {(-50.0, -20.0, 50.0, 20.0)}
    backwards = alone(wide(1, turn=math.pi), states=np.tile([0, 0, 3.1, 4.0, 0.0], (16, 1)))
    assert _straight_on(backwards)


def test_who_stands_is_looked_for_where_it_stands() -> None:
    state = [3.0, 4.0, 0.5, 0.0, 0.0]
    states = np.vstack([state, np.zeros((15, 5))])
    c = alone(is_static=True, states=states, outline=Region.rectangle(2.0, 1.0))
    found = _standing_still(c)
    assert [x.interval for x in found] == [0, 1, 2, 4, 8, 16, 20]
    for each in found:
        assert (each.obstacle, each.kind, each.within) == (7, "set-based", None)
        assert each.regions is c.obstacles[0].possible[each.interval]
        assert shapely.centroid(each.body).coords[0] == pytest.approx((3.0, 4.0))
        assert each.body.area == pytest.approx(2.0)
    assert not _standing_still(alone(is_static=False))


@pytest.mark.parametrize("is_static", [True, False])
def test_who_is_seen_now_is_played_and_nobody_else(is_static: bool) -> None:
    kind_of_play = _standing_still if is_static else _straight_on
    now, later = np.tile([0.0, 0.0, 0.0, 4.0, 0.0], (2, 16, 1))
    now[1:], later[0] = math.nan, math.nan
    assert len(kind_of_play(alone(is_static=is_static, states=now))) == (7 if is_static else 21)
    assert not kind_of_play(alone(is_static=is_static, states=later))
    # Who is played where it is now does not depend on what comes later.
    elsewhere = now.copy()
    elsewhere[1:] = [300.0, 0.0, 2.0, -4.0, 0.0]
    found = kind_of_play(alone(is_static=is_static, states=elsewhere))
    assert shapely.bounds(found[0].body)[0] == pytest.approx(-1.0 if is_static else -0.66)


def test_who_is_nowhere_is_not_looked_for() -> None:
    assert not _standing_still(alone(is_static=True, states=np.full((16, 5), math.nan)))


@pytest.mark.parametrize(
    ("prediction", "basis", "is_looked_at"),
    [
        ("recorded", (), True),
        ("most-likely", ("lane",), True),
        ("constant-velocity", (), True),
        ("recorded", ("recorded occupancies",), False),
        ("set-based", (), False),
    ],
)
def test_a_predicted_trajectory_is_within_its_regions(
    prediction: str, basis: tuple[str, ...], is_looked_at: bool
) -> None:
    likely = ((EVERYWHERE,),) * 6 + ((FAR,),) * 9
    c = replace(alone(likely=likely, basis=basis), prediction=prediction)
    answer = occupancies(c)
    if is_looked_at:
        assert answer == Violation(
            "occupancies",
            f"obstacle 7: its region in the {prediction} prediction, interval 6, does not hold a "
            "body that its assumptions allow there",
            6,
            pytest.approx(0.6),
        )
    else:
        assert isinstance(answer, Checked)


def test_both_ends_of_an_interval_must_be_in_its_regions() -> None:
    """The body is elsewhere at step 4: interval 3 ends there, and interval 4 begins."""
    states = np.tile([0.0, 0.0, 0.0, 4.0, 0.0], (16, 1))
    states[4] = [100.0, 0.0, 0.0, 4.0, 0.0]
    here = Region(np.array([[-5.0, -5.0], [9.0, -5.0], [9.0, 5.0], [-5.0, 5.0]]))
    for roomy, first in (((), 3), ((3,), 4), ((3, 4), None)):
        likely = tuple((EVERYWHERE,) if k in roomy else (here,) for k in range(15))
        answer = occupancies(alone(states=states, likely=likely))
        assert (answer.step if isinstance(answer, Violation) else None) == first
    # Who is not there needs no region.
    states[4] = math.nan
    assert isinstance(occupancies(alone(states=states, likely=((here,),) * 15)), Checked)
    none_left = alone(states=states, likely=tuple((() if k == 3 else (here,)) for k in range(15)))
    assert isinstance(occupancies(none_left), Violation)


def test_places_out_of_the_lanelet_are_not_demanded() -> None:
    """The car's centre must not get beyond x = 1 m, or it leaves the lanelet."""
    borders = (np.array([[-9.0, y], [2.0, y]]) for y in (5.0, -5.0))
    short = Pavement(1, *borders, None)
    for end, ok in ((2.0, True), (1.7, False)):
        near = Region(np.array([[-1.0, -1.0], [end, -1.0], [end, 1.0], [-1.0, 1.0]]))
        c = replace(alone(short, possible=((near,),) * 21), prediction="set-based")
        answer = occupancies(c)
        if ok:
            # In interval 0 all three stay within it, in 1 two, then only who brakes.
            assert answer == Checked(
                "occupancies", "10 allowed places of others lie in their regions"
            )
        else:
            assert isinstance(answer, Violation)
            assert answer.step == 1


def test_a_body_may_stick_out_by_5_cm() -> None:
    body = shapely.box(0.0, 0.0, 4.0, 2.0)
    for length, ok in ((3.951, True), (3.949, False)):
        inner = Region(np.array([[0.0, 0.0], [length, 0.0], [length, 2.0], [0.0, 2.0]]))
        assert _held([(inner,)], np.array([body])).tolist() == [ok]
    assert others.SLACK == 0.05


def test_regions_hold_a_body_together_or_alone() -> None:
    body, beside = shapely.box(0.0, 0.0, 4.0, 2.0), shapely.box(50.0, 0.0, 54.0, 2.0)
    whole = Region(np.array([[-1.0, -1.0], [5.0, -1.0], [5.0, 3.0], [-1.0, 3.0]]))
    first, second = (
        Region(np.array([[x, -1.0], [x + 3.0, -1.0], [x + 3.0, 3.0], [x, 3.0]])) for x in (-1, 2)
    )
    capsule = Region(np.array([[0.0, 1.0], [4.0, 1.0]]), 1.5)
    several = [(whole,), (first, second), (first,), (capsule,), (), (FAR, whole), (whole, FAR)]
    expected = [True, True, False, True, False, True, True]
    assert _held(several, np.array([body] * 7)).tolist() == expected
    assert _held(several, np.array([beside] * 7)).tolist() == [False] * 7
    # The same regions for several bodies.
    regions = (first, second)
    assert _held([regions, (whole,), regions], np.array([body, beside, body])).tolist() == [
        *(True, False, True)
    ]


def test_a_shape_is_within_a_radius_if_its_corners_are() -> None:
    point, bar = shapely.Point(0.0, 0.0), shapely.box(-3.0, -1.0, 3.0, 1.0)
    shape = shapely.Polygon([(3.0, 4.0), (-3.0, 4.0), (0.0, -5.0)])
    for radius, hull, ok in (
        # Every corner is 5 m from the point; 3, 3 and 4 m from the bar, one of them aside of it.
        (5.0, point, True),
        (math.nextafter(5.0, 0.0), point, False),
        (4.0, bar, True),
        (3.9, bar, False),
        (2.9, bar, False),
        (0.0, bar, False),
        (0.0, shape, True),
    ):
        several = np.array([shape, point, shapely.Polygon()])
        found = _within(np.full(3, radius), np.array([hull] * 3), several)
        # The point lies in each of them, and what has no corner is nowhere.
        assert found.tolist() == [ok, True, False]


# How much must be predicted


@pytest.mark.parametrize(("steps", "needed"), [(0, 1), (1, 2), (2, 2), (3, 3), (40, 21)])
def test_how_many_intervals_a_fail_safe_needs(steps: int, needed: int) -> None:
    """It begins after 2 steps, 2 of which are one interval."""
    t = BASE.fail_safe
    short = replace(t, states=t.states[: steps + 1], inputs=t.inputs[:steps])
    enough = replace(OTHER, possible=OTHER.possible[:needed])
    assert isinstance(predictions(replace(BASE, fail_safe=short, obstacles=(enough,))), Checked)
    fewer = replace(OTHER, possible=OTHER.possible[: needed - 1])
    answer = predictions(replace(BASE, fail_safe=short, obstacles=(enough, fewer)))
    assert answer == Violation(
        "predictions",
        f"obstacle 7: the set-based prediction has {needed - 1} intervals, {needed} are needed",
        needed - 1,
        pytest.approx((needed - 1) * 0.1),
        needed - 1.0,
        float(needed),
    )


# How near they come


def test_nobody_is_where_nobody_is_predicted() -> None:
    nobody = Clearance(math.inf)
    assert (nobody.step, nobody.obstacle) == (0, 0)
    assert NEAR == 2.0


def test_distances_of_boxes_are_at_most_those_of_regions() -> None:
    rng = np.random.default_rng(4)
    regions = [Region(rng.uniform(-9, 9, (n, 2)) + rng.uniform(-20, 20, 2)) for n in (1, 3, 5, 2)]
    boxes = _boxes(regions)
    for region, box in zip(regions, boxes, strict=True):
        assert box.tolist() == [*region.vertices.min(axis=0), *region.vertices.max(axis=0)]
    mine = np.array([[0.0, 0.0, 1.0, 2.0], [-30.0, 4.0, -28.0, 9.0]])
    gaps = _box_gaps(mine, boxes)
    for i, a in enumerate(mine):
        for j, b in enumerate(boxes):
            assert gaps[i, j] == pytest.approx(shapely.distance(shapely.box(*a), shapely.box(*b)))


def test_what_is_not_a_number_is_no_clearance() -> None:
    hulls = np.array([shapely.box(0, 0, 1, 1), shapely.box(0, 0, 1, 1)])
    lost = clearance(Sweep(hulls, np.array([0.0, math.nan])), 0, 2, [((FAR,),)])
    assert (lost.distance, lost.step) == (-math.inf, 1)
    far_off = clearance(Sweep(hulls, np.zeros(2)), 0, 2, [((Region(FAR.vertices, math.nan),),)])
    assert (far_off.distance, far_off.step) == (-math.inf, 0)


def beside(gap: float) -> Region:
    """Along the whole road, to the left of the body, whose half width is 0.9 m."""
    return Region(np.array([[-90.0, 0.9 + gap], [190.0, 0.9 + gap], [190.0, 9.0], [-90.0, 9.0]]))


def test_the_nearest_of_both_trajectories_counts() -> None:
    """Before the decision in interval 0, after it in 7; the witness also in 14, when it is over."""
    for first, later, least in ((0.5, 0.8, 0.5), (0.8, 0.5, 0.5), (0.8, 3.0, 0.8)):
        steps = [(FAR,)] * 21
        steps[0], steps[7] = (beside(first),), (beside(later),)
        likely = [(FAR,)] * 15
        likely[14] = (beside(0.25),)
        near = replace(OTHER, likely=tuple(likely), possible=tuple(steps))
        c = replace(BASE, obstacles=(BASE.obstacles[1], near), prediction="recorded")
        away = replace(BASE.obstacles[1], likely=((FAR,),) * 15, possible=((FAR,),) * 21)
        c = replace(c, obstacles=(away, near))
        answer = set_based_collision(c)
        assert isinstance(answer, Checked)
        assert answer.margin == pytest.approx(least, abs=2e-3)
        assert answer.sentence == f"at least {least:.2f} m from all in the set-based prediction"
        answer = witness_collision(c)
        assert isinstance(answer, Checked)
        assert answer.margin == pytest.approx(0.25, abs=1e-4)
        assert answer.sentence == "at least 0.25 m from all in the recorded prediction"


@pytest.mark.parametrize(
    ("kind", "interval", "condition", "name", "step", "time"),
    [
        ("likely", 14, "witness-collision", "witness", 28, 1.4),
        ("possible", 0, "set-based-collision", "witness", 0, 0.0),
        ("possible", 1, "set-based-collision", "fail-safe", 0, 0.1),
        ("possible", 20, "set-based-collision", "fail-safe", 38, 2.0),
    ],
)
def test_whom_it_may_touch_and_when(
    kind: str, interval: int, condition: str, name: str, step: int, time: float
) -> None:
    away = replace(BASE.obstacles[1], likely=((FAR,),) * 15, possible=((FAR,),) * 21)
    steps = list(getattr(away, kind))
    steps[interval] = (FAR, beside(-0.25))
    truck = replace(away, id=9, kind="truck", **{kind: tuple(steps)})
    check = witness_collision if kind == "likely" else set_based_collision
    answer = check(replace(BASE, obstacles=(away, truck, away)))
    prediction = "most-likely" if kind == "likely" else "set-based"
    assert isinstance(answer, Violation)
    assert answer.measured == pytest.approx(-1.56e-3 if name == "fail-safe" else 0.0, abs=1e-5)
    assert answer == Violation(
        condition,
        f"{name}, step {step} ({time:.2f} s): the body may touch obstacle 9 (truck, {prediction} "
        f"prediction), clearance {answer.measured:.3f} m",
        step,
        pytest.approx(time),
        answer.measured,
        0.0,
    )
