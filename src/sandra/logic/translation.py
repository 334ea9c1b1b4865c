"""From a formula to its minimal automaton, by progression.

What a formula demands of the rest of a trace after one letter is a truth function of
  * the atoms of that letter,
  * `end`: whether the letter was the last,
  * one obligation per subformula: "the rest satisfies it" (if there is a rest).
A state is such a function without letter atoms: the demand that is left. It accepts if it is
true at the end. Since the functions are canonical decision diagrams, states with the same demand
are one state, letters are never enumerated, and there are finitely many states. Partition
refinement then merges those that no further trace tells apart. (The idea of De Giacomo & Vardi
2013, with decision diagrams in place of sets of formulas.)
"""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import lru_cache

from sandra.errors import FormulaError
from sandra.logic.automaton import Cube, Dfa, Edge
from sandra.logic.diagram import Diagrams
from sandra.logic.formula import (
    And,
    Atom,
    Comparison,
    Constant,
    Finally,
    Formula,
    Globally,
    Iff,
    Implies,
    Next,
    Not,
    Or,
    Release,
    Until,
    WeakNext,
    WeakUntil,
    atoms_of,
)

MAX_STATES = 20_000
"""States before minimisation; beyond it a formula is refused, not waited for."""
MAX_CUBES = 100_000
"""Cubes of one automaton; beyond it a formula is refused, not waited for."""


def translate(formula: Formula) -> Dfa:
    """The minimal automaton that accepts exactly the finite traces that satisfy `formula`.

    Raises:
        FormulaError: if the automaton would be too large.
    """
    try:
        return _translate(formula)
    except RecursionError:
        raise FormulaError(
            "the formula is nested too deeply to be verified; use fewer or shorter rules"
        ) from None


@lru_cache(maxsize=512)
def _translate(formula: Formula) -> Dfa:
    progression = _Progression(formula)
    return _minimal(progression, *_explore(progression))


class _Progression:
    """The demands of a formula on the rest of a trace, as diagrams.

    Variables in order: the atoms, `end`, the obligations.
    """

    def __init__(self, formula: Formula) -> None:
        self.atoms = tuple(sorted(atoms_of(formula), key=_atom_order))
        self.end = len(self.atoms)
        obligations = sorted(_obligations(formula), key=_obligation_order)
        first = self.end + 1
        self._atom_variable = {atom: i for i, atom in enumerate(self.atoms)}
        self._obligation_variable = {f: first + i for i, f in enumerate(obligations)}
        self._obligation: list[Formula] = obligations
        chains: list[object] = [_atom_order(atom)[:2] for atom in self.atoms]
        chains += ["end", *(_obligation_order(f)[:3] for f in obligations)]
        self.diagrams = Diagrams(chains)
        self._now: dict[Formula, int] = {}
        self._after: dict[int, int] = {}
        self._is_end = self.diagrams.test(self.end)
        # A trace has at least one letter: before the first, the end is not accepted.
        self.start = self._strong(self._rest(formula))

    def accepts(self, state: int) -> bool:
        """Whether the demand is met if the trace ends here."""
        if self.diagrams.variable(state) == self.end:
            state = self.diagrams.branches(state)[1]
        return state == 1

    def successor(self, state: int) -> int:
        """The demand after one more letter, as a diagram that tests the letter first."""
        if self.diagrams.variable(state) == self.end:
            state = self.diagrams.branches(state)[0]
        return self._substitute(state)

    def _substitute(self, rest: int) -> int:
        """A function of obligations, each replaced by its formula, now."""
        if self.diagrams.is_leaf(rest):
            return rest
        known = self._after.get(rest)
        if known is None:
            low, high = self.diagrams.branches(rest)
            obligation = self._obligation[self.diagrams.variable(rest) - self.end - 1]
            known = self._after[rest] = self.diagrams.ite(
                self._at(obligation), self._substitute(high), self._substitute(low)
            )
        return known

    def _at(self, formula: Formula) -> int:
        """The formula as a function of this letter and the obligations for the rest."""
        known = self._now.get(formula)
        if known is None:
            known = self._now[formula] = self._expand(formula)
        return known

    def _expand(self, formula: Formula) -> int:
        d = self.diagrams
        match formula:
            case Atom():
                return d.test(self._atom_variable[formula])
            case Next(f):
                return self._strong(self._rest(f))
            case WeakNext(f):
                return self._weak(self._rest(f))
            case Finally(f, lower, upper):
                later = self._strong(self._rest(_later(formula))) if upper != 0 else 0
                return later if lower else d.disjunction(self._at(f), later)
            case Globally(f, lower, upper):
                later = self._weak(self._rest(_later(formula))) if upper != 0 else 1
                return later if lower else d.conjunction(self._at(f), later)
            case Until(left, right):
                later = d.conjunction(self._at(left), self._strong(self._rest(formula)))
                return d.disjunction(self._at(right), later)
            case WeakUntil(left, right):
                later = d.conjunction(self._at(left), self._weak(self._rest(formula)))
                return d.disjunction(self._at(right), later)
            case Release(left, right):
                later = d.disjunction(self._at(left), self._weak(self._rest(formula)))
                return d.conjunction(self._at(right), later)
        return self._connective(formula, [self._at(f) for f in formula.operands])

    def _rest(self, formula: Formula) -> int:
        """The obligation that the rest, which is not empty, satisfies the formula."""
        variable = self._obligation_variable.get(formula)
        if variable is not None:
            return self.diagrams.test(variable)
        return self._connective(formula, [self._rest(f) for f in formula.operands])

    def _connective(self, formula: Formula, operands: list[int]) -> int:
        d = self.diagrams
        match formula:
            case Constant(value):
                return d.leaf(int(value))
            case Not():
                return d.negation(operands[0])
            case And():
                return d.conjunction(*operands)
            case Or():
                return d.disjunction(*operands)
            case Implies():
                return d.ite(operands[0], operands[1], 1)
            case Iff():
                return d.ite(operands[0], operands[1], d.negation(operands[1]))
        raise TypeError(f"no rule to translate {type(formula).__name__}")

    def _strong(self, rest: int) -> int:
        return self.diagrams.ite(self._is_end, 0, rest)

    def _weak(self, rest: int) -> int:
        return self.diagrams.ite(self._is_end, 1, rest)


