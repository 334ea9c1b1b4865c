"""Routes and lanes on small maps written by hand."""

import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from sandra.errors import ScenarioError
from sandra.scene import Scene, load
from sandra.scene.network import lane_frame
from scene_xml import ROAD, lanelet, state, straight

Write = Callable[..., Path]


def lanes(scene: Scene) -> dict[str, list[tuple[int, ...]]]:
    found: dict[str, list[tuple[int, ...]]] = {}
    for lane in scene.lanes:
        found.setdefault(lane.relation, []).append(lane.lanelets)
    return found


def goal(*ids: int) -> str:
    refs = "".join(f'<lanelet ref="{i}"/>' for i in ids)
    return (
        "<goalState><time><intervalStart>0</intervalStart><intervalEnd>20</intervalEnd></time>"
        f"<position>{refs}</position></goalState>"
    )


def ego(x: float, y: float, heading: float = 0.0, speed: float = 10.0) -> str:
    return state("initialState", 0, x, y, orientation=heading, velocity=speed)


def test_two_lanes(write: Write) -> None:
    scene = load(write(initial=ego(-50.0, 0.3)))
    assert lanes(scene) == {"current": [(1, 2)], "left": [(3, 4)]}
    assert scene.right is None
    current = scene.current
    assert len(current.left) == len(current.right) == len(current.center) == 5
    assert scene.ego_curvilinear == pytest.approx((50.0, 0.3, 0.0, 0.0))
    changed = load(write(initial=ego(-50.0, 4.0)))
    assert lanes(changed) == {"current": [(3, 4)], "right": [(1, 2)]}


def test_the_same_file_gives_the_same_scene(write: Write) -> None:
    path = write()
    first, second = load(path), load(path)
    assert str(first) == str(second)
    assert first.ego == second.ego
    assert [lane.lanelets for lane in first.lanes] == [lane.lanelets for lane in second.lanes]


def test_five_lanes_opposite_and_other(write: Write) -> None:
    def side(left: int | None, right: int | None, same: str = "same") -> dict[str, object]:
        return {
            "adjacent_left": (left, same) if left else None,
            "adjacent_right": (right, "same") if right else None,
        }

    road = (
        straight(1, -200, 200, 0.0, **side(2, None)),
        straight(2, -200, 200, 4.0, **side(3, 1)),
        straight(3, -200, 200, 8.0, **side(4, 2)),
        straight(4, -200, 200, 12.0, **side(5, 3, "opposite")),
        straight(5, -200, 200, 16.0, back=True, adjacent_left=(4, "opposite")),
    )
    found = load(write(lanelets=road, initial=ego(0, 4.0)))
    assert lanes(found) == {"current": [(2,)], "left": [(3,)], "right": [(1,)], "other": [(4,)]}
    assert found.road_type == "highway"
    leftmost = load(write(lanelets=road, initial=ego(0, 12.0)))
    assert lanes(leftmost) == {
        "current": [(4,)],
        "right": [(3,)],
        "other": [(2,), (1,)],
        "opposite": [(5,)],
    }
    opposite = leftmost.opposite[0]
    assert opposite.side == "left"
    assert opposite.frame.heading(np.array([1.0]))[0] == pytest.approx(math.pi)
    # Overtaking on the opposite lane: the ego's lane is the one of its own direction.
    wrong_side = load(write(lanelets=road, initial=ego(0, 16.0)))
    assert wrong_side.current.lanelets == (4,)
    assert wrong_side.ego_curvilinear[1] == pytest.approx(4.0)


def curved(id: int, turn: int, **rest: object) -> str:
    """From (100, 0) to the left (turn 1) or right (-1) with a radius of 20 m."""
    a = np.linspace(0, math.pi / 2, 8)
    left, right = (
        [(100 + (20 - o) * math.sin(t), turn * (20 - (20 - o) * math.cos(t))) for t in a]
        for o in ((2, -2) if turn > 0 else (-2, 2))
    )
    return lanelet(id, left, right, **rest)  # type: ignore[arg-type]


FORK = (
    straight(1, 0, 100, 0.0, successors=[2, 3, 4]),
    curved(2, 1, predecessors=[1]),
    straight(3, 100, 200, 0.0, predecessors=[1]),
    curved(4, -1, predecessors=[1]),
)


def test_a_fork_follows_the_goal_else_straight_on(write: Write) -> None:
    start = ego(50, 0)
    assert load(write(lanelets=FORK, initial=start)).current.lanelets == (1, 3)
    for target in (2, 3, 4):
        scene = load(write(lanelets=FORK, initial=start, goal=goal(target)))
        assert scene.current.lanelets == (1, target)
        assert scene.goal is None
    # In the overlap of the three the goal decides on the ego's lanelet too.
    scene = load(write(lanelets=FORK, initial=ego(101, 0), goal=goal(4)))
    assert scene.current.lanelets == (1, 4)
    unreachable = load(write(lanelets=FORK, initial=ego(150, 0), goal=goal(1)))
    assert unreachable.current.lanelets == (1, 3)


