"""Our reachable set beside the peer's: the same problem, checked first, then timed."""

from sandra.evaluation.reach_bench.measure import HORIZONS, bench_reach
from sandra.evaluation.reach_bench.peer import Peer, PeerError, PeerRefused
from sandra.evaluation.reach_bench.rows import Report, Row

__all__ = ["HORIZONS", "Peer", "PeerError", "PeerRefused", "Report", "Row", "bench_reach"]