def _later(formula: Finally | Globally) -> Formula:
    """The same operator as seen from the next step."""
    upper = None if formula.upper is None else formula.upper - 1
    return replace(formula, lower=max(formula.lower - 1, 0), upper=upper)


def _obligations(formula: Formula) -> set[Formula]:
    """All formulas that may become a demand on the rest of the trace."""
    found: set[Formula] = set()
    pending = [formula]
    while pending:
        node = pending.pop()
        if node in found:
            continue
        pending.extend(node.operands)
        if not isinstance(node, Constant | Not | And | Or | Implies | Iff):
            found.add(node)
        if isinstance(node, Finally | Globally) and node.upper != 0:
            pending.append(_later(node))
        if len(found) > MAX_STATES:
            raise FormulaError(
                f"the formula is too large to be verified: its bounds span more than {MAX_STATES} "
                "steps; use shorter intervals"
            )
    return found


def _atom_order(atom: Atom) -> tuple[int, str, float, str]:
    """Predicates by name, then comparisons by variable; each comparison implies the next."""
    if isinstance(atom, Comparison):
        return (1, atom.variable, atom.bound, atom.op)
    return (0, str(atom), 0.0, "")


def _obligation_order(formula: Formula) -> tuple[str, str, int, float]:
    """Operators that differ in their last step stand together; each implies the next."""
    if isinstance(formula, Finally | Globally):
        last = math.inf if formula.upper is None else formula.upper
        rank = last if isinstance(formula, Finally) else -last
        return (formula.symbol, str(formula.operand), formula.lower, rank)
    # A chain of its own: no other formula has this text.
    return ("", str(formula), 0, 0.0)


def _explore(progression: _Progression) -> tuple[list[int], list[int]]:
    """All states that can be reached, the start first, and the successor diagram of each."""
    states = [progression.start]
    seen = {progression.start}
    successors: list[int] = []
    for state in states:  # grows while it is walked
        diagram = progression.successor(state)
        successors.append(diagram)
        for leaf in _leaves(progression, diagram):
            if leaf not in seen:
                seen.add(leaf)
                states.append(leaf)
        if len(states) > MAX_STATES:
            raise FormulaError(
                f"the formula is too large to be verified: its automaton needs more than "
                f"{MAX_STATES} states; use fewer or shorter rules"
            )
    return states, successors


def _leaves(progression: _Progression, diagram: int) -> Iterator[int]:
    """The states that a successor diagram leads to, each once."""
    d = progression.diagrams
    pending, seen = [diagram], {diagram}
    while pending:
        node = pending.pop()
        if d.variable(node) >= progression.end:
            yield node
            continue
        for branch in d.branches(node):
            if branch not in seen:
                seen.add(branch)
                pending.append(branch)


