"""Which cells are forbidden, by cause: found in Python, or found and held by the native kernel."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import numpy as np

from sandra.prediction.types import Prediction
from sandra.reach import twin
from sandra.reach.later import Later
from sandra.reach.lattice import Copied, Lattice, Mask, Masks, packed
from sandra.reach.windows import Lines, Window, Windows, distinct, on_lines, union


def occupied_by(prediction: Prediction, lines: Lines) -> Sequence[Windows]:
    """The forbidden windows of each obstacle at each step; see `sandra.reach.windows.windows`."""
    if twin.chosen() == "native":
        return NativeWindows.of(prediction, lines)
    return on_lines(prediction, lines)


def united(
    lattice: Lattice,
    off_road: Mask,
    occupied: Sequence[Windows],
    horizon: int,
    without: int | None = None,
) -> Sequence[Mask]:
    """All forbidden cells of each step 0..horizon, but for one obstacle's, read-only."""
    if isinstance(occupied, NativeWindows) and twin.chosen() == "native":
        return occupied.united(lattice, off_road, horizon, without)
    return union(off_road, [w for i, w in enumerate(occupied) if i != without], horizon)


class NativeWindows(Later[Windows]):
    """The windows of each obstacle, made from what the native kernel found when looked at.

    `numbers[i][k]` are the regions of obstacle i at step k.
    """

    def __init__(self, runs: Any, numbers: list[list[list[int]]]) -> None:
        super().__init__(self._made)
        self._runs, self._numbers = runs, numbers

    @staticmethod
    def of(prediction: Prediction, lines: Lines) -> NativeWindows:
        """Where each line across the road is within reach of each region."""
        regions = distinct(prediction)
        of_region = {key: i for i, key in enumerate(regions)}
        numbers = [
            [[of_region[id(region)] for region in at] for at in obstacle.at]
            for obstacle in prediction.obstacles
        ]
        several = list(regions.values())
        corners = np.concatenate([np.empty((0, 2)), *(region.vertices for region in several)])
        ends = np.cumsum([len(region.vertices) for region in several], dtype=np.int64)
        radii = np.array([region.radius for region in several], dtype=np.float64)
        table = np.column_stack([lines.start, lines.along, lines.spacing, lines.reach])
        return NativeWindows(twin.native.runs(table, lines.rows, corners, ends, radii), numbers)

    def united(
        self, lattice: Lattice, off_road: Mask, horizon: int, without: int | None
    ) -> NativeMasks:
        """All cells off the road, or forbidden by others than the obstacle `without`."""
        kept = [steps for i, steps in enumerate(self._numbers) if i != without]
        steps = [[n for each in kept for n in each[k]] for k in range(horizon + 1)]
        road = packed([off_road])
        field = twin.native.united(twin.numbers_of(lattice), road, self._runs, steps)
        return NativeMasks(field, lattice, horizon + 1)

    def _made(self) -> tuple[Windows, ...]:
        made: dict[int, tuple[Window, ...]] = {}
        for several in self._numbers:
            for numbers in several:
                for number in numbers:
                    if number not in made:
                        made[number] = tuple(_windows(self._runs.of(number)))
        return tuple(
            tuple(tuple(w for n in numbers for w in made[n]) for numbers in several)
            for several in self._numbers
        )

    def __len__(self) -> int:
        return len(self._numbers)


class NativeMasks(Copied, Later[Mask]):
    """One mask per step, held by the native kernel until somebody looks at it."""

    def __init__(self, field: Any, lattice: Lattice, count: int) -> None:
        super().__init__(self._made)
        self._native, self._lattice, self._count = field, lattice, count

    def _made(self) -> tuple[Mask, ...]:
        masks = [twin.mask_of(self._lattice, self._native.mask(k)) for k in range(self._count)]
        for mask in masks:
            mask.setflags(write=False)
        return tuple(masks)

    def __len__(self) -> int:
        return self._count

    def __reduce__(self) -> tuple[Any, ...]:
        return Masks, (tuple(self),)


def _windows(runs: list[tuple[int, int, int]]) -> list[Window]:
    """One window for each row of neighbouring columns."""
    begins = [i for i, run in enumerate(runs) if i == 0 or run[0] != runs[i - 1][0] + 1]
    found = []
    for a, b in pairwise([*begins, len(runs)]):
        first, last = np.array([run[1:] for run in runs[a:b]]).T
        j0, j1 = int(first.min()), int(last.max())
        row = np.arange(j0, j1)
        cells = (row >= first[:, None]) & (row < last[:, None])
        found.append((runs[a][0], runs[b - 1][0] + 1, j0, j1, cells))
    return found
