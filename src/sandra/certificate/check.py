"""The checker: accepts a certificate, or names the first condition that it violates.

Shares no code with what made it beyond data types and the syntax and semantics of formulas. The
conditions are checked in the order of `CONDITIONS`; the first violated one ends the check.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import shapely

from sandra.certificate.collision import predictions, set_based_collision, witness_collision
from sandra.certificate.cut_in import cut_in
from sandra.certificate.file import load
from sandra.certificate.form import form
from sandra.certificate.motion import (
    acceleration,
    lateral_acceleration,
    motion,
    speed,
    steering_angle,
    steering_rate,
)
from sandra.certificate.others import occupancies
from sandra.certificate.place import conflict_area, road, standstill
from sandra.certificate.report import Checked, Report, Violation
from sandra.certificate.timing import continuity, grid, initial_state
from sandra.certificate.trace import formula, trace
from sandra.certificate.types import Certificate

Condition = Callable[[Certificate], Checked | Violation]

CONDITIONS: dict[str, Condition] = {
    "format": form,
    "grid": grid,
    "initial-state": initial_state,
    "continuity": continuity,
    "steering-angle": steering_angle,
    "motion": motion,
    "acceleration": acceleration,
    "steering-rate": steering_rate,
    "speed": speed,
    "lateral-acceleration": lateral_acceleration,
    "standstill": standstill,
    "formula": formula,
    "predictions": predictions,
    "occupancies": occupancies,
    "witness-collision": witness_collision,
    "set-based-collision": set_based_collision,
    "road": road,
    "conflict-area": conflict_area,
    "trace": trace,
    "cut-in": cut_in,
}
"""All conditions by name, in the order in which they are checked; each relies on those before."""


def check(certificate: Certificate) -> Report:
    """Check every claim of a certificate.

    Returns:
        Accepted with the margins of all conditions, or rejected with the first violation.
    """
    checked: list[Checked] = []
    violation: Violation | None = None
    for name, condition in CONDITIONS.items():
        try:
            answer = condition(certificate)
        except shapely.errors.GEOSException as error:
            # Shapes so odd that the geometry library gives up prove nothing.
            answer = Violation(name, f"the shapes cannot be evaluated: {error}")
        if isinstance(answer, Violation):
            violation = answer
            break
        checked.append(answer)
    return Report(str(certificate.scenario), str(certificate.pair), tuple(checked), violation)


def check_file(path: str | Path) -> Report:
    """Check the certificate in a file.

    Raises:
        CertificateError: if the file cannot be read, or is no certificate of a known version.
    """
    return check(load(path))
