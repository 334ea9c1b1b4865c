"""An exhaustive search for trajectories of the model, on a grid of accelerations.

The model is that of the reachable set: a point mass in the lane's frame, one double integrator
along the lane and one across it, with bounded inputs that are constant within each step here. With
accelerations from an arithmetic progression all states lie on a lattice of integers, so sequences
that meet in a state are one from there on, exactly, and every sequence of grid accelerations is
looked at. What the formula still asks for is carried along with the state (formula progression,
Bacchus & Kabanza 1998). Nothing here is shared with `sandra.reach`, not even the automaton.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from math import ceil, floor

import numpy as np

from grid_formula import admissible, progressed
from grid_world import Cells, World, holds
from sandra.logic import Atom, Comparison, Formula, Predicate, Specification
from sandra.logic.evaluate import evaluate
from sandra.logic.formula import Constant, atoms_of, simplify, substitute

Array = np.ndarray
FALSE = Constant(False)

# ------------------------------------------------------------------ the grid


@dataclass(frozen=True)
class Progression:
    """Accelerations first + i gap, i = 0..count - 1 [m/s^2]."""

    first: float
    gap: float
    count: int

    @property
    def values(self) -> Array:
        return self.first + self.gap * np.arange(self.count)


@dataclass(frozen=True)
class Axis:
    """All states of one double integrator on the grid at each step, and where each input leads.

    `x[k]`, `v[k]` (n_k,) positions and speeds; `to[k]` (count, n_k) indices into step k + 1, -1
    where the speed would leave its bounds.
    """

    inputs: Array
    x: list[Array]
    v: list[Array]
    to: list[Array]


@lru_cache(maxsize=64)
def axis(
    x0: float, v0: float, inputs: Progression, dt: float, steps: int, low: float, high: float
) -> Axis:
    """The states as integers: v = v0 + k first dt + i gap dt, and x likewise with j gap dt^2/2."""
    pairs = np.array([[0, 0]])
    m = np.arange(inputs.count)[:, None]
    x, v, to = [np.array([x0])], [np.array([v0])], []
    for k in range(1, steps + 1):
        i = pairs[:, 0] + m
        j = pairs[:, 1] + 2 * pairs[:, 0] + m
        speed = v0 + k * inputs.first * dt + i * inputs.gap * dt
        speed = np.where(np.abs(speed) < 1e-9, 0.0, speed)
        inside = (speed >= low) & (speed <= high)
        pairs, index = np.unique(
            np.column_stack([i[inside], j[inside]]), axis=0, return_inverse=True
        )
        target = np.full(i.shape, -1)
        target[inside] = index.ravel()
        to.append(target)
        t = k * dt
        position = x0 + v0 * t + inputs.first * t**2 / 2 + pairs[:, 1] * inputs.gap * dt**2 / 2
        speed = v0 + inputs.first * t + pairs[:, 0] * inputs.gap * dt
        x.append(position)
        v.append(np.where(np.abs(speed) < 1e-9, 0.0, speed))
    return Axis(inputs.values, x, v, to)


def grids(world: World, formula: Formula, fine: bool) -> Iterator[tuple[Progression, Progression]]:
    """Pairs of grids, along and across: the admissible range in equal parts; one with a stop."""
    low, high = admissible(formula, world.settings.a_lon_min, world.settings.a_lon_max)
    if low > high:
        return
    parts, sideways = (4, 4 if world.prediction.horizon <= 8 else 2) if fine else (2, 2)
    if high - low < 1.0:
        parts = 2
    limit = world.settings.a_lat_max
    across = Progression(-limit, 2 * limit / sideways, sideways + 1)
    yield Progression(low, (high - low) / parts, parts + 1), across
    speed, dt = world.start()[1], world.drawn.scene.dt
    if low < 0.0 < high and speed > 0.0:
        # Standing still is reached exactly: the speed is a whole number of gaps.
        gap = speed / dt / max(1, ceil(speed / dt / ((high - low) / parts)))
        first, last = ceil(low / gap), floor(high / gap)
        yield Progression(first * gap, gap, last - first + 1), across


# ------------------------------------------------------------------ the search


@dataclass(frozen=True)
class Found:
    """States (h+1, 4) s, v, d, w and accelerations (h, 2), along and across."""

    states: Array
    inputs: Array


@dataclass(eq=False)
class Search:
    """All that satisfies the formula on one grid: states alive at each step, by what remains.

    The key of a layer at step h also names the class of the last acceleration, which the last
    letter carries.
    """

    world: World
    spec: Specification
    along: Progression
    across: Progression

    def __post_init__(self) -> None:
        world, values = self.world, self.world.settings
        scene, self.h = world.drawn.scene, world.prediction.horizon
        s, v, d, w = world.start()
        self.lon = axis(s, v, self.along, scene.dt, self.h, 0.0, values.v_max)
        bound = values.v_lat_max
        self.lat = axis(d, w, self.across, scene.dt, self.h, -bound, bound)
        self.cells = [
            Cells(k, self.lon.x[k], self.lon.v[k], self.lat.x[k], self.lat.v[k])
            for k in range(self.h + 1)
        ]
        atoms = sorted(atoms_of(self.spec.formula), key=str)
        self.of_input = [a for a in atoms if isinstance(a, Comparison) and a.variable == "a"]
        self.of_state = [a for a in atoms if a not in self.of_input]
        truths = [tuple(bool(holds(a, x)) for a in self.of_input) for x in self.lon.inputs]
        self.classes = sorted(set(truths))
        self.members = [[i for i, t in enumerate(truths) if t == c] for c in self.classes]
        self.after = lru_cache(maxsize=None)(self._after)
        self.layers = self._run()

    def trajectories(self, tries: int, rng: np.random.Generator) -> Iterator[Found]:
        """Some of the trajectories that satisfy the formula, drawn at random; none if none does."""
        last = self.layers[-1] if len(self.layers) == self.h + 1 else {}
        for _ in range(tries if last else 0):
            key = list(last)[rng.integers(len(last))]
            rows, columns = np.nonzero(last[key])
            which = rng.integers(len(rows))
            yield self._traced(key, int(rows[which]), int(columns[which]), rng)

    # -------------------------------------------------------------- forward

    def _run(self) -> list[dict[tuple[Formula, int], Array]]:
        asked = self._without_missing_lanes()
        if asked == FALSE:
            return [{}]
        layers = [self._living(0, {(asked, -1): np.ones((1, 1), dtype=bool)})]
        for k in range(self.h):
            if not layers[-1]:
                return layers
            moved: dict[tuple[Formula, int], Array] = {}
            for (q, _), alive in layers[-1].items():
                for c, rest, part in self._read(k, q, alive):
                    key = (rest, c if k == self.h - 1 else -1)
                    shape = (len(self.lon.x[k + 1]), len(self.lat.x[k + 1]))
                    into = moved.setdefault(key, np.zeros(shape, dtype=bool))
                    into |= self._moved(k, c, part)
            layers.append(self._living(k + 1, moved))
        return [*layers[:-1], self._accepted(layers[-1])]

    def _without_missing_lanes(self) -> Formula:
        """The formula, in which nobody ever is in a lane that the road does not have."""
        there = {relation for relation, _, _ in self.world.strips}
        never = {
            atom: FALSE
            for atom in self.of_state
            if isinstance(atom, Predicate)
            if atom.name == "in_lane" and atom.argument not in there
        }
        return simplify(substitute(self.spec.formula, never))

    def _living(
        self, k: int, moved: dict[tuple[Formula, int], Array]
    ) -> dict[tuple[Formula, int], Array]:
        """What is free of collisions at step k."""
        every = np.zeros((len(self.lon.x[k]), len(self.lat.x[k])), dtype=bool)
        for alive in moved.values():
            every |= alive
        rows, columns = np.nonzero(every)
        every[rows, columns] = self.world.free(self.cells[k], rows, columns)
        kept = {key: alive & every for key, alive in moved.items()}
        return {key: alive for key, alive in kept.items() if alive.any()}

    def state(self, k: int, row: int, column: int) -> Array:
        """(4,) s, v, d, w."""
        cells = self.cells[k]
        return np.array([cells.s[row], cells.v[row], cells.d[column], cells.w[column]])

    def _codes(self, k: int, rows: Array, columns: Array) -> Array:
        """(m,) truths of the atoms of the state, as the bits of a number."""
        code = np.zeros(len(rows), dtype=int)
        for i, atom in enumerate(self.of_state):
            code |= self.world.truth(atom, self.cells[k], rows, columns).astype(int) << i
        return code

    def _read(self, k: int, q: Formula, alive: Array) -> Iterator[tuple[int, Formula, Array]]:
        """(class of input, what remains, states from which it does) after letter k."""
        rows, columns = np.nonzero(alive)
        codes = self._codes(k, rows, columns)
        for code in np.flatnonzero(np.bincount(codes)).tolist():
            here = codes == code
            part = np.zeros_like(alive)
            part[rows[here], columns[here]] = True
            for c in range(len(self.classes)):
                rest = self.after(q, code, c)
                if rest != FALSE:
                    yield c, rest, part

    def _after(self, q: Formula, code: int, c: int) -> Formula:
        return progressed(q, self._letter(code, c))

    def _letter(self, code: int, c: int) -> dict[Atom, bool]:
        of_state = {a: bool(code >> i & 1) for i, a in enumerate(self.of_state)}
        return of_state | dict(zip(self.of_input, self.classes[c], strict=True))

    def _moved(self, k: int, c: int, part: Array) -> Array:
        halfway = np.zeros((len(self.lon.x[k + 1]), part.shape[1]), dtype=bool)
        for m in self.members[c]:
            to = self.lon.to[k][m]
            halfway[to[to >= 0]] |= part[to >= 0]
        done = np.zeros((len(self.lat.x[k + 1]), len(halfway)), dtype=bool)
        turned = np.ascontiguousarray(halfway.T)
        for to in self.lat.to[k]:
            done[to[to >= 0]] |= turned[to >= 0]
        return done.T

    def _accepted(
        self, layer: dict[tuple[Formula, int], Array]
    ) -> dict[tuple[Formula, int], Array]:
        """What satisfies the rest of the formula with the last letter."""
        found = {}
        for (q, c), alive in layer.items():
            rows, columns = np.nonzero(alive)
            codes = self._codes(self.h, rows, columns)
            good = [
                x
                for x in np.flatnonzero(np.bincount(codes)).tolist()
                if evaluate(q, [self._letter(x, c)])
            ]
            kept = np.isin(codes, good)
            if kept.any():
                final = np.zeros_like(alive)
                final[rows[kept], columns[kept]] = True
                found[q, c] = final
        return found

    # -------------------------------------------------------------- backward

    def _traced(
        self, key: tuple[Formula, int], row: int, column: int, rng: np.random.Generator
    ) -> Found:
        places, inputs = [(row, column)], []
        for k in range(self.h - 1, -1, -1):
            options = list(self._before(k, key, row, column))
            key, row, column, m, n = options[rng.integers(len(options))]
            places.append((row, column))
            inputs.append((self.lon.inputs[m], self.lat.inputs[n]))
        places.reverse()
        states = [self.state(k, i, j) for k, (i, j) in enumerate(places)]
        return Found(np.array(states), np.array(inputs[::-1]))

    def _before(
        self, k: int, key: tuple[Formula, int], row: int, column: int
    ) -> Iterator[tuple[tuple[Formula, int], int, int, int, int]]:
        rest, last = key
        sources = [(int(i), n) for n, i in zip(*np.nonzero(self.lat.to[k] == column), strict=True)]
        for m, i in zip(*np.nonzero(self.lon.to[k] == row), strict=True):
            c = next(c for c, members in enumerate(self.members) if m in members)
            if last not in (-1, c):
                continue
            for j, n in sources:
                for before, alive in self.layers[k].items():
                    if alive[i, j]:
                        code = int(self._codes(k, np.array([i]), np.array([j]))[0])
                        if self.after(before[0], code, c) == rest:
                            yield before, int(i), j, int(m), int(n)
