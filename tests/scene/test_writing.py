"""A scene that was written is the scene that is read."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import sandra
from sandra.errors import ScenarioError
from sandra.scene import Region, Scene
from sandra.scene.writing import write


@pytest.mark.parametrize("name", ["recorded-ego", "merge", "urban-parked", "rural-oncoming"])
def test_round_trip(name: str, tmp_path: Path) -> None:
    scene = sandra.load(sandra.example(name))
    back = sandra.load(write(scene, tmp_path / "scene.xml"))
    assert back.dt == scene.dt
    assert [x.id for x in back.lanelets] == [x.id for x in scene.lanelets]
    for a, b in zip(scene.lanelets, back.lanelets, strict=True):
        assert np.allclose(a.left, b.left, atol=1e-4)
        assert a.successors == b.successors
        assert a.adjacent_left == b.adjacent_left
        assert (a.speed_limit is None) == (b.speed_limit is None)
        assert a.speed_limit is None or abs(a.speed_limit - b.speed_limit) < 1e-3
    here = {o.id: o for o in scene.obstacles if o.occupancies is None}
    there = {o.id: o for o in back.obstacles}
    assert here.keys() <= there.keys()
    for i, o in here.items():
        assert there[i].kind == o.kind
        assert there[i].is_static == o.is_static
        assert there[i].length == pytest.approx(o.length, abs=1e-3)
        if o.states is not None:
            seen = np.isfinite(o.states[:, 0])
            assert np.allclose(
                o.states[seen, :2], there[i].states[: len(seen)][seen, :2], atol=1e-3
            )
    if scene.recorded_ego is not None:
        assert back.recorded_ego is not None
        assert np.allclose(scene.recorded_ego[:, :4], back.recorded_ego[:, :4], atol=1e-3)


def test_who_appears_late_is_there_from_then_on(tmp_path: Path) -> None:
    scene = sandra.load(sandra.example("recorded-ego"))
    other = next(o for o in scene.obstacles if o.states is not None)
    assert other.states is not None
    states = other.states.copy()
    states[:3] = np.nan
    late = replace(other, states=states)
    back = sandra.load(write(replace(scene, obstacles=(late,)), tmp_path / "late.xml"))
    (found,) = back.obstacles
    assert found.states is not None
    assert np.isnan(found.states[:3, 0]).all()
    assert np.allclose(found.states[3:, :2], states[3 : len(found.states), :2], atol=1e-3)


def test_an_ego_that_turns_is_read_back_turning(tmp_path: Path) -> None:
    scene = sandra.load(sandra.example("recorded-ego"))
    turning = replace(scene.ego.state, yaw_rate=0.25, steering_angle=0.1)
    written = replace(scene, ego=replace(scene.ego, state=turning))
    back = sandra.load(write(written, tmp_path / "turning.xml"))
    assert back.ego.state.yaw_rate == pytest.approx(0.25)


def with_outline(region: Region) -> Scene:
    scene = sandra.load(sandra.example("recorded-ego"))
    return replace(scene, obstacles=(replace(scene.obstacles[0], outline=region),))


def test_shapes(tmp_path: Path) -> None:
    triangle = Region(np.array([[-2.0, -1.0], [2.0, 0.0], [-2.0, 1.0]]))
    for region in (Region.disc(0.5), triangle):
        back = sandra.load(write(with_outline(region), tmp_path / "shape.xml"))
        (found,) = back.obstacles
        assert found.outline.radius == region.radius
        assert found.width == pytest.approx(2.0 if region is triangle else 1.0, abs=1e-3)
    capsule = Region(np.array([[-1.0, 0.0], [1.0, 0.0]]), 0.5)
    with pytest.raises(ScenarioError, match="no shape"):
        write(with_outline(capsule), tmp_path / "capsule.xml")


def test_where_nothing_can_be_written(tmp_path: Path) -> None:
    scene = sandra.load(sandra.example("recorded-ego"))
    with pytest.raises(ScenarioError, match="cannot be written"):
        write(scene, tmp_path / "absent" / "scene.xml")
