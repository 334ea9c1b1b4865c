"""Conditions `road`, `standstill` and `conflict-area`: where the body is, and where it ends."""

from __future__ import annotations

from typing import Any

import numpy as np
import shapely

from sandra.certificate.geometry import bodies, by_id, outline, pavement, sweep
from sandra.certificate.motion import trajectories
from sandra.certificate.report import Checked, Violation
from sandra.certificate.types import Certificate

STANDING = 1e-6
"""Speeds up to this are a standstill [m/s]."""
OVERLAP = 1e-4
"""A body that shares less area than this with a conflict area only touches it [m^2]."""

SLIVER = 0.2
"""Overlaps of lanelets narrower than this are inaccuracies of the map [m]."""
OWN = ("current", "left", "right")
"""Lanes in the ego's direction."""


def road(c: Certificate) -> Checked | Violation:
    """All that the body covers, at and between grid points, lies on the union of the lanelets."""
    area = pavement(c.lanelets)
    shapely.prepare(area)
    border = shapely.boundary(area)
    least = np.inf
    for name, t in trajectories(c):
        swept = sweep(t, c.ego)
        inside = shapely.covers(area, swept.hulls)
        room = shapely.distance(border, swept.hulls) - swept.margins
        # Without any road the distance to its border is not a number.
        on_road = inside & (room >= 0.0)
        if not on_road.all():
            step = int(np.argmin(on_road))
            beyond = float(shapely.distance(border, swept.hulls[step]))
            return Violation(
                "road",
                f"{name}, step {step}: the body leaves the road",
                step,
                t.start + step * t.tau,
                beyond if inside[step] else -beyond,
                float(swept.margins[step]),
            )
        least = min(least, float(room.min(initial=np.inf)))
    return Checked("road", f"at least {least:.2f} m from the edge of the road", least, "m")


def standstill(c: Certificate) -> Checked | Violation:
    """The fail-safe ends in a standstill."""
    t = c.fail_safe
    last = float(t.states[-1, 3])
    time = t.start + t.tau * len(t.inputs)
    if not abs(last) <= STANDING:
        return Violation(
            "standstill",
            f"the fail-safe ends at {time:.2f} s with {last:.3g} m/s, not in a standstill",
            len(t.inputs),
            time,
            last,
            STANDING,
        )
    return Checked("standstill", f"the fail-safe stands at {time:.2f} s")


def conflict_area(c: Certificate) -> Checked | Violation:
    """Where the fail-safe stands, no lane crosses or leads into the ego's route."""
    body = bodies(c.fail_safe.states[-1:], c.ego)[0]
    areas = by_id(c.lanelets)
    own = shapely.union_all(
        [areas[i] for lane in c.lanes if lane.relation in OWN for i in lane.lanelets]
    )
    nearest = np.inf
    for lanelet in c.conflicts:
        area = _without_slivers(outline(lanelet), own)
        shared = float(shapely.area(shapely.intersection(area, body)))
        if shared > OVERLAP:
            return Violation(
                "conflict-area",
                f"the fail-safe stands on lanelet {lanelet.id}, which crosses or leads into the "
                f"ego's route ({shared:.2f} m^2)",
                len(c.fail_safe.inputs),
                measured=shared,
                allowed=OVERLAP,
            )
        nearest = min(nearest, float(shapely.distance(area, body)))
    if not c.conflicts:
        return Checked("conflict-area", "there is none", nearest, "m")
    return Checked("conflict-area", f"{nearest:.2f} m away from all", nearest, "m")


def _without_slivers(area: Any, own: Any) -> Any:
    """An incoming lanelet, without overlaps with the own lanes that are narrower than `SLIVER`."""
    shared = shapely.buffer(shapely.intersection(area, own), -SLIVER / 2, join_style="mitre")
    opened = shapely.buffer(shared, SLIVER / 2, join_style="mitre", mitre_limit=2.0)
    return shapely.union(opened, shapely.difference(area, own))
