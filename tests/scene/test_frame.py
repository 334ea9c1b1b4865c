import pickle
import time

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sandra.errors import ScenarioError
from sandra.scene.frame import Frame, smoothed


def arc(radius: float, angle: float, n: int) -> np.ndarray:
    a = np.linspace(0.0, angle, n)
    return radius * np.stack([np.sin(a), 1 - np.cos(a)], axis=1)


@st.composite
def lines(draw: st.DrawFn) -> np.ndarray:
    """Lines of 2 to 40 points, segments of 0.5 to 20 m, bends of up to 0.4 rad each."""
    n = draw(st.integers(1, 39))
    steps = draw(st.lists(st.floats(0.5, 20.0), min_size=n, max_size=n))
    turns = draw(st.lists(st.floats(-0.4, 0.4), min_size=n, max_size=n))
    # Bends do not add up to more than half a turn, so that the line cannot meet itself.
    course = np.clip(np.cumsum(turns), -1.4, 1.4)
    delta = np.array(steps)[:, None] * np.stack([np.cos(course), np.sin(course)], axis=1)
    origin = draw(st.sampled_from([0.0, -5e5, 5e6]))
    return np.concatenate([[[origin, -origin]], origin * np.array([1, -1]) + np.cumsum(delta, 0)])


@settings(max_examples=60, deadline=None)
@given(lines(), st.integers(0, 2**32 - 1))
def test_the_map_and_its_inverse_are_exact_within_the_radius_of_curvature(
    line: np.ndarray, seed: int
) -> None:
    frame = Frame(line)
    rng = np.random.default_rng(seed)
    reach = min(0.95 * frame.clearance, 50.0)
    s = rng.uniform(0.0, frame.length, 200)
    points = np.stack([s, rng.uniform(-1, 1, 200) * reach], axis=1)
    # Where the line winds, a point can be nearer to another part of it: those have two feet.
    there = frame.to_cartesian(points)
    back = frame.to_curvilinear(there)
    again = frame.to_cartesian(back)
    assert np.abs(again - there).max() < 1e-6
    nearer = np.abs(back[:, 1]) < np.abs(points[:, 1]) - 1e-9
    beyond = (back[:, 0] < 0) | (back[:, 0] > frame.length)
    assert (np.abs(back - points).max(axis=1) < 1e-6)[~nearer & ~beyond].all()
    assert np.abs(back[:, 1]).max() <= reach + 1e-6


@pytest.mark.parametrize("radius", [-300.0, -60.0, 60.0, 300.0])
def test_round_trip_on_a_bend_and_beyond_both_ends(radius: float) -> None:
    line = arc(abs(radius), 1.5, 80)
    line[:, 1] *= np.sign(radius)
    frame = Frame(line)
    rng = np.random.default_rng(1)
    s = rng.uniform(-30.0, frame.length + 30.0, 2000)
    points = np.stack([s, rng.uniform(-20.0, 20.0, 2000)], axis=1)
    back = frame.to_curvilinear(frame.to_cartesian(points))
    assert np.abs(back - points).max() < 1e-9
    assert frame.clearance == pytest.approx(abs(radius), rel=1e-3)


def test_d_is_the_distance_across_the_line_and_left_is_positive() -> None:
    frame = Frame(np.array([[0.0, 0.0], [10.0, 0.0], [20.0, 5.0]]))
    assert frame.to_curvilinear(np.array([[5.0, 2.0]]))[0, 1] == pytest.approx(2.0)
    assert frame.to_curvilinear(np.array([[5.0, -2.0]]))[0, 1] == pytest.approx(-2.0)
    # A line of constant d is a parallel: its vertices lie on the mitres.
    offset = frame.to_cartesian(np.stack([np.linspace(0, frame.length, 50), np.full(50, 1.5)], 1))
    normal = np.array([-5.0, 10.0]) / np.hypot(5.0, 10.0)
    across = np.where(offset[:, 0] < 9.6, offset[:, 1], (offset - [10.0, 0.0]) @ normal)
    assert across == pytest.approx(np.full(50, 1.5))


def test_straight_on_beyond_the_ends() -> None:
    frame = Frame(arc(50.0, 1.0, 30))
    s = np.array([-10.0, frame.length + 10.0])
    ends = frame.to_cartesian(np.stack([s, np.zeros(2)], axis=1))
    assert ends[0] == pytest.approx(frame.line[0] - 10 * unit(frame.line[1] - frame.line[0]))
    assert ends[1] == pytest.approx(frame.line[-1] + 10 * unit(frame.line[-1] - frame.line[-2]))
    assert frame.curvature(s) == pytest.approx(0.0)


def unit(v: np.ndarray) -> np.ndarray:
    return v / np.linalg.norm(v)


def test_heading_and_curvature_of_a_circle() -> None:
    frame = Frame(arc(40.0, 6.0, 400))
    s = np.linspace(1.0, frame.length - 1.0, 100)
    assert frame.heading(s) == pytest.approx(s / 40.0, abs=1e-3)
    assert frame.curvature(s) == pytest.approx(1 / 40.0, rel=1e-3)
    mirrored = Frame(arc(40.0, 6.0, 400) * [1, -1])
    assert mirrored.curvature(s) == pytest.approx(-1 / 40.0, rel=1e-3)


