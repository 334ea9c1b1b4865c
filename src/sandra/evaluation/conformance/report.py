"""What conformance found: a table, plain data, and the tightest bounds as a named set."""

from __future__ import annotations

import math
from collections.abc import Collection
from dataclasses import dataclass, replace
from typing import Any

from sandra.errors import SettingsError
from sandra.evaluation.conformance.coverage import Coverage
from sandra.evaluation.conformance.measure import SWITCHES, UNITS, Finding
from sandra.settings import Assumptions

GRAIN = 1e-3
"""Bounds are rounded outwards to multiples of this."""


@dataclass(frozen=True, slots=True)
class Source:
    """A recording that was looked at: its name, SHA-256, and how much of it counts."""

    file: str
    sha256: str
    dt: float
    vehicles: int
    steps: int
    crashed_steps: int
    off_lanes: int
    position_error: float


@dataclass(frozen=True, slots=True)
class Conformance:
    """Assumptions beside recordings."""

    sources: tuple[Source, ...]
    findings: tuple[Finding, ...]
    assumptions: Assumptions
    """Those that were looked at."""
    towards: str
    broken_files: tuple[tuple[str, str], ...]
    """Files that could not be judged, and why."""
    coverage: Coverage | None = None
    """Under the assumptions that were looked at."""

    @property
    def holds(self) -> bool:
        """Whether no recorded vehicle breaks any, and all are covered."""
        covered = self.coverage is None or not self.coverage.missed
        return covered and not self.broken_files and all(f.broken_steps == 0 for f in self.findings)

    def __getitem__(self, name: str) -> Finding:
        for finding in self.findings:
            if finding.name == name:
                return finding
        raise KeyError(f"no assumption {name}: {', '.join(UNITS)}")

    def tightest(self, margin: float = 0.05, keep: Collection[str] = ()) -> Assumptions:
        """The tightest bounds that no recorded vehicle breaks, widened by `margin`.

        Bounds are the worst values times 1 + margin (a radius: divided by it), rounded outwards to
        0.001; of what was not observed, they stay as they are. A switch stays on if nobody broke
        it. Those in `keep` stay as they are, whoever broke them: a duty rather than a habit.

        Raises:
            SettingsError: a margin below 0, or a name that is no assumption.
        """
        if not (0.0 <= margin < math.inf):
            raise SettingsError(f"margin = {margin!r} must be a finite number >= 0")
        known = {*UNITS, "bounded_heading"}
        for name in keep:
            if name not in known:
                raise SettingsError(f"'{name}' is no assumption: choose from {', '.join(known)}")
        changes: dict[str, Any] = {}
        for finding in self.findings:
            name = finding.name
            if name in keep or math.isnan(finding.worst):
                continue
            if name in SWITCHES:
                changes[name] = finding.worst <= SWITCHES[name]
            elif name == "min_turning_radius":
                if finding.worst < math.inf:
                    changes[name] = math.floor(finding.worst / (1 + margin) / GRAIN) * GRAIN
            else:
                worst = max(finding.worst, 0.0) * (1 + margin)
                changes[name] = math.ceil(worst / GRAIN - 1e-9) * GRAIN
        changes = {k: round(v, 6) if isinstance(v, float) else v for k, v in changes.items()}
        heading = changes.get("max_slip_angle", 0.0)
        if heading > math.pi / 2 or changes.get("min_turning_radius", 1.0) <= 0.0:
            # Somebody turned on the spot, or slid: no such bound holds.
            for name in ("max_slip_angle", "min_turning_radius"):
                changes.pop(name, None)
            changes["bounded_heading"] = False
        return replace(self.assumptions, **changes)

    def to_dict(self) -> dict[str, Any]:
        """All of it, for JSON."""
        coverage = self.coverage
        return {
            "holds": self.holds,
            "towards": self.towards,
            "sources": [
                {name: getattr(s, name) for name in Source.__slots__} for s in self.sources
            ],
            "broken_files": [{"file": f, "error": e} for f, e in self.broken_files],
            "assumptions": {
                f.name: {
                    "assumed": getattr(self.assumptions, f.name),
                    "unit": UNITS[f.name],
                    "vehicles": f.vehicles,
                    "steps": f.steps,
                    "broken_vehicles": f.broken_vehicles,
                    "broken_steps": f.broken_steps,
                    "share": f.broken_steps / f.steps if f.steps else None,
                    "worst": f.worst,
                    "where": None
                    if f.where is None
                    else {"file": f.where.file, "vehicle": f.where.vehicle, "step": f.where.step},
                }
                for f in self.findings
            },
            "coverage": None
            if coverage is None
            else {
                "predictions": coverage.predictions,
                "steps": coverage.steps,
                "covered": coverage.covered,
                "missed": [list(x) for x in coverage.missed[:100]],
            },
        }

    def __str__(self) -> str:
        vehicles = sum(s.vehicles for s in self.sources)
        steps = sum(s.steps for s in self.sources)
        head = f"{len(self.sources)} recordings, {vehicles} vehicles, {steps} vehicle steps"
        crashed = sum(s.crashed_steps for s in self.sources)
        off = sum(s.off_lanes for s in self.sources)
        error = max((s.position_error for s in self.sources), default=0.0)
        lines = [head + (f"; {crashed} steps after a crash left out" if crashed else "")]
        lines.append(
            f"{'assumption':<28}{'assumed':>9}  {'worst':>9} {'':<6}"
            f"{'broken by':>14}{'at steps':>18}  worst at"
        )
        lines += [self._row(f) for f in self.findings]
        if off:
            lines.append(f"{off} vehicles on no lane when first seen: no lanes assumed of them")
        lines.append(f"recorded positions and speeds disagree by up to {error:.3f} m a step")
        if self.coverage is not None:
            c = self.coverage
            share = 100.0 * c.covered / c.steps if c.steps else 100.0
            lines.append(
                f"coverage: {c.covered} of {c.steps} vehicle steps within the assumptions are in "
                f"the predicted sets ({share:.2f} %), {c.predictions} predictions"
            )
            lines += [f"  outside: vehicle {v}, from {a}, step {b}" for v, a, b in c.missed[:5]]
        lines += [f"{file}: not judged: {error}" for file, error in self.broken_files]
        return "\n".join(lines)

    def _row(self, f: Finding) -> str:
        assumed = getattr(self.assumptions, f.name)
        told = ("yes" if assumed else "no") if isinstance(assumed, bool) else f"{assumed:.2f}"
        if math.isnan(f.worst):
            return f"{f.name:<28}{told:>9}  {'not seen':>9}"
        unit = UNITS[f.name]
        share = 100.0 * f.broken_steps / f.steps
        who = f"{f.broken_vehicles} of {f.vehicles}"
        at = f"{f.broken_steps} ({share:.2f} %)"
        where = f"  {f.where}" if f.worst > 0.0 or f.broken_steps else ""
        return f"{f.name:<28}{told:>9}  {f.worst:>9.3f} {unit:<6}{who:>14}{at:>18}{where}"
