"""Our set beside the peer's: what it is given, what is checked, and the command.

The tests with the real peer need its environment (`make bench` sets it up).
"""

from __future__ import annotations

import json
import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import sandra
from reach_particles import World, fly
from sandra.cli import main
from sandra.evaluation.reach_bench import Peer, PeerError, PeerRefused, bench_reach, checks
from sandra.evaluation.reach_bench.frames import framed
from sandra.evaluation.reach_bench.hand_over import (
    beyond_the_road,
    forbidden_boxes,
    polygon,
    problem_of,
    reference_line,
)
from sandra.evaluation.reach_bench.measure import SETTINGS, _handed_over
from sandra.evaluation.reach_bench.ours import free_set, prepare
from sandra.evaluation.reach_bench.rows import (
    Checks,
    Closeness,
    Ours,
    Peers,
    Report,
    Row,
    Tight,
)
from sandra.logic import Specification
from sandra.reach import Ground
from sandra.scene import Frame, Region

PYTHON = Path(__file__).resolve().parents[2] / ".venv-peer" / "bin" / "python"
PAIR = sandra.ActionPair.parse("keep,follow-lane")
needs_peer = pytest.mark.skipif(not PYTHON.exists(), reason="no .venv-peer (make bench)")


def base_of(name: str, horizon: int = 12, **changes: float) -> Ground:
    settings = SETTINGS.replace(horizon=horizon, **changes)
    return prepare(sandra.load(sandra.example(name), settings=settings), settings)


@pytest.fixture(scope="module")
def peer() -> Iterator[Peer]:
    with Peer(PYTHON) as running:
        yield running


PREPARE = {"do": "prepare", "grid": 0.2, "split": 0.7, "beyond": []}


# What the peer is given


@pytest.mark.parametrize("name", ["merge", "intersection", "rural-oncoming"])
def test_the_reference_line_has_our_coordinates_over_the_whole_lattice(name: str) -> None:
    base = base_of(name, 30)
    line, start = reference_line(base)
    s, d = base.lattice.corners()
    limit = 0.9 * Frame(line).clearance
    mesh = np.meshgrid(s[::7], d[np.abs(d) < limit], indexing="ij")
    ours = np.stack(mesh, axis=-1).reshape(-1, 2)
    theirs = Frame(line).to_curvilinear(base.scene.frame.to_cartesian(ours))
    assert np.abs(theirs + np.array([start, 0.0]) - ours).max() < 1e-6


def test_forbidden_boxes_are_our_forbidden_cells() -> None:
    base = base_of("roadworks")
    start = reference_line(base)[1]
    for mask, boxes in zip(base.forbidden, forbidden_boxes(base), strict=True):
        covered = np.zeros_like(mask)
        for a, b, c, d in boxes:
            i0, i1, j0, j1 = (
                round((value - origin) / size)
                for value, origin, size in (
                    (a + start, base.lattice.s0, base.lattice.ds),
                    (b + start, base.lattice.s0, base.lattice.ds),
                    (c, base.lattice.d0, base.lattice.dd),
                    (d, base.lattice.d0, base.lattice.dd),
                )
            )
            assert not covered[i0:i1, j0:j1].any()
            covered[i0:i1, j0:j1] = True
        assert (covered == mask).all()


def test_every_predicted_obstacle_is_handed_over_step_by_step() -> None:
    base = base_of("highway-dense")
    obstacles = problem_of(base)["obstacles"]
    assert len(obstacles) == len(base.prediction.obstacles) > 3
    for row, predicted in zip(obstacles, base.prediction.obstacles, strict=True):
        assert len(row["at"]) == base.horizon + 1
        for polygons, regions in zip(row["at"], predicted.at, strict=True):
            assert [len(p) for p in polygons] == [len(polygon(r)) for r in regions]
    assert not obstacles[0]["static"]


def test_a_disc_becomes_a_polygon_between_its_inside_and_its_outside() -> None:
    corners = polygon(Region(np.array([[1.0, 2.0]]), 0.5))
    away = np.hypot(*(corners - [1.0, 2.0]).T)
    assert len(corners) == 32
    assert 0.5 < away.min() <= away.max() < 0.503
    middles = (corners + np.roll(corners, 1, axis=0)) / 2
    assert (np.hypot(*(middles - [1.0, 2.0]).T) < 0.5).all()


