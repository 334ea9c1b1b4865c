"""Random problems for the kernel, degenerate ones among them; the same seed gives the same one."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from math import inf

import numpy as np

from sandra.reach import Lattice, Piece, Problem
from sandra.reach.answers import Body, Fixed, SafeDistance, Touching, not_touching
from sandra.reach.bands import Band, Stretch
from sandra.reach.lattice import Mask, Masks
from sandra.reach.moves import Interval, Move, Moves
from sandra.reach.polygon import Polygon, hull
from sandra.reach.problem import Answer, Region

Rng = np.random.Generator


def problem(seed: int) -> Problem:
    """Up to 8 steps on up to 150 x 40 cells, with up to three classes and four atoms."""
    rng = np.random.default_rng(seed)
    lattice = Lattice(
        float(rng.uniform(-20.0, 20.0)),
        float(rng.uniform(-8.0, 0.0)),
        float(rng.choice([0.1, 0.25, 0.5, 1.0])),
        float(rng.choice([0.1, 0.2, 0.5])),
        int(rng.choice([1, 3, 40, 64, 65, 128, 150])),
        int(rng.integers(1, 41)),
    )
    horizon = int(rng.choice([0, 1, 2, 4, 8], p=[0.05, 0.1, 0.25, 0.4, 0.2]))
    s = lattice.s0 + lattice.ds * lattice.columns * rng.uniform(0.0, 0.6)
    d = lattice.d0 + lattice.dd * lattice.rows * rng.uniform(0.1, 0.9)
    atoms = int(rng.integers(0, 5))
    return Problem(
        dt=float(rng.choice([0.05, 0.1, 0.2, 0.5])),
        horizon=horizon,
        lon=_start(rng, s, rng.choice([0.0, 3.0, 10.0])),
        lat=_start(rng, d, 0.0),
        a_lat=_interval(rng, 4.0),
        v_lon=(0.0, float(rng.choice([5.0, 12.0, 30.0, inf]))),
        v_lat=(-float(rng.choice([0.5, 3.0, inf])), float(rng.choice([0.5, 3.0, inf]))),
        lattice=lattice,
        forbidden=_forbidden(rng, lattice, horizon),
        moves=_moves(rng, horizon, atoms),
        answers=tuple(_answer(rng, lattice, horizon) for _ in range(atoms)),
        tight=seed % 3 == 0,
    )


def other_ends(problem: Problem, seed: int) -> list[Problem]:
    """The same problem with other last letters."""
    rng = np.random.default_rng(seed)
    atoms, count = len(problem.answers), len(problem.moves.moves)
    found = [problem]
    for _ in range(2):
        final = _table(rng, count, atoms, last=True)
        found.append(replace(problem, moves=replace(problem.moves, final=final)))
    return found


def _start(rng: Rng, x: float, v: float) -> Polygon:
    kind = rng.choice(["point", "segment", "box", "polygon"])
    if kind == "point":
        return [(float(x), float(v))]
    count = {"segment": 2, "box": 4, "polygon": 12}[str(kind)]
    size = rng.choice([1e-9, 0.1, 1.0])
    if kind == "box":
        points = [(x + i * size, v + j * size) for i in (-1, 1) for j in (-1, 1)]
    else:
        points = [(x + size * a, v + size * b) for a, b in rng.uniform(-1.0, 1.0, (count, 2))]
    return hull([(float(a), float(b)) for a, b in points])


def _interval(rng: Rng, most: float) -> Interval:
    kind = rng.choice(["none", "point", "wide", "aside"])
    if kind == "none":
        return 0.0, 0.0
    if kind == "point":
        a = float(rng.uniform(-most, most))
        return a, a
    if kind == "wide":
        return -most, most
    a, b = sorted(rng.uniform(-most, most, 2).tolist())
    return a, b


def _forbidden(rng: Rng, lattice: Lattice, horizon: int) -> tuple[Mask, ...]:
    masks = []
    for _ in range(horizon + 1):
        mask = np.zeros((lattice.columns, lattice.rows), dtype=bool)
        for _ in range(rng.integers(0, 6)):
            i, j = rng.integers(0, lattice.columns), rng.integers(0, lattice.rows)
            mask[i : i + rng.integers(1, 20), j : j + rng.integers(1, 12)] = True
        if rng.random() < 0.2:
            mask |= rng.random(mask.shape) < rng.choice([0.02, 0.5])
        masks.append(mask)
    return Masks(masks) if rng.random() < 0.5 else tuple(masks)


def _moves(rng: Rng, horizon: int, atoms: int) -> Moves:
    count = int(rng.integers(1, 4))
    live = tuple(
        frozenset(c for c in range(count) if rng.random() < 0.9) for _ in range(horizon + 2)
    )
    return Moves(
        int(rng.integers(count)),
        _table(rng, count, atoms, last=False),
        _table(rng, count, atoms, last=True),
        live,
    )


def _table(rng: Rng, count: int, atoms: int, last: bool) -> tuple[tuple[Move, ...], ...]:
    def move() -> Move:
        chosen = rng.permutation(atoms)[: rng.integers(0, min(atoms, 2) + 1)]
        literals = tuple(sorted((int(i), bool(rng.random() < 0.7)) for i in chosen))
        return Move(-1 if last else int(rng.integers(count)), literals, _interval(rng, 6.0))

    return tuple(tuple(move() for _ in range(rng.integers(1, 4))) for _ in range(count))


def _answer(rng: Rng, lattice: Lattice, horizon: int) -> Answer:
    match rng.choice(["fixed", "touching", "distance", "own"]):
        case "fixed":
            return Fixed(_region(rng, lattice), _region(rng, lattice))
        case "touching":
            bands = tuple(_band(rng, lattice) for _ in range(rng.integers(0, 3)))
            body = Body(
                *(float(x) for x in rng.uniform(0.5, 5.0, 2)),
                float(rng.uniform(0.0, 8.0)),
                float(rng.uniform(-0.5, 0.5)),
                tuple(rng.uniform(0.0, 0.2, lattice.columns).tolist()),
                lattice,
            )
            fails = tuple(not_touching(band, 0.9) for band in bands)
            return Touching(bands, body, fails)
        case "distance":
            bands = tuple(_band(rng, lattice) for _ in range(rng.integers(0, 3)))
            tables = tuple(_table_of_leaders(rng, lattice, horizon) for _ in bands)
            return SafeDistance(bands, tables, float(rng.uniform(0.2, 1.0)))
    asked = _region(rng, lattice)

    def own(truth: bool, k: int, lon: Polygon, lat: Polygon) -> Region:
        """A function of a user's, which looks at all that it is told."""
        return asked if truth or k > 2 or len(lon) + len(lat) > 9 or lon[0] < lat[0] else ()

    return own


