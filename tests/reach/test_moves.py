"""The moves that the kernel reads agree with the automaton, letter by letter."""

import itertools
import random

import pytest

from logic.random_formulas import random_formula
from sandra.actions import ActionPair
from sandra.logic import Comparison, Dfa, parse, specification, translate
from sandra.logic.automaton import Letter
from sandra.reach.moves import Interval, Move, Moves, _ranges, moves_of

INPUTS: Interval = (-6.0, 6.0)


def values(dfa: Dfa, inputs: Interval) -> list[float]:
    """One acceleration inside each range that the automaton tells apart."""
    return [(low + high) / 2 for low, high in _ranges(dfa, inputs)]


def letters(dfa: Dfa, a: float) -> list[tuple[Letter, dict[int, bool]]]:
    """Every possible letter with this acceleration: as the automaton and as the moves read it."""
    bounds = {x.bound for x in dfa.atoms if isinstance(x, Comparison) and x.variable == "v"}
    speeds = [b + e for b in bounds for e in (-1e-3, 0.0, 1e-3)] or [0.0]
    free = [i for i, x in enumerate(dfa.atoms) if not isinstance(x, Comparison)]
    found = []
    for v in speeds:
        for truths in itertools.product((False, True), repeat=len(free)):
            letter = {}
            for i, atom in enumerate(dfa.atoms):
                if isinstance(atom, Comparison):
                    letter[atom] = atom.holds(a if atom.variable == "a" else v)
                else:
                    letter[atom] = truths[free.index(i)]
            found.append((letter, {i: letter[x] for i, x in enumerate(dfa.atoms)}))
    return found


def targets(moves: Moves, row: str, label: int, truths: dict[int, bool], a: float) -> list[int]:
    return [
        m.target
        for m in getattr(moves, row)[label]
        if m.inputs[0] <= a <= m.inputs[1] and all(truths[i] == t for i, t in m.literals)
    ]


@pytest.mark.parametrize("seed", range(150))
def test_moves_run_as_the_automaton_does(seed: int) -> None:
    rng = random.Random(seed)
    dfa = translate(random_formula(rng, rng.randrange(2, 9)))
    moves = moves_of(dfa, INPUTS, 6)
    choices = [(a, *x) for a in values(dfa, INPUTS) for x in letters(dfa, a)]
    for _ in range(20):
        state, label = dfa.initial, moves.initial
        for _ in range(rng.randrange(6)):
            a, letter, truths = rng.choice(choices)
            state = dfa.step(state, letter)
            (label,) = targets(moves, "moves", label, truths, a)
        a, letter, truths = rng.choice(choices)
        accepted = dfa.step(state, letter) in dfa.accepting
        assert targets(moves, "final", label, truths, a) == ([-1] if accepted else [])


@pytest.mark.parametrize("seed", range(60))
@pytest.mark.parametrize("inputs", [(-6.0, 6.0), (0.1, 3.0), (0.0, 0.0)])
def test_live_classes_are_those_that_can_still_accept(seed: int, inputs: Interval) -> None:
    rng = random.Random(1000 + seed)
    dfa = translate(random_formula(rng, rng.randrange(2, 8)))
    horizon = 4
    moves = moves_of(dfa, inputs, horizon)
    assert moves.live[0] == frozenset()
    assert len(moves.live) == horizon + 2
    choices = [(a, x[0], x[1]) for a in values(dfa, inputs) for x in letters(dfa, a)]
    # the classes that go with each automaton state, found by walking both together
    pairs = {(dfa.initial, moves.initial)}
    while True:
        more = {
            (dfa.step(q, letter), c)
            for q, label in pairs
            for a, letter, truths in choices
            for c in targets(moves, "moves", label, truths, a)
        }
        if more <= pairs:
            break
        pairs |= more
    live = set(dfa.accepting)
    for left in range(1, horizon + 2):
        live = {
            q
            for q in range(dfa.n_states)
            if any(dfa.step(q, letter) in live for _, letter, _ in choices)
        }
        for q, label in pairs:
            assert (label in moves.live[left]) == (q in live)


def test_a_lane_change_has_one_class_before_the_last_step() -> None:
    spec = specification(ActionPair.parse("keep,right-lane"))
    moves = moves_of(spec.dfa, INPUTS, 5)
    assert moves.live[2] == {moves.initial}
    (move,) = (m for m in moves.moves[moves.initial] if m.target in moves.live[2])
    assert move.literals == ()
    assert move.inputs == (-0.2, 0.2)


