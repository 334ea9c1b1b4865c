"""Check, then time: our set and the peer's in alternation, in two processes of one thread each."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from statistics import median
from typing import Any

from sandra.actions import ActionPair
from sandra.evaluation.reach_bench import checks as check
from sandra.evaluation.reach_bench.frames import framed
from sandra.evaluation.reach_bench.hand_over import (
    beyond_the_road,
    forbidden_boxes,
    in_our_frame,
    problem_of,
)
from sandra.evaluation.reach_bench.ours import (
    OurTimes,
    free_set,
    prepare,
    tightened,
    time_ours,
)
from sandra.evaluation.reach_bench.peer import Peer, PeerError
from sandra.evaluation.reach_bench.rows import (
    Checks,
    Closeness,
    Ours,
    Peers,
    Report,
    Row,
    Tight,
)
from sandra.evaluation.reach_bench.seen import seen
from sandra.reach import Ground, ReachableSet, twin
from sandra.scene import load
from sandra.scene.types import Scene
from sandra.settings import Settings

HORIZONS = (15, 25, 50)
SETTINGS = Settings(a_lon_min=-5.9999, a_lon_max=5.9999, s_uncertainty=0.01, v_uncertainty=0.01)
"""The bounds of the paper, but for a hair: at +-6 m/s^2 the peer's half-space cut is wrong. Its
initial sets cannot be points, so both have its default uncertainty."""
GRID, SPLIT = 0.2, 0.7
"""The peer's default resolution: its grid, and the size below which it drops what collides [m]."""
TOLERANCE = 1.25
"""Largest factor between the two areas of any step, at matched resolution."""
FINER = 4
"""Cells of the finer setting are so many times smaller, along and across."""


def bench_reach(
    scenarios: Sequence[Path],
    *,
    horizons: Sequence[int] = HORIZONS,
    python: Path | None,
    pair: ActionPair,
    runs: int = 10,
    tolerance: float = TOLERANCE,
    progress: Callable[[str], None] = lambda text: None,
) -> Report:
    """Measure each scenario at each horizon.

    Args:
        python: the interpreter of the peer's environment; None: time ours alone.
        pair: the one that is timed alone, with its formula.
        runs: counted runs of each; one more before them is not counted.
        tolerance: largest factor between the two areas at matched resolution.
        progress: called with what is being done.

    Raises:
        SandraError: if a scenario cannot be read, or the peer cannot be started.
    """
    rows: list[Row] = []
    peer = Peer(python) if python else None
    versions = peer.versions if peer else {}
    try:
        for path in scenarios:
            for horizon in horizons:
                settings = SETTINGS.replace(horizon=horizon)
                scene = load(path, settings=settings)
                tell = partial(_tell, progress, f"{path.stem}, h = {horizon}")
                rows.append(_row(path.stem, scene, settings, pair, runs, peer, tolerance, tell))
                if peer is not None and not peer.alive:
                    assert python is not None
                    peer.close()
                    peer = Peer(python)
    finally:
        if peer is not None:
            peer.close()
    return Report(tuple(rows), versions, twin.chosen())


def _tell(progress: Callable[[str], None], where: str, text: str) -> None:
    progress(f"{where}: {text}")


def _row(
    name: str,
    scene: Scene,
    settings: Settings,
    pair: ActionPair,
    runs: int,
    peer: Peer | None,
    tolerance: float,
    progress: Callable[[str], None],
) -> Row:
    base = prepare(scene, settings)
    found = free_set(base)
    refused, checks, note, frame = None, None, "", 0.0
    if peer is not None:
        progress("checks")
        try:
            base, found, note, frame = _handed_over(scene, settings, peer)
            checks = _checked(base, found, peer, tolerance)
        except (PeerError, check.NotTheSame) as error:
            refused, peer = str(error), None
    close = free_set(tightened(base))
    times: list[OurTimes] = []
    theirs: list[dict[str, float]] = []
    for run in range(runs + 1):
        progress(f"run {run} of {runs}" if run else "warming up")
        times.append(time_ours(base.scene, pair, settings))
        if peer is not None:
            prepared = peer.ask(_prepare(base))
            theirs.append({**prepared, **peer.ask({"do": "compute"})})
    ours = Ours(
        predict=median(run.predict for run in times[1:]),
        ground=median(run.ground for run in times[1:]),
        forbidden=median(run.forbidden for run in times[1:]),
        free=median(run.free for run in times[1:]),
        pair=median(run.pair for run in times[1:]),
        every=median(run.every for run in times[1:]),
        areas=_areas(found),
        sets=sum(found.sizes),
        tight=Tight(
            median(run.tight_free for run in times[1:]),
            median(run.tight_every for run in times[1:]),
            _areas(close),
            sum(close.sizes),
        ),
    )
    peers = None
    if peer is not None:
        steps = peer.ask({"do": "sets"})["steps"]
        peers = Peers(
            frame,
            median(run["prepare_s"] for run in theirs[1:]),
            median(run["compute_s"] for run in theirs[1:]),
            tuple(step["area"] for step in steps),
            sum(step["sets"] for step in steps),
        )
    return Row(
        name,
        base.horizon,
        scene.dt,
        len(base.prediction.obstacles),
        str(pair),
        runs,
        ours,
        peers,
        checks,
        refused,
        note,
    )


