"""What several tests share."""

import os
from pathlib import Path

import pytest
from hypothesis import settings

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
