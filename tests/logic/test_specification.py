import math

import pytest

from sandra.actions import ALL_PAIRS, ActionPair
from sandra.errors import FormulaError
from sandra.logic.evaluate import evaluate, letter
from sandra.logic.formula import TRUE, Predicate, atoms_of, simplify
from sandra.logic.specification import Specification, parse_rules, specification
from sandra.logic.vocabulary import Vocabulary
from sandra.settings import Settings

RULES = ("R_G1", "R_G2", "R_G3")
CURRENT, LEFT, RIGHT = (Predicate("in_lane", side) for side in ("current", "left", "right"))
DISTANCE = Predicate("keeps_safe_distance", "preceding")
LIMIT = Predicate("keeps_lane_speed_limit")


def spec(pair, rules=(), **options):
    return specification(ActionPair.parse(pair), rules, **options)


def satisfies(specification_, steps):
    """Whether a trace of (a, v, true predicates) is accepted, by both ways to the truth."""
    atoms = atoms_of(specification_.formula)
    trace = [letter(atoms, {"a": a, "v": v}, set(true)) for a, v, true in steps]
    accepted = specification_.dfa.accepts(trace)
    assert accepted == evaluate(specification_.formula, trace)
    return accepted


@pytest.mark.parametrize(
    ("action", "accelerations"),
    [
        ("keep", {-0.3: False, -0.2: True, 0.0: True, 0.2: True, 0.3: False}),
        ("accelerate", {0.0: False, 0.2: False, 0.3: True, 6.0: True}),
        ("decelerate", {0.0: False, -0.2: False, -0.3: True, -6.0: True}),
    ],
)
def test_longitudinal_actions_bound_the_acceleration_at_every_step(action, accelerations):
    s = spec(f"{action},follow-lane")
    good = next(a for a, holds in accelerations.items() if holds)
    for a, holds in accelerations.items():
        assert satisfies(s, [(good, 5.0, [CURRENT]), (a, 5.0, [CURRENT])]) == holds
        assert satisfies(s, [(a, 5.0, [CURRENT]), (good, 5.0, [CURRENT])]) == holds


@pytest.mark.parametrize(
    ("v", "holds"), [(0.0, True), (0.1, True), (0.11, False), (-0.1, True), (-0.11, False)]
)
def test_stop_is_a_standstill_at_the_last_step(v, holds):
    s = spec("stop,follow-lane")
    assert satisfies(s, [(-3.0, 5.0, [CURRENT]), (-3.0, v, [CURRENT])]) == holds
    assert not satisfies(s, [(0.0, 0.0, [CURRENT]), (1.0, 1.0, [CURRENT])])


def test_follow_lane_touches_the_current_lane_at_every_step():
    s = spec("keep,follow-lane")
    assert satisfies(s, [(0, 5, [CURRENT]), (0, 5, [CURRENT, LEFT])])
    assert not satisfies(s, [(0, 5, [CURRENT]), (0, 5, [LEFT])])


@pytest.mark.parametrize(("lateral", "lane"), [("left-lane", LEFT), ("right-lane", RIGHT)])
def test_a_lane_change_may_be_done_at_the_last_step_only(lateral, lane):
    s = spec(f"keep,{lateral}")
    assert satisfies(s, [(0, 5, [CURRENT]), (0, 5, [CURRENT, lane])])
    assert not satisfies(s, [(0, 5, [lane]), (0, 5, [CURRENT])])


def test_safe_distance_at_every_step():
    s = spec("keep,follow-lane", ["R_G1"])
    assert satisfies(s, [(0, 5, [CURRENT, DISTANCE])] * 2)
    assert not satisfies(s, [(0, 5, [CURRENT, DISTANCE]), (0, 5, [CURRENT])])


def test_abrupt_braking_needs_the_justification():
    nominal = spec("decelerate,follow-lane", ["R_G2"])
    fail_safe = spec("decelerate,follow-lane", ["R_G2"], justified=True)
    for a, holds in ((-2.0, True), (-2.01, False)):
        assert satisfies(nominal, [(a, 5, [CURRENT])]) == holds
        assert satisfies(fail_safe, [(a, 5, [CURRENT])])
    assert str(nominal.parts[2].formula) == "G(a >= -2)"
    assert fail_safe.parts[2].formula == TRUE


def test_abrupt_braking_only_narrows_the_range_of_the_action():
    s = spec("accelerate,follow-lane", ["R_G2"])
    assert not satisfies(s, [(0.0, 5, [CURRENT])])
    assert s.dfa == spec("accelerate,follow-lane").dfa


def test_speed_limits():
    s = spec("keep,follow-lane", ["R_G3"], settings=Settings(v_type=22.22))
    assert satisfies(s, [(0, 22.22, [CURRENT, LIMIT])])
    assert not satisfies(s, [(0, 22.23, [CURRENT, LIMIT])])
    assert not satisfies(s, [(0, 5, [CURRENT])])
    assert [str(a) for a in s.dfa.atoms if str(a).startswith("v")] == ["v <= 22.22"]
    free = Settings(v_type=math.inf, v_fov=math.inf, v_braking=math.inf)
    assert str(spec("keep,follow-lane", ["R_G3"], settings=free).parts[2].formula) == (
        "G(keeps_lane_speed_limit)"
    )


