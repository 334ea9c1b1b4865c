"""The five rows of the paper's case study (DEU_Goeppingen-37_1_T-4, h = 25, dt = 0.1 s).

Three agree with the paper. For the other two the paper's set becomes empty; here a trajectory is
laid out that satisfies the specification and collides with nobody: see docs/case-study.md.
"""

import json
from dataclasses import dataclass
from functools import cache
from math import sqrt
from pathlib import Path

import numpy as np
import pytest
import shapely

from reach_particles import World, rectangles, road, shape
from sandra.actions import ActionPair
from sandra.logic import Comparison, Predicate, evaluate
from sandra.prediction import predict
from sandra.reach import Ground, Verdict, ground, verify_pair
from sandra.scene import Scene, load
from sandra.settings import Settings

HORIZON = 25
NAME = "DEU_Goeppingen-37_1_T-4"
TARGET = -1.79
"""d of the trajectory after its lane change [m]."""


@cache
def scene(folder: Path) -> Scene:
    return load(folder / "data" / "scenarios" / f"{NAME}.xml")


@cache
def grounded(folder: Path, kind: str) -> Ground:
    settings = Settings(horizon=HORIZON)
    one = scene(folder)
    return ground(one, predict(one, kind, HORIZON, settings), settings)


def row(folder: Path, index: int) -> tuple[dict[str, object], Verdict]:
    """A row of the paper's table, and our verdict for it."""
    tables = json.loads((folder / "data" / "paper" / "tables.json").read_text())
    entry = tables["case_study"]["verdicts"][index]
    assert tables["case_study"]["h"] == HORIZON
    base = grounded(folder, entry["prediction"])
    return entry, verify_pair(base, ActionPair.of(*entry["pair"]), tuple(entry["rules"]))


@pytest.mark.parametrize("index", [2, 3, 4])
def test_rows_that_agree(shared: Path, index: int) -> None:
    entry, verdict = row(shared, index)
    assert (verdict.first_empty_step is not None) == entry["empty"], str(verdict)


@dataclass(frozen=True)
class Drive:
    """A constant acceleration along the lane; bang-bang across it, then straight on."""

    start: tuple[float, float, float, float]
    a: float
    lateral: float
    target: float

    def times(self) -> tuple[float, float]:
        """Durations [s] of pushing to the right, and of taking the lateral speed out again."""
        _, _, d, w = self.start
        # With t2 = t1 + w / a the lateral speed ends at 0, and d at
        # d + w t1 - a t1^2 / 2 - a t2^2 / 2; the root for t1:
        a = self.lateral
        t1 = sqrt((d - self.target) / a + (w / a) ** 2 / 2) + w / a
        return t1, t1 - w / a

    def states(self, t: np.ndarray) -> np.ndarray:
        """(n, 4) states s, v_s, d, v_d at times t [s]."""
        s, v, d, w = self.start
        t1, t2 = self.times()
        a = self.lateral
        out, back = np.minimum(t, t1), np.clip(t - t1, 0.0, t2)
        speed = w - a * out + a * back
        offset = d + w * out - a * out**2 / 2 + (w - a * t1) * back + a * back**2 / 2
        return np.column_stack([s + v * t + self.a * t**2 / 2, v + self.a * t, offset, speed])


def bodies(base: Ground, states: np.ndarray) -> np.ndarray:
    """The ego's rectangles, heading where they move."""
    frame, ego = base.scene.frame, base.scene.ego
    s, v, d, w = states.T
    heading = frame.heading(s) + np.arctan2(w, v * (1.0 - frame.curvature(s) * d))
    return rectangles(frame.to_cartesian(states[:, [0, 2]]), heading, ego.length, ego.width)


def clearance(base: Ground, drive: Drive, parts: int = 10) -> float:
    """Smallest distance [m] between the ego's rectangle and another body, `parts` per step."""
    dt = base.scene.dt
    times = np.arange(HORIZON * parts + 1) / parts
    mine = bodies(base, drive.states(times * dt))
    closest = np.inf
    for other in base.prediction.obstacles:
        k = np.arange(HORIZON + 1)
        x, y = (np.interp(times, k, other.states[:, i]) for i in (0, 1))
        heading = np.interp(times, k, np.unwrap(other.states[:, 2]))
        for i in np.flatnonzero(np.isfinite(x)):
            body = shape(other.obstacle.outline.placed(x[i], y[i], heading[i]))
            closest = min(closest, shapely.distance(mine[i], body))
    return closest


@pytest.mark.parametrize(("index", "a"), [(0, 0.201), (1, 0.0), (1, 0.15)])
def test_rows_that_do_not_agree_have_a_compliant_trajectory(
    shared: Path, index: int, a: float
) -> None:
    entry, verdict = row(shared, index)
    base = grounded(shared, "most-likely")
    assert entry["empty"]
    assert verdict.first_empty_step is None

    # a trajectory of the model: within its bounds at all times
    settings = base.settings
    drive = Drive((*base.lon[0], *base.lat[0]), a, settings.a_lat_max, TARGET)
    assert sum(drive.times()) < 1.4
    states = drive.states(np.arange(HORIZON + 1) * base.scene.dt)
    assert settings.a_lon_min <= a <= settings.a_lon_max
    assert (states[:, 1] <= settings.v_max).all()
    assert states[0] == pytest.approx([*base.lon[0], *base.lat[0]])
    assert states[-1, 2] == pytest.approx(TARGET)
    assert states[-1, 3] == pytest.approx(0.0, abs=1e-9)

    # that collides with nobody, the whole body, at steps and between them, and stays on the road
    assert clearance(base, drive) > 0.01
    mine = bodies(base, states)
    regions = [o.at for o in base.prediction.obstacles]
    for k, body in enumerate(mine):
        assert not any(shape(r).intersects(body) for at in regions for r in at[k])
    assert shapely.covers(road(base), mine).all()

    # that satisfies the formula by direct evaluation
    world = World(base)
    xy = base.scene.frame.to_cartesian(states[:, [0, 2]])
    heading = base.scene.frame.heading(states[:, 0]) + np.arctan2(states[:, 3], states[:, 1])
    letters = []
    for k in range(HORIZON + 1):
        letter = {}
        for atom in verdict.specification.dfa.atoms:
            if isinstance(atom, Comparison) and atom.variable == "a":
                letter[atom] = atom.holds(a)
            else:
                assert isinstance(atom, Predicate)
                one = slice(k, k + 1)
                letter[atom] = bool(world.truth(atom, states[one], xy[one], heading[one], k)[0])
        letters.append(letter)
    assert evaluate(verdict.specification.formula, letters)

    # hence the set must not be empty, and it is not
    found = verdict.reachable_set
    assert all(found.contains(k, *state) for k, state in enumerate(states))


def test_the_gap_is_wider_than_the_ego(shared: Path) -> None:
    """Between 20074 in the own lane and 20076 in the right one: 7 cm more than the ego's width."""
    base = grounded(shared, "most-likely")
    sides = {}
    for other in base.prediction.obstacles:
        if other.obstacle.id in (20074, 20076):
            row = other.states[HORIZON]
            corners = other.obstacle.outline.placed(*row[:3]).vertices
            sides[other.obstacle.id] = base.scene.frame.to_curvilinear(corners)[:, 1]
    gap = sides[20074].min() - sides[20076].max()
    assert gap == pytest.approx(1.68, abs=0.02)
    assert gap > base.scene.ego.width
