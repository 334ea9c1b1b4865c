"""The letters that a planned trajectory gives, from geometry, and whether they satisfy a formula.

Letter k holds the state at t_k and the acceleration input of [t_k, t_k+1]; the last letter has
that of the last interval. A planned trajectory must satisfy its formula with room to spare: under
every reading of its letters, each of which shifts what is continuous by a small margin to one
side. For a formula without negations one of them is the strictest; for any other, all count.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import NDArray

from sandra.errors import FormulaError
from sandra.logic import Atom, Comparison, Predicate, Specification
from sandra.logic.evaluate import evaluate
from sandra.logic.formula import atoms_of
from sandra.planning.limits import MARGIN
from sandra.planning.prepared import Prepared
from sandra.planning.single_track import SPEED
from sandra.planning.validity import corners
from sandra.reach.ground import Ground

Array = NDArray[np.float64]
Bools = NDArray[np.bool_]

TOUCH_MARGIN = 0.02
"""Bodies touch a lane by this much, or are this far from it [m]."""
DISTANCE_MARGIN = 0.05
"""R_G1's safe distance is kept by this much [m]."""
RELATIONS = ("current", "left", "right", "opposite")

Area = tuple[Prepared, Prepared]
"""Of a lane: (shrunk, grown) by `TOUCH_MARGIN`."""


@dataclass(frozen=True, slots=True, eq=False)
class Lanes:
    """For each relation the areas of its lanes: (shrunk, grown) by `TOUCH_MARGIN`."""

    areas: Mapping[str, tuple[Area, ...]]

    @staticmethod
    def of(ground: Ground) -> Lanes:
        """The lanes that formulas can speak of."""
        found: dict[str, tuple[Area, ...]] = {}
        for relation in RELATIONS:
            lanes = [lane for lane in ground.scene.lanes if lane.relation == relation]
            found[relation] = tuple(_areas(ground, lane.lanelets) for lane in lanes)
        return Lanes(found)


def _areas(ground: Ground, lanelets: tuple[int, ...]) -> Area:
    import shapely

    parts = [x.area() for x in ground.scene.lanelets if x.id in lanelets]
    area = shapely.union_all(parts)
    return Prepared(area.buffer(-TOUCH_MARGIN)), Prepared(area.buffer(TOUCH_MARGIN))


@dataclass(frozen=True, slots=True, eq=False)
class Steps:
    """N trajectories at the prediction's steps k = 0..h.

    `bodies` (N, h+1, 4, 2) corners; `speed` (N, h+1) of the body's centre and `along` (N, h+1) of
    its foot point on the reference line [m/s]; `position` (N, h+1, 2) = (s, d); `inputs`
    (N, h+1, 2) the lowest and the highest acceleration of the interval that follows (the last: that
    came before).
    """

    bodies: Array
    speed: Array
    along: Array
    position: Array
    inputs: Array


def steps_of(ground: Ground, states: Array, inputs: Array, per_step: int) -> Steps:
    """What formulas speak of, for one trajectory (n+1, 5) with `per_step` fine steps per dt."""
    scene = ground.scene
    at = states[::per_step]
    position = scene.frame.to_curvilinear(at[:, :2])
    beta = np.arctan(np.tan(at[:, 4]) / 2)
    relative = at[:, 2] + beta - scene.frame.heading(position[:, 0])
    stretch = 1.0 - scene.frame.curvature(position[:, 0]) * position[:, 1]
    by_step = inputs[:, 0].reshape(-1, per_step)
    ranges = np.column_stack([by_step.min(axis=1), by_step.max(axis=1)])
    return Steps(
        corners(at, scene.ego)[None],
        at[None, :, SPEED],
        (at[:, SPEED] * np.cos(relative) / stretch)[None],
        position[None],
        np.vstack([ranges, ranges[-1:]])[None],
    )


