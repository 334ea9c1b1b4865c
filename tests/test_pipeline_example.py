"""`examples/pipeline/run.py`: every stage for real, in its smallest size."""

from __future__ import annotations

import csv
import importlib.util
import json
import sys
from pathlib import Path
from types import ModuleType

import pytest

from sandra.learn.rows import read_rows
from sandra.scene.tracks import Tracks

SCRIPT = Path(__file__).resolve().parents[1] / "examples" / "pipeline" / "run.py"


@pytest.fixture(scope="module")
def pipeline() -> ModuleType:
    spec = importlib.util.spec_from_file_location("pipeline_run", SCRIPT)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module  # its dataclass looks itself up
    spec.loader.exec_module(module)
    return module


def test_from_recorded_traffic_to_a_model_that_drives(
    pipeline: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    monkeypatch.setattr(sys, "argv", list(sys.argv))
    out = tmp_path / "run"
    pipeline.main(["--out", str(out), "--size", "tiny"])
    told = capsys.readouterr().out
    names = list(pipeline.stages(out, pipeline.SIZES["tiny"]))
    assert names == ["record", "label", "build", "scratch", "lora", "export", "evaluate", "drive"]
    assert [line.split()[0] for line in told.splitlines()[-9:-1]] == names

    recorded = {path.parent.name: Tracks(path) for path in (out / "data").rglob("*.xml")}
    assert set(recorded) == {"train", "validation", "test"}
    with (out / "labels" / "labels.csv").open() as file:
        assert len(list(csv.DictReader(file))) == sum(len(t.all()) for t in recorded.values())
    rows = [row for row in read_rows(out / "data.jsonl") if row.is_labelled]
    assert {row.split for row in rows} == set(recorded)

    scratch = json.loads((out / "small" / "card.json").read_text())
    adapter = json.loads((out / "adapter" / "card.json").read_text())
    assert scratch["sha256 of the rows"] == adapter["sha256 of the rows"]
    assert adapter["model"] == f"{out}/small/model"
    assert adapter["command_line"][:3] == ["sandra", "finetune", "lora"]
    assert adapter["steps"] == -(-sum(row.split == "train" for row in rows) // 2)
    assert (out / "tuned.gguf").read_bytes()[:4] == b"GGUF"

    judged = json.loads((out / "open-loop" / "scores.json").read_text())
    test = sum(row.split == "test" for row in rows)
    runs = {run["run"]: run for run in judged["runs"]}
    models = [run for name, run in runs.items() if name.startswith("hf:")]
    assert [run["n"] for run in models] == [test, test]
    assert all(run["failures"] == {} for run in models)

    decisions = (out / "drive" / "seed-5838" / "decisions.jsonl").read_text().splitlines()
    assert len(decisions) == pipeline.SIZES["tiny"].steps
    for decision in map(json.loads, decisions):
        assert decision["ranker"] == f"gguf:{out}/tuned.gguf"
        assert decision["failure"] is None
        assert len(decision["ranking"]) == 3
