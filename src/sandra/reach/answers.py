"""Where an atom may hold, as data: each answer is a function of a base set, and plain to copy.

An answer is asked with (truth, step, (s, v_s) polygon, (d, v_d) polygon) and tells the region in
which its atom may have that truth; see `sandra.reach.problem.Answer`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from math import asin, atan2, cos, inf, pi, sin

from sandra.reach.bands import Band, Stretch
from sandra.reach.lattice import Copied, Lattice
from sandra.reach.polygon import Polygon, range_x, range_y
from sandra.reach.problem import Piece, Region, Union

EVERYWHERE: Region = ()
PIECE_MERGE = 0.2
"""Pieces of a lane are merged where their bounds on a base set differ by at most this [m]."""


@dataclass(frozen=True, eq=False)
class Fixed(Copied):
    """The same for every step and base set."""

    holds: Region
    fails: Region

    def __call__(self, truth: bool, k: int, lon: Polygon, lat: Polygon) -> Region:
        return self.holds if truth else self.fails


@dataclass(frozen=True, eq=False)
class Body:
    """The ego's body as far as it decides how far it reaches sideways.

    `length`, `width` [m]; `grip` = l_r a_lat [m^2/s^2], which bounds the slip angle; `heading`
    at step 0, relative to the lane [rad]; `bend`: largest |curvature| of the reference line in
    each column of `lattice` [1/m].
    """

    length: float
    width: float
    grip: float
    heading: float
    bend: tuple[float, ...]
    lattice: Lattice

    def half_extent(self, k: int, lon: Polygon, lat: Polygon) -> float:
        """How far it can reach sideways from its centre [m], for all states of a base set.

        It heads where it moves, up to the slip angle of a single-track model at its centre,
        asin(l_r a_lat / v^2); a body as long as ours bends out of a curved lane by l^2 kappa / 8.
        """
        i0, i1, _, _ = self.lattice.touched(*range_x(lon), 0.0, 0.0)
        kappa = max(self.bend[i0 : max(i1, i0 + 1)], default=0.0)
        d_low, d_high = range_x(lat)
        if k == 0:
            angle = abs(self.heading)
        else:
            stretch = max(0.1, 1.0 - kappa * max(abs(d_low), abs(d_high)))
            forward = max(range_y(lon)[0], 0.0) * stretch
            slowest, fastest = range_y(lat)
            angle = atan2(max(abs(slowest), abs(fastest)), forward)
            square = forward * forward
            angle += asin(self.grip / square) if square > self.grip else pi / 2
        a, b = self.length / 2, self.width / 2
        angle = min(angle, atan2(a, b))  # beyond the diagonal the extent would shrink again
        return a * sin(angle) + b * cos(angle) + a * a * kappa / 2


@dataclass(frozen=True, eq=False)
class Touching(Copied):
    """in_lane(x, L): the body touches a lanelet of L (paper Sec. III-C)."""

    bands: tuple[Band, ...]
    body: Body
    fails: Region

    def __call__(self, truth: bool, k: int, lon: Polygon, lat: Polygon) -> Region:
        if not truth:
            return self.fails
        side = self.body.half_extent(k, lon, lat)
        return (tuple(p for lane in self.bands for p in touching(lane, side, lon, lat)),)


def touching(band: Band, side: float, lon: Polygon, lat: Polygon) -> list[Piece]:
    """Where the body may touch a lane, in as few pieces as a base set needs.

    Neighbouring stretches become one piece where they bound the base set alike, up to
    `PIECE_MERGE`; the piece then takes the looser bound.
    """
    s_low, s_high = range_x(lon)
    d_low, d_high = range_x(lat)
    found: list[tuple[float, float, tuple[float, float], tuple[float, float]]] = []
    for x in band:
        start, end = x.s_low, x.s_high
        if end < s_low or start > s_high:
            continue
        low, high = max(x.right_low - side, d_low), min(x.left_high + side, d_high)
        if low > high:
            continue
        if found and found[-1][1] == start:
            before = found[-1]
            lows = (min(before[2][0], low), max(before[2][1], low))
            highs = (min(before[3][0], high), max(before[3][1], high))
            if lows[1] - lows[0] <= PIECE_MERGE and highs[1] - highs[0] <= PIECE_MERGE:
                found[-1] = (before[0], end, lows, highs)
                continue
        found.append((start, end, (low, low), (high, high)))
    return [Piece((a, b, lows[0], highs[1])) for a, b, lows, highs in found]


def not_touching(band: Band, inner: float) -> Union:
    """Where a body of half width `inner` [m] may be off a lane."""
    if not band:
        return (Piece((-inf, inf, -inf, inf)),)
    pieces = [
        Piece((-inf, band[0].s_low, -inf, inf)),
        Piece((band[-1].s_high, inf, -inf, inf)),
    ]
    for a, b in pairwise(band):
        if b.s_low > a.s_high:
            pieces.append(Piece((a.s_high, b.s_low, -inf, inf)))
    for x in band:
        pieces.append(Piece((x.s_low, x.s_high, -inf, x.right_high - inner)))
        pieces.append(Piece((x.s_low, x.s_high, x.left_low + inner, inf)))
    return tuple(pieces)


Cuts = tuple[tuple[float, float, float], ...]
Table = tuple[tuple[tuple[float, Cuts], ...], ...]
"""Per step the leaders of a lane: the s up to which one precedes [m], and its half-planes."""


@dataclass(frozen=True, eq=False)
class SafeDistance(Copied):
    """R_G1's keeps_safe_distance towards whatever precedes (paper eq. (5) and (6)).

    Where the disc inscribed in the body, of radius `inner` [m], touches a lane, the nearest vehicle
    in front there precedes. `tables` belong to `bands`.
    """

    bands: tuple[Band, ...]
    tables: tuple[Table, ...]
    inner: float

    def __call__(self, truth: bool, k: int, lon: Polygon, lat: Polygon) -> Region:
        if not truth:
            return EVERYWHERE  # the complement is not convex; nothing is lost but tightness
        s_low, s_high = range_x(lon)
        d_low, d_high = range_x(lat)
        region: list[Union] = []
        for lane, table in zip(self.bands, self.tables, strict=True):
            near = [x for x in lane if x.s_low <= s_high and x.s_high >= s_low]
            step = table[k]
            if not step or not near or s_low > step[-1][0]:
                continue
            low, high = sure_band(near, s_low, s_high, self.inner)
            if low >= high or d_high < low or d_low > high:
                continue
            pieces = [Piece((-inf, inf, -inf, low)), Piece((-inf, inf, high, inf))]
            start = -inf
            for end, tangents in step:
                if end >= s_low and start <= s_high:
                    pieces.append(Piece((start, end, low, high), tangents))
                start = end
            pieces.append(Piece((start, inf, low, high)))
            region.append(tuple(pieces))
        return tuple(region)


def sure_band(
    near: Sequence[Stretch], s_low: float, s_high: float, inner: float
) -> tuple[float, float]:
    """Where the inscribed disc touches a lane for sure, over a whole range of s."""
    if near[0].s_low > s_low + 1e-6 or near[-1].s_high < s_high - 1e-6:
        return 0.0, 0.0
    if any(b.s_low > a.s_high for a, b in pairwise(near)):
        return 0.0, 0.0
    return max(x.right_high for x in near) - inner, min(x.left_low for x in near) + inner
