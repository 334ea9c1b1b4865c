"""The letters that a planned trajectory gives, from geometry, and whether they satisfy a formula.

Letter k holds the state at t_k and the acceleration input of [t_k, t_k+1]; the last letter has
that of the last interval. A planned trajectory must satisfy its formula with room to spare: under
every reading of its letters, each of which shifts what is continuous by a small margin to one
side. For a formula without negations one of them is the strictest; for any other, all count.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
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
    """A trajectory at the prediction's steps k = 0..h.

    `bodies` (h+1, 4, 2) corners; `speed` (h+1,) of the body's centre and `along` (h+1,) of its
    foot point on the reference line [m/s]; `position` (h+1, 2) = (s, d); `inputs` (h+1, 2) the
    lowest and the highest acceleration of the interval that follows (the last: that came before).
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
        corners(at, scene.ego),
        at[:, SPEED],
        at[:, SPEED] * np.cos(relative) / stretch,
        position,
        np.vstack([ranges, ranges[-1:]]),
    )


def satisfies(ground: Ground, lanes: Lanes, spec: Specification, steps: Steps) -> bool:
    """Whether the formula holds under every reading of the trajectory's letters.

    Raises:
        FormulaError: if an atom names a predicate, lane or lanelet that is not known here.
    """
    seen = []
    for sign, speed, which in product((1.0, -1.0), (steps.speed, steps.along), (0, 1)):
        trace = _letters(ground, lanes, atoms_of(spec.formula), steps, sign, speed, which)
        if trace not in seen:  # most readings agree
            seen.append(trace)
            if not evaluate(spec.formula, trace):
                return False
    return True


def _letters(
    ground: Ground,
    lanes: Lanes,
    atoms: Iterable[Atom],
    steps: Steps,
    sign: float,
    speed: Array,
    which: int,
) -> list[dict[Atom, bool]]:
    """Letters with every atom made harder to satisfy (sign 1) or easier (-1)."""
    values = {
        "a": steps.inputs[:, which],
        "v": speed,
        "s": steps.position[:, 0],
        "d": steps.position[:, 1],
    }
    truth: dict[Atom, NDArray[np.bool_]] = {}
    for atom in atoms:
        if isinstance(atom, Comparison):
            shifted = values[atom.variable] + sign * MARGIN / 2
            bound = atom.bound
            truth[atom] = shifted <= bound if atom.op == "<=" else shifted < bound
        else:
            assert isinstance(atom, Predicate)
            truth[atom] = _predicate(ground, lanes, atom, steps, sign, speed)
    return [
        {atom: bool(values[k]) for atom, values in truth.items()} for k in range(len(steps.speed))
    ]


def _predicate(
    ground: Ground, lanes: Lanes, atom: Predicate, steps: Steps, sign: float, speed: Array
) -> NDArray[np.bool_]:
    match atom.name:
        case "in_lane" if atom.argument in RELATIONS:
            return _touches(lanes.areas[atom.argument], steps.bodies, sign)
        case "in_lanelet" if atom.argument is not None and atom.argument.isdigit():
            return _touches((_areas(ground, (int(atom.argument),)),), steps.bodies, sign)
        case "keeps_safe_distance" if atom.argument == "preceding":
            return _keeps_distance(ground, lanes, replace(steps, speed=speed), sign)
        case "keeps_lane_speed_limit":
            return _keeps_limit(ground, steps.position[:, 0], speed + sign * MARGIN / 2)
    raise FormulaError(f"unknown predicate '{atom}' in a formula that is to be planned for")


def _touches(areas: tuple[Area, ...], bodies: Array, sign: float) -> NDArray[np.bool_]:
    """Whether each body touches one of the areas; for sure if sign = 1, perhaps if -1."""
    import shapely

    found = np.zeros(len(bodies), dtype=np.bool_)
    polygons = shapely.polygons(bodies)
    for shrunk, grown in areas:
        found |= (shrunk if sign > 0 else grown).intersects(polygons)
    return found


def _keeps_distance(ground: Ground, lanes: Lanes, steps: Steps, sign: float) -> NDArray[np.bool_]:
    """R_G1 (paper eq. 5, 6): the nearest vehicle in front in each lane that the body touches."""
    settings = ground.settings
    front = steps.position[:, 0] + ground.scene.ego.length / 2 + sign * DISTANCE_MARGIN
    speed = steps.speed
    needed = speed**2 / (2 * abs(settings.a_min)) + speed * settings.t_d
    kept = np.ones(len(front), dtype=np.bool_)
    touched = {
        relation: _touches(areas, steps.bodies, -sign)
        for relation, areas in lanes.areas.items()
        if areas
    }
    for (relation, _), by_step in zip(ground.bands, ground.leaders, strict=True):
        for k in np.flatnonzero(touched[relation]).tolist():
            # With the margin against us a vehicle that is level with the front still precedes.
            nearest = front[k] - (2 * DISTANCE_MARGIN if sign > 0 else 0.0)
            ahead = next((x for x in by_step[k] if x.rear > nearest), None)
            if ahead is not None:
                room = ahead.rear - front[k] + ahead.speed**2 / (2 * abs(settings.a_obs_min))
                kept[k] &= bool(room > needed[k])
    return kept


def _keeps_limit(ground: Ground, s: Array, speed: Array) -> NDArray[np.bool_]:
    """R_G3: the lowest limit of the own lanes at s; an unknown limit is kept."""
    kept = np.ones(len(s), dtype=np.bool_)
    for low, high, lowest, _ in ground.limits:
        if lowest is not None:
            kept &= (s < low) | (s > high) | (speed <= lowest)
    return kept