def bent(name: str, ahead: float, radius: float) -> sandra.Scene:
    """A scene whose reference line turns right some way ahead of the ego."""
    scene = sandra.load(sandra.example(name), settings=SETTINGS)
    s = scene.ego_curvilinear[0]
    straight = np.array([[x, 0.0] for x in np.arange(s - 20.0, s + ahead + 1.0, 1.0)])
    line = scene.frame.to_cartesian(straight)
    course = np.arctan2(*(line[-1] - line[-2])[::-1])
    angles = np.arange(1, 10) * np.pi / 20
    arc = radius * np.column_stack([np.sin(angles), np.cos(angles) - 1.0])
    turned = arc @ np.array([[np.cos(course), np.sin(course)], [-np.sin(course), np.cos(course)]])
    frame = Frame(np.vstack([line, line[-1] + turned]))
    lanes = tuple(replace(x, frame=frame) if x is scene.current else x for x in scene.lanes)
    return replace(scene, lanes=lanes)


def test_a_sharp_bend_ahead_is_left_away() -> None:
    scene = bent("merge", 15.0, 6.0)
    own, smooth, straight = framed(scene)
    assert own == (scene, "")
    assert smooth[0].frame.clearance > scene.frame.clearance
    assert straight[1] == "straight on where its line bends sharply"
    line = straight[0].frame.line
    assert (line == scene.frame.line[: len(line)]).all()
    assert 30.0 < straight[0].frame.length < 36.0
    assert len(list(framed(sandra.load(sandra.example("merge"))))) == 2


# What is checked


def test_speeds_beyond_the_bounds_are_noticed() -> None:
    base = base_of("merge", 3)
    v = base.scene.ego.state.speed

    def steps(gain: float) -> list[dict[str, list[float] | None]]:
        lon = [[v - 0.01 - gain * k * 0.1, v + 0.01 + gain * k * 0.1] for k in range(3)]
        return [{"v_lon": each, "v_lat": [0.0, 0.0]} for each in lon] + [
            {"v_lon": None, "v_lat": None}
        ]

    checks.check_bounds(base, steps(6.0))
    with pytest.raises(checks.NotTheSame, match=r"v_lon leaves its bounds by 0\.6"):
        checks.check_bounds(base, steps(12.5))


def test_missing_obstacles_are_noticed() -> None:
    assert checks.check_obstacles([[True] * 99 + [False], []]) == pytest.approx(0.99)
    with pytest.raises(checks.NotTheSame, match=r"only 98\.0%"):
        checks.check_obstacles([[True] * 98, [False] * 2])


def test_areas_are_compared_both_ways_and_only_where_they_are_large() -> None:
    areas = checks.check_areas((9.0, 2.2, 3.0), (0.5, 2.0, 3.0), 1.2)
    assert (areas.largest, areas.smallest) == (pytest.approx(1.1), 1.0)
    for ours in (2.5, 1.5):
        with pytest.raises(checks.NotTheSame, match="differ by a factor of"):
            checks.check_areas((ours,), (2.0,), 1.2)
    assert checks.Areas.of((0.1,), (0.2,)) == checks.Areas(1.0, 1.0)


def test_a_peer_that_gave_up_is_noticed() -> None:
    checks.check_alive((0.5, 3.0, 0.0), (0.5, 9.0, 0.4))
    with pytest.raises(checks.NotTheSame, match="empty at step 1; on our cells it has 9"):
        checks.check_alive((0.5, 0.0, 0.0), (0.5, 9.0, 20.0))


def test_points_are_compared_in_our_frame() -> None:
    base = base_of("merge", 3)
    start = reference_line(base)[1]
    corners = np.array([[30.0, 1.0], [31.0, -1.0]])
    points = (corners - np.array([start, 0.0])).tolist()
    assert checks.check_frame(base, corners, points) < 1e-9
    with pytest.raises(checks.NotTheSame, match=r"differ by 0\.10 m"):
        checks.check_frame(base, corners + np.array([0.0, 0.1]), points)
    with pytest.raises(checks.NotTheSame, match="lacks 1 of 2"):
        checks.check_frame(base, corners, [points[0], None])


# With the real peer


@needs_peer
def test_a_free_set_has_the_same_area_in_both(peer: Peer) -> None:
    base = base_of("merge", 6)
    peer.ask(problem_of(base))
    peer.ask(PREPARE)
    assert peer.ask({"do": "compute"})["compute_s"] > 0.0
    steps = peer.ask({"do": "sets"})["steps"]
    found = free_set(base)
    checks.check_bounds(base, steps)
    for k, step in enumerate(steps):
        assert step["area"] == pytest.approx(found.area(k), rel=1e-3)


@needs_peer
def test_where_the_lane_bends_too_sharply_both_get_another_frame(peer: Peer) -> None:
    scene, settings = bent("merge", 15.0, 1.5), SETTINGS.replace(horizon=16)
    base, found, note, _ = _handed_over(scene, settings, peer)
    assert note
    assert base.scene.frame.clearance > scene.frame.clearance
    assert found.lattice == base.lattice


