"""The tightest bounds, their file, who is covered, and the command."""

from __future__ import annotations

import hashlib
import json
import tomllib
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from conformance_recordings import (
    BREAKS,
    DT,
    LOOSE,
    ROAD,
    N,
    T,
    calm,
    changing,
    entering,
    judged,
    recorded,
    sideways,
)
from monitor_roads import car, rows
from sandra.cli import main
from sandra.errors import ScenarioError, SettingsError
from sandra.evaluation.conformance import conformance, recordings_in, write
from sandra.prediction import predict
from sandra.scenarios import example
from sandra.settings import Assumptions, Settings

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
