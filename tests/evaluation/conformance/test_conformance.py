"""Recordings that break exactly one assumption each, and what is no evidence."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from conformance_recordings import (
    BREAKS,
    LOOSE,
    ROAD,
    N,
    T,
    behind,
    calm,
    changing,
    entering,
    judged,
    recorded,
)
from monitor_roads import car, rows
from sandra.errors import ScenarioError
from sandra.evaluation.conformance import conformance, recordings_in
from sandra.evaluation.conformance.measure import UNITS
from sandra.scenarios import example
from sandra.scene import load
from sandra.scene.types import Region
from sandra.settings import Settings


@pytest.mark.parametrize("name", BREAKS)
def test_a_recording_that_breaks_one_assumption_breaks_no_other(name: str) -> None:
    make, assumptions, worst = BREAKS[name]
    found = judged(*make(), assumptions=assumptions)
    broken = {f.name for f in found.findings if f.broken_steps}
    assert broken == {name}
    finding = found[name]
    assert finding.broken_vehicles == 1
    assert finding.worst == pytest.approx(worst, abs=1e-6)
    assert finding.where is not None
    assert finding.where.vehicle == 7
    assert not found.holds
    assert f"{finding.worst:.3f}" in str(found)


def test_leaving_the_lanes_for_one_that_does_not_follow() -> None:
    """A lanelet beside the road that no link leads to."""
    scene = recorded(car(ROAD, 7, rows(ROAD, 10.0 * T, np.where(np.arange(N) < 4, 0.0, 20.0))))
    far = replace(scene.lanelets[0], id=5, adjacent_left=None, adjacent_right=None)
    up = np.array([0.0, 20.0])
    far = replace(far, left=far.left + up, right=far.right + up)
    found = conformance(
        [replace(scene, lanelets=(*scene.lanelets, far))], Settings(assumptions=LOOSE)
    )
    assert found["follow_lanes"].broken_steps == 1
    assert found["follow_lanes"].worst == pytest.approx(20.0 - 5.25)


def test_who_keeps_everything_breaks_nothing() -> None:
    found = judged(calm(), calm(8, 30.0, 3.5), calm(9, 60.0, -3.5))
    assert found.holds
    assert all(f.broken_steps == 0 for f in found.findings)
    assert [f.name for f in found.findings] == list(UNITS)
    assert found["max_speed"].steps == 3 * N
    assert found["max_acceleration"].steps == 3 * (N - 1)
    with pytest.raises(KeyError, match="no assumption"):
        found["speed"]


# Traffic law


@pytest.mark.parametrize(
    ("gap", "legal"), [(8.35, True), (8.25, False), (-12.0, True), (-2.0, False)]
)
def test_a_cut_in_is_legal_at_the_safe_distance_or_behind(gap: float, legal: bool) -> None:
    """d_safe = 8.1667 m, and 0.1345 m for the corner of a turned body."""
    finding = judged(*entering(gap), assumptions=LOOSE)["legal_cut_in"]
    assert (finding.broken_steps == 0) is legal


def test_towards_the_recorded_ego_only() -> None:
    other = entering(6.0)
    assert judged(*other, assumptions=LOOSE, towards="ego")["legal_cut_in"].broken_steps == 0
    scene = recorded(other[1], ego=rows(ROAD, 10.0 * T))
    found = conformance([scene], Settings(assumptions=LOOSE), towards="ego")
    assert found["legal_cut_in"].broken_vehicles == 1
    # The ego is none of the others.
    assert found["max_speed"].vehicles == 1


def test_the_ego_is_not_asked() -> None:
    scene = recorded(calm(8, 40.0), ego=rows(ROAD, 80.0 * T, speed=80.0))
    assert conformance([scene])["max_speed"].broken_steps == 0


# What is no evidence


def test_after_a_crash_nothing_counts() -> None:
    states = changing(0.0)
    states[9:, 3] = 0.0
    states[9:, 0] = states[8, 0] + 1.0
    wreck = car(ROAD, 7, states)
    assert judged(wreck)["max_acceleration"].broken_steps == 1
    name = recorded().name
    found = judged(wreck, crashed={name: {7: 9}})
    assert found.holds
    assert found.sources[0].crashed_steps == N - 9
    assert found["max_speed"].steps == 9
    assert judged(wreck, crashed={name: {7: 10}})["max_acceleration"].broken_steps == 1


def test_bodies_that_touch_have_crashed() -> None:
    first, second = behind(5.0)
    states = np.array(second.states)
    states[8:, 3] = -20.0
    found = judged(first, replace(second, states=states), touching=True)
    assert found["max_acceleration"].broken_steps == 0
    assert found.sources[0].crashed_steps > 0
    assert "after a crash left out" in str(found)


def test_a_run_folder_marks_its_crashes(tmp_path: Path) -> None:
    path = tmp_path / "scenario.xml"
    path.write_bytes(example("recorded-ego").read_bytes())
    whole = conformance([path]).sources[0]
    number = load(path).obstacles[0].id
    (tmp_path / "metrics.json").write_text(json.dumps({"crashed": {str(number): 10, "99999": 3}}))
    marked = conformance([path]).sources[0]
    assert marked.crashed_steps == whole.steps - marked.steps > 0


def test_files_are_named_below_their_common_folder(tmp_path: Path) -> None:
    several = []
    for seed in ("1", "2"):
        (tmp_path / seed).mkdir()
        several.append(tmp_path / seed / "scenario.xml")
        several[-1].write_bytes(example("recorded-ego").read_bytes())
    number = load(several[0]).obstacles[0].id
    found = conformance(recordings_in([tmp_path]), crashed={"2/scenario.xml": {number: 5}})
    assert [s.file for s in found.sources] == ["1/scenario.xml", "2/scenario.xml"]
    assert [s.crashed_steps > 0 for s in found.sources] == [False, True]


def test_along_a_lanelet_that_leads_there_nobody_cuts_in() -> None:
    """The left lane ends in the middle one: the same motion, with and without that link."""
    scene = recorded(*entering(6.0))
    left = next(x for x in scene.lanelets if x.id == 101)
    middle = next(x for x in scene.lanelets if x.id == 100)
    right = next(x for x in scene.lanelets if x.id == 99)
    leads = (replace(left, successors=(100,)), replace(middle, predecessors=(101,)), right)
    chosen = Settings(assumptions=LOOSE)
    assert conformance([scene], chosen)["legal_cut_in"].broken_steps == 1
    assert conformance([replace(scene, lanelets=leads)], chosen)["legal_cut_in"].broken_steps == 0


def test_a_cut_in_before_one_on_the_lanelet_behind() -> None:
    """The lane is cut in two between both vehicles: distances go on along it."""
    whole = recorded(*entering(6.0))
    middle = next(x for x in whole.lanelets if x.id == 100)
    rest = tuple(x for x in whole.lanelets if x.id != 100)

    def part(number: int, low: float, high: float, **links: Any) -> Any:
        x = np.array([low, high])
        left, right = (np.column_stack([x, np.full(2, y)]) for y in (1.75, -1.75))
        beside = {"adjacent_left": (101, True), "adjacent_right": (99, True)}
        return replace(middle, id=number, left=left, right=right, **beside, **links)

    # Both are there when the body appears: one ends at s = 11.5, the other begins at 15.5.
    first, second = part(1, -40.0, 13.0, successors=(2,)), part(2, 13.0, 400.0, predecessors=(1,))
    scene = replace(whole, lanelets=(first, second, *rest))
    chosen = Settings(assumptions=LOOSE)
    found, before = (conformance([x], chosen)["legal_cut_in"] for x in (scene, whole))
    assert before.broken_steps == found.broken_steps == 1
    assert found.worst == pytest.approx(before.worst)


def test_every_so_many_seconds() -> None:
    """At every second step of a car that speeds up and slows down by turns."""
    speed = 10.0 + np.arange(N) % 2
    scene = recorded(car(ROAD, 7, rows(ROAD, 10.5 * T, 0.0, speed)))
    assert conformance([scene])["max_driving"].worst == pytest.approx(5.0)
    found = conformance([scene], step=0.4, horizon=3)
    assert found["max_driving"].worst == pytest.approx(0.0)
    assert found["max_speed"].steps == N // 2
    assert found.sources[0].dt == pytest.approx(0.4)
    swerve = rows(ROAD, 10.0 * T, 0.0, np.where(np.arange(N) == 6, 20.0, 10.0))
    where = conformance([recorded(car(ROAD, 7, swerve))], step=0.4)["max_driving"].where
    assert where is not None
    assert where.step == 6


@pytest.mark.parametrize("mark", [{"8": 3}, {"7": -1}, {"7": "x"}, [7], {"x": 2}])
def test_marks_that_mark_nothing(mark: Any, tmp_path: Path) -> None:
    path = tmp_path / "r.xml"
    path.write_bytes(example("recorded-ego").read_bytes())
    (tmp_path / "r.crashed.json").write_text(json.dumps(mark))
    with pytest.raises(ScenarioError, match="crashed"):
        conformance([path])


def test_who_is_off_the_road_when_first_seen_is_assumed_no_lanes_of() -> None:
    found = judged(calm(d=12.0), calm(8, 30.0))
    assert found["max_overhang"].vehicles == 1
    assert found["stay_on_carriageway"].broken_steps == 0
    assert found.sources[0].off_lanes == 1
    assert "1 vehicles on no lane when first seen" in str(found)


def test_a_gap_in_a_recording_is_no_jump() -> None:
    states = changing(0.0)
    states[6] = math.nan
    states[7:, 0] = 100.0 + 30.0 * T[7:]
    states[7:, 3] = 30.0
    found = judged(car(ROAD, 7, states))
    assert found.holds
    assert found["max_acceleration"].steps == N - 1 - 2


def test_pedestrians_have_their_own_bounds() -> None:
    walker = car(
        ROAD, 7, rows(ROAD, 3.0 * T, 8.0, 3.0), kind="pedestrian", outline=Region.disc(0.4)
    )
    found = judged(walker)
    assert {f.name for f in found.findings if f.broken_steps} == {"pedestrian_max_speed"}
    assert math.isnan(found["max_speed"].worst)
    assert "not seen" in str(found)


def test_round_bodies_stick_out_as_far_as_they_reach() -> None:
    round_ = car(ROAD, 7, rows(ROAD, 10.0 * T, 5.0), outline=Region.disc(0.5))
    assert judged(round_)["max_overhang"].worst == pytest.approx(0.25, abs=0.01)