def test_parameters_come_from_the_settings():
    s = spec("accelerate,follow-lane", settings=Settings(a_lim=1.0))
    assert not satisfies(s, [(0.5, 5, [CURRENT])])
    assert satisfies(s, [(1.5, 5, [CURRENT])])


def test_all_pairs_with_all_rules():
    specifications = [specification(pair, RULES) for pair in ALL_PAIRS]
    assert len({s.dfa for s in specifications}) == 12
    for s in specifications:
        assert [part.name for part in s.parts] == [
            s.pair.longitudinal.value,
            s.pair.lateral.value,
            *RULES,
        ]
        assert all(part.description.endswith(".") for part in s.parts)
        assert s.dfa.initial in s.dfa.acceptable(26)
        assert s.dfa.n_states <= 4


def test_a_contradiction_is_seen_before_any_geometry():
    s = spec("accelerate,follow-lane", ["F(a < 0)"])
    assert s.dfa.initial not in s.dfa.acceptable(26)


def test_a_formula_of_the_users_own():
    s = spec("keep,follow-lane", ["G[0s,0.5s] (v <= 50 km/h)"], dt=0.1)
    assert s.parts[2].name == s.parts[2].text == "G[0s,0.5s] (v <= 50 km/h)"
    assert satisfies(s, [(0, 13, [CURRENT])] * 6 + [(0, 14, [CURRENT])])
    assert not satisfies(s, [(0, 13, [CURRENT])] * 5 + [(0, 14, [CURRENT])])


def test_rules_do_not_depend_on_case_and_count_once():
    s = spec("keep,follow-lane", ["r_g1", "R_G1", " R_g1 "])
    assert [part.name for part in s.parts] == ["keep", "follow-lane", "R_G1"]


def test_without_leaves_one_part_out():
    s = spec("keep,left-lane", RULES)
    assert s.without("R_G3") == spec("keep,left-lane", RULES[:2])
    assert s.without("keep").without("left-lane").without("R_G1").without("R_G2") != s
    assert satisfies(s.without("keep"), [(3.0, 5, [LEFT, DISTANCE, LIMIT])])
    with pytest.raises(FormulaError, match="no part 'R_G9' in the specification: choose from keep"):
        s.without("R_G9")


def test_without_anything_every_trace_is_accepted():
    s = spec("keep,left-lane").without("keep").without("left-lane")
    assert s.formula == TRUE
    assert satisfies(s, [(9.0, 9.0, [])])


@pytest.mark.parametrize(
    ("rule", "message"),
    [
        ("R_G9", "unknown rule 'R_G9': choose from R_G1, R_G2, R_G3, or write a formula"),
        ("", "unknown rule ''"),
        ("in_lane", "'in_lane' needs an argument"),
        ("G(fly)", "unknown name 'fly'"),
        ("G[0s,1s] v < 3", "need the duration of a step"),
    ],
)
def test_unknown_rules(rule, message):
    with pytest.raises(FormulaError) as error:
        spec("keep,follow-lane", [rule])
    assert message in str(error.value)
    assert "\n" not in str(error.value)


def test_rules_as_one_text_are_refused():
    with pytest.raises(TypeError, match="parse_rules"):
        spec("keep,follow-lane", "R_G1,R_G2")


@pytest.mark.parametrize(
    ("text", "rules"),
    [
        ("R_G1,R_G2", ("R_G1", "R_G2")),
        (" R_G1 , r_g3 ", ("R_G1", "r_g3")),
        ("", ()),
        ("  ", ()),
        ("none", ()),
        ("None", ()),
        ("R_G1, F[0,3] in_lane(left)", ("R_G1", "F[0,3] in_lane(left)")),
        ("G(v <= 3)", ("G(v <= 3)",)),
    ],
)
def test_parse_rules(text, rules):
    assert parse_rules(text) == rules


@pytest.mark.parametrize("text", [",", "R_G1,", "R_G1,,R_G2"])
def test_an_empty_rule_is_an_error(text):
    with pytest.raises(FormulaError, match="an empty rule"):
        parse_rules(text)


def test_a_vocabulary_of_the_users_own(tmp_path):
    file = tmp_path / "mine.toml"
    file.write_text("[actions]\nkeep = 'G(|a| <= 1)'\n[rules]\nR_slow = 'G(v <= 3)'\n")
    mine = Vocabulary.load(file)
    s = spec("keep,follow-lane", ["r_slow"], vocabulary=mine)
    assert satisfies(s, [(0.9, 3.0, [CURRENT])])
    assert not satisfies(s, [(0.9, 3.1, [CURRENT])])
    assert str(s) == "keep: G(|a| <= 1)\nfollow-lane: G(in_lane(current))\nR_slow: G(v <= 3)"


@pytest.mark.parametrize("word", ["true", "false", "keeps_lane_speed_limit", "in_standstill"])
def test_a_formula_may_be_one_word(word):
    part = spec("keep,follow-lane", [word]).parts[2]
    assert part.name == part.text == word
    assert part.formula == simplify(Vocabulary.default().parse(word, Settings()))


def test_the_formula_follows_from_the_parts_and_cannot_be_given():
    with pytest.raises(TypeError, match="formula"):
        Specification(ActionPair.parse("keep,follow-lane"), (), formula=TRUE)


def test_specifications_are_values():
    assert spec("keep,left-lane", RULES) == spec("keep,left-lane", RULES)
    assert hash(spec("keep,left-lane")) == hash(spec("keep,left-lane"))
    assert spec("keep,left-lane") != spec("keep,right-lane")
