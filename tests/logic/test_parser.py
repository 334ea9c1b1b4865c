import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from sandra.errors import FormulaError
from sandra.logic import parser
from sandra.logic.formula import (
    And,
    Comparison,
    Finally,
    Globally,
    Iff,
    Implies,
    Next,
    Not,
    Or,
    Predicate,
    Release,
    Until,
    WeakNext,
    WeakUntil,
)
from sandra.logic.parser import check_definition_name, parse
from sandra.logic.tokens import excerpt, tokens_of

L, C, R = (Predicate("in_lane", side) for side in ("left", "current", "right"))
PARAMETERS = {"a_lim": 0.2, "v_err": 0.1, "v_type": math.inf}
DEFINITIONS = {
    "in_standstill": "v <= v_err & v >= -v_err",
    "halts": "F G in_standstill",
    "round": "X about",
    "about": "N round",
    "broken": "v <= ",
}


def read(text):
    text = text.replace("lft", "in_lane(left)").replace("cur", "in_lane(current)")
    return parse(text.replace("rgt", "in_lane(right)"), PARAMETERS, 0.1, DEFINITIONS)


@pytest.mark.parametrize(
    ("text", "formula"),
    [
        ("lft & cur | rgt", Or(And(L, C), R)),
        ("lft | cur & rgt", Or(L, And(C, R))),
        ("lft -> cur -> rgt", Implies(L, Implies(C, R))),
        ("lft <-> cur -> rgt", Iff(L, Implies(C, R))),
        ("lft <-> cur <-> rgt", Iff(Iff(L, C), R)),
        ("lft | cur -> rgt", Implies(Or(L, C), R)),
        ("lft U cur & rgt", And(Until(L, C), R)),
        ("lft U cur R rgt", Until(L, Release(C, R))),
        ("lft W cur", WeakUntil(L, C)),
        ("!lft U cur", Until(Not(L), C)),
        ("G lft & cur", And(Globally(L), C)),
        ("G(lft & cur)", Globally(And(L, C))),
        ("F G lft", Finally(Globally(L))),
        ("FG lft", Finally(Globally(L))),
        ("FG(lft)", Finally(Globally(L))),
        ("XNX lft", Next(WeakNext(Next(L)))),
        ("F[2,5]G lft", Finally(Globally(L), 2, 5)),
        ("FG[2,5] lft", Finally(Globally(L, 2, 5))),
        ("G[2,inf] lft", Globally(L, 2, None)),
        ("G[0s,1.5s] lft", Globally(L, 0, 15)),
        ("G[0.05s,0.25s] lft", Globally(L, 1, 2)),
        ("F[0.3s,0.3s] lft", Finally(L, 3, 3)),
        ("not lft and cur or rgt", Or(And(Not(L), C), R)),
        ("¬lft ∧ cur ∨ rgt → cur ↔ lft", Iff(Implies(Or(And(Not(L), C), R), C), L)),
        ("v ≤ 3", Comparison("v", "<=", 3.0)),
        ("v ≥ 3", Not(Comparison("v", "<", 3.0))),
        ("v <= +3 - -1", Comparison("v", "<=", 4.0)),
        ("in_lanelet(0012)", Predicate("in_lanelet", "12")),
        ("a > a_lim", Not(Comparison("a", "<=", 0.2))),
        ("a < -a_lim", Comparison("a", "<", -0.2)),
        ("a_lim < a", Not(Comparison("a", "<=", 0.2))),
        ("-a_lim >= a", Comparison("a", "<=", -0.2)),
        ("|a| <= a_lim", And(Comparison("a", "<=", 0.2), Not(Comparison("a", "<", -0.2)))),
        ("|a| < 1", And(Comparison("a", "<", 1), Not(Comparison("a", "<=", -1)))),
        ("|a| > 1", Or(Not(Comparison("a", "<=", 1)), Comparison("a", "<", -1))),
        ("|a| >= 1", Or(Not(Comparison("a", "<", 1)), Comparison("a", "<=", -1))),
        ("lft | |a| < 1", Or(L, And(Comparison("a", "<", 1), Not(Comparison("a", "<=", -1))))),
        ("1 > |a|", And(Comparison("a", "<", 1), Not(Comparison("a", "<=", -1)))),
        ("v <= 36 km/h", Comparison("v", "<=", 10.0)),
        ("v <= 13.9 m/s", Comparison("v", "<=", 13.9)),
        ("a < -2 m/s^2", Comparison("a", "<", -2.0)),
        ("d < 2*(1 + a_lim)/4 - 1e-1", Comparison("d", "<", 0.5)),
        ("s < .5", Comparison("s", "<", 0.5)),
        ("v <= 1 - 2 - 3", Comparison("v", "<=", -4.0)),
        ("v <= 8 / 2 / 2", Comparison("v", "<=", 2.0)),
        ("in_standstill", And(Comparison("v", "<=", 0.1), Not(Comparison("v", "<", -0.1)))),
    ],
)
def test_text_means(text, formula):
    assert read(text) == formula


