"""What the native kernel finds forbidden, cell by cell that which Python finds."""

import pickle

import numpy as np
import pytest

from random_scenes import draw
from sandra.prediction import predict
from sandra.reach import Ground, ground, twin
from sandra.reach.occupied import NativeMasks, NativeWindows, _windows
from sandra.settings import Settings

pytestmark = pytest.mark.skipif(twin.native is None, reason="the native kernel was not built")


def both(seed: int, kind: str, monkeypatch: pytest.MonkeyPatch) -> tuple[Ground, Ground]:
    settings = Settings(horizon=4 + seed % 12)
    scene = draw(seed).scene
    predicted = predict(scene, kind, settings.horizon, settings)
    grounds = []
    for name in ("native", "python"):
        monkeypatch.setenv(twin.VARIABLE, name)
        grounds.append(ground(scene, predicted, settings))
    return grounds[0], grounds[1]


def test_each_kernel_is_given_what_is_its_own(monkeypatch: pytest.MonkeyPatch) -> None:
    """What the native one has found serves the other one as well, and not the other way round."""
    found, expected = both(3, "most-likely", monkeypatch)
    assert isinstance(found.by_obstacle, NativeWindows)
    assert isinstance(found.forbidden, NativeMasks)
    assert not isinstance(expected.by_obstacle, NativeWindows)
    assert not isinstance(expected.forbidden, NativeMasks)
    assert not isinstance(found.forbidden_without(None), NativeMasks)
    monkeypatch.setenv(twin.VARIABLE, "native")
    assert isinstance(found.forbidden_without(None), NativeMasks)
    assert not isinstance(expected.forbidden_without(None), NativeMasks)


def test_neighbouring_columns_are_one_window() -> None:
    first, second = _windows([(2, 0, 2), (3, 1, 3), (5, 4, 5)])
    assert first[:4] == (2, 4, 0, 3)
    assert first[4].tolist() == [[True, True, False], [False, True, True]]
    assert second[:4] == (5, 6, 4, 5)
    assert second[4].tolist() == [[True]]
    assert _windows([]) == []


@pytest.mark.parametrize("kind", ["most-likely", "set-based"])
def test_the_same_cells_for_the_same_causes(kind: str, monkeypatch: pytest.MonkeyPatch) -> None:
    count = 0
    for seed in range(40):
        found, expected = both(seed, kind, monkeypatch)
        assert isinstance(found.forbidden, NativeMasks)
        assert isinstance(found.by_obstacle, NativeWindows)
        assert len(found.forbidden) == len(expected.forbidden) == found.horizon + 1
        for ours, right in zip(found.forbidden, expected.forbidden, strict=True):
            assert ours.dtype == np.bool_
            assert (ours == right).all()
        for steps, right_steps in zip(found.by_obstacle, expected.by_obstacle, strict=True):
            for at_step, right_at in zip(steps, right_steps, strict=True):
                for window, right_window in zip(at_step, right_at, strict=True):
                    assert window[:4] == right_window[:4]
                    assert (window[4] == right_window[4]).all()
                    count += 1
    assert count > 300


def test_leaving_a_cause_out(monkeypatch: pytest.MonkeyPatch) -> None:
    checked = 0
    for seed in range(20):
        found, expected = both(seed, "most-likely", monkeypatch)
        for index in (None, *range(len(expected.by_obstacle))):
            for road in (True, False):
                monkeypatch.setenv(twin.VARIABLE, "native")
                ours = found.forbidden_without(index, road)
                monkeypatch.setenv(twin.VARIABLE, "python")
                right = expected.forbidden_without(index, road)
                assert all((a == b).all() for a, b in zip(ours, right, strict=True))
                # a ground that was made natively serves the Python kernel as well
                again = found.forbidden_without(index, road)
                assert all((a == b).all() for a, b in zip(again, right, strict=True))
                checked += 1
    assert checked > 60


def test_masks_are_read_only_and_go_to_other_processes(monkeypatch: pytest.MonkeyPatch) -> None:
    found, _ = both(3, "most-likely", monkeypatch)
    with pytest.raises(ValueError, match="read-only"):
        found.forbidden[0][0, 0] = True
    masks = pickle.loads(pickle.dumps(found.forbidden))
    assert all((a == b).all() for a, b in zip(masks, found.forbidden, strict=True))
    windows = pickle.loads(pickle.dumps(found.by_obstacle))
    assert len(windows) == len(found.by_obstacle)
    assert found.forbidden[:2][1] is found.forbidden[1]


def test_what_does_not_fit_is_refused() -> None:
    native = twin.native
    lines = np.array([[0.0, 0.0, 0.0, 1.0, 0.5, 1.0], [1.0, 0.0, 0.0, 1.0, 0.5, 1.0]])
    corners, one = np.zeros((1, 2)), np.array([1], dtype=np.int64)
    runs = native.runs(lines, 4, corners, one, np.ones(1))
    assert runs.of(0) == [(0, 0, 2)] or runs.of(0)[0][0] == 0
    wrong = [
        (lines[:, :5].copy(), 4, corners, one, np.ones(1)),
        (lines, 0, corners, one, np.ones(1)),
        (lines, 4, np.zeros((1, 3)), one, np.ones(1)),
        (lines, 4, corners, one, np.ones(2)),
        (lines, 4, corners, np.array([0], dtype=np.int64), np.ones(1)),
        (lines, 4, corners, np.array([2], dtype=np.int64), np.ones(1)),
    ]
    for arguments in wrong:
        with pytest.raises(ValueError, match=r"numbers|corners|radius"):
            native.runs(*arguments)
    road = np.zeros((1, 1, 1), dtype=np.uint8)
    with pytest.raises(ValueError, match="do not fit"):
        native.united((0.0, 0.0, 1.0, 1.0, 1, 1), road, runs, [[0]])
    with pytest.raises(ValueError, match="one mask"):
        native.united((0.0, 0.0, 1.0, 1.0, 1, 1), np.zeros((2, 1, 1), np.uint8), runs, [[]])
    with pytest.raises(IndexError):
        native.united((0.0, 0.0, 1.0, 1.0, 1, 4), np.zeros((1, 4, 1), np.uint8), runs, [[7]])
