"""Closed loop: how far, how safely and how lawfully episodes were driven; the paper's table."""

from sandra.evaluation.closed_loop.metrics import (
    OURS,
    PAPER,
    Convention,
    Metrics,
    Proofs,
    Summary,
    measure,
    summarise,
    wilson,
)

__all__ = [
    "OURS",
    "PAPER",
    "Convention",
    "Metrics",
    "Proofs",
    "Summary",
    "measure",
    "summarise",
    "wilson",
]
