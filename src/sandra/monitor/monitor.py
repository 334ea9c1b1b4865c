"""Quantitative semantics of R_G1, R_G2 and R_G3 on a trajectory that was driven.

Each rule is G(predicate); its robustness is the smallest of the predicate's values over time
(Donze & Maler 2010; paper, Fig. "Robustness evaluation of the simulated trajectories").
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import shapely
from numpy.typing import NDArray

from sandra.errors import FormulaError, ScenarioError
from sandra.logic import parse_rules
from sandra.monitor.distance import NOBODY, Others, leaders, safe_distance
from sandra.monitor.lanes import driven_lanes
from sandra.monitor.limits import signed_limits
from sandra.monitor.types import Robustness, RuleRobustness
from sandra.scene.types import Scene, placed
from sandra.settings import Settings

Array = NDArray[np.float64]
Bools = NDArray[np.bool_]

RULES = ("R_G1", "R_G2", "R_G3")


def monitor(
    scene: Scene,
    rules: str | Sequence[str] = RULES,
    settings: Settings | None = None,
    states: Array | None = None,
    justified: Bools | None = None,
) -> Robustness:
    """How well a driven trajectory keeps the rules.

    Args:
        scene: with the recordings of the others, row 0 of which is the ego's row 0.
        rules: of R_G1, R_G2, R_G3; or text, "R_G1,R_G3".
        settings: the parameters, the same as the verifier's.
        states: (n, 5) of the ego: x, y of its centre [m], heading [rad], speed [m/s],
            acceleration [m/s^2] from this step on; NaN rows where it is not known. Where only the
            acceleration is NaN, it is derived from the speeds. Default: `scene.recorded_ego`.
        justified: (n,) steps at which abrupt braking is justified (R_G2): a fail-safe is driven.

    Raises:
        ScenarioError: no trajectory of the ego, or one of the wrong shape.
        FormulaError: a rule that is not monitored.
    """
    settings = Settings() if settings is None else settings
    names = parse_rules(rules) if isinstance(rules, str) else tuple(rules)
    for name in names:
        if name not in RULES:
            raise FormulaError(f"rule '{name}' is not monitored: choose from {', '.join(RULES)}")
    if not names:
        raise FormulaError(f"no rule to monitor: choose from {', '.join(RULES)}")
    states = _trajectory(scene, states)
    excused = _mask(justified, len(states))
    seen = np.asarray(np.isfinite(states[:, :4]).all(axis=1))
    limits, off = np.full(len(states), np.nan), np.zeros(len(states), dtype=bool)
    limits[seen], off[seen] = signed_limits(scene, states[seen, :3])
    found = []
    for name in names:
        match name:
            case "R_G1":
                found.append(_safe_distance(scene, states, seen, settings))
            case "R_G2":
                found.append(_abrupt_braking(scene, states, seen, excused, settings))
            case _:
                found.append(_speed_limit(states, seen, limits, settings))
    return Robustness(scene.name, scene.dt, tuple(found), limits, off)


def _safe_distance(scene: Scene, states: Array, seen: Bools, s: Settings) -> RuleRobustness:
    shapes = np.full(len(states), None, dtype=object)
    shapes[seen] = shapely.polygons(placed(scene.ego.outline.vertices, states[seen, :3]))
    others = Others.of(scene, len(states))
    lanes = driven_lanes(scene.lanelets, shapes, states[:, :3])
    found = leaders(states, shapes, scene.ego.length, lanes, others, s, scene.dt)
    values = np.where(seen, found.slack, np.nan)
    scale = float(safe_distance(np.array(s.v_max), np.array(0.0), s))
    ids = tuple(None if i == NOBODY else int(i) for i in found.who)
    return RuleRobustness("R_G1", "m", values, ~(values <= 0.0), scale, ids)


def _abrupt_braking(
    scene: Scene, states: Array, seen: Bools, excused: Bools, s: Settings
) -> RuleRobustness:
    values = np.where(seen, _accelerations(states, scene.dt) - s.a_abrupt, np.nan)
    values = np.where(seen & excused, np.inf, values)
    scale = s.a_abrupt - s.a_lon_min
    return RuleRobustness("R_G2", "m/s^2", values, ~(values < 0.0), scale if scale > 0 else 1.0)


def _speed_limit(states: Array, seen: Bools, limits: Array, s: Settings) -> RuleRobustness:
    allowed = np.fmin(limits, min(s.v_fov, s.v_braking, s.v_type))
    values = np.where(seen, allowed - states[:, 3], np.nan)
    return RuleRobustness("R_G3", "m/s", values, ~(values < 0.0), s.v_max)


def _accelerations(states: Array, dt: float) -> Array:
    """(n,) as recorded; else of the speeds to the next step, at the end from the one before."""
    given, speed = states[:, 4], states[:, 3]
    ahead = np.append(np.diff(speed) / dt, np.nan)
    behind = np.insert(ahead[:-1], 0, np.nan)
    derived = np.where(np.isfinite(ahead), ahead, np.where(np.isfinite(behind), behind, 0.0))
    return np.where(np.isfinite(given), given, derived)


def _trajectory(scene: Scene, states: Array | None) -> Array:
    if states is None:
        states = scene.recorded_ego
    if states is None:
        raise ScenarioError(
            f"{scene.name}: the ego is not recorded; give `states`, or a file with a moving "
            "obstacle that starts where the planning problem does"
        )
    states = np.asarray(states, dtype=float)
    if states.ndim != 2 or states.shape[1] != 5 or not np.isfinite(states[:, :4]).all(axis=1).any():
        raise ScenarioError(
            f"{scene.name}: a trajectory of shape {states.shape} cannot be monitored; give one row "
            "x, y, heading, speed, acceleration per step, at least one of them without NaN"
        )
    return states


def _mask(justified: Bools | None, n: int) -> Bools:
    if justified is None:
        return np.zeros(n, dtype=bool)
    mask = np.asarray(justified)
    if mask.dtype != bool or mask.shape != (n,):
        raise ScenarioError(
            f"`justified` has shape {mask.shape} and type {mask.dtype}; give {n} booleans, one per "
            "step of the trajectory"
        )
    return mask