@needs_peer
def test_the_peers_faulty_cut_is_noticed(peer: Peer) -> None:
    base = base_of("merge", 6, a_lon_min=-6.0, a_lon_max=6.0)
    peer.ask(problem_of(base))
    peer.ask(PREPARE)
    peer.ask({"do": "compute"})
    with pytest.raises(checks.NotTheSame, match="v_lon leaves its bounds"):
        checks.check_bounds(base, peer.ask({"do": "sets"})["steps"])


@needs_peer
def test_an_obstacle_or_a_border_that_the_peer_lacks_is_noticed(peer: Peer) -> None:
    base = base_of("merge", 20)
    asked = checks.forbidden_points(base, free_set(base))
    problem = problem_of(base)
    peer.ask(problem)
    peer.ask(PREPARE)
    assert checks.check_obstacles(peer.ask(asked)["collides"]) == 1.0
    wider = [_moved(lanelet, 5.0) for lanelet in problem["lanelets"]]
    for change in ({"obstacles": []}, {"lanelets": wider}):
        peer.ask(problem | change)
        peer.ask(PREPARE)
        with pytest.raises(checks.NotTheSame, match="only"):
            checks.check_obstacles(peer.ask(asked)["collides"])


def _moved(lanelet: dict[str, Any], away: float) -> dict[str, Any]:
    """Both borders moved along y [m]."""
    borders = {side: np.array(lanelet[side]) + np.array([0.0, away]) for side in ("left", "right")}
    return lanelet | {side: line.tolist() for side, line in borders.items()}


@needs_peer
def test_what_lies_beyond_the_road_is_closed(peer: Peer) -> None:
    base = base_of("recorded-ego", 12, a_lat_max=8.0)
    peer.ask(problem_of(base))
    areas = []
    for beyond in ([], beyond_the_road(base)):
        peer.ask(PREPARE | {"beyond": beyond})
        peer.ask({"do": "compute"})
        areas.append(peer.ask({"do": "sets"})["steps"][-1]["area"])
    assert areas[0] > 1.2 * areas[1]  # in 0.2 s it jumps over the border
    assert areas[1] < free_set(base).area(12)


@needs_peer
def test_trajectories_leave_the_peers_set_where_it_drops_narrow_gaps(peer: Peer) -> None:
    """Why areas are compared on the same forbidden cells, at matched resolution."""
    base = base_of("intersection", 15)
    found, start = free_set(base), reference_line(base)[1]
    outcome = fly(World(base), Specification(PAIR, ()), found, 20_000, 1)
    assert outcome.missing == 0
    s, d = outcome.survivors[-1][:, [0, 2]].T
    peer.ask(problem_of(base))
    peer.ask(PREPARE)
    peer.ask({"do": "compute"})
    inside = np.zeros(len(s), dtype=bool)
    for s_low, d_low, s_high, d_high in peer.ask({"do": "sets"})["steps"][-1]["boxes"]:
        inside |= (s - start >= s_low) & (s - start <= s_high) & (d >= d_low) & (d <= d_high)
    assert inside.any()
    assert (~inside).mean() > 0.02


@needs_peer
def test_a_tight_set_is_as_tight_as_the_peers() -> None:
    """Behind a gap, boxes along the lane mix what got ahead and what got aside."""
    report = bench_reach(
        [sandra.example("intersection")], horizons=[25], python=PYTHON, pair=PAIR, runs=1
    )
    (row,) = report.rows
    assert row.checks is not None
    assert row.checks.quick.largest > 1.08
    assert row.checks.tight.largest <= 1.05
    assert row.checks.tight.finer <= 1.01
    assert row.checks.tight.smallest > 0.9
    assert f"| area {row.checks.tight}" in str(report)


@needs_peer
def test_an_error_of_the_peer_is_told_and_survived(peer: Peer) -> None:
    base = base_of("merge", 3)
    problem = problem_of(base)
    *place, _ = problem["initial"]["state"]
    with pytest.raises(PeerRefused, match="exceeds valid velocity interval"):
        peer.ask(problem | {"initial": problem["initial"] | {"state": [*place, 99.0]}})
    assert peer.alive
    peer.ask(problem)


@needs_peer
def test_rows_are_checked_and_timed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    told: list[str] = []
    report = bench_reach(
        [sandra.example("merge")],
        horizons=[8],
        python=PYTHON,
        pair=PAIR,
        runs=1,
        progress=told.append,
    )
    (row,) = report.rows
    assert row.refused is None
    assert row.ours is not None
    assert row.peer is not None
    assert row.checks is not None
    assert row.checks.obstacles > 0.99
    for found in (row.checks.quick, row.checks.tight):
        assert 0.9 < found.smallest <= found.largest < 1.2
    assert row.peer.areas[8] == pytest.approx(row.ours.areas[8], rel=0.1)
    assert row.ratios["free"] == pytest.approx(row.peer.free / row.ours.free)
    assert report.versions["commonroad-reach"] == "2025.2.1"
    assert any("run 1 of 1" in text for text in told)
    assert list(tmp_path.iterdir()) == []  # the peer writes where it pleases, not here