def _region(rng: Rng, lattice: Lattice) -> Region:
    def bounds(low: float, size: float) -> tuple[float, float]:
        a, b = sorted((low + size * rng.uniform(-0.2, 1.2, 2)).tolist())
        return (-inf if rng.random() < 0.3 else a), (inf if rng.random() < 0.3 else b)

    def piece() -> Piece:
        cuts = tuple(
            (float(rng.choice([0.0, 1.0, -1.0])), float(rng.normal()), float(rng.uniform(-5, 60)))
            for _ in range(rng.integers(0, 3))
        )
        s = bounds(lattice.s0, lattice.ds * lattice.columns)
        return Piece((*s, *bounds(lattice.d0, lattice.dd * lattice.rows)), cuts)

    return tuple(tuple(piece() for _ in range(rng.integers(0, 4))) for _ in range(rng.integers(3)))


def _band(rng: Rng, lattice: Lattice) -> Band:
    edges = np.sort(
        lattice.s0 + lattice.ds * rng.integers(-2, lattice.columns + 3, 2 * rng.integers(1, 5))
    )
    found = []
    middle = lattice.d0 + lattice.dd * lattice.rows * rng.uniform(0.0, 1.0)
    whole = rng.random() < 0.5
    for a, b in pairwise(edges):
        if b > a and (whole or rng.random() < 0.7):
            right, left = middle - rng.uniform(0.5, 2.0), middle + rng.uniform(0.5, 2.0)
            slack = rng.uniform(0.0, 0.3, 2)
            values = (a, b, right, right + slack[0], left - slack[1], left)
            found.append(Stretch(*(float(x) for x in values)))
    return tuple(found)


def _table_of_leaders(
    rng: Rng, lattice: Lattice, horizon: int
) -> tuple[tuple[tuple[float, tuple[tuple[float, float, float], ...]], ...], ...]:
    table = []
    for _ in range(horizon + 1):
        size = lattice.ds * lattice.columns
        ends = sorted((lattice.s0 + size * rng.uniform(-0.1, 1.3, rng.integers(0, 3))).tolist())
        speeds = (0.0, 4.0, 8.0)
        table.append(
            tuple(
                (end, tuple((1.0, 0.4 + u / 6.0, end + u * u / 12.0 + 3.0) for u in speeds))
                for end in ends
            )
        )
    return tuple(table)
