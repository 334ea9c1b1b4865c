import itertools
import random

import pytest

from logic.random_formulas import PREDICATES, VALUES, random_formula
from sandra.logic.automaton import Cube, Dfa, Edge
from sandra.logic.evaluate import evaluate, letter
from sandra.logic.formula import Comparison, Predicate
from sandra.logic.parser import parse
from sandra.logic.translation import translate

LEFT = Predicate("in_lane", "left")


def possible_letters(dfa):
    """Bits of every letter that some values and predicates give."""
    steps = itertools.product(VALUES, VALUES, itertools.product((0, 1), repeat=len(PREDICATES)))
    return sorted(
        {
            dfa.bits(
                letter(
                    dfa.atoms,
                    {"a": a, "v": v},
                    {p for p, on in zip(PREDICATES, chosen, strict=True) if on},
                )
            )
            for a, v, chosen in steps
        }
    )


def n_classes(dfa, letters):
    """States that no trace of possible letters tells apart, by Moore's algorithm."""
    label = [state in dfa.accepting for state in range(dfa.n_states)]
    while True:
        signature = [
            (label[state], *(label[dfa.step(state, x)] for x in letters))
            for state in range(dfa.n_states)
        ]
        if len(set(signature)) == len(set(label)):
            return len(set(label))
        label = signature


def random_automata(n, seed, smallest=1, largest=9):
    rng = random.Random(seed)
    return [translate(random_formula(rng, rng.randrange(smallest, largest))) for _ in range(n)]


def test_every_letter_takes_exactly_one_edge_even_an_impossible_one():
    for dfa in random_automata(250, seed=1):
        for edges in dfa.edges:
            for bits in range(2 ** len(dfa.atoms)):
                assert sum(cube.admits(bits) for edge in edges for cube in edge.cubes) == 1


def test_automata_are_minimal_and_reachable():
    sizes = []
    for dfa in random_automata(250, seed=2, smallest=3):
        letters = possible_letters(dfa)
        assert n_classes(dfa, letters) == dfa.n_states
        reached, pending = {dfa.initial}, [dfa.initial]
        while pending:
            state = pending.pop()
            new = {dfa.step(state, x) for x in letters} - reached
            reached |= new
            pending.extend(new)
        assert reached == set(range(dfa.n_states))
        sizes.append(dfa.n_states)
    assert max(sizes) > 5


def test_every_cube_is_possible_and_every_atom_matters():
    for dfa in random_automata(250, seed=3):
        letters = possible_letters(dfa)
        used = set()
        for edges in dfa.edges:
            for cube in (cube for edge in edges for cube in edge.cubes):
                assert any(cube.admits(x) for x in letters)
                used |= cube.true | cube.false
        assert used == set(range(len(dfa.atoms)))


def test_acceptable_is_what_exploring_every_trace_finds():
    for dfa in random_automata(60, seed=4, smallest=4):
        letters = possible_letters(dfa)
        for left in range(4):
            found = set()
            for state in range(dfa.n_states):
                ends = {state}
                for _ in range(left):
                    ends = {dfa.step(q, x) for q in ends for x in letters}
                if ends & dfa.accepting:
                    found.add(state)
            assert dfa.acceptable(left) == found


def test_acceptable_of_a_deadline():
    dfa = translate(parse("F[2,3] in_lane(left)"))
    # At least three letters are needed: the third is step 2.
    assert [dfa.initial in dfa.acceptable(n) for n in range(5)] == [False, False, False, True, True]
    by_step = dfa.acceptable_by_step(4)
    assert len(by_step) == 5
    assert by_step[-1] == dfa.accepting
    assert [by_step[k] for k in range(5)] == [dfa.acceptable(4 - k) for k in range(5)]


def test_acceptable_needs_a_number_of_letters():
    with pytest.raises(ValueError, match="-1 letters"):
        translate(parse("true")).acceptable(-1)


@pytest.mark.parametrize(
    ("text", "n_states"),
    [
        ("true", 2),
        ("false", 1),
        ("in_lane(left)", 3),
        ("G in_lane(left)", 3),
        ("F in_lane(left)", 2),
        ("F G in_lane(left)", 2),
        ("X in_lane(left)", 4),
        ("N in_lane(left)", 4),
        ("in_lane(left) U in_lane(right)", 3),
        ("F[0,10] in_lane(left)", 13),
        ("G(in_lane(left) -> F[0,10] in_lane(right))", 13),
    ],
)
def test_size(text, n_states):
    assert translate(parse(text)).n_states == n_states


