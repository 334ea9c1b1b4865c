"""Recordings that break exactly one assumption each, bounds that are found, and the command."""

from __future__ import annotations

import hashlib
import json
import math
import tomllib
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from monitor_roads import car, rows
from reach_scenes import Course
from sandra.cli import main
from sandra.errors import ScenarioError, SettingsError
from sandra.evaluation.conformance import Conformance, conformance, recordings_in, write
from sandra.evaluation.conformance.measure import UNITS
from sandra.prediction import predict
from sandra.scenarios import example
from sandra.scene import load
from sandra.scene.types import Obstacle, Region, Scene
from sandra.settings import Assumptions, Settings

ROAD = Course()
DT = 0.2
N = 16
T = DT * np.arange(N)


def recorded(*others: Obstacle, ego: np.ndarray | None = None) -> Scene:
    """Three lanes of one direction, from right to left 99, 100, 101; the ego in the middle one."""
    scene = ROAD.scene(ROAD.lanes(1, 1, end=400.0), others, dt=DT)
    right, middle, left = (next(x for x in scene.lanelets if x.id == i) for i in (99, 100, 101))
    lanelets = (
        replace(middle, adjacent_left=(101, True), adjacent_right=(99, True)),
        replace(left, adjacent_right=(100, True)),
        replace(right, adjacent_left=(100, True)),
    )
    return replace(scene, lanelets=lanelets, recorded_ego=ego)


def calm(number: int = 7, s: float = 0.0, d: float = 0.0, v: float = 10.0) -> Obstacle:
    """A car that goes straight on."""
    return car(ROAD, number, rows(ROAD, s + v * T, d, v))


def changing(acceleration: float = 0.0, start: float = 10.0) -> np.ndarray:
    """Positions and speeds under a constant acceleration, exactly."""
    return rows(ROAD, start * T + acceleration * T**2 / 2, 0.0, start + acceleration * T)


def sideways(speed: float) -> np.ndarray:
    """From the middle of the lane to that of the left one at a constant lateral speed."""
    d = np.minimum(speed * T, 3.5)
    moving = np.append(np.diff(d) > 0, False)
    turn = np.where(moving, math.asin(speed / 20.0), 0.0)
    return rows(ROAD, 20.0 * T, d, 20.0, turn)


def turning(step: float) -> np.ndarray:
    """The body turns by `step` [rad] once and back, while it drives on."""
    turn = np.where(np.arange(N) == 5, step, 0.0)
    return rows(ROAD, 2.0 * T, 0.0, 2.0, turn)


def behind(speed: float) -> tuple[Obstacle, ...]:
    """One that drives into a standing one: its front reaches the other's rear at s = 4.5."""
    return calm(8, 9.0, v=0.0), car(ROAD, 7, rows(ROAD, speed * T - 1.0, 0.0, speed))


def entering(gap: float, v: float = 10.0) -> tuple[Obstacle, ...]:
    """One that enters the lane of another, `gap` before it, within its lateral bound."""
    d = np.clip(3.5 - 2.0 * (T - 0.4), 0.0, 3.5)
    turn = np.append(np.where(np.diff(d) < 0.0, -math.asin(2.0 / v), 0.0), 0.0)
    return calm(8, v=v), car(ROAD, 7, rows(ROAD, gap + 4.5 + v * T, d, v, turn))


CORNER = 2.25 * math.cos(math.asin(0.2)) + 0.9 * 0.2 - 2.25
"""The rear corner of a car that is turned by asin(0.2) is so much nearer [m]."""
LOOSE = Assumptions(max_slip_angle=1.0, max_acceleration=1000.0, max_braking=5.0, max_driving=3.0)
"""Bounds of which a recording breaks what it is to break, and nothing else."""

