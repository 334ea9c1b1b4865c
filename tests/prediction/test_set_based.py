"""The set-based prediction: coverage decides, area keeps it honest, each switch has its effect."""

from __future__ import annotations

import itertools
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import shapely

from prediction.referee import Road, first_breach, inside_union, uncovered
from prediction.traffic import CAR, Course, bend, car, drive, fork, scene, straight_road
from sandra.prediction import PredictedObstacle, predict
from sandra.scene.types import Lanelet, Obstacle, Region, Scene, State
from sandra.settings import Assumptions, Settings

OPEN = Assumptions(no_rear_end=False, legal_cut_in=False)
ROAD = straight_road()

DRIVES = {
    "middle lane of three": (ROAD, Course(0, 10.5), State(-100, 5.25, 0, 12)),
    "changing lane, fast": (ROAD, Course(0, 10.5), State(-30, 2.2, 0.1, 25)),
    # Lanes of two directions are cut into cells; those of one are computed in closed form.
    "middle lane, two directions": (
        straight_road(oncoming=True),
        Course(0, 10.5),
        State(-100, 5.25, 0, 12),
    ),
    "changing lane, two directions": (
        straight_road(oncoming=True),
        Course(0, 10.5),
        State(-30, 2.2, 0.1, 25),
    ),
    "one lane, slow": (straight_road(1, oncoming=True), Course(0, 3.5), State(-10, 1.75, 0, 3)),
    "outer lane of a bend": (bend(), Course(-3.5, 3.5, 60, True), State(0, -1.75, 0, 10)),
    "inner lane of a bend": (bend(), Course(-3.5, 3.5, 60, True), State(0, 1.75, 0, 15)),
    "fork, straight on": (fork(), Course(-1.75, 1.75), State(-20, 0, 0, 8)),
    "fork, into the bend": (fork(), Course(-1.75, 1.75, 30), State(-20, 0, 0, 8)),
    "from standstill": (fork(), Course(-1.75, 1.75, 30), State(-5, 0.3, 0, 0)),
}


def sets_of(
    lanelets: tuple[Lanelet, ...], obstacle: Obstacle, a: Assumptions, steps: int = 25
) -> PredictedObstacle:
    return predict(
        scene(lanelets, (obstacle,)), "set-based", steps, Settings(assumptions=a)
    ).obstacles[0]


def outside(
    lanelets: tuple[Lanelet, ...],
    course: Course,
    start: State,
    a: Assumptions,
    steps: int = 25,
    count: int = 200,
) -> tuple[int, int]:
    """How many bodies of made-up drives lie outside their sets, and how many were looked at."""
    sets = sets_of(lanelets, car(1, start.x, start.y, start.heading, start.speed), a, steps)
    assert sets.dropped == ()
    fine = 4
    # The map's borders are chords of its arcs, and lie up to 0.016 m within them.
    overhang = a.max_overhang - (0.0 if np.isinf(course.radius) else 0.02)
    poses, valid = drive(course, start, steps, 0.1, count, seed=count, fine=fine, overhang=overhang)
    marks = np.vstack([CAR.vertices, [[2.25, 0.0], [-2.25, 0.0]]])
    missing = looked = 0
    for j in range(len(poses)):
        x, y, heading = poses[j, valid > j].T
        c, s = np.cos(heading), np.sin(heading)
        points = np.stack(
            [np.column_stack([x + c * u - s * v, y + s * u + c * v]) for u, v in marks], axis=1
        )
        k, rest = divmod(j, fine)
        chosen = [sets.between[k]] if k < steps else []
        if rest == 0:
            chosen += [sets.at[k]] + ([sets.between[k - 1]] if k else [])
        for regions in chosen:
            inside = inside_union(points.reshape(-1, 2), regions).reshape(points.shape[:2])
            missing += int((~inside.all(axis=1)).sum())
            looked += len(points)
    return missing, looked


