"""Whether the peer was given the same problem: checked before anything is timed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sandra.errors import SandraError
from sandra.evaluation.reach_bench.hand_over import reference_line
from sandra.reach import Ground, ReachableSet
from sandra.reach.lattice import Mask

Array = NDArray[np.float64]

FRAME_TOLERANCE = 0.05
"""How far points may lie apart in the two frames [m]."""
SPEED_TOLERANCE = 0.01
"""How far the peer's speeds may exceed what its bounds allow [m/s]."""
OBSTACLE_SHARE = 0.99
"""Share of our forbidden cells that the peer must forbid as well."""
CELLS = 2000
"""At most so many forbidden cells of a step are looked at."""
AROUND = 5
"""They are looked for so many cells around our set."""
LARGE = 1.0
"""Areas are compared from this size on [m^2]."""


class NotTheSame(SandraError):
    """A check failed: the two do not solve the same problem, or do not agree on it."""


class TooNarrow(NotTheSame):
    """The peer's coordinate system does not reach as far as our set, or bends differently."""


@dataclass(frozen=True, slots=True)
class Areas:
    """Our drivable area over the peer's, per step, where the peer's is at least `LARGE`.

    `largest` and `smallest`: the extreme ratios; 1.0 where there is none to compare.
    """

    largest: float
    smallest: float

    @staticmethod
    def of(ours: Sequence[float], peers: Sequence[float]) -> Areas:
        """Compare the areas [m^2] of all steps."""
        pairs = zip(ours, peers, strict=True)
        ratios = [mine / other for mine, other in pairs if other >= LARGE]
        return Areas(max(ratios, default=1.0), min(ratios, default=1.0))


def corners_of(found: ReachableSet) -> Array:
    """(n, 2) corners (s, d) of our base sets, a few hundred over all steps [m]."""
    boxes = [b.rectangle for step in found.steps for b in step]
    every = max(1, len(boxes) // 50)
    return np.array([(box[i], box[j]) for box in boxes[::every] for i in (0, 1) for j in (2, 3)])


def check_frame(base: Ground, corners: Array, points: list[list[float] | None]) -> float:
    """The largest distance between (s, d) of the same points in our and the peer's frame [m].

    Raises:
        TooNarrow: if it exceeds `FRAME_TOLERANCE`, or points lie outside of the peer's frame.
    """
    missing = sum(point is None for point in points)
    if missing:
        raise TooNarrow(
            f"the peer's coordinate system lacks {missing} of {len(points)} points of our set"
        )
    start = reference_line(base)[1]
    found = np.array(points, dtype=np.float64) + np.array([start, 0.0])
    apart = float(np.abs(found - corners).max())
    if apart > FRAME_TOLERANCE:
        raise TooNarrow(f"the two frames differ by {apart:.2f} m, more than {FRAME_TOLERANCE} m")
    return apart


def check_bounds(base: Ground, steps: list[dict[str, Any]]) -> None:
    """The peer's speeds stay within what its initial state and its bounds allow.

    Its half-space cut goes wrong at some symmetric bounds, such as +-6 m/s^2 with dt = 0.1 s; the
    set then grows at twice the acceleration.

    Raises:
        NotTheSame: if they do not.
    """
    settings = base.settings
    axes = (
        ("v_lon", base.lon, settings.a_lon_min, settings.a_lon_max, 0.0, settings.v_max),
        (
            *("v_lat", base.lat, -settings.a_lat_max, settings.a_lat_max),
            *(-settings.v_lat_max, settings.v_lat_max),
        ),
    )
    for name, polygon, push_low, push_high, least, most in axes:
        low, high = min(v for _, v in polygon), max(v for _, v in polygon)
        for k, step in enumerate(steps):
            if k == 0 or step[name] is None:  # the initial set itself is not cut
                continue
            t = k * base.scene.dt
            allowed = max(low + push_low * t, least), min(high + push_high * t, most)
            over = max(allowed[0] - step[name][0], step[name][1] - allowed[1])
            if over > SPEED_TOLERANCE:
                raise NotTheSame(
                    f"the peer's {name} leaves its bounds by {over:.2f} m/s at step {k}"
                )


def forbidden_points(base: Ground, found: ReachableSet) -> dict[str, Any]:
    """The request `Worker.collides` for centres of cells around our set that we forbid.

    At three steps. Of the cells off the road only those along its border are asked for: there the
    peer has it.
    """
    start = reference_line(base)[1]
    s, d = base.lattice.centers()
    steps = sorted({0, base.horizon // 2, base.horizon})
    border = _along_border(base.off_road)
    points = []
    for k in steps:
        around = _around(base, found, k)
        columns, rows = np.nonzero(base.forbidden[k] & around & (~base.off_road | border))
        every = max(1, len(columns) // CELLS)
        columns, rows = columns[::every], rows[::every]
        points.append(np.column_stack([s[columns] - start, d[rows]]).tolist())
    return {"do": "collides", "steps": steps, "points": points}


def _around(base: Ground, found: ReachableSet, k: int) -> Mask:
    """The cells of our set at step k, and those within `AROUND` of them."""
    mask = np.zeros_like(base.off_road)
    if k < len(found.steps):
        for i0, i1, j0, j1 in found.boxes(k):
            mask[max(0, i0 - AROUND) : i1 + AROUND, max(0, j0 - AROUND) : j1 + AROUND] = True
    return mask


def _along_border(off_road: Mask) -> Mask:
    """Cells off the road with one on the road at either side of them, across the lane."""
    near = np.zeros_like(off_road)
    near[:, 1:] |= ~off_road[:, :-1]
    near[:, :-1] |= ~off_road[:, 1:]
    return off_road & near


def check_obstacles(collides: list[list[bool]]) -> float:
    """The share of our forbidden cells whose centres the peer forbids as well.

    Raises:
        NotTheSame: if it is below `OBSTACLE_SHARE`.
    """
    answers = [answer for step in collides for answer in step]
    share = float(np.mean(answers)) if answers else 1.0
    if share < OBSTACLE_SHARE:
        raise NotTheSame(f"the peer forbids only {share:.1%} of the cells that we forbid")
    return share


def check_alive(own: Sequence[float], matched: Sequence[float]) -> None:
    """The peer's set with its own obstacles is not empty where it is large on our cells.

    It is where the ego starts nearer to the border of the road than the peer tells from on it.

    Raises:
        NotTheSame: if it is.
    """
    for k, (area, other) in enumerate(zip(own, matched, strict=True)):
        if area == 0.0 and other >= LARGE:
            raise NotTheSame(
                f"the peer's own set is empty at step {k}; on our cells it has {other:.0f} m^2"
            )


def check_nothing_lost(share: float) -> None:
    """Our set holds every position to which trajectories were driven.

    Raises:
        NotTheSame: if it lacks a share of them.
    """
    if share > 0.0:
        raise NotTheSame(f"our set lacks {share:.2%} of the positions on trajectories")


def check_areas(ours: Sequence[float], peers: Sequence[float], tolerance: float) -> Areas:
    """Our areas beside the peer's at matched resolution, on the same forbidden cells.

    Raises:
        NotTheSame: if a ratio is above `tolerance` or below its inverse.
    """
    areas = Areas.of(ours, peers)
    worst = max(areas.largest, 1.0 / max(areas.smallest, 1e-9))
    if worst > tolerance:
        raise NotTheSame(
            f"the areas differ by a factor of {worst:.2f} at matched resolution, more than "
            f"{tolerance:g}"
        )
    return areas