BREAKS: dict[str, tuple[Callable[[], tuple[Obstacle, ...]], Assumptions, float]] = {
    # assumption: (who, under which assumptions, worst value)
    "max_acceleration": (
        lambda: (car(ROAD, 7, changing(2.0)),),
        Assumptions(max_acceleration=1.9),
        2.0,
    ),
    "max_braking": (
        lambda: (car(ROAD, 7, changing(-3.0, 15.0)),),
        Assumptions(max_braking=2.9),
        3.0,
    ),
    "max_driving": (lambda: (car(ROAD, 7, changing(3.0)),), Assumptions(max_driving=2.9), 3.0),
    "max_speed": (lambda: (calm(v=50.5),), Assumptions(), 50.5),
    "no_reversing": (lambda: (calm(s=30.0, v=-1.0),), Assumptions(), 1.0),
    "stay_on_carriageway": (
        lambda: (car(ROAD, 7, rows(ROAD, 10.0 * T, 5.0 + 0.1 * np.arange(N), 10.0, 0.05)),),
        replace(LOOSE, max_overhang=10.0, follow_lanes=False),
        1.25,
    ),
    "max_lateral_speed": (lambda: (car(ROAD, 7, sideways(4.1)),), LOOSE, 4.1),
    "no_rear_end": (lambda: behind(5.0), Assumptions(), 5.0),
    "legal_cut_in": (lambda: entering(6.0), LOOSE, 8.0 + 1.0 / 6.0 - 6.0 + CORNER),
    "max_overhang": (lambda: (calm(d=4.75),), Assumptions(), 0.4),
    "min_turning_radius": (lambda: (car(ROAD, 7, turning(0.15)),), LOOSE, 0.4 / 0.149),
    "max_slip_angle": (
        lambda: (
            car(ROAD, 7, rows(ROAD, 10.0 * T, 0.0, 10.0, np.where(np.arange(N) < 8, 0.0, 0.15))),
        ),
        Assumptions(max_acceleration=1000.0),
        0.15,
    ),
}


def judged(
    *others: Obstacle, assumptions: Assumptions | None = None, **options: Any
) -> Conformance:
    chosen = Settings(assumptions=assumptions or Assumptions())
    return conformance([recorded(*others)], chosen, **options)


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


# Bounds


def test_the_tightest_bounds_are_kept_by_those_they_come_from() -> None:
    on_road = [make for name, (make, _, _) in BREAKS.items() if name != "stay_on_carriageway"]
    scenes = [recorded(*make()) for make in on_road]
    scenes = [replace(x, name=f"TST_{i}") for i, x in enumerate(scenes)]
    found = conformance(scenes)
    assert not found.holds
    for margin in (0.0, 0.05):
        tight = found.tightest(margin)
        assert conformance(scenes, Settings(assumptions=tight)).holds
    tight = found.tightest(0.0)
    # A little less of any bound is broken by somebody.
    for name in ("max_acceleration", "max_speed", "max_overhang", "max_driving", "max_braking"):
        less = replace(tight, **{name: getattr(tight, name) - 2e-3})
        assert conformance(scenes, Settings(assumptions=less))[name].broken_steps > 0, name
    assert (tight.no_reversing, tight.legal_cut_in, tight.no_rear_end) == (False, False, False)
    # What nobody showed stays as it was.
    assert tight.pedestrian_max_speed == Assumptions().pedestrian_max_speed


def test_duties_may_be_kept() -> None:
    found = judged(*entering(6.0))
    assert not found.tightest().legal_cut_in
    assert found.tightest(keep=["legal_cut_in"]).legal_cut_in
    assert found.tightest(keep=["max_speed"]).max_speed == 50.0
    with pytest.raises(SettingsError, match="'speed' is no assumption"):
        found.tightest(keep=["speed"])
    with pytest.raises(SettingsError, match="margin"):
        found.tightest(-0.1)


def test_a_body_that_turns_on_the_spot_has_no_bound() -> None:
    spin = rows(ROAD, 0.0 * T, 0.0, 0.0, 0.1 * np.arange(N))
    found = judged(car(ROAD, 7, spin))
    assert found["min_turning_radius"].worst == 0.0
    tight = found.tightest()
    assert not tight.bounded_heading
    assert judged(car(ROAD, 7, spin), assumptions=tight)["min_turning_radius"].broken_steps == 0


# Files


def test_a_set_is_written_and_read(tmp_path: Path) -> None:
    source = example("recorded-ego")
    found = conformance([source])
    path = tmp_path / "set.toml"
    written = write(found, path, "mine", 0.1, ["no_rear_end"])
    assert Assumptions.load(path) == written == Assumptions.named(f"conformant:{path}")
    data = tomllib.loads(path.read_text())
    assert data["conformance"]["name"] == "mine"
    assert data["conformance"]["keep"] == ["no_rear_end"]
    (entry,) = data["conformance"]["source"]
    assert entry["sha256"] == hashlib.sha256(source.read_bytes()).hexdigest()
    assert entry["vehicle_steps"] == found.sources[0].steps > 0
    assert Assumptions.named("paper") == Assumptions()
    with pytest.raises(SettingsError, match="cannot be written"):
        write(found, tmp_path / "no" / "set.toml")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "no set of assumptions"),
        ("[assumptions]\nspeed = 1.0\n", "unknown parameter 'assumptions.speed'"),
        ("[assumptions]\nmax_speed = 'x'\n", "assumptions.max_speed"),
        ("a_min = -3.0\n[assumptions]\n", "no set of assumptions"),
        ("[assumptions\n", "not a TOML file"),
    ],
)
def test_sets_that_are_none(text: str, message: str, tmp_path: Path) -> None:
    path = tmp_path / "set.toml"
    path.write_text(text)
    with pytest.raises(SettingsError, match=message):
        Assumptions.load(path)


