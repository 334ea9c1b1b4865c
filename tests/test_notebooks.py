"""The notebooks run from the first cell to the last; they are stored without outputs."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import nbformat
import pytest
from nbclient import NotebookClient

ROOT = Path(__file__).resolve().parents[1]
NOTEBOOKS = sorted((ROOT / "docs" / "notebooks").glob("*.ipynb"))


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_stored_without_outputs(path: Path) -> None:
    cells = [c for c in nbformat.read(path, as_version=4).cells if c.cell_type == "code"]
    assert len(cells) >= 5
    assert all(c.outputs == [] and c.execution_count is None for c in cells)


def outputs(path: Path, folder: Path) -> tuple[str, int]:
    """All that the cells print, and the number of pictures that they show."""
    notebook: Any = nbformat.read(path, as_version=4)
    NotebookClient(
        notebook, timeout=300, kernel_name="python3", resources={"metadata": {"path": str(folder)}}
    ).execute()
    found = [out for cell in notebook.cells for out in cell.get("outputs", ())]
    text = "".join(out.get("text", "") for out in found)
    return text, sum("image/png" in out.get("data", {}) for out in found)


@pytest.fixture(autouse=True)
def here(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PYTHONPATH", str(ROOT / "src"))


def test_a_decision_step_by_step(tmp_path: Path) -> None:
    text, pictures = outputs(ROOT / "docs" / "notebooks" / "decide.ipynb", tmp_path)
    assert pictures == 5
    assert "accepted: decelerate,follow-lane" in text
    assert "False Violation(condition='acceleration'" in text


def test_a_ranker_of_ones_own(tmp_path: Path) -> None:
    text, pictures = outputs(ROOT / "docs" / "notebooks" / "evaluate.ipynb", tmp_path)
    assert pictures == 1
    assert "| cautious:Cautious" in text
    assert "collision: False" in text
    assert (tmp_path / "open" / "ablation-ranker.pdf").is_file()
