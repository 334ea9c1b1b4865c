"""Cutting lanelets into slices: as long as the road is straight, they become regions."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from sandra.prediction.lanes import Strip
from sandra.scene.convex import hulls

Array = NDArray[np.float64]
Points = NDArray[np.complex128]

FEW_CORNERS = 8
"""Hulls with no more corners are left as they are."""
GROWTH = 0.01
"""Leaving out corners moves no border outwards by more [m]."""
STRAIGHT = 0.15
"""Borders of a slice leave its chords by at most this [m]."""
END_CELLS = 8
"""A slice ends so many cells from either end of a lanelet."""


@dataclass(frozen=True, slots=True, eq=False)
class Slice:
    """Cross-sections first..last of a strip, whose hull is nearly the strip itself.

    `hull` is the hull, without corners that hardly matter.
    """

    first: int
    last: int
    hull: Array
    """(n, 2) [m]"""
    along: Array
    """(2,) unit vector in the direction of travel."""
    sides: tuple[float, float]
    """Smallest and largest coordinate across the slice, left of `along` positive [m]."""
    ahead: float
    """Largest progress in it [m]."""
    lag: float
    """Progress exceeds the way along the slice by at most this: along . x >= p - lag [m]."""


def slices_of(strips: tuple[Strip, ...]) -> list[tuple[Slice, ...]]:
    """The slices of each strip, in order."""
    parts = [_parts(np.stack([_points(x.right), _points(x.left)], axis=1)) for x in strips]
    clouds = [
        np.concatenate([strip.right[first : last + 1], strip.left[first : last + 1]])
        for strip, several in zip(strips, parts, strict=True)
        for first, last in several
    ]
    outlines = iter([simplified(outline) for outline in hulls(clouds)])
    return [
        tuple(_slice(strip, first, last, next(outlines)) for first, last in several)
        for strip, several in zip(strips, parts, strict=True)
    ]


def simplified(outline: Array) -> Array:
    """A polygon (m, 2) with m <= n corners that holds a convex one (n, 2) and is hardly larger.

    Of the edges of a bend only some are kept, so far from each other that the corners at which
    they meet are beyond those left out by no more than `GROWTH`. Counter-clockwise.
    """
    n = len(outline)
    if n <= FEW_CORNERS:
        return outline
    p: list[complex] = _points(outline).tolist()
    p += p[:1]
    edges = [(b - a) / abs(b - a) for a, b in pairwise(p)]
    corners = []
    i = 0
    while i < n:
        corner, j = p[i + 1], i + 1
        while j < n:
            further = _meeting(p, edges, i, (j + 1) % n)
            if further is None or any(
                (edges[k].conjugate() * (p[k] - further)).imag > GROWTH for k in range(i + 1, j + 1)
            ):
                break
            corner, j = further, j + 1
        corners.append(corner)
        i = j
    return np.array([[c.real, c.imag] for c in corners])


def _meeting(p: list[complex], edges: list[complex], i: int, j: int) -> complex | None:
    """Where the lines through edges i and j meet, if they turn left by less than pi."""
    turn = (edges[i].conjugate() * edges[j]).imag
    if turn <= 1e-9 or (edges[i].conjugate() * edges[j]).real < 0.0:
        return None
    ahead: float = ((p[j] - p[i]).conjugate() * edges[j]).imag / turn
    return p[i] + ahead * edges[i]


def _points(line: Array) -> Points:
    """(n, 2) as points x + iy."""
    points: Points = np.ascontiguousarray(line).view(np.complex128)[:, 0]
    return points


def _slice(strip: Strip, first: int, last: int, outline: Array) -> Slice:
    index = slice(first, last + 1)
    way = strip.centre[last] - strip.centre[first]
    length = float(np.hypot(*way))
    along = way / length if length > 0 else np.array([1.0, 0.0])
    borders = np.stack([strip.right[index], strip.left[index]], axis=1)
    across = borders @ np.array([-along[1], along[0]])
    progress = strip.progress[index]
    return Slice(
        first=first,
        last=last,
        hull=outline,
        along=along,
        sides=(float(across.min()), float(across.max())),
        ahead=float(progress.max()),
        lag=float((progress - borders @ along).max()),
    )


def _parts(sides: Points) -> list[tuple[int, int]]:
    """(first, last) cross-sections of each slice of a strip with borders (n, 2), points x + iy.

    Lanelets begin and end where the road widens; slices end there too, so that what lies beyond
    one end does not loosen the bounds of the rest.
    """
    total = len(sides)
    marks = [i for i in (END_CELLS, total - 1 - END_CELLS) if END_CELLS <= i < total - 1]
    return [
        (first, last)
        for low, high in pairwise([0, *sorted(set(marks)), total - 1])
        for first, last in _straight_parts(sides, low, high)
    ]


def _straight_parts(sides: Points, low: int, high: int) -> list[tuple[int, int]]:
    """Greedy: each part as long as both borders stay within STRAIGHT of their chords."""
    if _is_straight(sides[low : high + 1]):
        return [(low, high)]
    parts = []
    first = low
    while first < high:
        last = first + 1
        step = 1
        # Gallop, then narrow down: few tests also on long straight lanelets.
        while last + step <= high and _is_straight(sides[first : last + step + 1]):
            last += step
            step *= 2
        while step:
            if last + step <= high and _is_straight(sides[first : last + step + 1]):
                last += step
            step //= 2
        parts.append((first, last))
        first = last
    return parts


def _is_straight(sides: Points) -> bool:
    way = sides - sides[0]
    chord = way[-1]
    length = np.abs(chord)
    # The product with a conjugate is the dot product and, as its imaginary part, the cross product.
    away = np.abs((way * chord.conj()).imag).max(axis=0)
    return bool(((length >= 1e-9) & (away <= STRAIGHT * length)).all())
