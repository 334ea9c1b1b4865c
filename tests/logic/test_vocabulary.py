import pytest

from sandra.errors import FormulaError
from sandra.logic.vocabulary import ACTION_NAMES, Vocabulary, parameters
from sandra.settings import Settings


def load(tmp_path, text):
    file = tmp_path / "mine.toml"
    file.write_text(text, encoding="utf-8")
    return Vocabulary.load(file)


def test_the_default_holds_the_actions_and_rules_of_the_paper():
    default = Vocabulary.default()
    assert tuple(default.actions) == ACTION_NAMES
    assert tuple(default.rules) == ("R_G1", "R_G2", "R_G3")
    assert default.actions["keep"] == "G(|a| <= a_lim)"
    for name in (*default.actions, *default.rules):
        assert default.describe(name) == default.descriptions[name]
        assert default.describe(name).endswith(".")


def test_the_default_cannot_be_changed():
    with pytest.raises(TypeError):
        Vocabulary.default().rules["R_G1"] = "true"


def test_a_file_is_laid_over_the_default(tmp_path):
    mine = load(
        tmp_path,
        """
        [actions]
        stop = "F[0,10] G in_standstill"
        [rules]
        r_g3 = "G(keeps_my_limit)"
        R_own = "G[0s,1s] !in_lane(opposite)"
        [predicates]
        keeps_my_limit = "v <= 30 km/h"
        in_standstill = "v <= 0"
        [descriptions]
        R_own = "Do not be a ghost driver."
        """,
    )
    default = Vocabulary.default()
    assert mine.actions["stop"] == "F[0,10] G in_standstill"
    assert mine.actions["keep"] == default.actions["keep"]
    assert mine.rules["R_G3"] == "G(keeps_my_limit)"
    assert tuple(mine.rules) == ("R_G1", "R_G2", "R_G3", "R_own")
    assert str(mine.parse("G in_standstill")) == "G(v <= 0)"
    assert default.rules["R_G3"] != mine.rules["R_G3"]
    assert mine.describe("R_own") == "Do not be a ghost driver."
    # The old sentence spoke of the old formula.
    assert mine.describe("stop") == "Satisfy F[0,10] G in_standstill."
    assert mine.describe("R_G3") == "Satisfy G(keeps_my_limit)."


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (
            "[action]\nkeep = 'true'",
            "unknown section [action]: choose from [actions], [rules], [predicates]",
        ),
        ("keep = 'true'", "unknown section [keep]"),
        ("rules = 'R_G1'", "'rules' must be a section"),
        ("[rules]\nR_1 = 3", "[rules] R_1 must be text in quotes"),
        ("[actions]\nfly = 'true'", "unknown action 'fly': choose from keep"),
        ("[rules]\nR_1 = 'G('", "[rules] R_1: expected a formula"),
        ("[rules]\nR_1 = 'G(a < a_limm)'", "did you mean 'a_lim'?"),
        ("[rules]\nR_1 = ''", "[rules] R_1: a formula is empty"),
        ("[rules]\nkeep = 'true'", "'keep' is no name of a rule"),
        ("[rules]\nnone = 'true'", "'none' is no name of a rule"),
        ("[rules]\n'G(x)' = 'true'", "is no name of a rule"),
        ("[rules]\nR_1 = 'true'\nr_1 = 'false'", "is there twice"),
        ("[predicates]\nfast = 'v > '", "[predicates] fast: expected a number"),
        ("[predicates]\nin_lane = 'true'", "'in_lane' is built in"),
        ("[predicates]\nv = 'true'", "'v' is built in"),
        ("[predicates]\nFG = 'true'", "'FG' is no name of a predicate"),
        ("[predicates]\n'my-name' = 'true'", "is no name of a predicate"),
        ("[predicates]\nloop = '!loop'", "'loop' is defined by itself"),
        ("[descriptions]\nR_9 = 'Nothing.'", "'R_9' is neither an action nor a rule"),
        ("[rules", "not a TOML file"),
    ],
)
def test_a_bad_file_is_one_line_that_names_file_and_place(tmp_path, text, message):
    with pytest.raises(FormulaError) as error:
        load(tmp_path, text)
    assert message in str(error.value)
    assert "mine.toml" in str(error.value)
    assert "\n" not in str(error.value)


def test_a_rule_that_is_there_twice_by_case_does_not_win_silently(tmp_path):
    with pytest.raises(FormulaError, match="is there twice"):
        load(tmp_path, "[rules]\nR_G1 = 'true'\nr_g1 = 'false'")


def test_files_that_cannot_be_read(tmp_path):
    with pytest.raises(FormulaError, match="cannot be read"):
        Vocabulary.load(tmp_path / "absent.toml")
    (tmp_path / "noise.toml").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(FormulaError, match="not a TOML file"):
        Vocabulary.load(tmp_path / "noise.toml")


def test_parameters_are_the_numbers_of_the_settings():
    values = parameters(Settings(a_abrupt=-3.0))
    assert values["a_abrupt"] == -3.0
    assert values["horizon"] == 25.0
    assert "cut_in_exception" not in values
    assert "assumptions" not in values


def test_describe_names_what_there_is():
    with pytest.raises(FormulaError, match="unknown action or rule 'R_G9': choose from keep"):
        Vocabulary.default().describe("R_G9")