def test_spaces_do_not_matter():
    assert read("G( a>a_lim )\n  &\t FG(lft)") == read("G(a > a_lim) & F G lft")


def test_definitions_may_use_definitions():
    assert read("halts") == Finally(Globally(read("in_standstill")))


def test_an_infinite_parameter_demands_nothing():
    assert str(read("G(v <= v_type & lft)")) == "G(true & in_lane(left))"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "a formula is empty"),
        ("   ", "a formula is empty"),
        ("G(", "expected a formula, found the end at column 3"),
        ("G(lft", "expected ')', found the end"),
        ("lft)", "unexpected ')'"),
        ("lft cur", "unexpected 'in_lane'"),
        ("lft &", "expected a formula, found the end"),
        ("v <= 3 $", "unexpected '$' at column 8 of 'v <= 3 $'"),
        ("v = 3", "unexpected '='"),
        ("v", "expected one of < <= > >=, found the end"),
        ("v <=", "expected a number, found the end"),
        ("v <= & 3 < v", "expected a number, found '&' at column 6"),
        ("0 <= v <= 3", "unexpected '<='"),
        ("v <= a", "a state variable can only be compared with numbers and parameters"),
        ("v <= a_lm", "unknown parameter 'a_lm' (did you mean 'a_lim'?) at column 6"),
        ("v <= 1/0", "division by zero at column 8"),
        ("cur & v <= inf - inf", "something that is not a number at column 20"),
        ("3 < 4", "'4' is no state variable (choose from a, v, s, d)"),
        ("3 < w", "'w' is no state variable"),
        ("|w| < 3", "'w' is no state variable"),
        ("|a < 3", "expected '|', found '<'"),
        ("w <= 3", "unknown name 'w'"),
        ("in_lan(left)", "unknown name 'in_lan' (did you mean 'in_lane'?) at column 1"),
        ("in_lane(up)", "takes current or left or right or opposite, not 'up' at column 9"),
        ("in_lane", "'in_lane' needs an argument"),
        ("in_lane(left", "expected ')'"),
        ("in_lane(3)", "'in_lane' takes"),
        ("in_lanelet(left)", "'in_lanelet' takes a number, not 'left'"),
        ("in_lanelet(1.5)", "'in_lanelet' takes a number"),
        ("in_lanelet(ID)", "'in_lanelet' takes a number"),
        ("keeps_safe_distance(7)", "'keeps_safe_distance' takes preceding"),
        ("keeps_lane_speed_limit(7)", "unexpected '('"),
        ("in_standstill(7)", "unexpected '('"),
        ("G[3,2] lft", "no step lies within the interval at column 2"),
        ("G[0.12s,0.18s] lft", "no step lies within the interval"),
        ("G[1.5,2] lft", "'1.5' is no number of steps: for seconds write '1.5s' at column 3"),
        ("G[-1,2] lft", "expected a number of steps or seconds, found '-' at column 3"),
        ("G[0,1e308s] lft", "'1e308s' is too long: for no limit write 'inf' at column 5"),
        ("G[0,1e999s] lft", "'1e999s' is too long"),
        ("G[inf,inf] lft", "cannot begin at inf at column 2"),
        ("G[1 2] lft", "expected ',', found '2'"),
        ("X[1,2] lft", "expected a formula, found '['"),
        ("round", "'round' is defined by itself"),
        ("broken", "predicate broken: expected a number"),
        ("!" * 500 + "lft", "nested too deeply"),
        ("(" * 450 + "lft" + ")" * 450, "nested too deeply"),
        (" & ".join(["true"] * 300), "nested too deeply"),
        (" & ".join(["lft"] * 600), "more than 1000 words"),
    ],
)
def test_bad_text_is_one_line_that_says_what_and_where(text, message):
    with pytest.raises(FormulaError) as error:
        read(text)
    assert message in str(error.value)
    assert "\n" not in str(error.value)
    assert len(str(error.value)) < 400


