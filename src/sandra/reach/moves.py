"""A specification's DFA as the kernel reads it: moves of classes of states, by range of input.

Before the horizon only what a DFA state does next matters, not whether it accepts; states that
behave alike are one class. (F G p, for instance, has a single class: nothing is asked of a set
before its last step.) A letter consists of state literals, answered by regions, and of bounds on
the acceleration, answered by the range of input of the step.
"""

from __future__ import annotations

from collections.abc import Hashable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise
from math import inf

from sandra.logic import Comparison, Dfa, Edge
from sandra.reach.lattice import Copied

Literal = tuple[int, bool]
"""Index of an atom, and the truth asked of it."""

Interval = tuple[float, float]


@dataclass(frozen=True, slots=True)
class Move:
    """To class `target`, where all `literals` hold and the input lies in `inputs` [m/s^2]."""

    target: int
    literals: tuple[Literal, ...]
    inputs: Interval


@dataclass(frozen=True)
class Moves(Copied):
    """What can be read before the last step (`moves`), and at it (`final`), per class.

    `live[n]` are the classes from which acceptance is possible when n letters remain to be read,
    for some letters whose input is admissible.
    """

    initial: int
    moves: tuple[tuple[Move, ...], ...]
    final: tuple[tuple[Move, ...], ...]
    live: tuple[frozenset[int], ...]


@lru_cache(maxsize=256)
def moves_of(dfa: Dfa, inputs: Interval, horizon: int) -> Moves:
    """Translate `dfa` for admissible inputs [m/s^2] and a trace of `horizon` + 1 letters."""
    ranges = _ranges(dfa, inputs)
    letters = [
        [
            (lit, interval, edge.target)
            for edge in edges
            for lit, interval in _split(dfa, edge, ranges)
        ]
        for edges in dfa.edges
    ]
    final = [
        _joined([Move(-1, lit, i) for lit, i, target in row if target in dfa.accepting])
        for row in letters
    ]
    group = _classes(letters, final)
    count = max(group) + 1
    first = [group.index(c) for c in range(count)]
    moves = tuple(
        _joined([Move(group[target], lit, i) for lit, i, target in letters[q]]) for q in first
    )
    ends = tuple(final[q] for q in first)
    live = [frozenset[int](), frozenset(c for c in range(count) if ends[c])]
    for _ in range(horizon):
        live.append(
            frozenset(c for c in range(count) if any(m.target in live[-1] for m in moves[c]))
        )
    return Moves(group[dfa.initial], moves, ends, tuple(live))


def _ranges(dfa: Dfa, inputs: Interval) -> list[Interval]:
    """The admissible inputs, parted at every bound on the acceleration that the DFA reads."""
    low, high = inputs
    if low > high:
        return []
    bounds = {a.bound for a in dfa.atoms if isinstance(a, Comparison) and a.variable == "a"}
    marks = [low, *sorted(b for b in bounds if low < b < high), high]
    return list(pairwise(marks))


def _split(
    dfa: Dfa, edge: Edge, ranges: list[Interval]
) -> list[tuple[tuple[Literal, ...], Interval]]:
    """Each cube of an edge, once per range of input in which its bounds on `a` hold."""
    found = []
    for cube in edge.cubes:
        literals = [(i, True) for i in cube.true] + [(i, False) for i in cube.false]
        of_state: list[Literal] = []
        of_input: list[tuple[Comparison, bool]] = []
        for index, truth in sorted(literals):
            atom = dfa.atoms[index]
            if isinstance(atom, Comparison) and atom.variable == "a":
                of_input.append((atom, truth))
            else:
                of_state.append((index, truth))
        for interval in ranges:
            if all(_holds(atom, interval) == truth for atom, truth in of_input):
                found.append((tuple(of_state), interval))
    return found


def _holds(atom: Comparison, interval: Interval) -> bool:
    """A comparison on the acceleration, in the inside of a range that its bound does not part."""
    return atom.holds((interval[0] + interval[1]) / 2)


def _joined(moves: list[Move]) -> tuple[Move, ...]:
    """The same moves, fewer: literals that do not matter dropped, adjacent ranges united."""
    current = set(moves)
    while True:
        merged = _drop_one_literal(current) or _unite_two_ranges(current)
        if merged is None:
            return tuple(sorted(current, key=lambda m: (m.target, m.inputs, m.literals)))
        current = merged


def _drop_one_literal(moves: set[Move]) -> set[Move] | None:
    for move in sorted(moves, key=lambda m: (m.target, m.inputs, m.literals)):
        for index, truth in move.literals:
            rest = tuple(x for x in move.literals if x[0] != index)
            twin = tuple(sorted((*rest, (index, not truth))))
            other = Move(move.target, twin, move.inputs)
            if other in moves:
                return (moves - {move, other}) | {Move(move.target, rest, move.inputs)}
    return None


def _unite_two_ranges(moves: set[Move]) -> set[Move] | None:
    ordered = sorted(moves, key=lambda m: (m.target, m.literals, m.inputs))
    for a, b in pairwise(ordered):
        same = (a.target, a.literals) == (b.target, b.literals)
        if same and a.inputs[1] == b.inputs[0]:
            united = Move(a.target, a.literals, (a.inputs[0], b.inputs[1]))
            return (moves - {a, b}) | {united}
    return None


def _classes(
    letters: list[list[tuple[tuple[Literal, ...], Interval, int]]],
    final: list[tuple[Move, ...]],
) -> list[int]:
    """Coarsest classes of DFA states that move alike and end alike (Moore's refinement)."""
    group = _numbered(final)
    while True:
        views = [
            (group[q], _joined([Move(group[t], lit, i) for lit, i, t in row]))
            for q, row in enumerate(letters)
        ]
        finer = _numbered(views)
        if max(finer) == max(group):
            return group
        group = finer


def _numbered(keys: Sequence[Hashable]) -> list[int]:
    seen: dict[Hashable, int] = {}
    return [seen.setdefault(key, len(seen)) for key in keys]


UNBOUNDED: Interval = (-inf, inf)
