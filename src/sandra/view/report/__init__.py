"""Reports: one HTML page that shows a decision, an episode or an evaluation, and needs no network.

Data walks one way: `decided`, `episode` and `evaluation` turn results into a `Document`, plain and
versioned; `html` puts it into the static page whose parts lie in `page/`.
"""

from sandra.view.report.document import FORMAT, VERSION, Document
from sandra.view.report.episode import episode_document
from sandra.view.report.frames import FrameLog
from sandra.view.report.html import page, write
from sandra.view.report.of_decision import decision_document
from sandra.view.report.writing import write_report

__all__ = [
    "FORMAT",
    "VERSION",
    "Document",
    "FrameLog",
    "decision_document",
    "episode_document",
    "page",
    "write",
    "write_report",
]
