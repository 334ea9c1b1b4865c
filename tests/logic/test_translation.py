import time
from dataclasses import dataclass

import pytest

from sandra.actions import ALL_PAIRS
from sandra.errors import FormulaError
from sandra.logic import diagram, translation
from sandra.logic.diagram import Diagrams
from sandra.logic.evaluate import evaluate
from sandra.logic.formula import TRUE, Finally, Formula, Globally, Not, Or, Predicate, Until
from sandra.logic.parser import parse
from sandra.logic.specification import specification
from sandra.logic.translation import translate
from sandra.settings import Settings

P = Predicate("p")


@pytest.mark.parametrize(
    "text",
    [
        "G[0,100000] in_lane(left)",
        # Remembers for each of 20 steps whether it was true: 2^20 states.
        "G(in_lane(left) <-> X" + " X" * 19 + " in_lane(right))",
    ],
)
def test_a_formula_that_is_too_large_is_refused(text):
    with pytest.raises(FormulaError, match="too large"):
        translate(parse(text))


def test_a_formula_that_is_too_deep_is_refused():
    formula = P
    for _ in range(700):
        formula = Globally(Not(formula))
    with pytest.raises(FormulaError, match="too deeply"):
        translate(formula)


def test_deadlines_that_overlap_do_not_multiply():
    # Without knowing that an earlier deadline implies a later one: 2^40 states.
    dfa = translate(parse("G(in_lane(left) -> F[0,40] in_lane(right))"))
    assert dfa.n_states == 43
    dfa = translate(parse("G(in_lane(left) -> G[0,40] in_lane(right))"))
    assert dfa.n_states == 43


def test_a_long_deadline_is_no_trouble():
    dfa = translate(Finally(P, 0, 300))
    assert dfa.n_states == 303
    assert dfa.accepts([set()] * 300 + [{P}])
    assert not dfa.accepts([set()] * 301 + [{P}])


def test_a_specification_takes_milliseconds():
    # Bounds that no other test uses: nothing is remembered.
    settings = Settings(a_lim=0.123, a_abrupt=-1.23, v_fov=12.3)
    start = time.process_time()
    for pair in ALL_PAIRS:
        specification(pair, ("R_G1", "R_G2", "R_G3"), settings)
    # About 3 ms each; ten times that still serves a decision.
    assert (time.process_time() - start) / len(ALL_PAIRS) < 0.03


def test_diagrams_of_equal_functions_are_equal():
    d = Diagrams(["x", "y"])
    x, y = d.test(0), d.test(1)
    assert d.conjunction(x, y) == d.conjunction(y, x)
    assert d.negation(d.conjunction(x, y)) == d.disjunction(d.negation(x), d.negation(y))
    assert d.disjunction(x, d.negation(x)) == 1
    assert d.conjunction(x, d.negation(x)) == 0
    assert d.ite(x, y, y) == y
    assert d.conjunction(x, y) != d.disjunction(x, y)


def test_in_a_chain_each_variable_implies_the_next():
    d = Diagrams(["c", "c", "c", "other"])
    first, second, third, other = (d.test(i) for i in range(4))
    assert d.disjunction(first, second) == second
    assert d.conjunction(first, third) == first
    assert d.conjunction(first, d.negation(third)) == 0
    assert d.disjunction(first, other) != d.disjunction(second, other)
    # "The first true one is the second" is a function of its own.
    only_second = d.conjunction(second, d.negation(first))
    assert d.conjunction(only_second, third) == only_second
    assert d.disjunction(only_second, first) == second


def states_before_minimisation(n):
    """Of F[0,n] p: n + 1 deadlines, accepted and failed."""
    return n + 3


def test_the_limit_of_states_itself_is_allowed(monkeypatch):
    formula = Finally(Predicate("limit_of_states"), 0, 20)
    monkeypatch.setattr(translation, "MAX_STATES", states_before_minimisation(20) - 1)
    with pytest.raises(FormulaError, match=r"more than 22 states; use fewer"):
        translate(formula)
    monkeypatch.setattr(translation, "MAX_STATES", states_before_minimisation(20))
    assert translate(formula).n_states == 23


def test_the_limit_of_deadlines_itself_is_allowed(monkeypatch):
    p = Predicate("limit_of_deadlines")
    # 21 deadlines and p; all of them are sure to be met, so that there are but two states.
    formula = Finally(Or(p, Not(p)), 0, 20)
    monkeypatch.setattr(translation, "MAX_STATES", 21)
    with pytest.raises(FormulaError, match=r"span more than 21 steps"):
        translate(formula)
    monkeypatch.setattr(translation, "MAX_STATES", 22)
    assert translate(formula) == translate(TRUE)


def test_the_limit_of_cubes_itself_is_allowed(monkeypatch):
    formula = Until(Predicate("cubes_left"), Predicate("cubes_right"))
    cubes = sum(len(edge.cubes) for edges in translate(formula).edges for edge in edges)
    # Four at first, for the values of two atoms; one each once it is accepted or failed.
    assert cubes == 6
    other = Until(Predicate("cubes_left"), Predicate("cubes_other"))
    monkeypatch.setattr(translation, "MAX_CUBES", cubes - 1)
    with pytest.raises(FormulaError, match=r"more than 5 cubes"):
        translate(other)
    monkeypatch.setattr(translation, "MAX_CUBES", cubes)
    assert translate(other).n_states == 3


def test_the_limit_of_nodes_itself_is_allowed(monkeypatch):
    monkeypatch.setattr(diagram, "MAX_NODES", 4)
    d = Diagrams(["x", "y", "z"])
    # Two leaves and two tests; what is known takes no room.
    x, y = d.test(0), d.test(1)
    assert (d.test(0), d.test(1)) == (x, y)
    with pytest.raises(FormulaError, match=r"more than 4 nodes"):
        d.test(2)


def test_an_operator_without_a_rule_is_refused():
    @dataclass(frozen=True)
    class Often(Formula):
        operands: tuple = (P,)

    with pytest.raises(TypeError, match="no rule to translate Often"):
        translate(Often())
    with pytest.raises(TypeError, match="no rule to evaluate Often"):
        evaluate(Often(), [{P}])
