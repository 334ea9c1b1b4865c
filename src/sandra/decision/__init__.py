"""One decision: the walk through all rooms, once per cycle (paper Sec. III-A)."""

from sandra.decision.cycle import ACCEPTANCE, DEFAULT_DEADLINE, WALKS, decide
from sandra.decision.result import Decision
from sandra.decision.stages import STAGES

__all__ = ["ACCEPTANCE", "DEFAULT_DEADLINE", "STAGES", "WALKS", "Decision", "decide"]
