"""Fail-safe trajectories of the planner where the prediction relies on legal cut-ins."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from prediction.traffic import car
from rollout_scenes import LEFT, two_lanes
from sandra.planning.fail_safe_checks import beyond_legal_cut_in
from sandra.planning.fail_safe_search import FailSafe, fail_safe, fail_safe_horizon
from sandra.prediction import predict
from sandra.settings import Assumptions, Settings


def found(speed: float, settings: Settings) -> FailSafe:
    now = two_lanes(car(8, -100.0 + 6.0, LEFT, speed=speed), speed=speed)
    sets = predict(now, "set-based", fail_safe_horizon(now, settings, 0.1, 2.0), settings)
    ego = now.ego.state
    state = np.array([ego.x, ego.y, ego.heading, ego.speed, 0.0])
    answer = fail_safe(now, state, 0.1, sets, settings)
    assert isinstance(answer, FailSafe)
    return answer


@pytest.mark.parametrize("speed", [8.0, 16.0, 24.0])
def test_it_stops_within_what_the_law_keeps_free(speed: float) -> None:
    t = found(speed, Settings()).trajectory
    v = t.states[:, 3]
    rest = (v[1:] + v[:-1])[::-1].cumsum()[::-1] / 2 * t.tau
    assert (rest <= v[:-1] ** 2 / 12 + 0.4 * v[:-1] + 1e-6).all()


def test_without_relying_on_it_the_mildest_is_kept() -> None:
    off = Settings(assumptions=Assumptions(legal_cut_in=False, max_acceleration=1.0))
    assert found(20.0, off).deceleration < found(20.0, Settings()).deceleration - 1.0


def test_before_the_decision_the_larger_way_and_the_smaller_speed_count() -> None:
    ego = SimpleNamespace(state=SimpleNamespace(speed=12.0))
    task: Any = SimpleNamespace(
        settings=Settings(), scene=SimpleNamespace(ego=ego), tau=0.05, t_dec=0.2
    )
    v = np.maximum(10.0 - 5.0 * 0.05 * np.arange(41), 0.0)
    states = np.zeros((1, 41, 5))
    states[0, :, 3] = v
    # 12 m/s for 0.2 s and 10 m of braking, against 10^2 / 12 + 4 m.
    assert beyond_legal_cut_in(task, states)[0] == pytest.approx(2.4 + 10.0 - 100 / 12 - 4.0)