@pytest.mark.parametrize("name", DRIVES)
def test_every_drive_within_the_assumptions_is_covered(name: str) -> None:
    missing, looked = outside(*DRIVES[name], OPEN)
    assert looked > 3000
    assert missing == 0


def test_the_coverage_test_can_fail() -> None:
    """Assuming a little less than the drives do is noticed, bound by bound."""
    lanelets, course, start = DRIVES["middle lane of three"]
    for weaker in (
        replace(OPEN, max_acceleration=0.95 * 12),
        replace(OPEN, max_lateral_speed=2.5),
        replace(OPEN, max_speed=30.0),
    ):
        assert outside(lanelets, course, start, weaker)[0] > 0
    lanelets, course, start = DRIVES["fork, into the bend"]
    straight_only = tuple(
        replace(each, successors=tuple(i for i in each.successors if i != 3)) for each in lanelets
    )
    assert outside(straight_only, course, start, OPEN)[0] > 0


@pytest.mark.soundness
@pytest.mark.parametrize("name", DRIVES)
def test_many_drives_are_covered(name: str) -> None:
    assert outside(*DRIVES[name], OPEN, count=6000)[0] == 0


RECORDED = {
    # file: (start steps, least number of covered vehicle steps)
    "DEU_Goeppingen-37_1_T-4": ((30,), 300),
    "DEU_MONAEast-2_4316_T-4341": ((0,), 900),
    "DEU_LocationALower-11_10_T-1": ((0, 10), 250),
    "DEU_AachenBendplatz-1_80_T-19": ((0, 8), 50),
    "DEU_Gar-1_1_T-1": ((0, 5), 40),
    "ZAM_Sandra-5838_1_T-1001-DiLu": ((0,), 25),
}


def recorded_coverage(
    path: Path, starts: tuple[int, ...], steps: int = 25
) -> tuple[int, list[str]]:
    """Vehicle steps within the assumptions, and those of them that are not covered."""
    from sandra.scene import load

    whole = load(path)
    road = Road(whole.lanelets)
    looked, missing = 0, []
    for start in starts:
        seen, futures = [], []
        for obstacle in whole.obstacles:
            if obstacle.states is None or obstacle.kind == "pedestrian":
                continue
            future = obstacle.states[start : start + steps + 1]
            if len(future) < 2 or not np.isfinite(future[:, :4]).all():
                continue
            seen.append(replace(obstacle, state=State(*future[0, :4].tolist()), states=None))
            futures.append(future)
        now = replace(whole, obstacles=tuple(seen))
        sets = predict(now, "set-based", steps, Settings(assumptions=OPEN))
        for each, future in zip(sets.obstacles, futures, strict=True):
            outline = each.obstacle.outline
            kept, _ = first_breach(future, outline, whole.dt, road, OPEN, noise=0.02)
            looked += kept
            missing += [
                f"{path.stem}: {each.obstacle.id} from {start}: {where}"
                for where in uncovered(each, future, outline, kept)
            ]
    return looked, missing


@pytest.mark.parametrize("name", RECORDED)
def test_recorded_vehicles_that_keep_the_assumptions_are_covered(shared: Path, name: str) -> None:
    starts, least = RECORDED[name]
    looked, missing = recorded_coverage(shared / "data/scenarios" / f"{name}.xml", starts)
    assert missing == []
    assert looked >= least


@pytest.mark.soundness
@pytest.mark.parametrize("name", RECORDED)
def test_recordings_from_many_starts_are_covered(shared: Path, name: str) -> None:
    path = shared / "data/scenarios" / f"{name}.xml"
    assert recorded_coverage(path, tuple(range(0, 90, 6)))[1] == []


def area(regions: tuple[Region, ...]) -> float:
    shapes = [shapely.MultiPoint(r.vertices).convex_hull.buffer(r.radius) for r in regions]
    return float(shapely.union_all(shapes).area)


