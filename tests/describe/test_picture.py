"""The picture of the prompt: what is where in it, pixel by pixel."""

import io
import math

import numpy as np
import pytest
from PIL import Image

import sandra
from sandra.describe import Beams, Picture, PromptOptions, describe, render
from sandra.describe.picture import BELOW, SCALE, SIZE
from sandra.errors import SandraError, SettingsError
from sandra.scene.types import Region, Scene, TrafficLight
from straight_road import WIDTH, Road

BLUE, GREY, ORANGE, BROWN = (0, 87, 194), (110, 110, 110), (213, 94, 0), (176, 138, 46)
LANE, CURRENT, GROUND = (223, 226, 229), (188, 214, 234), (244, 242, 236)
RED = (208, 0, 0)


def picture(scene: Scene, up: str, **options: object) -> Picture:
    found = describe(scene, options=PromptOptions(picture=up, **options)).picture  # type: ignore[arg-type]
    assert found is not None
    return found


def pixels(found: Picture) -> np.ndarray:
    image = Image.open(io.BytesIO(found.png))
    assert image.format == "PNG"
    assert image.size == (found.width, found.height) == (SIZE, SIZE)
    return np.asarray(image.convert("RGB")).astype(int)


def centre(image: np.ndarray, colour: tuple[int, int, int]) -> tuple[float, float] | None:
    """Mean (column, row) of the pixels of exactly this colour."""
    rows, columns = np.nonzero((image == colour).all(axis=2))
    return (float(columns.mean()), float(rows.mean())) if len(rows) else None


EGO = (SIZE / 2 - 0.5, SIZE - BELOW / SCALE - 0.5)
MIDDLE = (SIZE / 2 - 0.5, SIZE / 2 - 0.5)


@pytest.mark.parametrize("angle", [0.0, 0.9, math.pi / 2, 3.0, -2.0])
def test_ego_up_turns_with_the_ego(angle: float) -> None:
    road = Road(angle, 40.0, -10.0)
    scene = road.scene(road.obstacle(5, 40.0, 0.0, 0.0), lanes=road.three_lanes())
    image = pixels(picture(scene, "ego"))
    assert centre(image, BLUE) == pytest.approx(EGO, abs=1.0)
    # 40 m ahead is straight above the ego.
    ahead = centre(image, GREY)
    assert ahead == pytest.approx((EGO[0], EGO[1] - 40.0 / SCALE), abs=1.0)


@pytest.mark.parametrize(("d", "side"), [(WIDTH, -1), (-WIDTH, 1)])
def test_left_is_left(d: float, side: int) -> None:
    road = Road(2.2)
    scene = road.scene(road.obstacle(5, 20.0, d, 0.0), lanes=road.three_lanes())
    beside = centre(pixels(picture(scene, "ego")), GREY)
    expected = (EGO[0] + side * WIDTH / SCALE, EGO[1] - 20.0 / SCALE)
    assert beside == pytest.approx(expected, abs=1.0)


@pytest.mark.parametrize("angle", [0.0, 0.9, -2.0])
def test_north_up_does_not_turn(angle: float) -> None:
    road = Road(angle, 40.0, -10.0)
    scene = road.scene(road.obstacle(5, 40.0, 0.0, 0.0), lanes=road.three_lanes())
    image = pixels(picture(scene, "north"))
    assert centre(image, BLUE) == pytest.approx(MIDDLE, abs=1.0)
    c, s = math.cos(angle), math.sin(angle)
    expected = (MIDDLE[0] + 40.0 / SCALE * c, MIDDLE[1] - 40.0 / SCALE * s)
    assert centre(image, GREY) == pytest.approx(expected, abs=1.5)


def test_ego_up_follows_the_ego_and_not_its_lane() -> None:
    road = Road()
    scene = road.scene(road.obstacle(5, 40.0, 0.0, 0.0), heading=0.3)
    ahead = centre(pixels(picture(scene, "ego")), GREY)
    # The ego looks to the left, so what stands along its lane is to the right.
    expected = (EGO[0] + 200.0 * math.sin(0.3), EGO[1] - 200.0 * math.cos(0.3))
    assert ahead == pytest.approx(expected, abs=1.5)


def test_lanes_have_their_colours_and_widths() -> None:
    road = Road(1.3)
    image = pixels(picture(road.scene(lanes=road.three_lanes()), "ego"))
    row = image[100]
    at = {name: (row == colour).all(axis=1).nonzero()[0] for name, colour in
          (("lane", LANE), ("current", CURRENT), ("ground", GROUND))}  # fmt: skip
    assert at["current"].min() == pytest.approx(EGO[0] - WIDTH / 2 / SCALE, abs=1.5)
    assert at["current"].max() == pytest.approx(EGO[0] + WIDTH / 2 / SCALE, abs=1.5)
    assert at["lane"].min() == pytest.approx(EGO[0] - 1.5 * WIDTH / SCALE, abs=1.5)
    assert at["ground"].size > 400


def test_a_lane_whose_points_are_far_away_is_drawn() -> None:
    road = Road(0.9)
    ends = [np.array([road.at(s, d) for s in (-900.0, 900.0)]) for d in (1.75, -1.75)]
    lane = road.lane("current", 0, left=ends[0], right=ends[1])
    image = pixels(picture(road.scene(lanes=(lane,)), "ego"))
    assert (image[50, 256] == CURRENT).all()
    assert (image[50, 100] == GROUND).all()