def test_the_nearest_foot_point_is_taken_on_a_hairpin() -> None:
    out = np.stack([np.linspace(0, 100, 101), np.zeros(101)], axis=1)
    bend = np.array([100, 0]) + arc(10.0, np.pi, 30)[1:]
    back = np.stack([np.linspace(99, 0, 100), np.full(100, 20.0)], axis=1)
    frame = Frame(np.concatenate([out, bend, back]))
    found = frame.to_curvilinear(np.array([[30.0, 9.0], [30.0, 11.0]]))
    assert found[0] == pytest.approx([30.0, 9.0])
    assert found[1, 1] == pytest.approx(9.0)
    assert found[1, 0] > 130.0
    # A foot on the line is preferred to one on the extension of its end.
    start = Frame(np.concatenate([out[50:], bend, back]))
    assert start.to_curvilinear(np.array([[10.0, 19.0]]))[0] == pytest.approx(
        [start.length - 10.0, 1.0], abs=1e-6
    )


def test_a_point_without_a_normal_gets_the_nearest_point_and_nan_stays_nan() -> None:
    frame = Frame(arc(5.0, 3.0, 40))
    found = frame.to_curvilinear(np.array([[0.0, 5.05], [np.nan, 0.0]]))
    assert abs(found[0, 1]) == pytest.approx(5.0, abs=0.2)
    assert np.isnan(found[1]).all()
    assert frame.to_curvilinear(np.empty((0, 2))).shape == (0, 2)


def test_repeated_points_are_dropped_and_bad_lines_refused() -> None:
    frame = Frame(np.array([[0, 0], [0, 0], [1, 0], [1.001, 0.001], [2, 0], [2, 0.002]]))
    assert frame.line.shape == (3, 2)
    for line, what in [
        ([[0, 0]], "fewer than two"),
        ([[1, 1], [1, 1], [1, 1.001]], "fewer than two"),
        ([[0, 0], [np.nan, 1]], "NaN"),
        ([[0, 0], [np.inf, 1]], "NaN or infinite"),
        ([[0, 0], [10, 0], [5, 0.1]], "runs back"),
        (np.zeros((3, 3)), "points"),
        (np.zeros((0, 2)), "fewer than two"),
    ]:
        with pytest.raises(ScenarioError, match=what):
            Frame(np.array(line, dtype=float))


def test_a_frame_is_immutable_and_leaves_its_input_alone() -> None:
    line = arc(50.0, 1.0, 10)
    frame = Frame(line)
    line[0] = 99.0
    assert frame.line[0] == pytest.approx([0.0, 0.0])
    with pytest.raises(ValueError, match="read-only"):
        frame.line[0] = 1.0
    with pytest.raises(AttributeError):
        frame.line = line  # type: ignore[misc]
    assert pickle.loads(pickle.dumps(frame)).length == frame.length


def test_smoothing_removes_kinks_and_stays_close() -> None:
    rng = np.random.default_rng(3)
    line = np.stack([np.arange(0.0, 100.0, 0.5), rng.normal(0, 0.03, 200)], axis=1)
    raw, mended = Frame(line), Frame(smoothed(line))
    assert raw.clearance < 5.0
    assert mended.clearance > 40.0
    assert np.abs(mended.to_curvilinear(line)[:, 1]).max() < 0.15
    assert mended.line[[0, -1]] == pytest.approx(line[[0, -1]])
    assert smoothed(np.array([[0.0, 0.0], [0.3, 0.0]])).shape == (2, 2)


def test_100_000_points_in_half_a_second() -> None:
    frame = Frame(arc(100.0, 2.5, 300))
    rng = np.random.default_rng(0)
    points = rng.uniform([0.0, -10.0], [frame.length, 10.0], (100_000, 2))
    there = frame.to_cartesian(points)
    durations = []
    for _ in range(3):
        start = time.process_time()
        frame.to_curvilinear(there)
        durations.append(time.process_time() - start)
    assert min(durations) < 0.5


@pytest.mark.slow  # The import of the reference alone takes several seconds.
def test_agrees_with_commonroad_clcs() -> None:
    """The reference projects along interpolated normals too, but on a resampled line."""
    clcs = pytest.importorskip("commonroad_clcs.clcs")
    config = pytest.importorskip("commonroad_clcs.config")
    line = arc(80.0, 1.2, 97)
    reference = clcs.CurvilinearCoordinateSystem(line, config.CLCSParams())
    frame = Frame(line)
    rng = np.random.default_rng(5)
    points = rng.uniform([2.0, -6.0], [frame.length - 2.0, 6.0], (300, 2))
    there = frame.to_cartesian(points)
    # The reference extends the line at its start, so its s has an offset.
    offset = reference.convert_to_curvilinear_coords(*line[0])[0]
    expected = np.array([reference.convert_to_curvilinear_coords(x, y) for x, y in there])
    expected[:, 0] -= offset
    assert np.abs(frame.to_curvilinear(there) - expected).max() < 0.02
