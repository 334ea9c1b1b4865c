"""The fail-safe maneuver: full braking in the lane.

It is shown as what it is: nothing is proven of it yet (no collision check, no invariably safe
state); a fail-safe with a proof belongs to the certificate.
"""

from __future__ import annotations

from math import ceil, cos, sin

import numpy as np

from sandra.planning.bounds import moves, stands
from sandra.planning.types import Maneuver
from sandra.scene.types import Scene
from sandra.settings import Settings


def full_braking(scene: Scene, settings: Settings) -> Maneuver:
    """Brake with `a_lon_min` to a standstill, parallel to the current lane.

    What speed the ego has across its lane is braked off with at most `a_lat_max`.
    """
    dt = scene.dt
    s, d, heading, _ = scene.ego_curvilinear
    kappa = float(scene.frame.curvature(np.array([s]))[0])
    speed = scene.ego.state.speed
    v_s, v_d = speed * cos(heading) / (1.0 - kappa * d), speed * sin(heading)
    braking = min(settings.a_lon_min, -1e-3)
    steps = max(1, ceil(v_s / (-braking * dt) - 1e-9))
    t = dt * np.arange(steps + 1)
    t_s = np.minimum(t, max(v_s, 0.0) / -braking)
    t_d = np.minimum(t, abs(v_d) / settings.a_lat_max)
    sign = np.sign(v_d)
    path = np.column_stack(
        [
            s + v_s * t_s + braking * t_s**2 / 2,
            d + v_d * t_d - sign * settings.a_lat_max * t_d**2 / 2,
        ]
    )
    along = np.maximum(v_s + braking * t_s, 0.0)
    across = v_d - sign * settings.a_lat_max * t_d
    points = scene.frame.to_cartesian(path)
    # Along the path itself, not along the reference line.
    along *= np.maximum(1.0 - scene.frame.curvature(path[:, 0]) * path[:, 1], 0.0)
    relative = np.where(moves(along), np.arctan2(across, along), 0.0)
    acceleration = np.where(stands(along), 0.0, braking)
    states = np.column_stack(
        [
            points,
            scene.frame.heading(path[:, 0]) + relative,
            np.hypot(along, across),
            acceleration,
        ]
    )
    start = scene.ego.state
    states[0, :4] = start.x, start.y, start.heading, start.speed
    note = (
        f"full braking in the lane with {braking:g} m/s^2 to a standstill after "
        f"{path[-1, 0] - s:.1f} m; not proven collision-free"
    )
    return Maneuver("fail-safe", None, states, dt, note)