def test_an_arrow_is_as_long_as_the_way_of_half_a_second() -> None:
    road = Road()
    still = pixels(picture(road.scene(speed=0.0), "ego"))
    moving = pixels(picture(road.scene(speed=24.0), "ego"))
    rows, columns = np.nonzero((still != moving).any(axis=2))
    assert columns.min() > EGO[0] - 8
    assert columns.max() < EGO[0] + 8
    front = EGO[1] - 2.25 / SCALE
    assert rows.min() == pytest.approx(front - 12.0 / SCALE, abs=2.0)
    assert rows.max() == pytest.approx(front, abs=3.0)


def test_kinds_have_colours_and_lights_are_lines() -> None:
    road = Road(0.4)
    scene = road.scene(
        road.obstacle(9, 20.0, -5.0, 0.0, kind="pedestrian", outline=Region.disc(0.3)),
        road.obstacle(10, 30.0, 4.0, kind="parkedVehicle", is_static=True),
        lights=(TrafficLight(1, "red", 27.75),),
    )
    image = pixels(picture(scene, "ego"))
    walker = centre(image, ORANGE)
    assert walker == pytest.approx((EGO[0] + 5.0 / SCALE, EGO[1] - 20.0 / SCALE), abs=1.5)
    parked = centre(image, BROWN)
    assert parked == pytest.approx((EGO[0] - 4.0 / SCALE, EGO[1] - 30.0 / SCALE), abs=1.5)
    # 27.75 m from the front, 2.25 m before the ego's centre.
    line = centre(image, RED)
    assert line == pytest.approx((EGO[0], EGO[1] - 30.0 / SCALE), abs=1.5)


def test_nothing_of_the_future_is_drawn() -> None:
    road = Road()
    states = np.array([[*road.at(30.0 + 2.0 * k, 0.0), 0.0, 20.0, 0.0] for k in range(30)])
    other = np.array([[*road.at(30.0 + 1.0 * k, 0.3 * k), 0.1, 20.0, 0.0] for k in range(30)])
    one = road.scene(road.obstacle(5, 30.0, 0.0, 20.0, states=states))
    two = road.scene(road.obstacle(5, 30.0, 0.0, 20.0, states=other))
    assert picture(one, "ego").png == picture(two, "ego").png


def test_who_is_not_there_yet_is_not_drawn() -> None:
    road = Road()
    later = np.full((3, 5), np.nan)
    later[2] = [60.0, 0.0, 0.0, 5.0, 0.0]
    scene = road.scene(road.obstacle(5, 60.0, 0.0, 0.0, states=later))
    assert centre(pixels(picture(scene, "ego")), GREY) is None


def test_what_beams_do_not_see_is_not_drawn() -> None:
    road = Road()
    scene = road.scene(
        road.obstacle(1, 20.0, 0.0, outline=Region.rectangle(8.0, 3.0), is_static=True),
        road.obstacle(2, 40.0, 0.0),
    )
    assert centre(pixels(picture(scene, "ego")), GREY) is not None
    assert centre(pixels(picture(scene, "ego", beams=Beams())), GREY) is None
    assert centre(pixels(picture(scene, "ego", beams=Beams())), BROWN) is not None


def test_the_ids_that_are_told_are_written() -> None:
    road = Road()
    # Far beside the road: drawn, but not told, so without an id.
    scene = road.scene(road.obstacle(1, 30.0, 30.0))
    near = road.scene(road.obstacle(1, 30.0, 0.0))
    white = (255, 255, 255)
    assert centre(pixels(picture(scene, "ego")), white) is None
    assert centre(pixels(picture(near, "ego")), white) is not None


def test_the_text_says_what_the_picture_is() -> None:
    scene = Road().scene()
    plain = describe(scene)
    for up in ("ego", "north"):
        prompt = describe(scene, options=PromptOptions(picture=up))
        assert prompt.user.startswith(plain.user)
        assert "102 meters wide" in prompt.user[len(plain.user) :]
        assert prompt.system == plain.system
    assert plain.picture is None
    assert "PNG" not in render(prompt)


@pytest.mark.parametrize("far", [1e6, 1e12, 1e18])
def test_what_is_far_away_does_no_harm(far: float) -> None:
    road = Road(0.7)
    ends = [np.array([road.at(s, d) for s in (-far, far)]) for d in (1.75, -1.75)]
    lane = road.lane("current", 0, left=ends[0], right=ends[1])
    scene = road.scene(
        road.obstacle(5, far, 0.0, 10.0), road.obstacle(6, 20.0, 0.0, far), lanes=(lane,)
    )
    assert centre(pixels(picture(scene, "ego")), BLUE) == pytest.approx(EGO, abs=1.0)


@pytest.mark.parametrize("name", sandra.examples())
def test_every_scenario_of_ours(name: str) -> None:
    scene = sandra.load(sandra.example(name))
    assert centre(pixels(picture(scene, "ego")), BLUE) == pytest.approx(EGO, abs=1.0)
    assert centre(pixels(picture(scene, "north", beams=Beams())), BLUE) == pytest.approx(
        MIDDLE, abs=1.0
    )


def test_it_is_small_and_always_the_same() -> None:
    road = Road(0.3)
    scene = road.scene(*(road.obstacle(i, 9.0 * i - 40.0, WIDTH, 9.0) for i in range(10)))
    found = picture(scene, "north")
    assert len(found.png) < 30_000
    assert found.png == picture(scene, "north").png
    assert found.data_url.startswith("data:image/png;base64,iVBORw0KGgo")


def test_it_is_written_to_a_file(tmp_path) -> None:  # type: ignore[no-untyped-def]
    found = picture(Road().scene(), "ego")
    assert found.save(tmp_path / "look.png").read_bytes() == found.png
    with pytest.raises(SandraError, match="cannot be written"):
        found.save(tmp_path / "no" / "look.png")


def test_an_unknown_view() -> None:
    with pytest.raises(SettingsError, match="picture 'south': choose from ego, north"):
        PromptOptions(picture="south")