def test_area_on_the_case_study_only_shrinks(shared: Path) -> None:
    """Mean area per vehicle [m^2] with all assumptions; lower these numbers when it shrinks."""
    from sandra.scene import load

    now = load(shared / "data/scenarios/DEU_Goeppingen-37_1_T-4.xml")
    sets = predict(now, "set-based", 25)
    for k, most in AREAS.items():
        mean = float(np.mean([area(each.at[k]) for each in sets.obstacles]))
        assert mean <= most, f"step {k}: {mean:.1f} m^2"
        assert mean >= 0.9 * most, f"step {k}: {mean:.1f} m^2, lower the bound"


AREAS = {1: 9.7, 5: 36.2, 10: 102.4, 25: 564.0}


def spread(regions: tuple[Region, ...]) -> tuple[float, float, float, float]:
    """(x_min, x_max, y_min, y_max)."""
    points = np.vstack([r.vertices for r in regions])
    return (*np.sort(points[:, 0])[[0, -1]].tolist(), *np.sort(points[:, 1])[[0, -1]].tolist())


def test_tight_in_a_straight_lane() -> None:
    """The reachable interval is that of the formula, to a few centimetres and the body's turn."""
    each = sets_of(ROAD, car(1, -100, 5.25, speed=20.0), OPEN)
    for k in (1, 5, 10, 25):
        t = 0.1 * k
        front = -100 + 20 * t + 6 * t**2
        stop = min(t, 20 / 12)
        rear = -100 + 20 * stop - 6 * stop**2
        x0, x1, y0, y1 = spread(each.at[k])
        half = 2.25 if k == 1 else np.hypot(2.25, 0.9)
        assert front + 2.25 <= x1 <= front + half + 0.15
        assert rear - half - 1.2 <= x0 <= rear - 2.25
        assert y0 >= -0.35
        assert y1 <= 10.85
    assert spread(each.at[0]) == pytest.approx((-102.25, -97.75, 4.35, 6.15))
    assert spread(each.at[1])[2:] == pytest.approx((4.35, 6.15), abs=0.5)


def test_a_lane_change_goes_on_in_the_step_in_which_it_crosses_the_border() -> None:
    """At the bound on the speed across, from 0.6 m before the border, in steps of 0.8 m."""
    small = Obstacle(1, "motorcycle", Region.rectangle(0.2, 0.2), State(-100, 2.9, 0.0, 20.0))
    settings = Settings(assumptions=replace(OPEN, max_acceleration=100.0))
    each = predict(scene(ROAD, (small,), dt=0.2), "set-based", 3, settings).obstacles[0]
    for k in (1, 2, 3):
        top = 2.9 + 4.0 * 0.2 * k
        assert top + 0.1 <= spread(each.at[k])[3] <= top + 0.1 + 0.3
        assert spread(each.between[k - 1])[3] >= top + 0.1


def test_sets_grow_and_intervals_hold_their_ends() -> None:
    each = sets_of(bend(), car(1, 0, -1.75, speed=8.0), OPEN)
    areas = [area(regions) for regions in each.at]
    assert all(a < b for a, b in itertools.pairwise(areas))
    for k in range(25):
        for end in (k, k + 1):
            for region in each.at[end]:
                assert inside_union(region.vertices, each.between[k]).all()


def test_each_switch_only_widens() -> None:
    obstacle = car(1, -100, 1.75, speed=10.0)
    lanelets = straight_road(2, oncoming=True)
    slow = replace(OPEN, max_lateral_speed=1.0)
    base = sets_of(lanelets, obstacle, slow)
    x0, _, _, y1 = spread(base.at[25])
    assert y1 <= 7.0 + 0.35
    for name in ("no_reversing", "stay_on_carriageway", "follow_lanes", "bounded_heading"):
        wider = sets_of(lanelets, obstacle, replace(slow, **{name: False}))
        assert name not in wider.assumptions
        assert name in base.assumptions
        assert sum(map(area, wider.at)) > sum(map(area, base.at))
        for k in (3, 10, 25):
            for region in base.at[k]:
                assert inside_union(region.vertices * 0.999 + region.vertices.mean(0) * 0.001,
                                    wider.at[k]).all()  # fmt: skip
        if name == "no_reversing":
            assert spread(wider.at[25])[0] < x0 - 5.0
        if name == "stay_on_carriageway":
            assert spread(wider.at[25])[3] > 10.0


