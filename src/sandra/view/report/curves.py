"""What is planned, and the fail-safe that follows it, as curves of a page."""

from __future__ import annotations

import numpy as np

from sandra.planning import Maneuver
from sandra.view.profile import curves_of
from sandra.view.report.document import Curve
from sandra.view.report.scenery import pack_states
from sandra.view.shapes import View


def curves(view: View, maneuver: Maneuver) -> tuple[Curve, ...]:
    """Planned until the next decision, planned on from there, fail-safe; none if not known."""
    if not np.isfinite(maneuver.states).all():
        return ()
    found = []
    for curve in curves_of(maneuver):
        for kind, rows in curve.parts:
            times, packed = curve.times[rows], pack_states(view, curve.states[rows])
            found.append(Curve(kind, float(times[0]), maneuver.dt, float(times[-1]), packed))
    return tuple(found)
