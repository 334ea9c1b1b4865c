"""Obstacles of every kind and shape, as a file gives them."""

import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sandra.scene import Obstacle, Scene, load
from sandra.scene.convex import hull
from scene_xml import car, points, state

Write = Callable[..., Path]
MOVING = {"orientation": 0.0, "velocity": 10.0}


def only(scene: Scene) -> Obstacle:
    assert len(scene.obstacles) == 1
    return scene.obstacles[0]


def shaped(write: Write, shape: str) -> Obstacle:
    start = state("initialState", 0, 50.0, 1.0, orientation=math.pi / 2, velocity=3.0)
    return only(load(write(obstacles=(car(5, start, shape=shape),))))


def test_rectangle_and_circle(write: Write) -> None:
    box = shaped(write, "<rectangle><length>4</length><width>2</width></rectangle>")
    assert (box.length, box.width, box.outline.radius) == (4.0, 2.0, 0.0)
    disc = shaped(write, "<circle><radius>0.4</radius></circle>")
    assert disc.outline.vertices.tolist() == [[0.0, 0.0]]
    assert disc.outline.radius == pytest.approx(0.4)


def test_a_polygon_is_centred_and_a_non_convex_one_becomes_its_hull(write: Write) -> None:
    # An L around (1, 1): its box is [0, 4] x [0, 2], its centre (2, 1).
    corners = [(0, 0), (4, 0), (4, 1), (1, 1), (1, 2), (0, 2)]
    found = shaped(write, f"<polygon>{points([*corners, corners[0]])}</polygon>")
    assert (found.length, found.width) == (4.0, 2.0)
    assert len(found.outline.vertices) == 5
    # The body points to +y: its centre lies 2 m ahead of the given position and 1 m to the left.
    assert (found.state.x, found.state.y) == pytest.approx((49.0, 3.0))


def test_a_group_of_shapes_and_a_displaced_shape(write: Write) -> None:
    trailer = (
        "<rectangle><length>4</length><width>2</width></rectangle>"
        "<rectangle><length>6</length><width>2</width><center><x>-6</x><y>0</y></center></rectangle>"
    )
    found = shaped(write, trailer)
    assert (found.length, found.width) == pytest.approx((11.0, 2.0))
    assert (found.state.x, found.state.y) == pytest.approx((50.0, 1.0 - 3.5))
    turned = shaped(
        write,
        "<rectangle><length>4</length><width>2</width><orientation>1.5707963</orientation>"
        "</rectangle>",
    )
    assert (turned.length, turned.width) == pytest.approx((2.0, 4.0), abs=1e-5)
    disc = shaped(write, "<circle><radius>1</radius><center><x>1</x><y>0</y></center></circle>")
    assert 2.0 <= disc.length < 2.02
    assert (disc.state.x, disc.state.y) == pytest.approx((50.0, 2.0), abs=1e-6)


def test_a_trajectory_starts_at_the_step_of_the_planning_problem(write: Write) -> None:
    recorded = car(
        5,
        state("initialState", 0, 20.0, 0.0, acceleration=0.5, **MOVING),
        *(state("state", k, 20.0 + k, 0.0, **MOVING) for k in range(1, 6)),
    )
    late = car(
        6,
        state("initialState", 4, 80.0, 4.0, **MOVING),
        state("state", 5, 81.0, 4.0, orientation=0.0, velocity=12.0),
    )
    gone = car(7, state("initialState", 0, 60.0, 0.0, **MOVING), state("state", 1, 61, 0, **MOVING))
    initial = state("initialState", 2, 0.0, 0.0, **MOVING)
    scene = load(write(obstacles=(recorded, late, gone), initial=initial))
    assert [obstacle.id for obstacle in scene.obstacles] == [5, 6]
    first, second = scene.obstacles
    assert first.states is not None
    assert second.states is not None
    assert first.states[:, 0].tolist() == [22.0, 23.0, 24.0, 25.0]
    assert (first.state.x, first.state.speed) == (22.0, 10.0)
    assert np.isnan(second.states[:2]).all()
    assert second.states[2:, 0].tolist() == [80.0, 81.0]
    # Acceleration is derived from the speeds: 2 m/s in 0.1 s.
    assert second.states[2:, 4] == pytest.approx([20.0, 20.0])
    assert second.state.x == 80.0
    assert scene.recorded_steps == 3


def test_what_the_recording_lacks_is_derived(write: Write) -> None:
    silent = car(
        5,
        state("initialState", 0, 20.0, 0.0, orientation=0.0),
        state("state", 1, 20.0, 0.5),
        state("state", 2, 20.0, 1.0),
    )
    found = only(load(write(obstacles=(silent,))))
    assert not found.speed_is_known
    assert found.states is not None
    assert found.states[:, 3] == pytest.approx([5.0, 5.0, 5.0])
    assert found.states[:, 2] == pytest.approx([0.0, math.pi / 2, math.pi / 2])
    assert found.state.speed == pytest.approx(5.0)


def test_no_prediction_and_no_speed(write: Write) -> None:
    still = car(5, state("initialState", 0, 20.0, 0.0, orientation=0.0))
    found = only(load(write(obstacles=(still,))))
    assert found.states is None
    assert found.occupancies is None
    assert not found.speed_is_known
    known = only(load(write(obstacles=(car(5, state("initialState", 0, 20, 0, **MOVING)),))))
    assert known.speed_is_known
    assert known.state.speed == 10.0


