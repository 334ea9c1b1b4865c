"""A certificate as JSON; see `file` for the format."""

from __future__ import annotations

import base64
import math
from dataclasses import fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sandra.certificate.types import Body, Certificate, Occupancies, Participant, Pavement
from sandra.errors import CertificateError
from sandra.planning.types import Trajectory
from sandra.scene.types import Region
from sandra.settings import Assumptions, Settings

Array = NDArray[np.float64]
Json = Any
"""What `json` writes: None, bool, int, float, str, list, dict."""


def names_of(kind: type) -> tuple[str, ...]:
    """The fields of a dataclass."""
    return tuple(f.name for f in fields(kind))


PARAMETERS = tuple(name for name in names_of(Settings) if name != "assumptions")
"""Parameters by name, all but the assumptions."""
WORDS = ("precision",)
"""Those that are words, not numbers."""


def to_json(c: Certificate) -> dict[str, Json]:
    """A certificate as JSON."""
    return {
        "format": c.format,
        "versions": dict(c.versions),
        "note": c.note,
        "scenario": c.scenario,
        "dt": c.dt,
        "horizon": c.horizon,
        "ego": {name: getattr(c.ego, name) for name in names_of(Body)},
        "initial": _listed(c.initial),
        "pair": str(c.pair),
        "rules": list(c.rules),
        "formula": c.formula,
        "parts": [list(part) for part in c.parts],
        "vocabulary": None
        if c.vocabulary is None
        else {section: dict(texts) for section, texts in c.vocabulary.items()},
        "lanes": [{"relation": x.relation, "lanelets": list(x.lanelets)} for x in c.lanes],
        "lanelets": [_of_pavement(x) for x in c.lanelets],
        "reference": _listed(c.reference),
        "conflicts": [_of_pavement(x) for x in c.conflicts],
        "obstacles": [_of_participant(x) for x in c.obstacles],
        "prediction": c.prediction,
        "set_based": c.set_based,
        "notes": list(c.notes),
        "witness": _of_trajectory(c.witness),
        "t_dec": c.t_dec,
        "fail_safe": _of_trajectory(c.fail_safe),
        "settings": {
            **{name: _of_number(getattr(c.settings, name)) for name in PARAMETERS},
            "assumptions": {
                name: _of_number(getattr(c.settings.assumptions, name))
                for name in names_of(Assumptions)
            },
        },
    }


def _listed(values: Array) -> Json:
    nested = values.tolist()
    if np.isfinite(values).all():
        return nested
    return _without_nan(nested)


def _without_nan(values: Json) -> Json:
    if isinstance(values, list):
        return [_without_nan(x) for x in values]
    if math.isinf(values):
        raise CertificateError("an array holds an infinite number: it cannot be written")
    return None if math.isnan(values) else values


def _of_number(value: float | bool | str) -> Json:
    return "inf" if value == math.inf else value


def _of_pavement(x: Pavement) -> Json:
    return {
        "id": x.id,
        "left": _listed(x.left),
        "right": _listed(x.right),
        "speed_limit": x.speed_limit,
    }


def _of_participant(x: Participant) -> Json:
    return {
        "id": x.id,
        "kind": x.kind,
        "outline": _of_region(x.outline),
        "is_static": x.is_static,
        "states": _listed(x.states),
        "likely": _of_occupancies(x.likely),
        "possible": _of_occupancies(x.possible),
        "assumptions": list(x.assumptions),
        "dropped": list(x.dropped),
        "basis": list(x.basis),
    }


def _of_occupancies(occupancies: Occupancies) -> Json:
    regions = [region for step in occupancies for region in step]
    points = np.concatenate([np.empty((0, 2)), *(region.vertices for region in regions)])
    return {
        "regions": [len(step) for step in occupancies],
        "vertices": [len(region.vertices) for region in regions],
        "radii": _packed(np.array([region.radius for region in regions])),
        "points": _packed(points),
    }


def _packed(values: Array) -> str:
    return base64.b64encode(values.astype("<f8").tobytes()).decode("ascii")


def _of_region(region: Region) -> Json:
    return {"vertices": _listed(region.vertices), "radius": region.radius}


def _of_trajectory(t: Trajectory) -> Json:
    return {
        "start": t.start,
        "tau": t.tau,
        "states": _listed(t.states),
        "inputs": _listed(t.inputs),
    }
