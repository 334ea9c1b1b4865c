"""The document of a single decision."""

from __future__ import annotations

from sandra.decision import Decision
from sandra.logic import Vocabulary
from sandra.view.report.decided import decided, map_of_decision
from sandra.view.report.document import Document


def decision_document(decision: Decision, vocabulary: Vocabulary | None = None) -> Document:
    """What the page of a decision shows; `vocabulary`: that of the decision, if not the packaged.

    All twelve pairs are on it. Those that the decision did not verify are verified now, on the same
    ground, and said to be so.
    """
    base, texts = decision.ground, list[str]()
    found = decided(decision, texts=texts, vocabulary=vocabulary)
    command = decision.prompt.situation.command
    return Document(
        "decision",
        decision.scene.name,
        (
            ("ranked by", decision.ranking.ranker),
            ("command", command or "none"),
            ("prediction", base.prediction.kind),
            ("rules", ", ".join(decision.verdicts.rules) or "none"),
            ("horizon", f"{base.horizon} steps of {decision.scene.dt:g} s"),
        ),
        maps=(map_of_decision(decision),),
        decisions=(found,),
        texts=tuple(texts),
    )
