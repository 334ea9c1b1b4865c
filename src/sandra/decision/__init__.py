"""One decision: the walk through all rooms, once per cycle (paper Sec. III-A)."""

from sandra.decision.cycle import ACCEPTANCE, DEFAULT_DEADLINE, decide
from sandra.decision.modes import MODES, WALKS
from sandra.decision.result import Decision
from sandra.decision.stages import STAGES

__all__ = ["ACCEPTANCE", "DEFAULT_DEADLINE", "MODES", "STAGES", "WALKS", "Decision", "decide"]
