"""The deterministic automaton of a formula over finite traces, with symbolic edges."""

from __future__ import annotations

from collections.abc import Container, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass

from sandra.logic.formula import Atom, Not


@dataclass(frozen=True, slots=True)
class Cube:
    """A conjunction of literals: atoms that must be true and atoms that must be false.

    Both are indices into `Dfa.atoms`; an atom in neither does not matter.
    """

    true: frozenset[int]
    false: frozenset[int]

    @property
    def true_mask(self) -> int:
        """`true` as bits: bit i stands for atom i."""
        return sum(1 << i for i in self.true)

    @property
    def false_mask(self) -> int:
        """`false` as bits: bit i stands for atom i."""
        return sum(1 << i for i in self.false)

    def admits(self, letter: int) -> bool:
        """Whether a letter, given as bits, satisfies the literals."""
        true = self.true_mask
        return letter & true == true and not letter & self.false_mask


@dataclass(frozen=True, slots=True)
class Edge:
    """To `target` under any of `cubes`, which exclude each other."""

    target: int
    cubes: tuple[Cube, ...]


Letter = Mapping[Atom, bool] | Container[Atom] | int
"""One step: the truth of each atom, or the true atoms, or bits (bit i: atom i of the automaton)."""


@dataclass(frozen=True, slots=True)
class Dfa:
    """The minimal deterministic automaton of a formula; the empty trace is not accepted.

    States are 0..n_states-1, numbered from the initial state outwards, so that two formulas with
    the same meaning have equal automata. `edges[q]` are the edges of state q: their cubes are
    disjoint and complete, every letter takes exactly one. `atoms` are those that matter.

    Letters must be possible ones: where `a <= -0.2` is true, `a <= 0.2` is. For others, the run
    is some run.
    """

    atoms: tuple[Atom, ...]
    n_states: int
    initial: int
    accepting: frozenset[int]
    edges: tuple[tuple[Edge, ...], ...]

    def __hash__(self) -> int:
        """Without the edges, of which there are many."""
        return hash((self.atoms, self.n_states, self.initial, self.accepting))

    def bits(self, letter: Letter) -> int:
        """A letter as bits over `atoms`. Raises `KeyError` if a mapping lacks one of them."""
        if isinstance(letter, int):
            return letter
        if isinstance(letter, Mapping):
            return sum(1 << i for i, atom in enumerate(self.atoms) if letter[atom])
        return sum(1 << i for i, atom in enumerate(self.atoms) if atom in letter)

    def step(self, state: int, letter: Letter) -> int:
        """The state after reading `letter` in `state`.

        Raises:
            ValueError: if there is no such state.
        """
        if not 0 <= state < self.n_states:
            raise ValueError(f"no state {state} in an automaton of {self.n_states} states")
        bits = self.bits(letter)
        for edge in self.edges[state]:
            if any(cube.admits(bits) for cube in edge.cubes):
                return edge.target
        raise ValueError(f"state {state} has no edge for the letter {bits:b}")

    def run(self, trace: Iterable[Letter]) -> Iterator[int]:
        """The states after each letter, from the initial one (which is not yielded)."""
        state = self.initial
        for letter in trace:
            state = self.step(state, letter)
            yield state

    def accepts(self, trace: Sequence[Letter]) -> bool:
        """Whether the finite trace satisfies the formula; the empty one does not."""
        states = list(self.run(trace))
        return bool(states) and states[-1] in self.accepting

    def acceptable(self, letters_left: int) -> frozenset[int]:
        """The states from which exactly `letters_left` more letters can lead to acceptance."""
        return self.acceptable_by_step(letters_left)[0]

    def acceptable_by_step(self, letters: int) -> tuple[frozenset[int], ...]:
        """For a trace of `letters` letters: after k of them, the states that may still accept.

        Entry k (0 <= k <= `letters`) is `acceptable(letters - k)`; the last one is `accepting`.

        Raises:
            ValueError: if `letters` is negative.
        """
        if letters < 0:
            raise ValueError(f"{letters} letters are left, but it must be 0 or more")
        sets = [self.accepting]
        for _ in range(letters):
            after = sets[-1]
            sets.append(
                frozenset(
                    state
                    for state, edges in enumerate(self.edges)
                    if any(edge.target in after for edge in edges)
                )
            )
        return tuple(reversed(sets))

    def to_dot(self) -> str:
        """The automaton as Graphviz text; accepting states have a double border."""
        lines = ["digraph dfa {", "  rankdir=LR;", '  start [shape=point, label=""];']
        for state in range(self.n_states):
            shape = "doublecircle" if state in self.accepting else "circle"
            lines.append(f"  {state} [shape={shape}];")
        lines.append(f"  start -> {self.initial};")
        for state, edges in enumerate(self.edges):
            for edge in edges:
                label = " or\\n".join(self.describe(cube) for cube in edge.cubes)
                lines.append(f'  {state} -> {edge.target} [label="{label}"];')
        return "\n".join([*lines, "}"])

    def describe(self, cube: Cube) -> str:
        """A cube in the syntax of formulas, e.g. `in_lane(left) & a > 0.2`."""
        literals = [
            str(atom if i in cube.true else Not(atom))
            for i, atom in enumerate(self.atoms)
            if i in cube.true or i in cube.false
        ]
        return " & ".join(literals) or "true"
