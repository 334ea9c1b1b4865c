"""Lidar-like beams: exact distances, and what hides behind what."""

import math

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st

from sandra.describe import Beams, PromptOptions, describe
from sandra.describe.beams import distances
from sandra.errors import SettingsError
from sandra.scene.convex import hull
from sandra.scene.types import Obstacle, Region, Scene
from straight_road import CAR, WIDTH, Road


def rays(*angles: float) -> np.ndarray:
    return np.column_stack([np.cos(angles), np.sin(angles)])


def test_distances_by_hand() -> None:
    car = Region.rectangle(4.0, 2.0).placed(10.0, 0.0, 0.0)
    assert distances(car, rays(0.0, math.pi)).tolist() == [8.0, math.inf]
    disc = Region.disc(1.0).placed(0.0, 5.0, 0.0)
    assert distances(disc, rays(math.pi / 2)) == pytest.approx([4.0])
    capsule = Region(np.array([[3.0, -2.0], [3.0, 2.0]]), 0.5)
    # The flat side, and the tangent to the round end.
    assert distances(capsule, rays(0.0)) == pytest.approx([2.5])
    grazing = math.atan2(2.0, 3.0) + math.asin(0.5 / math.hypot(2.0, 3.0))
    assert np.isfinite(distances(capsule, rays(grazing - 1e-6)))
    assert np.isinf(distances(capsule, rays(grazing + 1e-6)))


@pytest.mark.parametrize("body", [Region.rectangle(4.0, 2.0), Region.disc(0.5)])
def test_within_a_body_every_beam_has_met_it(body: Region) -> None:
    assert distances(body.placed(0.2, 0.1, 0.4), rays(0.0, 1.0, 4.0)).tolist() == [0.0] * 3


@given(
    st.lists(st.tuples(st.floats(-9, 9), st.floats(-9, 9)), min_size=3, max_size=6),
    st.sampled_from([0.0, 0.7]),
    st.floats(0.0, 2 * math.pi),
)
def test_as_shapely_finds_them(
    points: list[tuple[float, float]], radius: float, angle: float
) -> None:
    vertices = hull(np.round(np.array(points), 2))
    if len(vertices) < 3:
        return
    body = Region(vertices, radius)
    shape = shapely.Polygon(vertices).buffer(radius, quad_segs=256)
    ray = rays(angle)
    line = shapely.LineString([(0.0, 0.0), 60.0 * ray[0]])
    met = shape.intersection(line)
    expected = math.inf if met.is_empty else shapely.Point(0.0, 0.0).distance(met)
    found = float(distances(body, ray)[0])
    grazes = shape.buffer(-1e-3).intersects(line) != shape.buffer(1e-3).intersects(line)
    if not grazes:
        assert found == pytest.approx(expected, abs=1e-3)


def seen(scene: Scene, beams: Beams | None = None) -> set[int]:
    beams = beams or Beams()
    return set(beams.seen(scene, scene.obstacles))


def behind_a_truck(road: Road) -> Scene:
    truck = road.obstacle(1, 20.0, 0.0, kind="truck", outline=Region.rectangle(8.0, 2.5))
    return road.scene(
        truck,
        road.obstacle(2, 40.0, 0.0),
        road.obstacle(3, 40.0, 2 * WIDTH),
        road.obstacle(4, 30.0, 0.5, kind="pedestrian", outline=Region.disc(0.3)),
        lanes=road.three_lanes(),
    )


@pytest.mark.parametrize("angle", [0.0, 1.1, 3.0])
def test_what_is_hidden_is_not_seen(angle: float) -> None:
    road = Road(angle, -4.0, 9.0)
    scene = behind_a_truck(road)
    assert seen(scene) == {1, 3}
    without = road.scene(*scene.obstacles[1:], lanes=scene.lanes)
    assert seen(without) == {2, 3, 4}


def test_a_body_is_seen_as_soon_as_a_corner_is() -> None:
    road = Road()
    truck = road.obstacle(1, 20.0, 0.0, outline=Region.rectangle(8.0, 2.5))
    # The truck's shadow at its rear corner (16, 1.25): y = x 1.25 / 16, 3.125 at x = 40.
    hidden = road.obstacle(2, 40.0, 2.0, outline=Region.rectangle(1.0, 2.0))
    peeping = road.obstacle(2, 40.0, 2.4, outline=Region.rectangle(1.0, 2.0))
    many = Beams(3600)
    assert seen(road.scene(truck, hidden), many) == {1}
    assert seen(road.scene(truck, peeping), many) == {1, 2}


def test_beams_end_at_their_range() -> None:
    road = Road()
    scene = road.scene(road.obstacle(1, 52.2, 0.0))  # its rear is 49.95 m from the ego's centre
    assert seen(scene, Beams(8, 50.0)) == {1}
    assert seen(scene, Beams(8, 49.9)) == set()


def test_between_two_beams_nothing_is_seen() -> None:
    road = Road()
    scene = road.scene(road.obstacle(1, 30.0, 8.0, outline=CAR))
    assert seen(scene, Beams(8)) == set()
    assert seen(scene, Beams(360)) == {1}


def test_the_first_beam_is_along_the_heading() -> None:
    road = Road(0.7)
    scene = road.scene(road.obstacle(1, 0.0, 30.0), heading=math.pi / 2)
    assert seen(scene, Beams(1)) == {1}


def test_the_prompt_tells_only_what_is_seen() -> None:
    scene = behind_a_truck(Road())
    prompt = describe(scene, options=PromptOptions(beams=Beams()))
    assert {o.id for o in prompt.situation.obstacles} == {1, 3}
    assert "the obstacles that you see" in prompt.user
    assert "pedestrian" not in prompt.user
    assert "pedestrian 4" in describe(scene).user


def test_an_empty_road_says_how_far_the_beams_reach() -> None:
    prompt = describe(Road().scene(), options=PromptOptions(beams=Beams(90, 60.0)))
    assert prompt.user.endswith("You see no obstacles within 60 meters.")


def test_who_appears_only_later_hides_nobody() -> None:
    road = Road()
    later = np.full((3, 5), np.nan)
    later[2] = [20.0, 0.0, 0.0, 5.0, 0.0]
    ghost = road.obstacle(1, 20.0, 0.0, outline=Region.rectangle(8.0, 3.0), states=later)
    scene = road.scene(ghost, road.obstacle(2, 40.0, 0.0))
    prompt = describe(scene, options=PromptOptions(beams=Beams()))
    assert [o.id for o in prompt.situation.obstacles] == [2]


def test_names() -> None:
    assert Beams.named("lanes") is None
    assert Beams.named("beams") == Beams(720, 100.0)
    assert Beams.named("beams:72") == Beams(72, 100.0)
    assert Beams.named("beams:72,60.5") == Beams(72, 60.5)


@pytest.mark.parametrize(
    "text", ["", "radar", "beams:", "beams:x", "beams:0", "beams:9,nan", "beams:9,-1", "lanes:3"]
)
def test_bad_names(text: str) -> None:
    if text == "beams:":
        assert Beams.named(text) == Beams()
        return
    with pytest.raises(SettingsError, match="beams"):
        Beams.named(text)


def test_an_obstacle_of_one_point_is_never_met_and_hurts_nobody() -> None:
    point = Obstacle(1, "unknown", Region.disc(0.0), Road().obstacle(1, 20.0, 0.0).state)
    assert len(seen(Road().scene(point))) <= 1
