"""What the monitor found: how well each rule is kept, step by step."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from pathlib import Path

Array = NDArray[np.float64]
Bools = NDArray[np.bool_]


@dataclass(frozen=True, slots=True, eq=False)
class RuleRobustness:
    """Robustness of one rule at each of n steps, positive where it is kept.

    R_G1: distance beyond d_safe [m], inf where nobody precedes. R_G2: acceleration above the
    threshold of abrupt braking [m/s^2], inf where braking is justified. R_G3: speed below the
    limit [m/s], inf where there is none. NaN where the ego was not recorded.
    """

    rule: str
    unit: str
    values: Array
    """(n,)"""
    kept: Bools
    """(n,) whether the rule holds at a step; true where the ego was not recorded. Where `values`
    is 0 the rule decides: R_G1 demands more than d_safe, R_G2 and R_G3 allow their bounds."""
    scale: float
    """Robustness that `normalised` calls 1, in `unit`."""
    ids: tuple[int | None, ...] = ()
    """R_G1: who precedes at each step."""

    @property
    def holds(self) -> bool:
        """Whether the rule holds throughout (MTL: G)."""
        return bool(self.kept.all())

    @property
    def minimum(self) -> float:
        """The smallest robustness: that of G, in `unit`."""
        return float(np.nanmin(self.values))

    @property
    def step(self) -> int:
        """The first step with the smallest robustness."""
        return int(np.nanargmin(self.values))

    @property
    def normalised(self) -> Array:
        """(n,) `values` / `scale`, cut off at -1 and 1."""
        return np.clip(self.values / self.scale, -1.0, 1.0)

    def to_dict(self) -> dict[str, Any]:
        """Numbers and lists; infinite and undefined numbers as they are."""
        return {
            "rule": self.rule,
            "unit": self.unit,
            "holds": self.holds,
            "minimum": self.minimum,
            "step": self.step,
            "broken_steps": int((~self.kept).sum()),
            "scale": self.scale,
            "values": [float(x) for x in self.values],
            **({"preceding": list(self.ids)} if self.ids else {}),
        }

    def __str__(self) -> str:
        value = f"{self.minimum:+.3f} {self.unit}"
        if self.minimum == np.inf:
            return f"{self.rule}  kept    nothing to keep"
        who = self.ids[self.step] if self.ids else None
        text = f"smallest {value} at step {self.step}" + (f", vehicle {who}" if who else "")
        if self.holds:
            return f"{self.rule}  kept    {text}"
        broken = int((~self.kept).sum())
        first = int(np.argmin(self.kept))
        return f"{self.rule}  BROKEN  {text}; broken at {broken} steps, first {first}"


@dataclass(frozen=True, slots=True, eq=False)
class Robustness:
    """Robustness of rules along a trajectory of n steps."""

    scene: str
    """Its name."""
    dt: float
    """[s]"""
    rules: tuple[RuleRobustness, ...]
    limits: Array
    """(n,) the signed speed limit [m/s]; NaN where the map tells none."""
    off_road: Bools
    """(n,) whether the ego's centre is on no lanelet."""

    @property
    def holds(self) -> bool:
        """Whether all rules hold throughout."""
        return all(rule.holds for rule in self.rules)

    @property
    def times(self) -> Array:
        """(n,) [s]"""
        return np.asarray(self.dt * np.arange(len(self.limits)))

    def __getitem__(self, rule: str) -> RuleRobustness:
        for each in self.rules:
            if each.rule == rule:
                return each
        known = ", ".join(each.rule for each in self.rules)
        raise KeyError(f"no rule {rule}: monitored were {known}")

    def to_dict(self) -> dict[str, Any]:
        """All of it, for JSON."""
        return {
            "scene": self.scene,
            "dt": self.dt,
            "steps": len(self.limits),
            "holds": self.holds,
            "limit_unknown_steps": int(np.isnan(self.limits).sum()),
            "off_road_steps": int(self.off_road.sum()),
            "rules": [rule.to_dict() for rule in self.rules],
        }

    def figure(self, path: str | Path, **options: Any) -> Path:
        """Draw robustness over time; see `sandra.view.robustness_figure`."""
        from sandra.view import robustness_figure

        return robustness_figure(self, path, **options)

    def __str__(self) -> str:
        n = len(self.limits)
        lines = [f"{self.scene}: {n} steps of {self.dt:g} s", *map(str, self.rules)]
        unknown, off = int(np.isnan(self.limits).sum()), int(self.off_road.sum())
        if unknown and any(each.rule == "R_G3" for each in self.rules):
            lines.append(f"no signed speed limit is known at {unknown} of {n} steps")
        if off:
            lines.append(f"off all lanelets at {off} of {n} steps")
        return "\n".join(lines)
