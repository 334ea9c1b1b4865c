"""Specification-compliant reachable sets, and the verdicts that follow from them."""

from sandra.reach.ground import Ground, ground
from sandra.reach.lattice import Lattice
from sandra.reach.polygon import Polygon
from sandra.reach.problem import Piece, Problem
from sandra.reach.sets import BaseSet, ReachableSet
from sandra.reach.twin import reachable_set
from sandra.reach.verdict import Proof, Status, Verdict, Verdicts
from sandra.reach.verify import compute, explained, verify, verify_on, verify_pair

__all__ = [
    "BaseSet",
    "Ground",
    "Lattice",
    "Piece",
    "Polygon",
    "Problem",
    "Proof",
    "ReachableSet",
    "Status",
    "Verdict",
    "Verdicts",
    "compute",
    "explained",
    "ground",
    "reachable_set",
    "verify",
    "verify_on",
    "verify_pair",
]