def test_what_is_seen_drops_the_assumption() -> None:
    cases = {
        "no_reversing": car(1, 0, 1.75, speed=-1.0),
        "max_speed": car(1, 0, 1.75, speed=55.0),
        "max_lateral_speed": car(1, 0, 1.75, heading=0.6, speed=10.0),
        "stay_on_carriageway": car(1, 0, -4.0),
    }
    for name, obstacle in cases.items():
        each = sets_of(ROAD, obstacle, OPEN, steps=10)
        assert each.dropped == (name,), name
        assert name not in each.assumptions
    against = sets_of(ROAD, car(1, 0, 1.75, heading=np.pi), OPEN, steps=10)
    assert against.dropped == ("stay_on_carriageway",)
    # It goes on against the traffic, and the prediction goes with it.
    assert spread(against.at[10])[0] < -10.0
    back = sets_of(ROAD, cases["no_reversing"], OPEN, steps=10)
    assert spread(back.at[10])[0] < -1.0 - 6.0 - 2.0


def test_overhang_that_is_seen_is_kept() -> None:
    each = sets_of(ROAD, car(1, 0, 0.2), OPEN, steps=10)
    assert each.dropped == ()
    assert -0.75 <= spread(each.at[10])[2] <= -0.7


def test_pedestrians_bicycles_and_the_unknown() -> None:
    walker = Obstacle(1, "pedestrian", Region.disc(0.3), State(0, -3, np.pi / 2, 1.0))
    each = sets_of(ROAD, walker, OPEN)
    x0, x1, y0, y1 = spread(each.at[25])
    # 1 m/s up to 2.5 m/s with 3 m/s^2 takes 0.5 s.
    ahead = 1.0 * 0.5 + 1.5 * 0.25 + 2.5 * 2.0
    assert y1 == pytest.approx(-3 + ahead + 0.3, abs=0.02)
    assert y0 < -3 - 3.0
    assert -x0 == pytest.approx(x1)
    assert each.assumptions == ("pedestrian_max_acceleration", "pedestrian_max_speed")
    cyclist = sets_of(ROAD, car(1, 0, 1.75, speed=5.0, kind="bicycle"), OPEN)
    assert spread(cyclist.at[20])[3] > 15.0
    assert "stay_on_carriageway" not in cyclist.assumptions
    unknown = sets_of(ROAD, car(1, 0, 1.75, kind="unknown", speed_is_known=False), OPEN)
    assert spread(unknown.at[10])[0] <= -50.0
    blind = sets_of(ROAD, car(1, 0, 1.75, speed_is_known=False), OPEN)
    assert spread(blind.at[10])[1] >= 50.0 + 2.25
    assert spread(blind.at[10])[0] >= -3.0 - 1.2


def with_ego(*obstacles: Obstacle, speed: float = 15.0, x: float = 0.0) -> Scene:
    """The ego in the middle lane of three."""
    return scene(ROAD, obstacles, State(x, 5.25, 0.0, speed), current=(21, 22))


def in_ego_lane(each: PredictedObstacle) -> list[bool]:
    """Per step: does the prediction reach into the ego's lane, more than 5 cm from its edge?"""
    lane = shapely.box(-1000, 3.55, 1000, 6.95)
    return [
        any(shapely.MultiPoint(r.vertices).convex_hull.intersects(lane) for r in regions)
        for regions in each.between
    ]


