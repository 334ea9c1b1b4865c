"""What rollouts found, in words and as JSON."""

from __future__ import annotations

from collections import Counter
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from sandra.evaluation.rollouts.adversary import KINDS
from sandra.evaluation.rollouts.outcome import Played
from sandra.evaluation.rollouts.statistics import upper_bound


@dataclass(frozen=True, slots=True, eq=False)
class Tried:
    """One certificate and its rollouts; `index` is the number of its scene."""

    index: int
    label: str
    pair: str
    prediction: str
    rules: tuple[str, ...]
    played: Played


@dataclass(frozen=True, slots=True, eq=False)
class Report:
    """What was played and what came of it. Numbers in the sense of `docs/soundness.md`."""

    tried: tuple[Tried, ...]
    scenes: int
    seed: int
    broken: tuple[str, ...] = ()
    """Scenes that could not be tried because something of ours broke, and what."""

    @property
    def rollouts(self) -> int:
        """All that were played."""
        return sum(len(t.played.kind) for t in self.tried)

    @property
    def admissible(self) -> int:
        """Those in which every other kept what is assumed of it: only they count."""
        return sum(int(t.played.admissible.sum()) for t in self.tried)

    def failed(self, what: str) -> tuple[int, int]:
        """(rollouts, certificates) with an event of this kind."""
        rollouts = certificates = 0
        for t in self.tried:
            hit = {e.rollout for e in t.played.events if e.what == what}
            rollouts, certificates = rollouts + len(hit), certificates + bool(hit)
        return rollouts, certificates

    @property
    def broken_rules(self) -> Counter[str]:
        """In how many certificates the ego broke which of its rules."""
        return Counter(name for t in self.tried for name in t.played.rules)

    @property
    def holds(self) -> bool:
        """Whether there was neither a collision nor a broken rule, and no scene was left out."""
        return not self.broken and not any(t.played.events or t.played.rules for t in self.tried)

    def to_dict(self) -> dict[str, Any]:
        """The JSON contract of `sandra evaluate soundness --json`."""
        return {
            "seed": self.seed,
            "scenes": self.scenes,
            "certificates": len(self.tried),
            "rollouts": self.rollouts,
            "admissible": self.admissible,
            "holds": self.holds,
            "broken": list(self.broken),
            "collisions": self._counts("collision"),
            "after_cut_in": {
                **self._counts("after a cut-in"),
                "avoided_by_braking": sum(e.avoided for t in self.tried for e in t.played.events),
            },
            "rules": {
                "asked": dict(Counter(name for t in self.tried for name in t.rules)),
                "broken_by_the_ego": dict(self.broken_rules),
                "distance_short_because_of_another": sum(t.played.shortfalls for t in self.tried),
            },
            "not_admissible": dict(self._breaches()),
            "cut_ins": sum(t.played.cut_ins for t in self.tried),
            "adversaries": self._kinds(),
            "certificates_tried": [
                {
                    "scene": t.index,
                    "label": t.label,
                    "pair": t.pair,
                    "prediction": t.prediction,
                    "rules": list(t.rules),
                    "rollouts": len(t.played.kind),
                    "admissible": int(t.played.admissible.sum()),
                    "others": t.played.others,
                    "duration_s": t.played.duration,
                    "smallest_distance_m": float(t.played.distance.min(initial=np.inf)),
                    "broken_rules": list(t.played.rules),
                    "events": [asdict(e) for e in t.played.events],
                }
                for t in self.tried
            ],
        }

    def _counts(self, what: str) -> dict[str, float | int]:
        rollouts, certificates = self.failed(what)
        return {
            "rollouts": rollouts,
            "certificates": certificates,
            "upper_bound_per_rollout": upper_bound(rollouts, max(self.admissible, rollouts)),
            "upper_bound_per_certificate": upper_bound(certificates, len(self.tried)),
        }

    def _breaches(self) -> Counter[str]:
        found: Counter[str] = Counter()
        for t in self.tried:
            found.update(t.played.breaches)
        return found

    def _kinds(self) -> dict[str, dict[str, float | int]]:
        table = {}
        for number, name in enumerate(KINDS):
            rows = [t.played.distance[t.played.kind == number] for t in self.tried]
            near = np.concatenate(rows) if rows else np.zeros(0)
            near = near[np.isfinite(near)]
            table[name] = {
                "rollouts": sum(map(len, rows)),
                "smallest_m": float(near.min(initial=np.inf)),
                "median_m": float(np.median(near)) if len(near) else float("inf"),
                "below_1m": int((near < 1.0).sum()),
            }
        return table

    def __str__(self) -> str:
        data = self.to_dict()
        lines = [
            f"{len(self.tried)} certificates of {self.scenes} scenes, {self.rollouts} rollouts, "
            f"{self.admissible} of them admissible (seed {self.seed})",
            _line("collisions", data["collisions"]),
            _line("collisions after a legal cut-in", data["after_cut_in"])
            + f"; {data['after_cut_in']['avoided_by_braking']} of them avoided by braking "
            "with a_min after t_d",
            f"  legal cut-ins before the ego that were played: {data['cut_ins']}",
            "  rules broken by the ego: "
            + (", ".join(f"{k} {v}" for k, v in sorted(self.broken_rules.items())) or "none")
            + "; asked of "
            + (", ".join(f"{k} {v}" for k, v in sorted(data["rules"]["asked"].items())) or "none"),
            "  rollouts in which R_G1 fell short because of another: "
            f"{data['rules']['distance_short_because_of_another']}",
            f"  {'adversary':<10} {'rollouts':>9} {'smallest [m]':>13} {'median [m]':>11} "
            f"{'below 1 m':>10}",
        ]
        for name, row in data["adversaries"].items():
            lines.append(
                f"  {name:<10} {row['rollouts']:>9} {row['smallest_m']:>13.3f} "
                f"{row['median_m']:>11.2f} {row['below_1m']:>10}"
            )
        if data["not_admissible"]:
            broken = ", ".join(f"{k} {v}" for k, v in sorted(data["not_admissible"].items()))
            lines.append(f"  assumptions broken by vehicles, rollouts not counted: {broken}")
        lines += [f"  not tried, an internal error: {what}" for what in self.broken]
        for t in self.tried:
            for e in t.played.events[:1]:
                lines.append(
                    f"  {t.label} (scene {t.index}), {t.pair}: {e.what} with {e.obstacle_kind} "
                    f"{e.obstacle} at {e.time:.2f} s ({e.kind})"
                )
        return "\n".join(lines)


def _line(what: str, counts: dict[str, Any]) -> str:
    return (
        f"  {what}: {counts['rollouts']} rollouts of {counts['certificates']} certificates; 95 % "
        f"upper bound {counts['upper_bound_per_rollout']:.2g} per rollout, "
        f"{counts['upper_bound_per_certificate']:.2g} per certificate"
    )
