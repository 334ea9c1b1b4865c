"""Condition `cut-in`: who cuts in as the law allows, and then brakes fully, is not driven into.

The set-based prediction leaves out the ego's lane of whoever is assumed to cut in only legally. But
legally it may: leaving the ego at least
d_safe = v^2 / (2 |a_min|) - v_o^2 / (2 |a_obs_min|) + v t_d, and no less than 0.
From then on it may brake with a_obs_min; its rear end comes to stand v^2 / (2 |a_min|) + v t_d or
more ahead of where the ego's front was. If from every time on the ego's remaining way is no longer
than that, the ego stands behind it. Nor does it touch it before: while the ego is the faster one,
its remaining way is at least v^2 / (2 |a_min|), as it brakes with |a_min| at most, and so more than
what the other, braking harder, still goes; while it is the slower one, the gap grows.
"""

from __future__ import annotations

import numpy as np

from sandra.certificate.report import Checked, Violation
from sandra.certificate.timing import decision_point
from sandra.certificate.types import Certificate

SLACK = 1e-3
"""The remaining way may be longer by so much [m]: more than rounding and what lies between grid
points, where it exceeds the bound by at most tau^2 |a| / 8."""


def cut_in(c: Certificate) -> Checked | Violation:
    """From each grid point on, the ego stops within what a legal cut-in leaves it."""
    who = [o.id for o in c.obstacles if "legal_cut_in" in o.assumptions]
    if not who:
        return Checked("cut-in", "nothing is left out that rests on it")
    speed = np.concatenate(
        [c.witness.states[: decision_point(c), 3], np.asarray(c.fail_safe.states)[:, 3]]
    )
    way = np.concatenate([[0.0], np.cumsum((speed[1:] + speed[:-1]) / 2 * c.witness.tau)])
    rest = way[-1] - way
    s = c.settings
    kept_free = speed**2 / (2 * abs(s.a_min)) + speed * s.t_d
    spare = kept_free - rest
    step = int(np.argmin(spare))
    if not spare[step] >= -SLACK:
        return Violation(
            "cut-in",
            f"{step * c.witness.tau:.2f} s from now the ego still goes {rest[step]:.2f} m; who "
            f"cuts in legally, like obstacle {who[0]}, need only leave {kept_free[step]:.2f} m",
            step,
            step * c.witness.tau,
            float(rest[step]),
            float(kept_free[step]),
        )
    # Where it stands nothing is spare; what counts is when it decides.
    return Checked("cut-in", f"{spare[0]:.2f} m to spare for legal cut-ins", float(spare[0]), "m")
