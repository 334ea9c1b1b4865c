"""Do recorded vehicles keep what the set-based prediction assumes of them, and by how much?"""

from sandra.evaluation.conformance.conformance import conformance, recordings_in
from sandra.evaluation.conformance.coverage import Coverage
from sandra.evaluation.conformance.file import write
from sandra.evaluation.conformance.measure import Finding
from sandra.evaluation.conformance.report import Conformance, Source

__all__ = [
    "Conformance",
    "Coverage",
    "Finding",
    "Source",
    "conformance",
    "recordings_in",
    "write",
]