def test_no_rear_end() -> None:
    now = with_ego(car(1, -15, 5.25, speed=20.0), car(2, 40, 5.25, speed=20.0))
    follower, leader = predict(now, "set-based", 25).obstacles
    assert "no_rear_end" in follower.assumptions
    assert not any(in_ego_lane(follower))
    assert all(follower.between[10:])
    assert "no_rear_end" not in leader.assumptions
    assert all(in_ego_lane(leader))
    notes = predict(now, "set-based", 25).notes
    assert "behind the ego in its lane, assumed not to drive into it: 1" in notes
    off = Settings(assumptions=Assumptions(no_rear_end=False))
    assert all(in_ego_lane(predict(now, "set-based", 25, off).obstacles[0]))
    # Without `legal_cut_in` it may overtake and come back: then its sets are in the lane again.
    cutting = Settings(assumptions=Assumptions(legal_cut_in=False))
    again = in_ego_lane(predict(now, "set-based", 25, cutting).obstacles[0])
    assert not again[0]
    assert again[-1]


def test_legal_cut_in() -> None:
    # d_safe(15, 15) = 225/12 - 225/24 + 15 * 0.4 = 15.4 m bumper to bumper.
    beside = car(1, 2, 8.75, speed=15.0)
    near = car(2, 4.5 + 15.0, 8.75, speed=15.0)
    far = car(3, 4.5 + 15.8, 8.75, speed=15.0)
    behind = car(4, -30, 1.75, speed=25.0)
    now = with_ego(beside, near, far, behind)
    first, second, third, fourth = predict(now, "set-based", 20).obstacles
    for each in (first, second, fourth):
        assert "legal_cut_in" in each.assumptions
        assert not any(in_ego_lane(each))
    assert "legal_cut_in" not in third.assumptions
    assert in_ego_lane(third)[-1]
    off = Settings(assumptions=Assumptions(legal_cut_in=False))
    for each in predict(now, "set-based", 20, off).obstacles:
        assert in_ego_lane(each)[-1]


def test_what_is_left_out_of_the_egos_lane_names_both_assumptions() -> None:
    """Who is beside the ego may come in behind it: that it then does not drive into it is the other
    assumption, so it is named, and without it nothing is left out."""
    now = with_ego(car(1, 2, 8.75, speed=15.0))
    each = predict(now, "set-based", 20).obstacles[0]
    assert {"legal_cut_in", "no_rear_end"} <= set(each.assumptions)
    off = Settings(assumptions=Assumptions(no_rear_end=False))
    each = predict(now, "set-based", 20, off).obstacles[0]
    assert not {"legal_cut_in", "no_rear_end"} & set(each.assumptions)
    assert in_ego_lane(each)[-1]


def test_who_is_already_cutting_in_is_not_assumed_away() -> None:
    straddling = car(1, 6, 7.5, heading=-0.1, speed=15.0)
    each = predict(with_ego(straddling), "set-based", 20).obstacles[0]
    assert "legal_cut_in" in each.dropped
    assert all(in_ego_lane(each))


def test_merging_by_a_lane_that_leads_into_the_egos_is_not_assumed_away() -> None:
    """The two assumptions are about changing lanes; who comes along its own lane stays."""
    lanelets = fork()
    now = scene(lanelets, (car(1, -30, 0, speed=10.0),), State(5, 0, 0, 10.0), current=(2,))
    each = predict(now, "set-based", 20).obstacles[0]
    lane = shapely.box(1.0, -1.0, 150.0, 1.0)
    assert any(shapely.Polygon(r.vertices).intersects(lane) for r in each.at[20])


def test_slanted_and_single_cross_sections_do_not_break_it() -> None:
    """Two points per border, ends cut at 45 degrees."""
    half = 1.75
    left = np.array([[-50.0, half], [50.0, half]])
    one = Lanelet(1, left, left - [3.5, 2 * half], (), (), (), None, None, None)
    missing, looked = outside((one,), Course(-half, half), State(0, 0, 0, 8), OPEN, steps=15)
    assert missing == 0
    assert looked > 1000
