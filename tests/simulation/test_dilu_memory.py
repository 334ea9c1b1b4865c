"""What DiLu is told of the traffic, and what it remembers."""

import importlib.util
from pathlib import Path

import numpy as np
import pytest

from sandra.errors import SettingsError
from sandra.rankers.bounded import Deadline
from sandra.rankers.dilu.loop import number_in
from sandra.rankers.dilu.memory import dump
from sandra.rankers.dilu.view import Car, LaneView
from sandra.simulation import ACTIONS, highway
from sandra.simulation.dilu import Experience, HashedWords, Memory, View, load, view

pytest.importorskip("highway_env")

SCRIPT = Path(__file__).parents[2] / "scripts/dilu_memory.py"


def test_the_words_of_a_situation() -> None:
    seen = View(
        lanes=3,
        own=LaneView(1, Car(18.26, 21.0, -0.04), None),
        left=None,
        right=LaneView(2, Car(-1.2, 25.0, 1.0), Car(30.0, 20.0, 0.0)),
        changing_to=2,
        speed=25.0,
        acceleration=-1.25,
        target=25.25,
        slower=21.875,
        faster=28.625,
    )
    assert seen.situation().splitlines() == [
        "The road has 3 lanes in your direction; lane 1 is the leftmost. You are in lane 1.",
        "You drive 25.0 m/s, your acceleration is -1.2 m/s², and you are set to 25.2 m/s.",
        "You are changing to lane 2.",
        "Your lane (lane 1):",
        "- ahead: a car 18.3 m away, at 21.0 m/s, acceleration 0.0 m/s²",
        "- behind: nobody within 100 m",
        "There is no lane on your left.",
        "The lane on your right (lane 2):",
        "- ahead: a car beside you, overlapping by 1.2 m, at 25.0 m/s, acceleration 1.0 m/s²",
        "- behind: a car 30.0 m away, at 20.0 m/s, acceleration 0.0 m/s²",
    ]
    assert seen.choices().splitlines() == [
        "1 IDLE: stay in the lane, and set to the same speed",
        "2 LANE_RIGHT: change to the lane on your right",
        "3 FASTER: set the speed to 28.6 m/s",
        "4 SLOWER: set the speed to 21.9 m/s",
    ]


@pytest.mark.parametrize("setting", [1, 2, 3])
def test_the_nearest_of_each_lane_are_seen(setting: int) -> None:
    """Beside a search over all cars (lanes of highway-v0 lie along x, 4 m wide, from y = 0)."""
    world = highway(setting)
    for seed in (1, 2, 3):
        world.reset(seed)
        for _ in range(6):
            world.step("FASTER")
        seen, ego = view(world), world.ego
        x, length = float(ego.position[0]), float(ego.LENGTH)
        for lane in (seen.own, seen.left, seen.right):
            if lane is None:
                continue
            y = 4.0 * (lane.number - 1)
            gaps = [
                (float(v.position[0]) - x, v)
                for v in world.others
                if abs(float(v.position[1]) - y) <= 3.0
            ]
            for car, side in ((lane.ahead, 1), (lane.behind, -1)):
                near = [(side * gap, v) for gap, v in gaps if side * gap > 0.0]
                gap, nearest = min(near, key=lambda g: g[0], default=(np.inf, None))
                if car is None:
                    assert gap - length > 100.0
                else:
                    assert nearest is not None
                    assert car.gap == pytest.approx(gap - length)
                    assert car.speed == nearest.speed


def test_the_borders_of_the_road_and_a_change_under_way() -> None:
    world = highway(1)
    world.reset(1)
    for side, lane, action in (("left", 1, "LANE_LEFT"), ("right", 4, "LANE_RIGHT")):
        for _ in range(60):
            world.step(action)
        seen = view(world)
        assert seen.own.number == lane
        assert getattr(seen, side) is None
        assert f"There is no lane on your {side}." in seen.text()
        assert action not in seen.choices()
    world.step("LANE_LEFT")
    assert view(world).changing_to == 3
    assert "You are changing to lane 3." in view(world).situation()


@pytest.mark.parametrize("action", ["FASTER", "SLOWER"])
def test_the_speeds_that_are_told_are_those_that_are_set(action: str) -> None:
    world = highway(2)
    world.reset(7)
    for _ in range(8):
        seen = view(world)
        assert seen.target == world.ego.target_speed
        world.step(action)
        assert world.ego.target_speed == (seen.faster if action == "FASTER" else seen.slower)


def test_hashed_words_tell_situations_apart() -> None:
    embed = HashedWords().embed
    line = "Your lane (lane 2):\n- ahead: a car {} m away, at 20.0 m/s"
    near, also_near, far, other = embed(
        [line.format(12.0), line.format(14.0), line.format(80.0), "A cat sat on a mat."]
    )
    assert np.linalg.norm(near) == pytest.approx(1.0)
    assert near @ also_near == pytest.approx(1.0)
    assert near @ also_near > near @ far + 0.02 > near @ other + 0.2
    assert not embed([""]).any()
    assert np.array_equal(embed(["one 2 three"]), embed(["one 2 three"]))


def test_memory_finds_the_likest_and_puts_it_last() -> None:
    texts = ["red fish", "red red fish", "blue bird", "red bird", "green"]
    memory = Memory([Experience(text, "", "#### 1") for text in texts], HashedWords())
    found = memory.nearest("red red fish", 3, Deadline(1.0))
    assert isinstance(found, tuple)
    assert [item.situation for item in found] == ["red bird", "red fish", "red red fish"]
    assert memory.nearest("red", 0, Deadline(1.0)) == ()
    assert len(memory.nearest("red", 99, Deadline(1.0))) == 5  # type: ignore[arg-type]
    assert Memory([], HashedWords()).nearest("red", 3, Deadline(1.0)) == ()


def test_the_shipped_memory() -> None:
    items = load()
    assert len(items) == 21
    assert len({item.situation for item in items}) == 21
    numbers = [number_in(item.answer) for item in items]
    assert set(numbers) == set(range(len(ACTIONS)))
    for item, number in zip(items, numbers, strict=True):
        assert f"{number} {ACTIONS[number or 0]}" in item.choices


def test_the_shipped_memory_is_what_the_script_writes() -> None:
    """For one episode; `scripts/dilu_memory.py --check` compares all."""
    spec = importlib.util.spec_from_file_location("dilu_memory", SCRIPT)
    assert spec is not None
    assert spec.loader is not None
    script = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(script)
    happened = list(script.episode(3, 100_003))
    shipped = [item for item in load() if "setting 3, seed 100003," in item.source]
    assert shipped
    assert all(item in happened for item in shipped)


def test_a_memory_of_ones_own(tmp_path: Path) -> None:
    items = (Experience("s", "c", "#### 1", "me"),)
    path = tmp_path / "memory.json"
    path.write_text(dump(items), encoding="utf-8")
    assert load(path) == items
    for text in ("no", '[{"a": 1}]', "[3]"):
        path.write_text(text, encoding="utf-8")
        with pytest.raises(SettingsError, match="no memory can be read"):
            load(path)