def test_uncertain_states_widen_the_outline(write: Write) -> None:
    interval = "<intervalStart>-0.1</intervalStart><intervalEnd>0.3</intervalEnd>"
    place = (
        "<position><rectangle><length>2</length><width>1</width><orientation>0</orientation>"
        "<center><x>30</x><y>1</y></center></rectangle></position>"
    )
    initial = (
        f"<initialState><time><exact>0</exact></time>{place}<orientation>{interval}</orientation>"
        "<velocity><intervalStart>4</intervalStart><intervalEnd>6</intervalEnd></velocity>"
        "</initialState>"
    )
    found = only(load(write(obstacles=(car(5, initial),))))
    assert (found.state.x, found.state.y) == pytest.approx((30.0, 1.0))
    assert found.state.heading == pytest.approx(0.1)
    assert found.state.speed == pytest.approx(5.0)
    # It contains the body in each corner of the rectangle, at both ends of the angles.
    body = np.array([[-2.25, -0.9], [2.25, -0.9], [2.25, 0.9], [-2.25, 0.9]])
    around = found.outline.placed(found.state.x, found.state.y, found.state.heading)
    for dx, dy, angle in np.stack(np.meshgrid([-1, 1], [-0.5, 0.5], [-0.1, 0.3]), -1).reshape(
        -1, 3
    ):
        c, s = np.cos(angle), np.sin(angle)
        corners = body @ np.array([[c, s], [-s, c]]) + [30.0 + dx, 1.0 + dy]
        assert max(distance(around.vertices, p) for p in corners) <= around.radius + 1e-9


def distance(polygon: np.ndarray, point: np.ndarray) -> float:
    from shapely import Point, Polygon

    return float(Polygon(polygon).distance(Point(point)))


def test_sets_phantoms_environment_and_static_obstacles(write: Write) -> None:
    def at(time: str, x: float) -> str:
        return (
            f"<occupancy><shape><circle><radius>1</radius><center><x>{x}</x><y>0</y></center>"
            f"</circle></shape><time>{time}</time></occupancy>"
        )

    later = "<intervalStart>2</intervalStart><intervalEnd>3</intervalEnd>"
    occupied = f"<occupancySet>{at('<exact>1</exact>', 40.0)}{at(later, 41.0)}</occupancySet>"
    moving = car(5, state("initialState", 0, 39.0, 0.0, **MOVING), rest=occupied)
    phantom = f'<phantomObstacle id="8">{occupied}</phantomObstacle>'
    building = (
        '<environmentObstacle id="9"><type>building</type><shape>'
        f"<polygon>{points([(10, 20), (20, 20), (20, 30), (10, 30), (10, 20)])}</polygon>"
        "</shape></environmentObstacle>"
    )
    parked = (
        '<staticObstacle id="40"><type>parkedVehicle</type><shape><rectangle><length>4</length>'
        "<width>2</width></rectangle></shape>"
        + state("initialState", 0, 60.0, -1.0, orientation=0.5)
        + "</staticObstacle>"
    )
    scene = load(write(obstacles=(moving, phantom, building, parked)))
    by_id = {obstacle.id: obstacle for obstacle in scene.obstacles}
    assert list(by_id) == [5, 40, 9, 8]
    sets = by_id[5].occupancies
    assert sets is not None
    assert by_id[5].states is None
    assert len(sets) == 4
    assert sets[0][0].vertices.mean(axis=0) == pytest.approx([39.0, 0.0])
    assert [sets[k][0].vertices[0, 0] for k in (1, 2, 3)] == [40.0, 41.0, 41.0]
    assert by_id[8].occupancies is not None
    assert by_id[8].occupancies[0] == ()
    assert not by_id[8].speed_is_known
    assert (by_id[9].kind, by_id[9].is_static) == ("building", True)
    assert (by_id[9].state.x, by_id[9].state.y) == (15.0, 25.0)
    assert (by_id[40].kind, by_id[40].is_static, by_id[40].state.speed) == (
        "parkedVehicle",
        True,
        0.0,
    )


def test_the_recording_of_the_ego_is_taken_out(write: Write) -> None:
    def recorded(id: int, x: float, speed: float, heading: float = 0.0) -> str:
        values = {"orientation": heading, "velocity": speed}
        shape = "<rectangle><length>5</length><width>2</width></rectangle>"
        steps = (state("state", 1, x + 1, 0.0, **values),)
        return car(id, state("initialState", 0, x, 0.0, **values), *steps, shape=shape)

    scene = load(write(obstacles=(recorded(11, 0.3, 10.2), recorded(12, 0.1, 10.1))))
    assert [obstacle.id for obstacle in scene.obstacles] == [11]
    assert scene.recorded_ego is not None
    assert scene.recorded_ego[:, 0] == pytest.approx([0.1, 1.1])
    assert (scene.ego.length, scene.ego.width) == (5.0, 2.0)
    assert scene.ego.state.x == 0.0
    for other in (recorded(11, 0.6, 10.0), recorded(11, 0.0, 11.0), recorded(11, 0.0, 10.0, 0.3)):
        scene = load(write(obstacles=(other,)))
        assert len(scene.obstacles) == 1
        assert scene.recorded_ego is None
        assert scene.ego.length == 4.508


@settings(max_examples=60, deadline=None)
@given(
    st.lists(
        st.tuples(st.integers(-5, 5), st.integers(-5, 5)), min_size=3, max_size=30, unique=True
    )
)
def test_hull_agrees_with_shapely(cloud: list[tuple[int, int]]) -> None:
    from shapely import MultiPoint, Polygon

    expected = MultiPoint(cloud).convex_hull
    found = hull(np.array(cloud, dtype=float))
    if expected.geom_type != "Polygon":
        assert len(found) <= 2
        return
    assert Polygon(found).equals(expected)
    x, y = found.T
    assert (x * np.roll(y, -1) - y * np.roll(x, -1)).sum() > 0
