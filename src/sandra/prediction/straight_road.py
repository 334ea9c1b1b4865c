"""A road whose lanes are straight, of one direction and side by side, in its own frame."""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from sandra.prediction.lane_cutting import BACKWARD_EXTENSION
from sandra.prediction.lanes import Place
from sandra.scene.types import Lanelet

Array = NDArray[np.float64]

TOLERANCE = 1e-4
"""Borders may be crooked by so much; sets are so much wider [m]."""


@dataclass(frozen=True, slots=True, eq=False)
class StraightRoad:
    """L lanes, from right to left; (s, d) along the road and to its left, from `origin` [m]."""

    origin: Array
    course: float
    """Direction of travel [rad]."""
    ids: tuple[tuple[int, ...], ...]
    """For each lane its lanelets, one after another."""
    joints: tuple[tuple[float, ...], ...]
    """Where each of them begins, and the last one ends, along s [m]."""
    borders: tuple[float, ...]
    """(L + 1,) of the lanes, along d [m]."""
    reach: float
    """Beyond its end the road goes on straight for so much [m]."""

    @staticmethod
    def of(lanelets: Sequence[Lanelet], reach: float) -> StraightRoad | None:
        """The road that the lanelets are; None if they are anything else."""
        if not lanelets:
            return None
        first = lanelets[0]
        way = first.left[-1] - first.left[0] + first.right[-1] - first.right[0]
        course = math.atan2(way[1], way[0])
        empty = StraightRoad(np.array(first.right[0], float), course, (), (), (), reach)
        strips = []
        for lanelet in lanelets:
            strip = _strip(empty, lanelet)
            if strip is None:
                return None
            strips.append(strip)
        bands = _bands(strips)
        if bands is None or not _linked(bands):
            return None
        return StraightRoad(
            empty.origin,
            course,
            tuple(tuple(x.lanelet.id for x in band) for band in bands),
            tuple((*(x.start for x in band), band[-1].end) for band in bands),
            (bands[0][0].right, *(band[0].left for band in bands)),
            reach,
        )

    def to_frame(self, points: Array) -> Array:
        """(..., 2) x, y to s, d [m]."""
        c, s = math.cos(self.course), math.sin(self.course)
        return np.asarray((points - self.origin) @ np.array([[c, -s], [s, c]]))

    def to_world(self, points: Array) -> Array:
        """The reverse of `to_frame`."""
        c, s = math.cos(self.course), math.sin(self.course)
        return np.asarray(points @ np.array([[c, s], [-s, c]]) + self.origin)

    def band(self, lanelets: Collection[int]) -> int | None:
        """The number of the lane that consists of these lanelets; None if there is none."""
        for number, ids in enumerate(self.ids):
            if set(ids) == set(lanelets):
                return number
        return None

    def places(self, x: float, y: float, heading: float, tolerance: float) -> list[Place]:
        """As `LaneMap.places`, on the first lanelet of each lane there."""
        s, d = self.to_frame(np.array([x, y])).tolist()
        relative = (heading - self.course + math.pi) % (2 * math.pi) - math.pi
        found = []
        for lane, (ids, joints) in enumerate(zip(self.ids, self.joints, strict=True)):
            right, left = self.borders[lane], self.borders[lane + 1]
            if not right - tolerance <= d <= left + tolerance:
                continue
            if (
                not joints[0] - BACKWARD_EXTENSION - tolerance
                <= s
                <= joints[-1] + self.reach + tolerance
            ):
                continue
            number = sum(joint <= s for joint in joints[1:-1])
            y_here = d - (right + left) / 2
            found.append(Place(ids[number], s - joints[number], s, y_here, relative))
        return found


@dataclass(frozen=True, slots=True)
class _Strip:
    lanelet: Lanelet
    start: float
    end: float
    right: float
    left: float


def _strip(frame: StraightRoad, lanelet: Lanelet) -> _Strip | None:
    """A lanelet in the frame; None if it is no rectangle along it."""
    right, left = (frame.to_frame(np.asarray(x, float)) for x in (lanelet.right, lanelet.left))
    if not (np.isfinite(right).all() and np.isfinite(left).all()):
        return None
    low, high = float(right[0, 1]), float(left[0, 1])
    start, end = float(right[0, 0]), float(right[-1, 0])
    fits = (
        max(np.abs(right[:, 1] - low).max(), np.abs(left[:, 1] - high).max()) <= TOLERANCE
        and max(abs(left[0, 0] - start), abs(left[-1, 0] - end)) <= TOLERANCE
        and bool((np.diff(right[:, 0]) > 0.0).all() and (np.diff(left[:, 0]) > 0.0).all())
        and high - low > TOLERANCE
    )
    return _Strip(lanelet, start, end, low, high) if fits else None


def _bands(strips: list[_Strip]) -> list[list[_Strip]] | None:
    """The lanes from right to left, each of lanelets one after another; None if there are gaps."""
    strips = sorted(strips, key=lambda x: x.right)
    bands = [strips[:1]]
    for strip in strips[1:]:
        same = abs(strip.right - bands[-1][0].right) <= TOLERANCE
        bands[-1].append(strip) if same else bands.append([strip])
    for band in bands:
        band.sort(key=lambda x: x.start)
    for band, beside in pairwise(bands):
        if abs(band[0].left - beside[0].right) > TOLERANCE:
            return None
    ends = [(band[0].start, band[-1].end) for band in bands]
    if np.ptp(np.array(ends), axis=0).max() > TOLERANCE:
        return None
    return bands


def _linked(bands: list[list[_Strip]]) -> bool:
    """Whether lanelets lead on to the next one of their lane and to nothing else."""
    known = {x.lanelet.id for band in bands for x in band}
    members = [{x.lanelet.id for x in band} for band in bands]
    for number, band in enumerate(bands):
        for here, then in zip([None, *band], [*band, None], strict=True):
            onward = set() if here is None else known & set(here.lanelet.successors)
            before = set() if then is None else known & set(then.lanelet.predecessors)
            if here is None or then is None:
                if onward or before:
                    return False
            elif (
                onward != {then.lanelet.id}
                or before != {here.lanelet.id}
                or abs(here.end - then.start) > TOLERANCE
                or abs(here.left - then.left) > TOLERANCE
            ):
                return False
        for strip in band:
            for beside, to in (
                (strip.lanelet.adjacent_left, number + 1),
                (strip.lanelet.adjacent_right, number - 1),
            ):
                inside = 0 <= to < len(bands)
                linked = beside is not None and beside[1] and beside[0] in known
                if linked != inside or (
                    beside is not None and linked and beside[0] not in members[to]
                ):
                    return False
    return True
