"""A recorded trajectory as the letters that the formulas of the action pairs speak of.

Letter k holds the state at t_k and the acceleration in [t_k, t_k+1], from the difference of the
recorded speeds; the last one repeats the one before. Nothing is given a margin: a label says what
was recorded, it proves nothing.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray

from sandra.errors import FormulaError, ScenarioError
from sandra.logic.formula import Atom, Comparison, Predicate
from sandra.scene.types import Scene, areas, placed

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Recorded:
    """What the ego of a scene did: (h+1, 5) states, and the accelerations (h,) [m/s^2]."""

    scene: Scene
    states: Array
    accelerations: Array

    @staticmethod
    def of(scene: Scene, horizon: int) -> Recorded:
        """The first `horizon` steps of the recorded ego.

        Raises:
            ScenarioError: the scene holds no recording of its ego, or a shorter one.
        """
        given = scene.recorded_ego
        if given is None:
            raise ScenarioError(f"{scene.name}: the ego is not recorded; choose a recorded vehicle")
        states = given[: horizon + 1]
        if horizon < 1 or len(states) < horizon + 1 or np.isnan(states[:, :4]).any():
            seen = int(np.argmax(np.isnan(np.append(states[:, 0], np.nan))))
            raise ScenarioError(
                f"{scene.name}: vehicle {scene.ego.id} is recorded for {max(seen - 1, 0)} steps, "
                f"not for {horizon}; choose a shorter horizon, at least 1"
            )
        return Recorded(scene, states, np.diff(states[:, 3]) / scene.dt)

    @property
    def mean_acceleration(self) -> float:
        """Over the whole window [m/s^2]."""
        return float(self.accelerations.mean())

    def centre_in(self, relation: str, k: int = -1) -> bool:
        """Whether the centre of the body lies in the lane of that relation at step k."""
        centre = shapely.Point(self.states[k, :2])
        return any(bool(area.intersects(centre)) for area in _lanes(self.scene, relation))

    def letters(self, atoms: Iterable[Atom]) -> list[dict[Atom, bool]]:
        """(h+1) letters: the truth of each atom at each step.

        Raises:
            FormulaError: for a predicate that is no action's.
        """
        truth = {atom: self._truth(atom) for atom in atoms}
        return [
            {atom: bool(values[k]) for atom, values in truth.items()}
            for k in range(len(self.states))
        ]

    def _truth(self, atom: Atom) -> NDArray[np.bool_]:
        if isinstance(atom, Comparison):
            values = self._values(atom.variable)
            return np.array([atom.holds(float(value)) for value in values])
        assert isinstance(atom, Predicate)
        if atom.name != "in_lane" or atom.argument is None:
            raise FormulaError(f"'{atom}' is no predicate of an action: labels know in_lane alone")
        bodies = shapely.polygons(placed(self.scene.ego.outline.vertices, self.states[:, :3]))
        found = np.zeros(len(bodies), dtype=np.bool_)
        for area in _lanes(self.scene, atom.argument):
            found |= shapely.intersects(area, bodies)
        return found

    def _values(self, variable: str) -> Array:
        if variable == "a":
            return np.append(self.accelerations, self.accelerations[-1])
        if variable == "v":
            return self.states[:, 3]
        along, across = self.scene.frame.to_curvilinear(self.states[:, :2]).T
        return np.asarray(along if variable == "s" else across)


def _lanes(scene: Scene, relation: str) -> list[shapely.Geometry]:
    ids = {i for lane in scene.lanes if lane.relation == relation for i in lane.lanelets}
    return areas([x for x in scene.lanelets if x.id in ids])