def test_a_route_with_a_lane_change_keeps_beside_the_route(write: Write) -> None:
    # The right lane forks at 500: 6 turns beside the goal's lane, 5 goes straight on.
    far = (
        straight(1, 0, 500, 0.0, successors=[5, 6], adjacent_left=(2, "same")),
        straight(2, 0, 500, 4.0, successors=[7], adjacent_right=(1, "same")),
        straight(5, 500, 900, 0.0, predecessors=[1]),
        lanelet(
            6,
            [(500, 2), (700, 42)],
            [(500, -2), (700, 38)],
            predecessors=[1],
            adjacent_left=(7, "same"),
        ),
        lanelet(
            7,
            [(500, 6), (700, 46)],
            [(500, 2), (700, 42)],
            predecessors=[2],
            adjacent_right=(6, "same"),
        ),
    )
    scene = load(write(lanelets=far, initial=ego(450, 0), goal=goal(7)))
    assert lanes(scene)["current"] == [(1, 6)]
    assert lanes(scene)["left"] == [(2, 7)]
    assert load(write(lanelets=far, initial=ego(450, 0))).current.lanelets == (1, 5)


def test_a_circular_road_ends_before_it_repeats(write: Write) -> None:
    def quarter(id: int, k: int) -> str:
        a = np.linspace(k * math.pi / 2, (k + 1) * math.pi / 2, 12)
        ring = [[(r * math.cos(t), r * math.sin(t)) for t in a] for r in (28.0, 32.0)]
        return lanelet(id, *ring, successors=[id % 4 + 1], predecessors=[(id - 2) % 4 + 1])

    ring = tuple(quarter(k + 1, k) for k in range(4))
    scene = load(write(lanelets=ring, initial=ego(30.0, 1.0, math.pi / 2)))
    assert sorted(scene.current.lanelets) == [1, 2, 3, 4]


def crossing() -> tuple[str, ...]:
    """The ego's road along x, one from the right along +y, and a ramp that merges from the left."""
    return (
        straight(1, -100, 40, 0.0, successors=[2]),
        straight(2, 40, 300, 0.0, predecessors=[1, 8]),
        lanelet(5, [(18, -80), (18, 0), (18, 80)], [(22, -80), (22, 0), (22, 80)]),
        lanelet(8, [(-60, 27), (0, 12), (40, 2)], [(-60, 23), (0, 8), (40, -2)], successors=[2]),
    )


def test_incoming_lanes_and_the_side_they_come_from(write: Write) -> None:
    scene = load(write(lanelets=crossing(), initial=ego(-20, 0)))
    assert lanes(scene) == {
        "current": [(1, 2)],
        "incoming-left": [(8,)],
        "incoming-right": [(5,)],
    }
    assert scene.road_type == "intersection"
    past = load(write(lanelets=crossing(), initial=ego(60, 0)))
    assert past.incoming == ()
    merge = tuple(part for part in crossing() if 'id="5"' not in part)
    assert load(write(lanelets=merge, initial=ego(-20, 0))).road_type == "merge"


def test_ways_that_are_not_for_cars_are_no_lanes(write: Write) -> None:
    road = (
        straight(1, -100, 300, 0.0, adjacent_right=(2, "same")),
        straight(2, -100, 300, -4.0, adjacent_left=(1, "same"), kind="sidewalk"),
        lanelet(5, [(18, -80), (18, 80)], [(22, -80), (22, 80)], kind="crosswalk"),
    )
    scene = load(write(lanelets=road))
    assert lanes(scene) == {"current": [(1,)]}
    assert len(scene.lanelets) == 3


def test_joints_of_lanelets_with_overlap_or_repeated_points(write: Write) -> None:
    road = (
        straight(1, -100, 0, 0.0, successors=[2]),
        straight(2, -0.5, 100, 0.001, predecessors=[1], successors=[3]),
        straight(3, 100, 200, 0.0, predecessors=[2]),
    )
    lane = load(write(lanelets=road, initial=ego(-50, 0))).current
    assert lane.lanelets == (1, 2, 3)
    assert (np.diff(lane.center[:, 0]) > 0.04).all()
    assert lane.frame.length == pytest.approx(300.0, abs=0.01)


@pytest.mark.parametrize(
    ("kind", "expected"),
    [("highway", "highway"), ("urban", "urban"), ("country", "rural"), ("driveWay", "residential")],
)
def test_road_type_from_the_lanelet(write: Write, kind: str, expected: str) -> None:
    road = (straight(1, -100, 300, 0.0, kind=kind),)
    assert load(write(lanelets=road)).road_type == expected


def test_road_type_from_tags_or_unknown(write: Write) -> None:
    road = (straight(1, -100, 300, 0.0),)
    assert load(write(lanelets=road)).road_type == "unknown"
    tagged = write(lanelets=road, header="<scenarioTags><interstate/></scenarioTags>")
    assert load(tagged).road_type == "highway"


def test_a_jagged_line_is_smoothed_a_bend_is_not() -> None:
    x = np.arange(0.0, 60.0, 0.4)
    jagged = np.stack([x, 0.05 * (-1.0) ** np.arange(len(x))], axis=1)
    frame = lane_frame(jagged)
    assert frame.clearance >= 8.0
    assert np.abs(frame.to_curvilinear(jagged)[:, 1]).max() <= 0.15
    a = np.linspace(0, math.pi / 2, 20)
    bend = 20.0 * np.stack([np.sin(a), 1 - np.cos(a)], axis=1)
    assert (lane_frame(bend).line == bend).all()
    with pytest.raises(ScenarioError, match="NaN"):
        lane_frame(np.array([[0.0, 0.0], [np.nan, 1.0]]))


def test_country(write: Write) -> None:
    assert load(write()).country == "DEU"
    assert load(write(id="ZAM_Test-1_1_T-1")).country is None
    assert ROAD
