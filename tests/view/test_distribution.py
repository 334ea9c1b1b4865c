"""Shares of actions."""

import pytest

from sandra.errors import SandraError
from sandra.view.distribution import distribution_figure, shares


def test_fail_safe_steps_are_left_aside(tmp_path):
    pairs = {"keep,follow-lane": 2, "keep,left-lane": 1, "stop,left-lane": 1, "fail-safe": 6}
    found = shares(pairs)
    assert found["keep"] == 0.75
    assert found["stop"] == 0.25
    assert found["left-lane"] == found["follow-lane"] == 0.5
    assert found["accelerate"] == found["right-lane"] == 0.0
    file = distribution_figure({"one": pairs, "nothing": {"fail-safe": 3}}, tmp_path / "d.svg")
    text = file.read_text()
    assert text.startswith("<?xml")
    with pytest.raises(SandraError, match="nothing to draw"):
        distribution_figure({"nothing": {"IDLE": 3}}, tmp_path / "d.svg")
