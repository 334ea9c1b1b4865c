"""Where a literal may hold: each predicate as pieces of the state space, over-approximated."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise
from math import asin, atan2, cos, hypot, inf, pi, sin

import numpy as np

from sandra.errors import FormulaError
from sandra.logic import Atom, Comparison, Predicate
from sandra.reach.bands import Band, Leader, Stretch, band
from sandra.reach.ground import Ground
from sandra.reach.moves import Literal
from sandra.reach.polygon import Polygon, range_x, range_y
from sandra.reach.problem import Piece, Region, Regions, Union

EVERYWHERE: Region = ()
PIECE_MERGE = 0.2
"""Pieces of a lane are merged where their bounds on a base set differ by at most this [m]."""
TANGENT_STEP = 2.0
"""Spacing of the tangents to the safe-distance parabola [m/s]."""


def regions_of(ground: Ground, atoms: tuple[Atom, ...]) -> Regions:
    """The regions of each atom of a specification.

    Raises:
        FormulaError: if an atom names a predicate, lane or lanelet that is not known here.
    """
    answers = [_answer(ground, atom) for atom in atoms]

    def regions(literal: Literal, k: int, lon: Polygon, lat: Polygon) -> Region:
        index, truth = literal
        return answers[index](truth, k, lon, lat)

    return regions


Answer = Callable[[bool, int, Polygon, Polygon], Region]


def _answer(ground: Ground, atom: Atom) -> Answer:
    if isinstance(atom, Comparison):
        return _comparison(atom)
    assert isinstance(atom, Predicate)
    match atom.name:
        case "in_lane":
            return _in_lane(ground, _lane_bands(ground, atom))
        case "in_lanelet":
            return _in_lane(ground, (_lanelet_band(ground, atom),), exact=False)
        case "keeps_safe_distance" if atom.argument == "preceding":
            return _safe_distance(ground)
        case "keeps_lane_speed_limit":
            return _lane_speed_limit(ground)
    raise FormulaError(
        f"unknown predicate '{atom}': choose from in_lane(current|left|right|opposite), "
        "in_lanelet(ID), keeps_safe_distance(preceding), keeps_lane_speed_limit, in_standstill, "
        "or compare a, v, s or d with a number"
    )


def _comparison(atom: Comparison) -> Answer:
    bound = atom.bound

    def answer(truth: bool, k: int, lon: Polygon, lat: Polygon) -> Region:
        upper = truth
        if atom.variable == "v":
            cut = (0.0, 1.0, bound) if upper else (0.0, -1.0, -bound)
            return ((Piece((-inf, inf, -inf, inf), (cut,)),),)
        low, high = (-inf, bound) if upper else (bound, inf)
        if atom.variable == "s":
            return ((Piece((low, high, -inf, inf)),),)
        return ((Piece((-inf, inf, low, high)),),)

    return answer


def _lane_bands(ground: Ground, atom: Predicate) -> tuple[Band, ...]:
    if atom.argument not in ("current", "left", "right", "opposite"):
        raise FormulaError(f"unknown lane in '{atom}': choose current, left, right or opposite")
    return tuple(lane for relation, lane in ground.bands if relation == atom.argument)


def _lanelet_band(ground: Ground, atom: Predicate) -> Band:
    for lanelet in ground.scene.lanelets:
        if str(lanelet.id) == atom.argument:
            ego = ground.scene.ego
            radius = hypot(ego.length, ego.width) / 2
            return band(ground.scene.frame, ground.lattice, lanelet.left, lanelet.right, radius)
    raise FormulaError(f"no lanelet {atom.argument} in the map: check the id in '{atom}'")


def _in_lane(ground: Ground, bands: tuple[Band, ...], exact: bool = True) -> Answer:
    """in_lane(x, L): the body touches a lanelet of L (paper Sec. III-C)."""
    inner = ground.scene.ego.width / 2

    def answer(truth: bool, k: int, lon: Polygon, lat: Polygon) -> Region:
        if truth:
            side = half_extent(ground, k, lon, lat)
            return (tuple(p for lane in bands for p in _touching(lane, side, lon, lat)),)
        if not exact:
            return EVERYWHERE
        # Outside of all lanes at once: an intersection over the lanes.
        return tuple(_not_touching(lane, inner) for lane in bands)

    return answer


def _touching(band: Band, side: float, lon: Polygon, lat: Polygon) -> list[Piece]:
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


def _not_touching(band: Band, inner: float) -> Union:
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


def half_extent(ground: Ground, k: int, lon: Polygon, lat: Polygon) -> float:
    """How far the body can reach sideways from its centre [m], for all states of a base set.

    The body heads where it moves, up to the slip angle of a single-track model at its centre,
    asin(l_r a_lat / v^2); a body as long as ours bends out of a curved lane by l^2 kappa / 8.
    """
    ego = ground.scene.ego
    i0, i1, _, _ = ground.lattice.touched(*range_x(lon), 0.0, 0.0)
    columns = slice(i0, max(i1, i0 + 1))
    kappa = max(
        float(np.abs(ground.curvature[0][columns]).max(initial=0.0)),
        float(np.abs(ground.curvature[1][columns]).max(initial=0.0)),
    )
    d_low, d_high = range_x(lat)
    if k == 0:
        angle = abs(ground.scene.ego_curvilinear[2])
    else:
        stretch = max(0.1, 1.0 - kappa * max(abs(d_low), abs(d_high)))
        forward = max(range_y(lon)[0], 0.0) * stretch
        sideways = max(abs(v) for v in range_y(lat))
        angle = atan2(sideways, forward)
        grip = ego.wheelbase / 2 * ground.settings.a_lat_max
        angle += asin(min(1.0, grip / forward**2)) if forward > 0.0 else pi / 2
    a, b = ego.length / 2, ego.width / 2
    angle = min(angle, atan2(a, b))  # beyond the diagonal the extent would shrink again
    return a * sin(angle) + b * cos(angle) + a * a * kappa / 2


def _safe_distance(ground: Ground) -> Answer:
    """R_G1's keeps_safe_distance towards whatever precedes (paper eq. (5) and (6)).

    Where the inscribed disc touches a lane, the nearest vehicle in front there precedes. The states
    (s, v) that keep the distance are convex: s + v t_d + v^2 / (2 |a_min|) <= const; tangents to
    the parabola cut it from outside.
    """
    half = ground.scene.ego.length / 2
    inner = ground.scene.ego.width / 2
    settings = ground.settings
    speeds = np.arange(0.0, settings.v_max + TANGENT_STEP, TANGENT_STEP)
    braking = 2 * abs(settings.a_min)

    def cuts(leader: Leader) -> tuple[tuple[float, float, float], ...]:
        room = leader.rear - half + leader.speed**2 / (2 * abs(settings.a_obs_min))
        return tuple(
            (1.0, settings.t_d + 2 * float(u) / braking, room + float(u) ** 2 / braking)
            for u in speeds
        )

    tables = [
        [[(leader.rear - half, cuts(leader)) for leader in step] for step in steps]
        for steps in ground.leaders
    ]

    def answer(truth: bool, k: int, lon: Polygon, lat: Polygon) -> Region:
        if not truth:
            return EVERYWHERE  # the complement is not convex; nothing is lost but tightness
        s_low, s_high = range_x(lon)
        d_low, d_high = range_x(lat)
        region: list[Union] = []
        for (_, lane), table in zip(ground.bands, tables, strict=True):
            near = [x for x in lane if x.s_low <= s_high and x.s_high >= s_low]
            step = table[k]
            if not step or not near or s_low > step[-1][0]:
                continue
            low, high = _sure_band(near, s_low, s_high, inner)
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

    return answer


def _sure_band(
    near: list[Stretch], s_low: float, s_high: float, inner: float
) -> tuple[float, float]:
    """Where the inscribed disc touches a lane for sure, over a whole range of s."""
    if near[0].s_low > s_low + 1e-6 or near[-1].s_high < s_high - 1e-6:
        return 0.0, 0.0
    if any(b.s_low > a.s_high for a, b in pairwise(near)):
        return 0.0, 0.0
    return max(x.right_high for x in near) - inner, min(x.left_low for x in near) + inner


def _lane_speed_limit(ground: Ground) -> Answer:
    """keeps_lane_speed_limit: the signs' limit where it is known, the loosest lane's if several.

    An unknown limit is unknown: the predicate may then hold and may not.
    """

    def answer(truth: bool, k: int, lon: Polygon, lat: Polygon) -> Region:
        pieces = []
        for s_low, s_high, lowest, highest in ground.limits:
            bound = highest if truth else lowest
            if bound is None:
                cuts: tuple[tuple[float, float, float], ...] = ()
            else:
                cuts = ((0.0, 1.0, bound),) if truth else ((0.0, -1.0, -bound),)
            pieces.append(Piece((s_low, s_high, -inf, inf), cuts))
        return (tuple(pieces),)

    return answer
