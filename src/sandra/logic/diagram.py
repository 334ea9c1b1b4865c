"""Decision diagrams over ordered variables, of which some imply others.

A diagram is a function from truth assignments to leaves. Variables may form chains in which each
implies the next, such as `v <= 8`, `v <= 13.9`: assignments that break a chain do not occur, and
the diagrams are canonical on those that do. Two functions that agree there have one number, and
a test that cannot matter is not in the diagram.

Why canonical: along a chain c_1 -> c_2 -> ..., the possible assignments are "first true one is
c_i" or "none". A node c_i is kept only if the function differs between "first is c_i" and "first
is c_i+1", and below its true branch no later c_j is tested. That leaves one diagram per function.
"""

from __future__ import annotations

from collections.abc import Sequence

from sandra.errors import FormulaError

MAX_NODES = 500_000
"""More nodes than any specification needs; beyond it a formula is refused, not waited for."""


class Diagrams:
    """A store of diagrams, each a number; equal functions have equal numbers.

    Made for one translation and thrown away after it. Numbers 0 and 1 are `false` and `true`.

    Args:
        chains: for each variable, in order, the name of its chain; a chain's variables are
            neighbours in the order, and each implies those after it.
    """

    def __init__(self, chains: Sequence[object]) -> None:
        self._chain: list[object] = [*chains, None]
        self._leaf = len(chains)
        self._nodes: list[tuple[int, int, int]] = []
        self._numbers: dict[tuple[int, int, int], int] = {}
        self._ite: dict[tuple[int, int, int], int] = {}
        self.leaf(0)
        self.leaf(1)

    def leaf(self, value: int) -> int:
        """The constant function `value`."""
        return self._number((self._leaf, value, value))

    def is_leaf(self, node: int) -> bool:
        """Whether the function is constant."""
        return self._nodes[node][0] == self._leaf

    def variable(self, node: int) -> int:
        """The first variable that the function tests; the number of variables for a leaf."""
        return self._nodes[node][0]

    def branches(self, node: int) -> tuple[int, int]:
        """(where the variable is false, where it is true); of a leaf, its value twice."""
        return self._nodes[node][1:]

    def test(self, variable: int) -> int:
        """The function that is true where the variable is."""
        return self.choose(variable, 0, 1)

    def choose(self, variable: int, low: int, high: int) -> int:
        """`high` where the variable is true, else `low`; both test only later variables."""
        high = self._under(variable, high)
        if self._under(variable, low) == high:
            return low
        return self._number((variable, low, high))

    def negation(self, node: int) -> int:
        """Not `node`."""
        return self.ite(node, 0, 1)

    def conjunction(self, left: int, right: int) -> int:
        """`left` and `right`."""
        return self.ite(left, right, 0)

    def disjunction(self, left: int, right: int) -> int:
        """`left` or `right`."""
        return self.ite(left, 1, right)

    def ite(self, condition: int, then: int, otherwise: int) -> int:
        """`then` where the truth-valued `condition` is true, else `otherwise`."""
        if condition < 2:
            return then if condition else otherwise
        if then == otherwise:
            return then
        if (then, otherwise) == (1, 0):
            return condition
        key = (condition, then, otherwise)
        known = self._ite.get(key)
        if known is None:
            first = min(self._nodes[node][0] for node in key)
            low = self.ite(*(self._cofactor(node, first, False) for node in key))
            high = self.ite(*(self._cofactor(node, first, True) for node in key))
            known = self._ite[key] = self.choose(first, low, high)
        return known

    def _cofactor(self, node: int, variable: int, value: bool) -> int:
        tested, low, high = self._nodes[node]
        if tested == variable:
            return high if value else low
        return self._under(variable, node) if value else node

    def _under(self, variable: int, node: int) -> int:
        """`node` where `variable`, and with it the rest of its chain, is true."""
        tested, _, high = self._nodes[node]
        return (
            high if tested != self._leaf and self._chain[tested] == self._chain[variable] else node
        )

    def _number(self, node: tuple[int, int, int]) -> int:
        number = self._numbers.get(node)
        if number is None:
            number = len(self._nodes)
            if number >= MAX_NODES:
                raise FormulaError(
                    "the formula is too large to be verified: its automaton needs more than "
                    f"{MAX_NODES} nodes; use fewer or shorter rules"
                )
            self._numbers[node] = number
            self._nodes.append(node)
        return number