def test_columns_count_in_the_line_that_is_shown():
    with pytest.raises(FormulaError, match=r"at column 8 of 'true & w < 3'"):
        parse("true\n   &\n\n w < 3")


def test_seconds_need_the_duration_of_a_step():
    with pytest.raises(FormulaError, match="need the duration of a step: use steps at column 3"):
        parse("G[0s,1s] in_lane(left)")
    assert parse("G[0,1s] in_lane(left)", dt=0.04) == Globally(L, 0, 25)


@pytest.mark.parametrize("dt", [0.0, -0.1, math.nan, math.inf])
def test_the_duration_of_a_step_is_positive(dt):
    with pytest.raises(FormulaError, match="dt"):
        parse("true", dt=dt)


def test_definitions_cannot_blow_up():
    definitions = {"p0": "in_lane(left)"}
    definitions |= {f"p{i}": f"p{i - 1} & p{i - 1}" for i in range(1, 40)}
    with pytest.raises(FormulaError, match="more than 1000 defined predicates"):
        parse("p39", definitions=definitions)


def test_the_limit_of_definitions_itself_is_allowed(monkeypatch):
    monkeypatch.setattr(parser, "MAX_REPLACED", 3)
    definitions = {"p": "in_lane(left)", "q": "p"}
    assert parse("p & q", definitions=definitions) == And(L, L)
    with pytest.raises(FormulaError, match="more than 3 defined predicates to replace at column 1"):
        parse("q & q", definitions=definitions)


def test_the_limit_of_words_itself_is_allowed():
    assert len(tokens_of("v " * 1000)) == 1001
    with pytest.raises(FormulaError, match="more than 1000 words"):
        tokens_of("v " * 1001)


def test_every_operator_has_its_column():
    assert [(t.text, t.column) for t in tokens_of("FGX p")] == [
        ("F", 1),
        ("G", 2),
        ("X", 3),
        ("p", 5),
        ("the end", 6),
    ]


def test_a_long_text_is_quoted_shortened():
    assert excerpt("x" * 80) == "x" * 80
    assert excerpt("x" * 81) == "x" * 77 + "..."
    assert excerpt("a\n  b") == "a b"


def test_without_parameters_there_is_none_to_suggest():
    with pytest.raises(FormulaError, match=r"unknown parameter 'w' at column 6"):
        parse("v <= w")
    with pytest.raises(FormulaError, match=r"unknown parameter 'w' \(choose from x, y\)"):
        parse("v <= w", {"x": 1.0, "y": 2.0})


@pytest.mark.parametrize(
    "name", ["true", "false", "inf", "U", "R", "W", "a", "v", "s", "d", "in_lane", "and", "not"]
)
def test_what_is_built_in_cannot_be_defined(name):
    with pytest.raises(FormulaError, match=f"'{name}' is built in"):
        check_definition_name(name)


@pytest.mark.parametrize("name", ["", "3p", "p q", "p-q", "G", "FG", "XNX", "é"])
def test_names_of_definitions_are_words(name):
    with pytest.raises(FormulaError, match="is no name of a predicate"):
        check_definition_name(name)


def test_a_billionth_of_a_step_is_rounding():
    def interval(text):
        formula = parse(f"G[{text}] v < 1", dt=1.0)
        return formula.lower, formula.upper

    assert interval("0.000000001s,5s") == (0, 5)
    assert interval("0.000000002s,5s") == (1, 5)
    # Of a long time, a billionth is more.
    assert interval("0s,999999.9995s") == (0, 1_000_000)
    assert interval("0s,999999.998s") == (0, 999_999)


@given(st.integers(0, 500) | st.integers(0, 10**7), st.sampled_from((0.04, 0.1, 0.2, 1 / 3)))
def test_a_whole_number_of_steps_in_seconds_is_that_number(steps, dt):
    assert parse(f"F[0,{steps * dt!r}s] v < 1", dt=dt).upper == steps


@given(st.text(alphabet="GFXNURW!&|()[],.<>=-+*/ 019avsdin_lae\n$é", max_size=30))
def test_any_text_is_a_formula_or_an_error(text):
    try:
        formula = read(text)
    except FormulaError:
        return
    assert parse(str(formula)) == formula
