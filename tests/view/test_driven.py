"""What is driven, over time and on the map: which rows of a maneuver, and when."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sandra.actions import ActionPair
from sandra.planning import Maneuver
from sandra.view.driven import APART, MOST, instants
from sandra.view.profile import Curve, curves_of, times_of

PAIR = ActionPair.parse("keep,follow-lane")


def rows(speeds: list[float], accelerations: list[float]) -> np.ndarray:
    """States of a maneuver along x."""
    states = np.zeros((len(speeds), 5))
    states[:, 3], states[:, 4] = speeds, accelerations
    return states


def braking(speed: float, by: float, dt: float) -> np.ndarray:
    """Down to a standstill that may lie between two steps."""
    times = np.append(np.arange(0.0, speed / by, dt), speed / by)
    return rows((speed - by * times).tolist(), [-by] * len(times))


@pytest.mark.parametrize(("speed", "by"), [(8.0, 4.0), (7.7, 5.0), (1.0, 3.0), (0.1, 6.0)])
def test_the_last_row_may_lie_between_two_steps(speed: float, by: float) -> None:
    times = times_of(braking(speed, by, 0.1), 0.1)
    assert times[-1] == pytest.approx(speed / by)
    assert times[:-1] == pytest.approx(0.1 * np.arange(len(times) - 1))


def test_a_constant_speed_ends_at_a_step() -> None:
    assert times_of(rows([5.0] * 4, [0.0] * 4), 0.2) == pytest.approx([0.0, 0.2, 0.4, 0.6])
    assert times_of(rows([0.0], [0.0]), 0.2) == pytest.approx([0.0])


def test_curves_of_a_certified_maneuver() -> None:
    planned, fail_safe = rows([5.0] * 11, [0.0] * 11), braking(5.0, 4.0, 0.1)
    maneuver = Maneuver("certified", PAIR, planned, 0.1, "", fail_safe, 0.3)
    first, second = curves_of(maneuver)
    assert [kind for kind, _ in first.parts] == ["planned", "planned on"]
    (_, until), (_, beyond) = first.parts
    assert first.times[until] == pytest.approx([0.0, 0.1, 0.2, 0.3])
    # Both parts share the point at which the next decision is due.
    assert first.times[beyond][0] == pytest.approx(0.3)
    assert first.times[beyond][-1] == pytest.approx(1.0)
    assert [kind for kind, _ in second.parts] == ["fail-safe"]
    assert second.times[0] == pytest.approx(0.3)
    assert second.times[-1] == pytest.approx(0.3 + 1.25)


def test_curves_of_other_maneuvers() -> None:
    planned = rows([5.0] * 11, [0.0] * 11)
    (only,) = curves_of(Maneuver("reachable", PAIR, planned, 0.1, ""))
    assert [kind for kind, _ in only.parts] == ["planned"]
    (only,) = curves_of(Maneuver("fail-safe", None, braking(5.0, 4.0, 0.1), 0.1, ""))
    assert [kind for kind, _ in only.parts] == ["fail-safe"]
    # A decision that is due at the very end leaves nothing beyond it.
    last = Maneuver("certified", PAIR, planned, 0.1, "", braking(5.0, 4.0, 0.1), 1.0)
    assert [kind for kind, _ in curves_of(last)[0].parts] == ["planned"]


def test_a_curve_of_one_row() -> None:
    curve = Curve("fail-safe", np.array([0.1]), rows([0.0], [0.0]))
    assert curve.parts == [("fail-safe", slice(0, 1))]
    assert instants(np.zeros((1, 2)), 4.5) == []


@given(st.lists(st.floats(0.0, 3.0), min_size=1, max_size=60), st.floats(1.0, 8.0))
def test_bodies_at_instants_do_not_lie_on_one_another(gone: list[float], length: float) -> None:
    path = np.column_stack([np.cumsum([0.0, *gone]), np.zeros(len(gone) + 1)])
    kept = instants(path, length)
    assert kept == sorted(set(kept))
    assert len(kept) <= MOST + 1
    # All but the last keep their distance; the last is at the end, wherever that is.
    places = path[[0, *kept[:-1]], 0]
    assert (np.diff(places) >= APART * length - 1e-9).all()
    if path[-1, 0] > 0.3 * length:
        assert kept[-1] == len(path) - 1
