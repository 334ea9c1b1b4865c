"""A driving corridor as plain data, for a planner in another program or another language."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from sandra.actions import ActionPair
from sandra.errors import SandraError
from sandra.reach.ground import Ground
from sandra.reach.polygon import range_y
from sandra.reach.sets import BaseSet
from sandra.reach.verdict import Verdict, Verdicts
from sandra.scene.types import Lanelet, Region

Array = NDArray[np.float64]

FORMAT = "sandra-corridor/1"
"""Name and version of the format."""
NEAR = 50.0
"""Lanelets so far around the corridor are told [m]."""


def corridor_data(verdicts: Verdicts, pair: ActionPair | str | int) -> dict[str, Any]:
    """The driving corridor of one pair, and what a planner needs beside it; ready for JSON.

    Lengths in m, angles in rad, SI units. Entries:

    * `format`, `scenario`, `pair`, `formula`, `prediction`, `dt`, `horizon`
    * `reference`: points of the line along which s is measured from its first point; d is the
      distance to the left of it. Beyond its ends it goes straight on.
    * `ego`: x, y of the body's centre, heading, speed, acceleration, steering_angle, yaw_rate, the
      same place as s and d, and length, width, wheelbase
    * `limits`: bounds of the acceleration, lateral acceleration, speed, steering angle and rate
    * `steps`: for each k = 0..horizon the parts of the corridor, each with the ranges (low, high)
      of `s`, `d`, `speed` = ds/dt, `lateral_speed` = dd/dt, the range of the `acceleration` with
      which it goes on, and `parents`, the places in the step before of the parts it follows
    * `road`: lanelets nearby, `left` and `right` border of each
    * `others`: id, kind, and for each step k < horizon the regions that hold the body in
      [t_k, t_k+1]: convex polygons `vertices` widened by `radius`; no collision with any of them
      is what the certificate will ask for.

    Every trajectory that satisfies the formula and collides with nobody lies in the corridor; that
    one lies in it is necessary for that, not sufficient (`sandra.certify_trajectory` decides).

    Raises:
        KeyError: for a pair that was not verified. SandraError: for one that is UNSAFE.
    """
    verdict = verdicts[pair]
    if verdict.first_empty_step is not None:
        raise SandraError(f"{verdict.pair} is UNSAFE and has no corridor ({verdict.reason})")
    base = verdicts.ground
    settings = base.settings
    corridor = verdict.reachable_set.corridor()
    return {
        "format": FORMAT,
        "scenario": base.scene.name,
        "pair": verdict.pair.to_dict(),
        "formula": str(verdict.specification.formula),
        "prediction": base.prediction.kind,
        "dt": base.scene.dt,
        "horizon": base.horizon,
        "reference": base.scene.frame.line.tolist(),
        "ego": _ego(base),
        "limits": {
            "acceleration": [settings.a_lon_min, settings.a_lon_max],
            "lateral_acceleration": settings.a_lat_max,
            "speed": settings.v_max,
            "steering_angle": settings.steering_angle_max,
            "steering_rate": settings.steering_rate_max,
        },
        "steps": [[_part(part) for part in step] for step in corridor.steps],
        "road": [
            {"id": x.id, "left": x.left.tolist(), "right": x.right.tolist()}
            for x in _nearby(base, verdict)
        ],
        "others": [
            {
                "id": each.obstacle.id,
                "kind": each.obstacle.kind,
                "between": [[_region(region) for region in regions] for regions in each.between],
            }
            for each in base.prediction.obstacles
        ],
    }


def _ego(base: Ground) -> dict[str, float]:
    ego, state = base.scene.ego, base.scene.ego.state
    s, d, *_ = base.scene.ego_curvilinear
    names = ("x", "y", "heading", "speed", "acceleration", "steering_angle", "yaw_rate")
    return {
        **{name: float(getattr(state, name)) for name in names},
        "s": float(s),
        "d": float(d),
        "length": ego.length,
        "width": ego.width,
        "wheelbase": ego.wheelbase,
    }


def _part(part: BaseSet) -> dict[str, Any]:
    s_low, s_high, d_low, d_high = part.rectangle
    return {
        "s": [s_low, s_high],
        "d": [d_low, d_high],
        "speed": list(part.speeds),
        "lateral_speed": list(range_y(part.lat)),
        "acceleration": list(part.inputs),
        "parents": list(part.parents),
    }


def _region(region: Region) -> dict[str, Any]:
    return {"vertices": region.vertices.tolist(), "radius": float(region.radius)}


def _nearby(base: Ground, verdict: Verdict) -> list[Lanelet]:
    """The lanelets whose bounding box comes near to the box of all positions."""
    rectangles = [b.rectangle for step in verdict.reachable_set.steps for b in step]
    places = np.array([(s, d) for a, b, c, e in rectangles for s in (a, b) for d in (c, e)])
    points = base.scene.frame.to_cartesian(places)
    low, high = points.min(axis=0) - NEAR, points.max(axis=0) + NEAR
    found = []
    for lanelet in base.scene.lanelets:
        border = np.vstack([lanelet.left, lanelet.right])
        if (border.max(axis=0) >= low).all() and (border.min(axis=0) <= high).all():
            found.append(lanelet)
    return found
