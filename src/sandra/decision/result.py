"""What one cycle of deciding has found, and how it shows itself."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from sandra.certificate import Certificate
from sandra.certify import Basis, Proven
from sandra.decision.stages import STAGES
from sandra.describe import Prompt
from sandra.planning import FailSafe, Maneuver
from sandra.rankers import Ranking
from sandra.reach import Ground, Verdict, Verdicts
from sandra.scene.types import Scene

if TYPE_CHECKING:
    from pathlib import Path


@dataclass(frozen=True, slots=True, eq=False)
class Decision:
    """All that was told, answered, verified and chosen in one cycle.

    `verdicts` holds the ranked pairs in the order of the ranking, then, where all twelve were
    verified, the others. `prompt` is the question as it was last put: in mode verify-first the one
    about the pairs that hold. `durations_s` has one entry per stage, and their "total" [s]: the
    ranker is at work while the others are predicted, so the stages may add up to more.
    """

    scene: Scene
    prompt: Prompt
    ranking: Ranking
    verdicts: Verdicts
    maneuver: Maneuver
    accept: str
    basis: Basis | None
    """What certificates of this cycle stand on; None where none was asked for."""
    durations_s: dict[str, float]
    mode: str = "rank"
    """In which order was asked and verified; see `sandra.decide`."""
    fail_safe_now: Callable[[], FailSafe | None] = lambda: None
    """A fail-safe trajectory from now on, without any maneuver before it; searched for once."""

    @property
    def ground(self) -> Ground:
        """What all verdicts stand on: lattice, prediction, forbidden cells."""
        return self.verdicts.ground

    @property
    def certificate(self) -> Certificate | None:
        """The accepted certificate of what is executed; None if it has none."""
        proof = None if self.executed is None else self.executed.proof
        return proof.certificate if isinstance(proof, Proven) else None

    @property
    def executed(self) -> Verdict | None:
        """The verdict of the pair that is executed; None for a fail-safe."""
        return None if self.maneuver.pair is None else self.verdicts[self.maneuver.pair]

    def to_dict(self) -> dict[str, Any]:
        """The JSON contract of `sandra decide --json`."""
        failure = self.ranking.failure
        return {
            "scenario": self.scene.name,
            "mode": self.mode,
            "ranker": self.ranking.ranker,
            "ranking": [pair.to_dict() for pair in self.ranking.pairs],
            "failure": None if failure is None else failure.value,
            "failure_detail": self.ranking.detail,
            "warnings": list(self.ranking.warnings),
            "usage": None if self.ranking.usage is None else self.ranking.usage.to_dict(),
            "cached": self.ranking.cached,
            "recorded_rank_s": self.ranking.recorded_s,
            "prediction": self.ground.prediction.kind,
            "assumed": list(self.ground.prediction.notes),
            "rules": list(self.verdicts.rules),
            "horizon": self.ground.horizon,
            "dt": self.scene.dt,
            "accept": self.accept,
            "verdicts": self.verdicts.to_list(),
            "executed": self.maneuver.to_dict(),
            "maneuver": {
                "note": self.maneuver.note,
                "states": self.maneuver.states.tolist(),
                "fail_safe_start": self.maneuver.fail_safe_start,
                "fail_safe": None
                if self.maneuver.fail_safe is None
                else self.maneuver.fail_safe.tolist(),
            },
            "durations_s": dict(self.durations_s),
        }

    def figure(self, path: str | Path, **options: Any) -> Path:
        """Draw the decision; see `sandra.view.decision_figure`."""
        from sandra.view import decision_figure

        return decision_figure(self, path, **options)

    def report(self, path: str | Path) -> Path:
        """Write an HTML page to look into the decision; see docs/report.md."""
        from sandra.view.report import decision_document, write

        return write(decision_document(self), path)

    def __str__(self) -> str:
        lines = [
            f"{self.scene.name}: ranked by {self.ranking.ranker}, prediction "
            f"{self.ground.prediction.kind}, rules {', '.join(self.verdicts.rules) or 'none'}, "
            f"h = {self.ground.horizon}, dt = {self.scene.dt:g} s"
        ]
        if self.mode != "rank":
            lines[0] += f", mode {self.mode}"
        lines += [f"  note: {note}" for note in self.ground.prediction.notes]
        if self.ranking.recorded_s is not None:
            took = f"{self.ranking.recorded_s:.1f} s"
            lines.append(f"  ranking: from the cache on disk; the server had taken {took}")
        if self.ranking.failure is not None:
            lines.append(
                f"  no ranking: {self.ranking.failure.value}"
                + (f" ({self.ranking.detail})" if self.ranking.detail else "")
            )
        lines += [f"  ranking: {warning}" for warning in self.ranking.warnings]
        for rank, verdict in enumerate(self.verdicts, start=1):
            place = f"{rank}." if rank <= len(self.ranking.pairs) else "  "
            lines.append(f"  {place:>3} {verdict}")
        pair = "" if self.maneuver.pair is None else f" {self.maneuver.pair}"
        lines.append(f"  executed: {self.maneuver.kind}{pair} ({self.maneuver.note})")
        stages = ", ".join(f"{name} {1e3 * self.durations_s[name]:.0f}" for name in STAGES)
        lines.append(f"  {1e3 * self.durations_s['total']:.0f} ms: {stages}")
        return "\n".join(lines)