@dataclass(frozen=True, slots=True)
class _Relabelling:
    """Successor diagrams with each state replaced by a number: its class or its new name."""

    progression: _Progression
    label: dict[int, int]
    memo: dict[int, int]

    def __call__(self, diagram: int) -> int:
        known = self.memo.get(diagram)
        if known is None:
            d = self.progression.diagrams
            variable = d.variable(diagram)
            if variable >= self.progression.end:
                known = d.leaf(self.label[diagram])
            else:
                low, high = d.branches(diagram)
                known = d.choose(variable, self(low), self(high))
            self.memo[diagram] = known
        return known


def _classes(progression: _Progression, states: list[int], successors: list[int]) -> dict[int, int]:
    """Partition refinement: state -> class, states of a class accept the same rests.

    Only states whose successors changed class are looked at again, and the largest part of a
    class keeps its number, so that each state changes class at most log(n) times.
    """
    diagram = dict(zip(states, successors, strict=True))
    predecessors: defaultdict[int, list[int]] = defaultdict(list)
    for state in states:
        for leaf in _leaves(progression, diagram[state]):
            predecessors[leaf].append(state)
    label = {state: int(progression.accepts(state)) for state in states}
    members: defaultdict[int, set[int]] = defaultdict(set)
    for state in states:
        members[label[state]].add(state)
    n_classes = 2
    dirty = set(states)
    while dirty:
        relabel = _Relabelling(progression, label, {})
        by_class: defaultdict[int, defaultdict[int, set[int]]]
        by_class = defaultdict(lambda: defaultdict(set))
        for state in dirty:
            by_class[label[state]][relabel(diagram[state])].add(state)
        moved: list[int] = []
        label = dict(label)
        for old, parts in by_class.items():
            # States that are not dirty still agree with each other, and with no dirty one.
            untouched = members[old].difference(*parts.values())
            groups = sorted(([untouched] if untouched else []) + list(parts.values()), key=len)
            members[old] = groups.pop()
            for group in groups:
                members[n_classes] = group
                label.update(dict.fromkeys(group, n_classes))
                moved.extend(group)
                n_classes += 1
        dirty = {p for state in moved for p in predecessors[state]}
    return label


def _minimal(progression: _Progression, states: list[int], successors: list[int]) -> Dfa:
    """The quotient by `_classes`, states numbered in the order of their discovery."""
    d = progression.diagrams
    label = _classes(progression, states, successors)
    by_class = _Relabelling(progression, label, {})
    representative: dict[int, tuple[int, int]] = {}
    for state, successor in zip(states, successors, strict=True):
        representative.setdefault(label[state], (state, by_class(successor)))

    number = {label[progression.start]: 0}
    paths: list[dict[int, list[tuple[frozenset[int], frozenset[int]]]]] = []
    n_cubes = 0
    accepting: set[int] = set()
    for old in (order := [label[progression.start]]):  # grows while it is walked
        state, diagram = representative[old]
        if progression.accepts(state):
            accepting.add(number[old])
        edges: defaultdict[int, list[tuple[frozenset[int], frozenset[int]]]] = defaultdict(list)
        for target, true, false in _paths(d, diagram):
            if target not in number:
                number[target] = len(number)
                order.append(target)
            edges[number[target]].append((true, false))
            n_cubes += 1
            if n_cubes > MAX_CUBES:
                raise FormulaError(
                    f"the formula is too large to be verified: its automaton needs more than "
                    f"{MAX_CUBES} cubes; use fewer or shorter rules"
                )
        paths.append(edges)

    used = sorted(
        {i for edges in paths for cubes in edges.values() for c in cubes for i in c[0] | c[1]}
    )
    index = {old: new for new, old in enumerate(used)}
    return Dfa(
        atoms=tuple(progression.atoms[i] for i in used),
        n_states=len(order),
        initial=0,
        accepting=frozenset(accepting),
        edges=tuple(
            tuple(
                Edge(
                    target,
                    tuple(
                        Cube(frozenset(index[i] for i in t), frozenset(index[i] for i in f))
                        for t, f in edges[target]
                    ),
                )
                for target in sorted(edges)
            )
            for edges in paths
        ),
    )


def _paths(
    diagrams: Diagrams,
    node: int,
    true: frozenset[int] = frozenset(),
    false: frozenset[int] = frozenset(),
) -> Iterator[tuple[int, frozenset[int], frozenset[int]]]:
    """Each path to a leaf: (value of the leaf, variables that are true, that are false)."""
    variable = diagrams.variable(node)
    low, high = diagrams.branches(node)
    if diagrams.is_leaf(node):
        yield low, true, false
    else:
        yield from _paths(diagrams, high, true | {variable}, false)
        yield from _paths(diagrams, low, true, false | {variable})
