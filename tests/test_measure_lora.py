"""The arithmetic of `scripts/measure_lora.py`: intervals over scenarios, paired; labels alike."""

from __future__ import annotations

import importlib.util
import sys
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from sandra.learn.rows import Row

SCRIPT = Path(__file__).resolve().parents[1] / "scripts" / "measure_lora.py"


@pytest.fixture(scope="module")
def script() -> ModuleType:
    spec = importlib.util.spec_from_file_location("measure_lora", SCRIPT)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    return module


def rows(scenarios: int, each: int) -> list[Row]:
    return [
        Row("labelled", "test", f"{s}.xml", 1, i, "keep,follow-lane" if i else "stop,follow-lane")
        for s in range(scenarios)
        for i in range(each)
    ]


def test_an_interval_is_as_wide_as_scenarios_differ(script: ModuleType) -> None:
    """Rows of one scenario that are all alike count as one, not as many."""
    draw = np.random.default_rng(3)
    found = rows(40, 10)
    by_scenario = np.repeat(draw.choice([-1.0, 0.0, 1.0], 40, p=[0.1, 0.5, 0.4]), 10)
    shuffled = draw.permutation(by_scenario)
    wide, narrow = (np.ptp(script.interval(d, found)) for d in (by_scenario, shuffled))
    assert wide == pytest.approx(4 * np.std(by_scenario) / np.sqrt(40), rel=0.15)
    assert narrow == pytest.approx(4 * np.std(by_scenario) / np.sqrt(400), rel=0.25)
    low, high = script.interval(by_scenario, found)
    assert low < by_scenario.mean() < high
    assert script.interval(np.full(400, 0.25), found) == (0.25, 0.25)


def test_the_table(script: ModuleType) -> None:
    found = rows(4, 5)
    first = np.array([row.label == "stop,follow-lane" for row in found])
    never, always = np.zeros(20, bool), np.ones(20, bool)
    answers = script.Answers
    sheet = script.table(
        {
            script.UNTUNED: [answers(first, always)],
            "LoRA, 2 seeds": [answers(always, always), answers(never, always)],
        },
        found,
    )
    untuned, tuned = sheet.rows
    assert untuned == (script.UNTUNED, "20.0", "50.0", "", "100.0", "")
    assert tuned[1:3] == ("50.0 (100.0, 0.0)", "50.0")
    assert tuned[3:] == ("+30.0 [+30.0, +30.0]", "100.0 (100.0, 100.0)", "+0.0 [+0.0, +0.0]")


def test_the_constant_ranking_is_of_the_rows_for_tuning(script: ModuleType) -> None:
    train = [row for row in rows(3, 5) if row.label == "stop,follow-lane"]
    hits = script.constant(train, rows(3, 5))
    assert hits.top1.sum() == hits.top3.sum() == 3


def test_rows_are_thinned_evenly(script: ModuleType, tmp_path: Path) -> None:
    from dataclasses import replace

    found = [replace(r, split="train", status="unknown") for r in rows(10, 5)]
    found += [replace(r, split="validation", status="unknown") for r in rows(1, 5)]
    kept = list(script.read_rows(script.thinned(tmp_path, found, 20)))
    assert sum(row.split == "train" for row in kept) == 20
    assert {row.scenario for row in kept if row.split == "train"} == {r.scenario for r in found}
    assert sum(row.split == "validation" for row in kept) == 2
