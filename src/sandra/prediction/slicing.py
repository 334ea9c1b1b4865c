"""Cutting lanelets into slices: as long as the road is straight, they become regions."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from sandra.prediction.lanes import Strip
from sandra.scene.convex import hulls

Array = NDArray[np.float64]

STRAIGHT = 0.15
"""Borders of a slice leave its chords by at most this [m]."""
END_CELLS = 8
"""A slice ends so many cells from either end of a lanelet."""


@dataclass(frozen=True, slots=True, eq=False)
class Slice:
    """Cross-sections first..last of a strip, whose hull is nearly the strip itself."""

    first: int
    last: int
    hull: Array
    """(n, 2) [m]"""
    along: Array
    """(2,) unit vector in the direction of travel."""
    ahead: float
    """Largest progress in it [m]."""
    lag: float
    """Progress exceeds the way along the slice by at most this: along . x >= p - lag [m]."""


def slices_of(strips: tuple[Strip, ...]) -> list[tuple[Slice, ...]]:
    """The slices of each strip, in order."""
    parts = [_parts(np.stack([x.right, x.left], axis=1)) for x in strips]
    clouds = [
        np.concatenate([strip.right[first : last + 1], strip.left[first : last + 1]])
        for strip, several in zip(strips, parts, strict=True)
        for first, last in several
    ]
    outlines = iter(hulls(clouds))
    return [
        tuple(_slice(strip, first, last, next(outlines)) for first, last in several)
        for strip, several in zip(strips, parts, strict=True)
    ]


def _slice(strip: Strip, first: int, last: int, outline: Array) -> Slice:
    index = slice(first, last + 1)
    way = strip.centre[last] - strip.centre[first]
    length = float(np.hypot(*way))
    along = way / length if length > 0 else np.array([1.0, 0.0])
    progress = strip.progress[index]
    ways = np.column_stack([strip.right[index] @ along, strip.left[index] @ along])
    return Slice(first, last, outline, along, float(progress.max()), float((progress - ways).max()))


def _parts(sides: Array) -> list[tuple[int, int]]:
    """(first, last) cross-sections of each slice of a strip with borders (n, 2, 2).

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


def _straight_parts(sides: Array, low: int, high: int) -> list[tuple[int, int]]:
    """Greedy: each part as long as both borders stay within STRAIGHT of their chords."""
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


def _is_straight(sides: Array) -> bool:
    x, y = (sides[1:, :, 0] - sides[0, :, 0]).T, (sides[1:, :, 1] - sides[0, :, 1]).T
    chord_x, chord_y = x[:, -1:], y[:, -1:]
    length = np.hypot(chord_x, chord_y)
    away = np.abs(chord_x * y - chord_y * x)
    return bool((length >= 1e-9).all() and (away <= STRAIGHT * length).all())
