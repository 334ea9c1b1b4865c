"""The lattice over (s, d) on which regions are counted, and their cover by boxes.

A cell (i, j) is the closed rectangle [s0 + i ds, s0 + (i+1) ds] x [d0 + j dd, d0 + (j+1) dd].
Masks are boolean arrays of shape (columns along s, rows along d).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import ceil, floor
from typing import Any

import numpy as np
from numpy.typing import NDArray

Mask = NDArray[np.bool_]
Box = tuple[int, int, int, int]
"""Cells i0 <= i < i1 along s and j0 <= j < j1 along d."""


class Copied:
    """Something that never changes, with which the native kernel keeps its copy of it."""

    def __getstate__(self) -> dict[str, Any]:
        """All but that copy, which does not go to other processes."""
        return {name: value for name, value in self.__dict__.items() if name != "_native"}


class Masks(Copied, tuple[Mask, ...]):
    """One mask per step."""


def packed(masks: Sequence[Mask]) -> NDArray[np.uint8]:
    """(steps, rows, ceil(columns / 8)) bits: bit i % 8 of byte i // 8 is column i."""
    return np.packbits(np.stack([mask.T for mask in masks]), axis=2, bitorder="little")


@dataclass(frozen=True, slots=True)
class Lattice:
    """Origin [m], cell sizes [m] and numbers of cells."""

    s0: float
    d0: float
    ds: float
    dd: float
    columns: int
    rows: int

    @staticmethod
    def around(
        s_range: tuple[float, float], d_range: tuple[float, float], ds: float, dd: float
    ) -> Lattice:
        """The smallest lattice with whole cells that covers both ranges."""
        i0, i1 = floor(s_range[0] / ds), ceil(s_range[1] / ds)
        j0, j1 = floor(d_range[0] / dd), ceil(d_range[1] / dd)
        return Lattice(i0 * ds, j0 * dd, ds, dd, max(1, i1 - i0), max(1, j1 - j0))

    def touched(self, s_low: float, s_high: float, d_low: float, d_high: float) -> Box:
        """Every cell that the rectangle touches (rounded outwards), within the lattice.

        None, i0 >= i1 or j0 >= j1, if it lies beside the lattice; no bound is negative.
        """
        i0 = floor((s_low - self.s0) / self.ds - 1e-6)
        i1 = floor((s_high - self.s0) / self.ds + 1e-6) + 1
        j0 = floor((d_low - self.d0) / self.dd - 1e-6)
        j1 = floor((d_high - self.d0) / self.dd + 1e-6) + 1
        i1, j1 = min(max(i1, 0), self.columns), min(max(j1, 0), self.rows)
        return max(i0, 0), i1, max(j0, 0), j1

    def bounds(self, box: Box) -> tuple[float, float, float, float]:
        """(s_low, s_high, d_low, d_high) of a box [m]."""
        i0, i1, j0, j1 = box
        return (
            self.s0 + i0 * self.ds,
            self.s0 + i1 * self.ds,
            self.d0 + j0 * self.dd,
            self.d0 + j1 * self.dd,
        )

    def corners(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """s of the columns + 1 lattice lines, d of the rows + 1 lattice lines."""
        return (
            self.s0 + self.ds * np.arange(self.columns + 1, dtype=np.float64),
            self.d0 + self.dd * np.arange(self.rows + 1, dtype=np.float64),
        )

    def centers(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """s of the column centres, d of the row centres."""
        return (
            self.s0 + self.ds * (np.arange(self.columns, dtype=np.float64) + 0.5),
            self.d0 + self.dd * (np.arange(self.rows, dtype=np.float64) + 0.5),
        )


Runs = list[tuple[int, int]]


def boxes(mask: Mask, tolerance: int = 0, grow: bool = True, along_s: bool = True) -> list[Box]:
    """Disjoint boxes whose union is the mask, or differs from it within `tolerance` cells.

    The mask is read row by row (`along_s`: each row is a line of cells along s). Neighbouring rows
    with the same runs become one box; with a tolerance, also those whose runs begin and end
    within so many cells of each other. Then the union is a superset of the mask (`grow`), or a
    subset of it.
    """
    lines = mask.T if along_s else mask
    used = np.flatnonzero(lines.any(axis=1))
    if used.size == 0:
        return []
    found: list[Box] = []
    band: list[Runs] = []
    start = 0

    def close() -> None:
        if band:
            end = start + len(band)
            for low, high in _merged(band, grow):
                if low < high:
                    found.append((low, high, start, end) if along_s else (start, end, low, high))

    first, last = int(used[0]), int(used[-1])
    edges = np.diff(lines[first : last + 1].astype(np.int8), axis=1, prepend=0, append=0)
    begins, ends = np.nonzero(edges == 1), np.nonzero(edges == -1)
    split = np.searchsorted(begins[0], np.arange(last - first + 2))
    low_list, high_list = begins[1].tolist(), ends[1].tolist()
    for offset in range(last - first + 1):
        index = first + offset
        a, b = int(split[offset]), int(split[offset + 1])
        runs = list(zip(low_list[a:b], high_list[a:b], strict=True))
        if not (band and _similar(band, runs, tolerance)):
            close()
            band, start = [], index
        if runs:  # a row without any is like none, so that a band has no gaps
            band.append(runs)
    close()
    return found


def _similar(band: list[Runs], runs: Runs, tolerance: int) -> bool:
    # Both the first and the last row count, so that a band cannot drift away row by row.
    return all(
        len(runs) == len(other)
        and all(
            abs(a - c) <= tolerance and abs(b - d) <= tolerance
            for (a, b), (c, d) in zip(runs, other, strict=True)
        )
        for other in (band[0], band[-1])
    )


def _merged(band: list[Runs], grow: bool) -> Runs:
    lows = [[run[0] for run in runs] for runs in band]
    highs = [[run[1] for run in runs] for runs in band]
    down, up = (min, max) if grow else (max, min)
    return [
        (down(low), up(high))
        for low, high in zip(zip(*lows, strict=True), zip(*highs, strict=True), strict=True)
    ]