def test_names_that_are_none() -> None:
    for text in ("", "conformant", "conformant:", "other", "paper:x"):
        with pytest.raises(SettingsError, match="write paper or conformant:FILE"):
            Assumptions.named(text)
    with pytest.raises(SettingsError, match="cannot be read"):
        Assumptions.named("conformant:/no/such/file")


def test_the_prediction_uses_the_set(tmp_path: Path) -> None:
    """Tighter bounds, smaller sets."""
    scene = recorded(calm(), calm(8, 40.0, 3.5))
    tight = conformance([scene]).tightest()

    def reach(a: Assumptions) -> float:
        several = predict(scene, "set-based", 8, Settings(assumptions=a)).obstacles
        vertices = np.vstack([region.vertices for o in several for region in o.at[8]])
        return float(np.ptp(vertices[:, 0]))

    assert reach(tight) < reach(Assumptions()) - 10.0


# Coverage


def test_who_keeps_the_assumptions_is_covered_who_does_not_is_not_asked() -> None:
    found = judged(calm(), car(ROAD, 8, sideways(3.0)), assumptions=LOOSE, horizon=6, every=5)
    assert found.coverage is not None
    assert found.coverage.predictions == 3
    assert found.coverage.covered == found.coverage.steps > 20
    wild = judged(car(ROAD, 8, changing(20.0)), horizon=6, every=5)
    assert wild.coverage is not None
    assert wild.coverage.steps == 0


def test_coverage_can_fail() -> None:
    """Positions that run away from the speeds, where so much noise is granted."""
    ghost = car(ROAD, 7, rows(ROAD, 60.0 * T, 0.0, 10.0))
    assert judged(ghost)["max_acceleration"].worst == pytest.approx(2 * 9.98 / DT**2)
    found = judged(ghost, horizon=6, every=5, noise=20.0)
    assert found.coverage is not None
    assert found.coverage.missed[0] == (7, 0, 1)
    assert not found.holds
    assert "outside: vehicle 7, from 0, step 1" in str(found)
    assert found.sources[0].position_error == pytest.approx(10.0)


# Input, and the command


def test_input_that_cannot_be_judged(tmp_path: Path) -> None:
    with pytest.raises(SettingsError, match="towards"):
        judged(calm(), towards="me")
    with pytest.raises(SettingsError, match="noise"):
        judged(calm(), noise=-0.1)
    with pytest.raises(SettingsError, match="step"):
        judged(calm(), step=-0.1)
    with pytest.raises(SettingsError, match="horizon"):
        judged(calm(), horizon=-1)
    with pytest.raises(ScenarioError, match="no recorded vehicle moves"):
        judged()
    with pytest.raises(ScenarioError, match="no recording of that name"):
        judged(calm(), crashed={"x": {7: 1}})
    with pytest.raises(ScenarioError, match="does not exist"):
        recordings_in([tmp_path / "x.xml"])
    with pytest.raises(ScenarioError, match=r"holds no \.xml file"):
        recordings_in([tmp_path])


def test_two_processes_say_the_same(tmp_path: Path) -> None:
    names = [example("recorded-ego"), example("merge")]
    one, two = (json.dumps(conformance(names, workers=n).to_dict()) for n in (1, 2))
    assert one == two


def test_the_command(capsys: Any, tmp_path: Path) -> None:
    out = tmp_path / "set.toml"
    words = ["conformance", "recorded-ego", "--out", str(out), "--coverage", "5", "--every", "20"]
    assert main([*words, "--json"]) in (0, 1)
    data = json.loads(capsys.readouterr().out)
    assert data["coverage"]["steps"] == data["coverage"]["covered"] > 0
    assert data["tightest"]["max_speed"] == Assumptions.load(out).max_speed
    again = ["conformance", "recorded-ego", "--assumptions", f"conformant:{out}"]
    assert main(again) == 0
    assert "max_speed" in capsys.readouterr().out
    assert main(["conformance", "recorded-ego", "--keep", "x"]) == 2
    assert "is no assumption" in capsys.readouterr().err
    assert main(["conformance", str(tmp_path / "none.xml")]) == 2
    verify = ["verify", "recorded-ego", "--pair", "keep,follow-lane", "--prediction", "set-based"]
    assert main([*verify, "--horizon", "5", "--assumptions", f"conformant:{out}"]) in (0, 1)
    capsys.readouterr()
    assert main([*verify, "--assumptions", "conformant:none"]) == 2
    assert "none: cannot be read" in capsys.readouterr().err