def _prepare(base: Ground) -> dict[str, Any]:
    return {"do": "prepare", "grid": GRID, "split": SPLIT, "beyond": beyond_the_road(base)}


def _handed_over(
    scene: Scene, settings: Settings, peer: Peer
) -> tuple[Ground, ReachableSet, str, float]:
    """Hand the problem over in the first frame in which both agree.

    Returns:
        Our ground and free set in that frame, what was changed about it, and the time that the
        peer's coordinate system takes [s].

    Raises:
        NotTheSame: if there is no such frame, or nothing to compare.
        PeerError: if the peer refuses the problem.
    """
    reason = check.TooNarrow("no frame")
    for framed_scene, note in framed(scene):
        base = prepare(framed_scene, settings)
        found = free_set(base)
        if found.first_empty_step == 0:
            raise check.NotTheSame("our set is empty from the start")
        frame: float = peer.ask(problem_of(base))["frame_s"]
        corners = check.corners_of(found)
        points = base.scene.frame.to_cartesian(corners).tolist()
        try:
            check.check_frame(base, corners, peer.ask({"do": "locate", "points": points})["points"])
        except check.TooNarrow as error:
            reason = error
        else:
            return base, found, note, frame
    raise reason


def _checked(base: Ground, found: ReachableSet, peer: Peer, tolerance: float) -> Checks:
    """Compare the two problems, then our sets with the peer's at matched resolution."""
    peer.ask(_prepare(base))
    share = check.check_obstacles(peer.ask(check.forbidden_points(base, found))["collides"])
    peer.ask({"do": "compute"})
    own = peer.ask({"do": "sets"})["steps"]
    check.check_bounds(base, own)

    cell_s, cell_d = base.settings.cell_s, base.settings.cell_d
    peer.ask(
        {
            "do": "forbid",
            "grid": min(cell_s, cell_d),
            "split": min(cell_s, cell_d),
            "boxes": forbidden_boxes(base),
            "beyond": beyond_the_road(base),
        }
    )
    spent: float = peer.ask({"do": "compute"})["compute_s"]
    steps = peer.ask({"do": "sets"})["steps"]
    check.check_bounds(base, steps)
    matched = tuple(step["area"] for step in steps)
    check.check_alive([step["area"] for step in own], matched)
    check.check_areas(_areas(found), matched, tolerance)
    finer = base.settings.replace(cell_s=cell_s / FINER, cell_d=cell_d / FINER)
    fine = prepare(base.scene, finer)
    sets = (found, free_set(tightened(base)))
    finer_sets = (free_set(fine), free_set(tightened(fine)))
    boxes = [in_our_frame(base, step["boxes"]) for step in steps]
    driven = seen(base, sets, boxes, matched)
    check.check_nothing_lost(driven.lost_by_us)
    of_sets = [check.Areas.of(_areas(each), matched) for each in sets]
    of_finer = [check.Areas.of(_areas(each), matched).largest for each in finer_sets]
    quick, tight = (
        Closeness(own.largest, own.smallest, finer, ratio)
        for own, finer, ratio in zip(of_sets, of_finer, driven.ratios, strict=True)
    )
    return Checks(share, matched, spent, driven.lost_by_peer, quick, tight)


def _areas(found: ReachableSet) -> tuple[float, ...]:
    return tuple(found.area(k) for k in range(found.horizon + 1))