@needs_peer
def test_a_row_that_fails_a_check_is_refused_not_timed() -> None:
    report = bench_reach(
        [sandra.example("merge")], horizons=[8], python=PYTHON, pair=PAIR, runs=1, tolerance=1.0
    )
    (row,) = report.rows
    assert row.refused is not None
    assert row.peer is None
    assert row.ours is not None
    assert not row.ratios
    assert f"not timed against the peer: {row.refused}" in str(report)


@needs_peer
def test_a_peer_that_does_not_answer_in_time_is_given_up() -> None:
    peer = Peer(PYTHON)
    try:
        peer._patience = 0.01
        with pytest.raises(PeerError, match="gave no answer to 'scene' for"):
            peer.ask(problem_of(base_of("highway-dense", 50)))
        assert not peer.alive
    finally:
        peer.close()


# Without it


def test_without_the_peers_packages_its_last_words_are_told() -> None:
    with pytest.raises(PeerError, match=r"the peer has stopped: .*Error: "):
        Peer(Path(sys.executable))


def test_medians_are_over_the_timed_rows() -> None:
    tight = Tight(0.004, 0.04, (1.0,), 6)
    ours = Ours(0.001, 0.03, 0.01, 0.002, 0.003, 0.02, (1.0,), 4, tight)
    rows = [
        Row("a", 15, 0.1, 3, "p", 2, ours, Peers(0.001, 0.02, 0.04, (1.0,), 5)),
        Row("b", 15, 0.1, 3, "p", 2, ours, Peers(0.001, 0.04, 0.08, (1.0,), 5)),
        Row("c", 25, 0.1, 3, "p", 2, replace(ours, free=0.001), refused="why"),
    ]
    report = Report(tuple(rows), {}, "native")
    expected = {"free": 30.0, "every": 3.0, "prepare": 3.0}
    assert report.medians() == pytest.approx(expected)
    assert report.medians(25) == {}
    text = str(report)
    assert "median of h = 15: free set 30.00, all twelve 3.00, preparation 3.00" in text
    assert "median of h = 25" not in text
    data = json.loads(json.dumps(report.to_dict()))
    assert data["medians"]["15"] == pytest.approx(expected)
    assert data["rows"][2]["refused"] == "why"
    assert data["areas"] == {}


def test_ratios_of_areas_are_told_for_both_precisions() -> None:
    rows = [
        Row("a", 15, 0.1, 3, "p", 2, checks=Checks(1.0, (1.0,), 0.1, 0.0, quick, tight))
        for quick, tight in (
            (Closeness(1.2, 1.0, 1.0, 1.1), Closeness(1.01, 0.9, 1.0, 1.0)),
            (Closeness(1.0, 1.0, 1.02, 1.0), Closeness(1.0500000005, 0.9, 1.0, 1.02)),
        )
    ]
    report = Report(tuple(rows), {}, "native")
    found = report.closeness()
    assert found["quick"]["matched"] == pytest.approx({"median": 1.1, "worst": 1.2, "within": 1})
    assert found["tight"]["matched"] == pytest.approx({"median": 1.03, "worst": 1.05, "within": 2})
    assert "areas, quick: matched 1.100 in the median, 1.200 at most" in str(report)
    assert "within 1.05 in 2 rows, finer 1.000 in the median" in str(report)


def test_command_without_peer(capsys: pytest.CaptureFixture[str]) -> None:
    words = ["bench", "reach", "merge", "--horizons", "3,5", "--runs", "1", "--no-peer"]
    assert main([*words, "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert [row["horizon"] for row in found["rows"]] == [3, 5]
    for row in found["rows"]:
        assert all(row["ours"][name] > 0.0 for name in ("predict", "ground", "free", "every"))
        assert len(row["ours"]["areas"]) == row["horizon"] + 1
        assert row["peer"] is None
    assert main(words) == 0
    assert "peer / ours" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--peer", "nowhere/python"], "make bench"),
        (["--horizons", "15,x"], "numbers of steps"),
        (["--horizons", "0"], "numbers of steps"),
        (["--runs", "0", "--no-peer"], "at least one run"),
        (["--tolerance", "0.9", "--no-peer"], "at least 1"),
        (["no-such-scenario", "--no-peer"], "no-such-scenario"),
    ],
)
def test_bad_words_are_one_line(
    words: list[str], said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["bench", "reach", *words]) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    assert said in error
