"""Text or an action pair goes in; an LTLf formula, its automaton and its truth come out.

Knows nothing of geometry: which atoms are true where is decided by whoever builds letters.
"""

from sandra.logic.automaton import Cube, Dfa, Edge
from sandra.logic.evaluate import evaluate, letter, truth
from sandra.logic.formula import Atom, Comparison, Formula, Predicate
from sandra.logic.parser import parse
from sandra.logic.specification import Part, Specification, parse_rules, specification
from sandra.logic.translation import translate
from sandra.logic.vocabulary import Vocabulary

__all__ = [
    "Atom",
    "Comparison",
    "Cube",
    "Dfa",
    "Edge",
    "Formula",
    "Part",
    "Predicate",
    "Specification",
    "Vocabulary",
    "evaluate",
    "letter",
    "parse",
    "parse_rules",
    "specification",
    "translate",
    "truth",
]
