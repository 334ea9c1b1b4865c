"""What is said of a text that is no formula, word for word, with the column where it goes wrong."""

import pytest

from logic.test_parser import DEFINITIONS, PARAMETERS
from sandra.errors import FormulaError
from sandra.logic.formula import TRUE
from sandra.logic.parser import parse
from sandra.logic.specification import Part
from sandra.logic.tokens import tokens_of

NAMES = (
    "in_lane, in_lanelet, keeps_safe_distance, keeps_lane_speed_limit, braking_justification, "
    "in_standstill, halts, round, about, broken, a_lim, v_err, v_type"
)
NO_VARIABLE = "is no state variable (choose from a, v, s, d)"


@pytest.mark.parametrize(
    ("text", "problem", "column"),
    [
        ("true & )", "expected a formula, found ')'", 8),
        ("true)", "unexpected ')'", 5),
        ("true false", "unexpected 'false'", 6),
        ("true & (false", "expected ')', found the end", 14),
        ("true & v = 3", "unexpected '='", 10),
        ("true & v", "expected one of < <= > >=, found the end", 9),
        ("true & v true", "expected one of < <= > >=, found 'true'", 10),
        ("true & v <=", "expected a number, found the end", 12),
        ("true & v <= & 3", "expected a number, found '&'", 13),
        # Other spellings of a sign are named by it, and have their own columns.
        ("true ∧ v ≤ ∧ 3", "expected a number, found '&'", 12),
        ("true and v <= not 3", "expected a number, found '!'", 15),
        (
            "true & v <= a + 1",
            "a state variable can only be compared with numbers and parameters",
            13,
        ),
        ("true & v <= a_lm + 1", "unknown parameter 'a_lm' (did you mean 'a_lim'?)", 13),
        (
            "true & v <= ww + 1",
            "unknown parameter 'ww' (choose from a_lim, v_err, v_type)",
            13,
        ),
        ("true & v <= 1/0 + 1", "division by zero", 15),
        (
            "true & v <= inf - inf & false",
            "a comparison with something that is not a number",
            8,
        ),
        ("true & 3 < 4 + 1", f"'4' {NO_VARIABLE}", 12),
        ("true & 3 < w & false", f"'w' {NO_VARIABLE}", 12),
        ("true & |w| < 3", f"'w' {NO_VARIABLE}", 9),
        ("true & 3 <", f"the end {NO_VARIABLE}", 11),
        ("true & |a < 3", "expected '|', found '<'", 11),
        ("true & ww <= 3", f"unknown name 'ww' (choose from {NAMES})", 8),
        ("true & in_lan(left)", "unknown name 'in_lan' (did you mean 'in_lane'?)", 8),
        (
            "true & in_lane(up)",
            "'in_lane' takes current or left or right or opposite, not 'up'",
            16,
        ),
        (
            "true & in_lane & false",
            "'in_lane' needs an argument: in_lane(current|left|right|opposite)",
            8,
        ),
        ("true & in_lanelet + 1", "'in_lanelet' needs an argument: in_lanelet(ID)", 8),
        ("true & in_lane(left", "expected ')', found the end", 20),
        ("true & in_lane(left false", "expected ')', found 'false'", 21),
        ("true & in_lanelet(x)", "'in_lanelet' takes a number, not 'x'", 19),
        ("true & G[3,2] false", "no step lies within the interval", 9),
        (
            "true & G[1.5,2] false",
            "'1.5' is no number of steps: for seconds write '1.5s'",
            10,
        ),
        ("true & G[-1,2] false", "expected a number of steps or seconds, found '-'", 10),
        (
            "true & G[0,1e308s] false",
            "'1e308s' is too long: for no limit write 'inf'",
            12,
        ),
        ("true & G[inf,2] false", "an interval cannot begin at inf", 9),
        ("true & G[1 2] false", "expected ',', found '2'", 12),
        ("true & G[1,2 false", "expected ']', found 'false'", 14),
    ],
)
def test_what_is_said_of_a_text_and_where(text: str, problem: str, column: int) -> None:
    with pytest.raises(FormulaError) as error:
        parse(text, PARAMETERS, 0.1, DEFINITIONS)
    assert str(error.value) == f"{problem} at column {column} of '{text}'"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "a formula is empty: write 'true' for no requirement"),
        (
            "true & again & false",
            "predicate again: 'again' is defined by itself at column 9 of 'false | again & true'",
        ),
        (
            "true & broken & false",
            "predicate broken: expected a number, found the end at column 5 of 'v <='",
        ),
        (
            " & ".join(["true"] * 400),
            f"the formula '{'true & ' * 11}...' is nested too deeply: use fewer parts",
        ),
        (" ".join(["v"] * 1001), f"the formula '{'v ' * 38}v...' has more than 1000 words"),
    ],
)
def test_what_is_said_of_a_text_as_a_whole(text: str, message: str) -> None:
    definitions = {**DEFINITIONS, "again": "false | again & true"}
    with pytest.raises(FormulaError) as error:
        parse(text, PARAMETERS, 0.1, definitions)
    assert str(error.value) == message


def test_other_spellings_have_the_columns_of_their_text() -> None:
    found = tokens_of("¬ p ∧ not q ↔ r or s")
    assert [(t.kind, t.text, t.column) for t in found] == [
        ("sign", "!", 1),
        ("name", "p", 3),
        ("sign", "&", 5),
        ("sign", "!", 7),
        ("name", "q", 11),
        ("sign", "<->", 13),
        ("name", "r", 15),
        ("sign", "|", 17),
        ("name", "s", 20),
        ("end", "the end", 21),
    ]


def test_a_part_need_not_be_described() -> None:
    assert Part("name", "true", TRUE).description == ""
