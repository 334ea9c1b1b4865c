"""The paper's closed-loop table, as it is printed there.

Source: Lin, Illing, Althoff, "SanDRA: Safe Large-Language-Model-Based Decision Making for Automated
Vehicles Using Reachability Analysis", Sec. "Closed-Loop Evaluation", the table of that section: ten
seeds, three repeats, the authors' changes of highway-env (profile `paper`), meta-actions, GPT-4o.
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Printed:
    """One cell of it: a method in a setting. Rates in per cent, distance in m."""

    method: str
    setting: int
    success_rate: float
    collision_free_steps: float
    r_g1: float
    """Steps compliant with R_G1."""
    r_g2: float
    r_g3: float
    success_steps: float
    distance: float
    fail_safe_rate: float | None


# fmt: off
TABLE = (
    Printed("DiLu", 1, 93.3, 27.7, 15.7, 24.4, 27.7, 12.3, 116.5, None),
    Printed("DiLu", 2, 53.3, 18.8, 12.1, 14.7, 18.8, 8.0, 94.8, None),
    Printed("DiLu", 3, 76.7, 23.8, 13.8, 19.6, 23.8, 9.6, 102.4, None),
    Printed("most-likely, no rules", 1, 83.3, 28.5, 23.3, 21.7, 28.5, 15.3, 114.4, 6.5),
    Printed("most-likely, no rules", 2, 73.3, 25.6, 17.5, 19.5, 25.6, 10.9, 93.7, 6.8),
    Printed("most-likely, no rules", 3, 83.3, 25.8, 16.9, 20.6, 25.8, 11.1, 98.7, 7.3),
    Printed("most-likely, rules", 1, 100.0, 30.0, 28.5, 26.8, 30.0, 20.0, 84.4, 25.2),
    Printed("most-likely, rules", 2, 96.7, 29.4, 27.2, 26.3, 29.4, 19.9, 68.4, 25.0),
    Printed("most-likely, rules", 3, 100.0, 30.0, 27.5, 27.2, 30.0, 20.3, 72.5, 26.1),
    Printed("set-based, no rules", 1, 100.0, 30.0, 25.0, 16.2, 30.0, 16.5, 113.6, 3.8),
    Printed("set-based, no rules", 2, 100.0, 30.0, 21.4, 14.3, 30.0, 14.1, 88.6, 7.4),
    Printed("set-based, no rules", 3, 100.0, 30.0, 19.6, 13.7, 30.0, 13.1, 86.4, 7.9),
    Printed("set-based, rules", 1, 100.0, 30.0, 28.4, 25.3, 30.0, 20.8, 85.6, 25.9),
    Printed("set-based, rules", 2, 100.0, 30.0, 27.7, 23.9, 30.0, 20.9, 70.1, 26.9),
    Printed("set-based, rules", 3, 100.0, 30.0, 27.6, 23.3, 30.0, 20.2, 72.2, 25.8),
)
# fmt: on


def printed(method: str, setting: int) -> Printed | None:
    """The paper's numbers of a method in a setting; None where it has none."""
    return next((x for x in TABLE if (x.method, x.setting) == (method, setting)), None)