def test_ranges_only_ever_intersect() -> None:
    """ACCELERATE under R_G2 stays ACCELERATE."""
    spec = specification(ActionPair.parse("accelerate,follow-lane"), ("R_G2",))
    moves = moves_of(spec.dfa, INPUTS, 5)
    alive = [m for row in moves.moves for m in row if m.target in moves.live[5]]
    assert alive
    assert all(m.inputs == (0.2, 6.0) for m in alive)


def test_no_admissible_input_no_move() -> None:
    spec = specification(ActionPair.parse("decelerate,follow-lane"), ("G(a >= 0)",))
    moves = moves_of(spec.dfa, INPUTS, 5)
    assert moves.initial not in moves.live[6]
    narrow = moves_of(translate(parse("G(a > 1)")), (-6.0, 0.5), 3)
    assert narrow.initial not in narrow.live[4]


@pytest.mark.parametrize(
    ("text", "inputs", "expected"),
    [
        ("G(a <= 1)", (-6.0, 6.0), [(-6.0, 1.0), (1.0, 6.0)]),
        ("G(a <= 1)", (1.0, 6.0), [(1.0, 6.0)]),
        ("G(a <= 1)", (-6.0, 1.0), [(-6.0, 1.0)]),
        ("G(a <= 1)", (2.0, 6.0), [(2.0, 6.0)]),
        ("G(a <= 1 & v <= 2)", (-6.0, 6.0), [(-6.0, 1.0), (1.0, 6.0)]),
        ("G(v <= 2)", (-6.0, 6.0), [(-6.0, 6.0)]),
        ("F(a < 1) & F(a > 3)", (-6.0, 6.0), [(-6.0, 1.0), (1.0, 3.0), (3.0, 6.0)]),
        ("G(a <= 1)", (1.0, 1.0), [(1.0, 1.0)]),
        ("G(a <= 1)", (1.5, 1.0), []),
    ],
)
def test_bounds_part_the_admissible_inputs_where_they_lie_inside(
    text: str, inputs: Interval, expected: list[Interval]
) -> None:
    assert _ranges(translate(parse(text)), inputs) == expected


def test_moves_of_formulas_in_full() -> None:
    """As few moves as there can be: unused literals dropped, ranges of input united."""
    free = moves_of(translate(parse("true")), INPUTS, 2)
    assert free.moves == ((Move(0, (), INPUTS),),)
    assert free.final == ((Move(-1, (), INPUTS),),)
    assert free.live == (frozenset(), *[frozenset({0})] * 3)
    bounded = moves_of(translate(parse("G(a <= 1)")), INPUTS, 1)
    assert bounded.initial == 0
    assert [m for m in bounded.moves[0] if m.target in bounded.live[1]] == [
        Move(0, (), (-6.0, 1.0))
    ]
    assert bounded.final[0] == (Move(-1, (), (-6.0, 1.0)),)
    sooner = moves_of(translate(parse("F(v <= 2)")), INPUTS, 2)
    assert sooner.live[1] == {0, 1}
    assert sooner.moves[sooner.initial] == (
        Move(0, ((0, False),), INPUTS),
        Move(1, ((0, True),), INPUTS),
    )
    assert sooner.final[sooner.initial] == (Move(-1, ((0, True),), INPUTS),)
    assert sooner.moves[1] == (Move(1, (), INPUTS),)


def test_no_input_at_all_leaves_nothing() -> None:
    found = moves_of(translate(parse("true")), (1.0, -1.0), 3)
    assert found.live == (frozenset(),) * 5
    assert found.moves == ((),)


def test_a_bound_holds_throughout_a_range_or_not_at_all() -> None:
    """However narrow the range is beside its distance from zero."""
    above, below = (
        moves_of(translate(parse(f"G(a {x})")), (3.0, 4.0), 1) for x in ("> 3.5", "<= 3.5")
    )
    assert above.final[above.initial] == (Move(-1, (), (3.5, 4.0)),)
    assert below.final[below.initial] == (Move(-1, (), (3.0, 3.5)),)
    low = moves_of(translate(parse("G(a < -3.5)")), (-4.0, -3.0), 1)
    assert low.final[low.initial] == (Move(-1, (), (-4.0, -3.5)),)
