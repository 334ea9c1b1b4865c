"""Growth: the scenes that are measured, the largest sizes, and what is said of them."""

import json
from pathlib import Path

import numpy as np
import pytest

from sandra.actions import ALL_PAIRS
from sandra.cli import main
from sandra.errors import SandraError
from sandra.evaluation.growth import AXES, BASE, Growth, Point, measure_growth, road
from sandra.logic import Specification
from sandra.prediction import predict
from sandra.reach import compute, ground, twin
from sandra.settings import Settings
from sandra.view.growth import growth_figure


def point(axis: str, value: int, time: float) -> Point:
    return Point(axis, value, time / 4, time / 4, time / 2, 3.0, 7)


@pytest.mark.parametrize(("lanes", "cars"), [(1, 1), (1, 40), (3, 60), (12, 500), (2, 3)])
def test_roads_have_what_is_asked_for_and_nobody_overlaps(lanes: int, cars: int) -> None:
    scene = road(lanes, cars)
    assert len(scene.lanelets) == len(scene.lanes) == lanes
    assert len(scene.obstacles) == cars
    places = np.array([(o.state.x, o.state.y) for o in (*scene.obstacles, scene.ego)])
    away = np.abs(places[:, None] - places[None, :])
    together = (away[..., 0] < 5.0) & (away[..., 1] < 2.0) & ~np.eye(cars + 1, dtype=bool)
    assert not together.any()
    relations = {lane.relation for lane in scene.lanes}
    assert ("left" in relations) == (lanes > 1)
    assert ("right" in relations) == (lanes > 2)
    along = scene.frame.to_curvilinear(places[-1:])
    assert 0.0 < along[0, 0] < scene.frame.length
    assert road(lanes, cars).obstacles[0].state == scene.obstacles[0].state


def test_the_largest_sizes_are_verified_in_full() -> None:
    assert max(AXES["horizon"]) == 200
    assert max(AXES["obstacles"]) == 500
    assert max(AXES["lanes"]) == 12
    horizon = 200 if twin.native is not None else 40
    for lanes, cars, h in ((12, 500, 10), (3, BASE["obstacles"], horizon)):
        settings = Settings().replace(horizon=h)
        scene = road(lanes, cars)
        base = ground(scene, predict(scene, "most-likely", h, settings), settings)
        whole = compute(base, Specification(ALL_PAIRS[0], ()))
        assert whole.first_empty_step is None
        assert len(whole.sizes) == h + 1
        assert all(0.0 < whole.area(k) < np.inf for k in (1, h // 2, h))


def test_points_are_measured_in_processes_of_their_own(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(AXES, "lanes", (1, 2))
    told: list[str] = []
    found = measure_growth(["lanes"], runs=1, progress=told.append)
    assert told == ["lanes 1", "lanes 2"]
    assert [(p.axis, p.value) for p in found.points] == [("lanes", 1), ("lanes", 2)]
    for each in found.points:
        assert min(each.predict, each.ground, each.verify) > 0.0
        assert each.base_sets > BASE["horizon"]
        assert np.isnan(each.memory) or 0.0 < each.memory < 500.0


def test_the_exponent_is_that_of_the_growth() -> None:
    for power in (1.0, 2.0):
        points = tuple(point("lanes", n, 0.01 * n**power) for n in (1, 2, 4, 8))
        growth = Growth((*points, point("horizon", 10, 1.0), point("horizon", 20, 1.0)))
        assert growth.exponent("lanes") == pytest.approx(power)
        assert f"lanes to the power of {power:.2f}" in str(growth)
        assert growth.to_dict()["exponents"]["lanes"] == pytest.approx(power)


def test_curves_are_drawn(tmp_path: Path) -> None:
    growth = Growth(tuple(point(axis, n, n) for axis in AXES for n in (1, 5, 9)))
    for suffix in ("png", "pdf", "svg"):
        path = growth_figure(growth, tmp_path / f"growth.{suffix}")
        assert path.stat().st_size > 1000
    with pytest.raises(SandraError):
        growth_figure(growth, tmp_path / "growth.txt")


def test_the_command(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(AXES, "lanes", (1, 2))
    figure = tmp_path / "growth.svg"
    line = ["bench", "growth", "--axes", "lanes", "--runs", "1", "--figure", str(figure)]
    assert main([*line, "--json"]) == 0
    data = json.loads(capsys.readouterr().out)
    assert [p["value"] for p in data["points"]] == [1, 2]
    assert figure.exists()
    assert main(["bench", "growth", "--axes", "speed"]) == 2
    assert "choose from horizon,obstacles,lanes" in capsys.readouterr().err
    assert main(["bench", "growth", "--runs", "0"]) == 2
