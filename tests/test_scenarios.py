"""The scenarios that are shipped: made by the script, readable, plausible, and as announced."""

import importlib.util
import sys
from functools import cache
from itertools import combinations
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
import shapely

from sandra.reach import Status, verify
from sandra.scene import Region, Scene
from sandra.scene import load as load_anew

ROOT = Path(__file__).resolve().parents[1]
SHIPPED = ROOT / "src" / "sandra" / "scenarios"
FILES = sorted(SHIPPED.glob("*.xml"))
NAMES = {path.stem.split("-")[0].split("_")[1]: path for path in FILES}

load = cache(load_anew)


@pytest.fixture(scope="module")
def script() -> ModuleType:
    path = ROOT / "scripts" / "make_scenarios.py"
    spec = importlib.util.spec_from_file_location("make_scenarios", path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    before = list(sys.path)
    try:
        spec.loader.exec_module(module)
    finally:
        sys.path[:] = before
    return module


def shape(region: Region) -> shapely.Geometry:
    vertices = region.vertices
    body = shapely.Polygon(vertices) if len(vertices) > 2 else shapely.Point(vertices[0])
    return body.buffer(region.radius) if region.radius > 0 else body


def bodies(scene: Scene, k: int) -> dict[int, shapely.Geometry]:
    """What is recorded of every obstacle at step k."""
    found = {}
    for obstacle in scene.obstacles:
        if obstacle.occupancies is not None:
            regions = obstacle.occupancies[k] if k < len(obstacle.occupancies) else ()
            if regions:
                found[obstacle.id] = shapely.union_all([shape(region) for region in regions])
            continue
        x, y, heading = obstacle.state.x, obstacle.state.y, obstacle.state.heading
        if obstacle.states is not None:
            if k >= len(obstacle.states) or np.isnan(obstacle.states[k, 0]):
                continue
            x, y, heading = obstacle.states[k, :3]
        found[obstacle.id] = shape(obstacle.outline.placed(x, y, heading))
    return found


def test_there_are_eight() -> None:
    assert set(NAMES) == {
        "Intersection",
        "HighwayDense",
        "Merge",
        "RuralOncoming",
        "UrbanParked",
        "NothingSafe",
        "RecordedEgo",
        "Roadworks",
    }


def test_script_makes_what_is_shipped(script: ModuleType) -> None:
    made = script.shipped()
    assert set(made) == {path.name for path in FILES}
    for path in FILES:
        assert made[path.name] == path.read_bytes(), f"{path.name}: run make scenarios"
        assert len(made[path.name]) < 400_000


def test_script_makes_the_other_formats(script: ModuleType) -> None:
    for name, content in script.for_tests().items():
        assert content == (ROOT / "tests" / "data" / name).read_bytes(), f"{name}: make scenarios"


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.stem)
def test_ego_stands_in_its_lane_and_touches_nobody(path: Path) -> None:
    scene = load(path)
    s, d, heading, _ = scene.ego_curvilinear
    assert abs(d) < 0.05
    assert abs(heading) < 0.01
    assert s > 5.0
    assert scene.speed_limit is not None
    state = scene.ego.state
    ego = shape(scene.ego.outline.placed(state.x, state.y, state.heading))
    assert not [i for i, body in bodies(scene, 0).items() if body.intersects(ego)]


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.stem)
def test_nobody_collides_and_everybody_moves_as_recorded(path: Path) -> None:
    scene = load(path)
    assert scene.recorded_steps >= 60
    for k in range(scene.recorded_steps + 1):
        for (i, one), (j, other) in combinations(bodies(scene, k).items(), 2):
            assert not one.intersects(other), f"{i} and {j} overlap at step {k}"
    for obstacle in scene.obstacles:
        if obstacle.is_static or obstacle.states is None:
            continue
        states = obstacle.states[~np.isnan(obstacle.states[:, 0])]
        way = np.diff(states[:, :2], axis=0)
        pace = np.hypot(*way.T) / scene.dt
        mean_speed = (states[:-1, 3] + states[1:, 3]) / 2
        assert np.abs(pace - mean_speed).max() < 0.25, obstacle.id
        assert (states[:, 3] >= 0.0).all()
        assert (np.abs(states[:, 4]) <= 5.01).all()
        moving = pace > 1.0
        turn = np.arctan2(way[moving, 1], way[moving, 0]) - states[:-1, 2][moving]
        assert (np.abs((turn + np.pi) % (2 * np.pi) - np.pi) < 0.05).all(), obstacle.id


def test_intersection() -> None:
    scene = load(NAMES["Intersection"])
    assert (scene.road_type, scene.country, scene.dt) == ("intersection", "DEU", 0.1)
    assert scene.speed_limit == pytest.approx(50 / 3.6, abs=0.01)
    assert scene.ego.state.speed == 7.7
    assert scene.ego.state.acceleration == -2.1
    assert scene.left is None
    assert scene.right is not None
    assert [lane.side for lane in scene.opposite] == ["left"]
    assert scene.incoming
    assert scene.lights[0].state == "red"
    assert 20.0 < scene.lights[0].distance < 50.0
    kinds = {obstacle.kind for obstacle in scene.obstacles}
    assert {"car", "truck", "bus", "taxi", "bicycle", "motorcycle"} <= kinds
    ahead = [(lane, _ahead(scene, lane)) for lane in ("current", "right")]
    assert all(gaps and min(gaps) < 25.0 for _, gaps in ahead)


