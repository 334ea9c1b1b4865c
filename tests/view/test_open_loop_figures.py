"""Figures of open-loop scores and durations."""

from __future__ import annotations

from pathlib import Path

import pytest

from sandra.errors import SandraError
from sandra.view.ablation import ablation_figure
from sandra.view.durations import durations_figure


def test_more_runs_than_looks_can_be_drawn(tmp_path: Path) -> None:
    bars = {f"run {n}": {"Safe@1": (5.0 * n, 4.0 * n, 5.5 * n)} for n in range(20)}
    file = ablation_figure(bars, tmp_path / "a.pdf")
    assert file.read_bytes().startswith(b"%PDF")
    fewer = {name: bars[name] for name in list(bars)[:3]}
    assert ablation_figure(fewer, tmp_path / "b.pdf").stat().st_size < file.stat().st_size


def test_a_metric_that_a_run_lacks_is_no_bar(tmp_path: Path) -> None:
    bars = {"a": {"Safe@1": (50.0, 40.0, 60.0), "Top-1": (1.0, 0.0, 2.0)}, "b": {}}
    assert ablation_figure(bars, tmp_path / "a.png").stat().st_size > 0


def test_durations_of_one_and_of_many(tmp_path: Path) -> None:
    told = {"one": [0.2], "many": [0.001 * n for n in range(1, 400)], "none": [], "zero": [0.0]}
    assert durations_figure(told, tmp_path / "d.svg").stat().st_size > 0


def test_nothing_to_draw_is_said(tmp_path: Path) -> None:
    with pytest.raises(SandraError, match="nothing to draw"):
        ablation_figure({"a": {}}, tmp_path / "a.pdf")
    with pytest.raises(SandraError, match="nothing to draw"):
        durations_figure({"a": []}, tmp_path / "a.pdf")