@pytest.mark.parametrize(
    ("left", "right"),
    [
        # What one bound implies about another is used.
        ("G(v <= 50) & G(v <= 43)", "G(v <= 43)"),
        ("G(a > 0.2) & F(a < -0.2)", "false"),
        ("G(a > 0.2 -> a >= 0.2)", "true"),
        ("G(a > 0.2) & G(a >= -2)", "G(a > 0.2)"),
        ("F(v < 1 | v <= 1)", "F(v <= 1)"),
        ("v > 1 & v < 1", "false"),
        ("v >= 1 & v <= 1", "!(v < 1 | v > 1)"),
        # So is what one deadline implies about another.
        ("F[0,3] in_lane(left) & F[0,7] in_lane(left)", "F[0,3] in_lane(left)"),
        ("G[0,3] in_lane(left) & G[0,7] in_lane(left)", "G[0,7] in_lane(left)"),
        ("X F[1,3] in_lane(left)", "F[2,4] in_lane(left)"),
        ("in_lane(left) | !in_lane(left)", "true"),
        ("G(in_lane(left) & in_lane(right))", "G in_lane(right) & G in_lane(left)"),
    ],
)
def test_same_meaning_gives_the_same_automaton(left, right):
    assert translate(parse(left)) == translate(parse(right))


def test_atoms_that_cannot_matter_are_not_in_the_automaton():
    dfa = translate(parse("G(v <= 50 & v <= 43 & (in_lane(left) | !in_lane(left)))"))
    assert dfa.atoms == (Comparison("v", "<=", 43.0),)


def test_closely_related_bounds_are_told_apart():
    formula = parse("G(v < 1 -> a > 0) & F(v <= 1 & a <= 0)")
    dfa = translate(formula)
    for values in itertools.product((0.5, 1.0, 1.5), (0.0, 1.0), repeat=2):
        trace = [
            letter(dfa.atoms, {"v": values[i], "a": values[i + 1]}, ()) for i in range(0, 4, 2)
        ]
        assert dfa.accepts(trace) == evaluate(formula, trace)


def test_letters_as_sets_mappings_and_bits():
    dfa = translate(parse("G(in_lane(left) & v <= 3)"))
    slow = Comparison("v", "<=", 3.0)
    assert dfa.atoms == (LEFT, slow)
    for both in ({LEFT, slow}, {LEFT: True, slow: True}, 0b11):
        assert dfa.accepts([both, both])
    for one in ({slow}, {LEFT: False, slow: True}, 0b10, 0b01):
        assert not dfa.accepts([0b11, one])
    with pytest.raises(KeyError):
        dfa.accepts([{LEFT: True}])


def test_the_empty_trace_is_not_accepted():
    for text in ("true", "G in_lane(left)", "N false"):
        assert not translate(parse(text)).accepts([])


def test_run_and_step():
    dfa = translate(parse("in_lane(left) U in_lane(right)"))
    assert dfa.initial == 0
    states = list(dfa.run([{LEFT}, {Predicate("in_lane", "right")}, set()]))
    assert states[0] == 0
    assert states[1] == states[2]
    assert states[1] in dfa.accepting
    with pytest.raises(ValueError, match="no state 3"):
        dfa.step(3, 0)
    with pytest.raises(ValueError, match="no state -1"):
        dfa.step(-1, 0)


def test_cube_masks():
    cube = Cube(true=frozenset({0, 2}), false=frozenset({3}))
    assert (cube.true_mask, cube.false_mask) == (0b0101, 0b1000)
    assert cube.admits(0b0101)
    assert cube.admits(0b0111)
    assert not cube.admits(0b0001)
    assert not cube.admits(0b1101)


def test_a_picture_names_the_literals():
    dot = translate(parse("G(in_lane(left) & a > 0.2)")).to_dot()
    assert "in_lane(left) & a > 0.2" in dot
    assert dot.count("doublecircle") == 1
    assert dot.startswith("digraph")
    assert dot.endswith("}")


def test_a_cube_is_described_by_its_literals_alone():
    dfa = translate(parse("G(in_lane(left) & in_lane(right) & a > 0.2)"))
    assert [str(atom) for atom in dfa.atoms] == ["in_lane(left)", "in_lane(right)", "a <= 0.2"]
    cube = Cube(true=frozenset({1}), false=frozenset({2}))
    assert dfa.describe(cube) == "in_lane(right) & a > 0.2"
    assert dfa.describe(Cube(true=frozenset(), false=frozenset({0}))) == "!in_lane(left)"
    assert dfa.describe(Cube(frozenset(), frozenset())) == "true"


def test_the_picture_of_an_automaton_in_full():
    assert translate(parse("F in_lane(left)")).to_dot().splitlines() == [
        "digraph dfa {",
        "  rankdir=LR;",
        '  start [shape=point, label=""];',
        "  0 [shape=circle];",
        "  1 [shape=doublecircle];",
        "  start -> 0;",
        '  0 -> 0 [label="!in_lane(left)"];',
        '  0 -> 1 [label="in_lane(left)"];',
        '  1 -> 1 [label="true"];',
        "}",
    ]


def test_an_automaton_with_a_gap_does_not_go_on():
    """Made by hand: the translation leaves no gaps."""
    edge = Edge(0, (Cube(frozenset({0}), frozenset()),))
    dfa = Dfa((LEFT,), n_states=1, initial=0, accepting=frozenset({0}), edges=((edge,),))
    assert dfa.accepts([{LEFT}])
    with pytest.raises(ValueError, match="no edge for the letter 0"):
        dfa.accepts([set()])
