"""Which answer each atom of a specification has on a ground."""

from __future__ import annotations

from math import hypot, inf

import numpy as np

from sandra.errors import FormulaError
from sandra.logic import Atom, Comparison, Predicate
from sandra.reach.answers import (
    EVERYWHERE,
    Body,
    Cuts,
    Fixed,
    SafeDistance,
    Touching,
    not_touching,
)
from sandra.reach.bands import Band, Leader, band
from sandra.reach.ground import Ground
from sandra.reach.problem import Answer, Piece

TANGENT_STEP = 2.0
"""Spacing of the tangents to the safe-distance parabola [m/s]."""


def answers_of(ground: Ground, atoms: tuple[Atom, ...]) -> tuple[Answer, ...]:
    """The answer of each atom of a specification; the same object for the same atom.

    Raises:
        FormulaError: if an atom names a predicate, lane or lanelet that is not known here.
    """
    known = ground.answers
    return tuple(
        known[atom] if atom in known else known.setdefault(atom, _answer(ground, atom))
        for atom in atoms
    )


def _answer(ground: Ground, atom: Atom) -> Answer:
    if isinstance(atom, Comparison):
        return _comparison(atom)
    assert isinstance(atom, Predicate)
    match atom.name:
        case "in_lane":
            return _in_lane(ground, _lane_bands(ground, atom))
        case "in_lanelet":
            return Touching((_lanelet_band(ground, atom),), body_of(ground), EVERYWHERE)
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
    match atom.variable:
        case "v":
            everywhere = (-inf, inf, -inf, inf)
            below = Piece(everywhere, ((0.0, 1.0, bound),))
            above = Piece(everywhere, ((0.0, -1.0, -bound),))
        case "s":
            below, above = Piece((-inf, bound, -inf, inf)), Piece((bound, inf, -inf, inf))
        case _:
            below, above = Piece((-inf, inf, -inf, bound)), Piece((-inf, inf, bound, inf))
    return Fixed(((below,),), ((above,),))


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


def _in_lane(ground: Ground, bands: tuple[Band, ...]) -> Answer:
    # Outside of all lanes at once: an intersection over the lanes.
    inner = inner_reach(ground)
    return Touching(bands, body_of(ground), tuple(not_touching(lane, inner) for lane in bands))


def inner_reach(ground: Ground) -> float:
    """By how much d may change so that the point is still in the disc inscribed in the body [m].

    At a kink of the reference line d is measured along the mitre, where a unit of d is longer
    than one metre.
    """
    frame, lattice = ground.scene.frame, ground.lattice
    s = lattice.s0, lattice.s0 + lattice.ds * lattice.columns
    first, last = np.searchsorted(frame.stations, s).tolist()
    mitres = frame.normals[max(first - 1, 0) : last + 1]
    longest = float(np.hypot(mitres[:, 0], mitres[:, 1]).max(initial=1.0))
    return ground.scene.ego.width / 2 / longest


def body_of(ground: Ground) -> Body:
    """The ego's body on a ground."""
    ego = ground.scene.ego
    low, high = ground.curvature
    return Body(
        ego.length,
        ego.width,
        ego.wheelbase / 2 * ground.settings.a_lat_max,
        ground.scene.ego_curvilinear[2],
        tuple(np.maximum(np.abs(low), np.abs(high)).tolist()),
        ground.lattice,
    )


def _safe_distance(ground: Ground) -> Answer:
    """The states (s, v) that keep the distance are convex: s + v t_d + v^2 / (2 |a_min|) <= const.

    Tangents to the parabola cut them from outside.
    """
    half = ground.scene.ego.length / 2
    settings = ground.settings
    speeds = np.arange(0.0, settings.v_max + TANGENT_STEP, TANGENT_STEP)
    braking = 2 * abs(settings.a_min)

    def cuts(leader: Leader) -> Cuts:
        room = leader.rear - half + leader.speed**2 / (2 * abs(settings.a_obs_min))
        return tuple(
            (1.0, settings.t_d + 2 * float(u) / braking, room + float(u) ** 2 / braking)
            for u in speeds
        )

    tables = tuple(
        tuple(tuple((leader.rear - half, cuts(leader)) for leader in step) for step in steps)
        for steps in ground.leaders
    )
    bands = tuple(lane for _, lane in ground.bands)
    return SafeDistance(bands, tables, inner_reach(ground))


def _lane_speed_limit(ground: Ground) -> Answer:
    """keeps_lane_speed_limit: the signs' limit where it is known, the loosest lane's if several.

    An unknown limit is unknown: the predicate may then hold and may not.
    """

    holds = tuple(_limited(low, high, 1.0, most) for low, high, _, most in ground.limits)
    fails = tuple(_limited(low, high, -1.0, least) for low, high, least, _ in ground.limits)
    return Fixed((holds,), (fails,))


def _limited(s_low: float, s_high: float, sign: float, bound: float | None) -> Piece:
    """Where the speed is at most (sign 1) or at least (sign -1) the bound, if there is one."""
    cuts = () if bound is None else ((0.0, sign, sign * bound),)
    return Piece((s_low, s_high, -inf, inf), cuts)