def satisfies(ground: Ground, lanes: Lanes, spec: Specification, steps: Steps) -> Bools:
    """(N,) whether the formula holds under every reading of a trajectory's letters.

    Raises:
        FormulaError: if an atom names a predicate, lane or lanelet that is not known here.
    """
    reading = _Reading(ground, lanes, steps)
    atoms = sorted(atoms_of(spec.formula), key=str)
    known: dict[bytes, bool] = {}  # most readings agree, and many trajectories do
    found = np.ones(len(steps.speed), dtype=np.bool_)
    for sign, speed, which in product((1.0, -1.0), (steps.speed, steps.along), (0, 1)):
        if not found.any():
            break
        letters = np.empty((len(atoms), *speed.shape), dtype=np.bool_)
        for row, atom in zip(letters, atoms, strict=True):
            row[:] = reading.truth(atom, sign, speed, which)
        for i in np.flatnonzero(found).tolist():
            key = letters[:, i].tobytes()
            if key not in known:
                columns = letters[:, i].T.tolist()
                trace = [dict(zip(atoms, column, strict=True)) for column in columns]
                known[key] = evaluate(spec.formula, trace)
            found[i] = known[key]
    return found


class _Reading:
    """Which atoms hold for N trajectories, made harder to satisfy (sign 1) or easier (-1)."""

    def __init__(self, ground: Ground, lanes: Lanes, steps: Steps) -> None:
        import shapely

        self.ground, self.lanes, self.steps = ground, lanes, steps
        self.bodies = shapely.polygons(steps.bodies)
        self.touched: dict[tuple[str, float], Bools] = {}

    def truth(self, atom: Atom, sign: float, speed: Array, which: int) -> Bools:
        """(N, h+1) of an atom; `speed`, `which`: of the two speeds and inputs of each step."""
        steps = self.steps
        if isinstance(atom, Comparison):
            value = {
                "a": steps.inputs[..., which],
                "v": speed,
                "s": steps.position[..., 0],
                "d": steps.position[..., 1],
            }[atom.variable]
            shifted = value + sign * MARGIN / 2
            return shifted <= atom.bound if atom.op == "<=" else shifted < atom.bound
        assert isinstance(atom, Predicate)
        match atom.name:
            case "in_lane" if atom.argument in RELATIONS:
                return self._in_lane(atom.argument, sign)
            case "in_lanelet" if atom.argument is not None and atom.argument.isdigit():
                return self._touch((_areas(self.ground, (int(atom.argument),)),), sign)
            case "keeps_safe_distance" if atom.argument == "preceding":
                return self._keeps_distance(speed, sign)
            case "keeps_lane_speed_limit":
                at = steps.position[..., 0]
                return _keeps_limit(self.ground, at, speed + sign * MARGIN / 2)
        raise FormulaError(f"unknown predicate '{atom}' in a formula that is to be planned for")

    def _in_lane(self, relation: str, sign: float) -> Bools:
        if (relation, sign) not in self.touched:
            self.touched[relation, sign] = self._touch(self.lanes.areas[relation], sign)
        return self.touched[relation, sign]

    def _touch(self, areas: tuple[Area, ...], sign: float) -> Bools:
        """Whether each body touches one of the areas; for sure if sign = 1, perhaps if -1."""
        found = np.zeros(self.bodies.shape, dtype=np.bool_)
        for shrunk, grown in areas:
            found |= (shrunk if sign > 0 else grown).intersects(self.bodies)
        return found

    def _keeps_distance(self, speed: Array, sign: float) -> Bools:
        """R_G1 (paper eq. 5, 6): the nearest vehicle in front in each lane that a body touches."""
        ground, settings = self.ground, self.ground.settings
        front = self.steps.position[..., 0] + ground.scene.ego.length / 2 + sign * DISTANCE_MARGIN
        needed = speed**2 / (2 * abs(settings.a_min)) + speed * settings.t_d
        kept = np.ones(front.shape, dtype=np.bool_)
        for (relation, _), by_step in zip(ground.bands, ground.leaders, strict=True):
            for i, k in np.argwhere(self._in_lane(relation, -sign)).tolist():
                # With the margin against us a vehicle that is level with the front still precedes.
                nearest = front[i, k] - (2 * DISTANCE_MARGIN if sign > 0 else 0.0)
                ahead = next((x for x in by_step[k] if x.rear > nearest), None)
                if ahead is not None:
                    room = ahead.rear - front[i, k] + ahead.speed**2 / (2 * abs(settings.a_obs_min))
                    kept[i, k] &= bool(room > needed[i, k])
        return kept


def _keeps_limit(ground: Ground, s: Array, speed: Array) -> Bools:
    """R_G3: the lowest limit of the own lanes at s; an unknown limit is kept."""
    kept = np.ones(s.shape, dtype=np.bool_)
    for low, high, lowest, _ in ground.limits:
        if lowest is not None:
            kept &= (s < low) | (s > high) | (speed <= lowest)
    return kept