def _ahead(scene: Scene, relation: str) -> list[float]:
    """Distances from centre to centre to those ahead in a lane [m]."""
    lane = next(lane for lane in scene.lanes if lane.relation == relation)
    area = shapely.Polygon(lane.polygon).buffer(0)
    s, *_ = scene.ego_curvilinear
    found = []
    for obstacle in scene.obstacles:
        at = np.array([[obstacle.state.x, obstacle.state.y]])
        if area.contains(shapely.Point(at[0])):
            distance = float(scene.frame.to_curvilinear(at)[0, 0]) - s
            found += [distance] if distance > 0 else []
    return found


def test_highway_dense() -> None:
    scene = load(NAMES["HighwayDense"])
    assert scene.road_type == "highway"
    assert scene.speed_limit == pytest.approx(120 / 3.6, abs=0.01)
    assert scene.left is not None
    assert scene.right is not None
    assert len(scene.obstacles) >= 20
    assert sum(obstacle.kind == "truck" for obstacle in scene.obstacles) >= 3


def test_merge() -> None:
    scene = load(NAMES["Merge"])
    assert scene.left is not None
    assert any("accessRamp" in lanelet.kinds for lanelet in scene.lanelets)
    truck = next(obstacle for obstacle in scene.obstacles if obstacle.kind == "truck")
    assert truck.states is not None
    _, d = scene.frame.to_curvilinear(truck.states[[0, -1], :2]).T
    assert d[0] < -3.0, "it starts to the right of the ego's lane"
    assert abs(d[1]) < 0.3, "and ends in it"


def test_rural_oncoming() -> None:
    scene = load(NAMES["RuralOncoming"])
    assert scene.road_type == "rural"
    assert scene.speed_limit == pytest.approx(100 / 3.6, abs=0.01)
    assert scene.left is None
    assert len(scene.opposite) == 1
    headings = [obstacle.state.heading - scene.ego.state.heading for obstacle in scene.obstacles]
    assert sum(np.cos(heading) < -0.8 for heading in headings) >= 1


def test_urban_parked() -> None:
    scene = load(NAMES["UrbanParked"])
    assert scene.road_type in ("urban", "residential")
    kinds = [obstacle.kind for obstacle in scene.obstacles]
    assert kinds.count("parkedVehicle") >= 10
    assert "bicycle" in kinds
    pedestrian = next(o for o in scene.obstacles if o.kind == "pedestrian")
    assert pedestrian.states is not None
    _, d = scene.frame.to_curvilinear(pedestrian.states[[0, -1], :2]).T
    assert d[0] < -2.0, "it starts beside the lane"
    assert d[1] > -1.75, "and ends on the road"


def test_nothing_safe() -> None:
    scene = load(NAMES["NothingSafe"])
    assert scene.ego.state.speed == 25.0
    truck = next(obstacle for obstacle in scene.obstacles if obstacle.is_static)
    wreck = shape(truck.outline.placed(truck.state.x, truck.state.y, truck.state.heading))
    for lane in (scene.current, scene.left):
        assert lane is not None
        road = shapely.Polygon(lane.polygon)
        assert len(road.difference(wreck).geoms) == 2, "it lies across the whole lane"
    assert scene.right is None
    assert wreck.distance(shapely.Point(scene.ego.state.x, scene.ego.state.y)) < 23.0


def test_recorded_ego() -> None:
    scene = load(NAMES["RecordedEgo"])
    assert scene.dt == 0.2
    assert scene.recorded_ego is not None
    assert len(scene.recorded_ego) >= 61
    _, d = scene.frame.to_curvilinear(scene.recorded_ego[[0, -1], :2]).T
    assert d[1] - d[0] == pytest.approx(3.5, abs=0.1)


def test_roadworks() -> None:
    scene = load(NAMES["Roadworks"])
    assert scene.weather == "light_rain"
    assert scene.time_of_day == "night"
    kinds = {obstacle.kind for obstacle in scene.obstacles}
    assert {"constructionZone", "truck", "bus", "motorcycle", "pedestrian", "roadBoundary"} <= kinds
    assert any(obstacle.occupancies is not None for obstacle in scene.obstacles)
    assert any(obstacle.outline.radius > 0 for obstacle in scene.obstacles)
    assert any(sign.name == "warning_construction_site" for sign in scene.signs)


@pytest.mark.parametrize(
    "name", ["DEU_RuralOncoming-1_1_T-1-2018b.xml", "DEU_RuralOncoming-1_1_T-1-SC.pb"]
)
def test_other_formats_tell_the_same(name: str) -> None:
    scene, other = load(NAMES["RuralOncoming"]), load(ROOT / "tests" / "data" / name)
    assert other.dt == scene.dt
    assert other.speed_limit == scene.speed_limit
    assert other.ego.state == scene.ego.state
    for one, two in zip(scene.obstacles, other.obstacles, strict=True):
        assert (one.id, one.kind) == (two.id, two.kind)
        np.testing.assert_allclose(one.states, two.states, atol=1e-6)


@pytest.mark.parametrize(
    ("name", "prediction", "reachable"),
    [
        (
            "Intersection",
            "most-likely",
            {"decelerate,follow-lane", "decelerate,right-lane"}
            | {"stop,follow-lane", "stop,right-lane"},
        ),
        ("RuralOncoming", "most-likely", {"decelerate,follow-lane"}),
        ("RuralOncoming", "set-based", {"decelerate,follow-lane"}),
        ("NothingSafe", "most-likely", set()),
    ],
)
def test_expected_verdicts(name: str, prediction: str, reachable: set[str]) -> None:
    verdicts = verify(load(NAMES[name]), prediction=prediction, horizon=25, reasons=False)
    assert {str(v.pair) for v in verdicts if v.status is Status.REACHABLE} == reachable
