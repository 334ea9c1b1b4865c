"""From a scene and a prediction to what the kernel reads: the ground on which all pairs stand.

Everything here is the same for all twelve pairs and computed once. Collisions are decided with
the disc inscribed in the ego's body, which lies within the body whatever its heading is.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from math import hypot, isclose

import numpy as np
from numpy.typing import NDArray

from sandra.errors import SettingsError
from sandra.logic import Atom
from sandra.prediction.types import Prediction
from sandra.reach.bands import Band, Leader, Limit, bands, leaders, limits
from sandra.reach.cells import bulge, grid, off_road
from sandra.reach.initial import initial_set, lattice_of
from sandra.reach.later import Later
from sandra.reach.lattice import Lattice, Mask
from sandra.reach.occupied import occupied_by, united
from sandra.reach.polygon import Polygon
from sandra.reach.problem import Answer
from sandra.reach.windows import Lines, Windows
from sandra.scene.types import Scene
from sandra.settings import Settings

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Ground:
    """The lattice, the ego's initial set, and the forbidden cells by cause."""

    scene: Scene
    prediction: Prediction
    settings: Settings
    lattice: Lattice
    lon: Polygon
    lat: Polygon
    curvature: tuple[Array, Array]
    """Lowest and highest curvature of the reference line in each column [1/m]."""
    off_road: Mask
    by_obstacle: Sequence[Windows]
    """For each predicted obstacle and each step, its forbidden windows."""
    forbidden: Sequence[Mask]
    """Union of all causes at each step."""
    bands: tuple[tuple[str, Band], ...]
    """(relation, band) of the lanes that rules and actions speak of."""
    leaders: Sequence[tuple[tuple[Leader, ...], ...]]
    """For each band and each step, the vehicles in it; R_G1 alone asks for them."""
    limits: tuple[Limit, ...]
    """Signed speed limits along s."""
    answers: dict[Atom, Answer] = field(default_factory=dict, init=False, repr=False)
    """What `answers_of` has found for each atom: always the same, so found once."""

    @property
    def horizon(self) -> int:
        """Number of steps h."""
        return self.prediction.horizon

    def forbidden_without(self, obstacle: int | None, road: bool = True) -> Sequence[Mask]:
        """The union of all causes but one obstacle (its index) or, `road` False, the border."""
        off_road = self.off_road if road else np.zeros_like(self.off_road)
        return united(self.lattice, off_road, self.by_obstacle, self.horizon, without=obstacle)

    def obstacles_at(self, k: int, cells: Mask) -> list[int]:
        """Indices of the obstacles that forbid some of `cells` at step k, most cells first."""
        counts = []
        for index, steps in enumerate(self.by_obstacle):
            count = sum(
                int((mask & cells[i0:i1, j0:j1]).sum()) for i0, i1, j0, j1, mask in steps[k]
            )
            if count:
                counts.append((-count, index))
        return [index for _, index in sorted(counts)]


def ground(scene: Scene, prediction: Prediction, settings: Settings) -> Ground:
    """Prepare the reachability analysis of `scene` under `prediction`.

    Raises:
        SettingsError: if the prediction was made with another time increment.
    """
    if not isclose(prediction.dt, scene.dt):
        raise SettingsError(
            f"the prediction has dt = {prediction.dt} s, the scene {scene.dt} s: predict again"
        )
    lon, lat = initial_set(scene, settings)
    lattice = lattice_of(scene, prediction.horizon, lon, lat, settings)
    beyond_road, occupied, forbidden = forbidden_cells(scene, prediction, lattice)
    samples = np.linspace(0.0, 1.0, 5)
    kappa = scene.frame.curvature((lattice.corners()[0][:-1, None] + lattice.ds * samples).ravel())
    kappa = kappa.reshape(lattice.columns, samples.size)
    radius = hypot(scene.ego.length, scene.ego.width) / 2
    known = ("current", "left", "right", "opposite")
    lanes = tuple(lane for lane in scene.lanes if lane.relation in known)
    of_lanes = bands(scene.frame, lattice, [(x.left, x.right) for x in lanes], radius)
    return Ground(
        scene,
        prediction,
        settings,
        lattice,
        lon,
        lat,
        (kappa.min(axis=1), kappa.max(axis=1)),
        beyond_road,
        occupied,
        forbidden,
        tuple((lane.relation, each) for lane, each in zip(lanes, of_lanes, strict=True)),
        Later(lambda: leaders(scene, prediction, settings, lanes)),
        limits(scene, tuple(x for x in (scene.current, scene.left, scene.right) if x)),
    )


def forbidden_cells(
    scene: Scene, prediction: Prediction, lattice: Lattice
) -> tuple[Mask, Sequence[Windows], Sequence[Mask]]:
    """The cells off the road, those that each obstacle forbids, and all of them at each step."""
    bulges = bulge(scene, lattice)
    beyond_road = off_road(scene, lattice, bulges)
    s, d = lattice.corners()
    ends = grid(scene, s, d[[0, -1]])
    lines = Lines.between(ends[:, 0], ends[:, 1], lattice.rows, scene.ego.width / 2 - bulges)
    occupied = occupied_by(prediction, lines)
    return beyond_road, occupied, united(lattice, beyond_road, occupied, prediction.horizon)
