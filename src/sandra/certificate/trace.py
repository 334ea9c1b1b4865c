"""Conditions `formula` and `trace`: what is claimed of the witness, and that it is true."""

from __future__ import annotations

import numpy as np

from sandra.certificate.atoms import Trace, decide, safe_distance_slack
from sandra.certificate.literals import first_false, holds
from sandra.certificate.report import Checked, Violation
from sandra.certificate.types import Certificate
from sandra.errors import FormulaError
from sandra.logic import Predicate, Specification, Vocabulary, specification
from sandra.logic.formula import atoms_of

SAFE = Predicate("keeps_safe_distance", "preceding")


def formula(c: Certificate) -> Checked | Violation:
    """The formula is that of the pair under the rules, with abrupt braking not justified."""
    found = _specification(c)
    if isinstance(found, str):
        return Violation("formula", found)
    if c.formula != str(found.formula):
        return Violation(
            "formula",
            f"'{c.formula}' is not the formula of {c.pair} under {_rules(c)}: '{found.formula}'",
        )
    if c.parts != tuple((part.name, part.text) for part in found.parts):
        return Violation("formula", f"the parts are not those of {c.pair} under {_rules(c)}")
    words = "" if c.vocabulary is None else ", in the certificate's own vocabulary"
    return Checked("formula", f"that of {c.pair} under {_rules(c)}{words}")


def trace(c: Certificate) -> Checked | Violation:
    """The witness satisfies the formula (evaluated directly, no automaton)."""
    found = _specification(c)
    if isinstance(found, str):
        return Violation("trace", found)
    seen = Trace.of(c)
    steps = c.horizon + 1
    atoms = atoms_of(found.formula)
    slack = safe_distance_slack(seen) if SAFE in atoms else np.full(steps, np.inf)
    try:
        decided = {atom: decide(seen, atom, slack) for atom in atoms}
        # The formula is the conjunction of the parts, and `formula` has compared its text.
        for part in found.parts:
            if not holds(part.formula, decided, steps):
                step = first_false(part.formula, decided, steps)
                at = "" if step is None else f" at step {step} ({step * c.dt:.2f} s)"
                return Violation(
                    "trace",
                    f"the witness does not satisfy {part.name}: {part.text}{at}",
                    step,
                    None if step is None else step * c.dt,
                )
    except FormulaError as error:
        return Violation("trace", str(error))
    least = float(slack.min())
    if np.isfinite(least):
        words = f"satisfied on {steps} letters, {least:.2f} m more than the safe distance"
        return Checked("trace", words, least, "m")
    return Checked("trace", f"satisfied on {steps} letters")


def _specification(c: Certificate) -> Specification | str:
    """The specification, made anew from pair, rules and settings; or why there is none."""
    try:
        return specification(c.pair, c.rules, c.settings, _vocabulary(c), c.dt, justified=False)
    except FormulaError as error:
        return str(error)


def _vocabulary(c: Certificate) -> Vocabulary | None:
    if c.vocabulary is None:
        return None
    own = c.vocabulary
    return Vocabulary(own["actions"], own["rules"], own["predicates"], {})


def _rules(c: Certificate) -> str:
    return ", ".join(c.rules) or "no rules"
