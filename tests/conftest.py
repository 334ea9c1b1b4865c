"""What several tests share."""

import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from filelock import FileLock
from hypothesis import settings

import tiny_model

ROOT = Path(__file__).resolve().parents[1]
SHARED = ROOT.parent / "shared"

# In continuous integration every run draws the same examples; elsewhere they differ.
settings.register_profile("repeatable", derandomize=True, deadline=None)
if os.environ.get("CI"):
    settings.load_profile("repeatable")


@pytest.fixture(scope="session")
def shared() -> Path:
    """The folder of reference data beside the project; the test skips where it is absent."""
    if not SHARED.is_dir():
        pytest.skip("reference data folder '../shared' is absent")
    return SHARED


@pytest.fixture
def no_openai_key(monkeypatch: pytest.MonkeyPatch) -> None:
    """Whatever key and server the user of this machine has set, the test has none."""
    for name in ("OPENAI_API_KEY", "OPENAI_BASE_URL"):
        monkeypatch.delenv(name, raising=False)


@pytest.fixture(scope="session")
def tiny(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a tiny language model, made once for all processes of a test run.

    `model/` (Hugging Face), `adapter/` (LoRA), `model.gguf`; see `tiny_model`.
    """
    base = tmp_path_factory.getbasetemp()
    if "PYTEST_XDIST_WORKER" in os.environ:
        base = base.parent
    folder, made = base / "tiny-model", base / "tiny-model.made"
    with FileLock(base / "tiny-model.lock"):
        if not made.exists():
            tiny_model.make(folder)
            made.touch()
    return folder


@pytest.fixture(scope="session")
def llama_server(tiny: Path) -> Iterator[str]:
    """The address of a real llama.cpp server on loopback that serves the tiny model."""
    with tiny_model.served(tiny / "model.gguf") as url:
        yield url


@pytest.fixture(scope="session")
def vcr_config() -> dict[str, Any]:
    """Of recorded answers: the body of a request must match, and no key is in them."""
    return {
        "match_on": ["method", "scheme", "host", "port", "path", "query", "body"],
        "filter_headers": ["authorization"],
        "record_mode": "none",
    }
