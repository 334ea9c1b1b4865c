"""The table of verdicts: counts, reasons, and rows for what cannot be read."""

import json
from pathlib import Path

import pytest

import sandra
from sandra.actions import ALL_PAIRS
from sandra.certify import Basis, certify
from sandra.cli import main
from sandra.evaluation.reasons import STAGES, kind_of
from sandra.evaluation.verdicts import Row, Table, rows_of, tabulate
from sandra.reach import Status, ground, verify_on
from sandra.settings import Settings

RULES = ("R_G1", "R_G2", "R_G3")
SHORT = Settings(horizon=12)


@pytest.fixture
def broken(tmp_path: Path) -> Path:
    path = tmp_path / "broken.xml"
    path.write_text("<commonRoad>", encoding="utf-8")
    return path


def test_counts_are_those_of_verify_and_certify() -> None:
    path = sandra.example("recorded-ego")
    (row,) = rows_of(path, "most-likely", [RULES], SHORT)
    scene = sandra.load(path)
    base = ground(scene, sandra.predict(scene, "most-likely", 12, SHORT), SHORT)
    basis = Basis.of(base)
    found = [certify(basis, v, RULES) for v in verify_on(base, ALL_PAIRS, RULES, reasons=False)]
    statuses = [verdict.status for verdict in found]
    assert row.unsafe == statuses.count(Status.UNSAFE) > 0
    assert row.certified == statuses.count(Status.CERTIFIED) > 0
    assert row.unsafe + row.reachable + row.certified == 12
    assert row.fail_safe is True
    expected = [(str(v.pair), v.reason) for v in found if v.status is Status.REACHABLE]
    assert list(row.without) == expected


def test_rows_are_in_the_order_asked_for_and_bad_scenarios_stay(broken: Path) -> None:
    paths = [sandra.example("nothing-safe"), broken]
    told: list[tuple[int, int, str]] = []
    table = tabulate(
        paths,
        settings=Settings(horizon=4),
        progress=lambda done, total, name: told.append((done, total, name)),
    )
    assert [(row.scenario, row.prediction, row.rules) for row in table.rows] == [
        (name, prediction, rules)
        for name in ("ZAM_NothingSafe-1_1_T-1", "broken")
        for prediction in ("most-likely", "set-based")
        for rules in ((), RULES)
    ]
    assert [row.scenario for row in table.failed] == ["broken"] * 4
    assert all(row.error and "broken.xml" in row.error for row in table.failed)
    assert table.markdown().count("| error: ") == 4
    assert [(done, total) for done, total, _ in told] == [(1, 4), (2, 4), (3, 4), (4, 4)]


def test_a_rule_that_cannot_be_read_is_a_row_of_its_own() -> None:
    rules = [("R_G3",), ("in_lanelet(4711)",)]
    good, bad = rows_of(sandra.example("nothing-safe"), "most-likely", rules, Settings(horizon=3))
    assert good.error is None
    assert bad.error is not None
    assert "4711" in bad.error


def test_processes_change_nothing() -> None:
    paths = [sandra.example("nothing-safe"), sandra.example("urban-parked")]
    some = {"predictions": ["most-likely"], "settings": Settings(horizon=5)}
    alone, together = (tabulate(paths, workers=n, **some) for n in (1, 2))

    def without_time(table: Table) -> list[dict[str, object]]:
        return [{**row.to_dict(), "cpu_s": None} for row in table.rows]

    assert without_time(alone) == without_time(together)


def test_what_breaks_is_an_error_of_its_scenario_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    def brittle(path: Path, *arguments: object) -> list[Row]:
        if "Merge" in path.stem:
            raise ZeroDivisionError("too flat")
        return rows_of(path, *arguments)

    monkeypatch.setattr("sandra.evaluation.verdicts.rows_of", brittle)
    paths = [sandra.example("merge"), sandra.example("nothing-safe")]
    table = tabulate(paths, ["most-likely"], settings=Settings(horizon=4))
    assert [row.error for row in table.rows] == [
        *["internal error: ZeroDivisionError: too flat"] * 2,
        *[None] * 2,
    ]
    assert table.totals()[0][2:] == (table.rows[2].unsafe, table.rows[2].reachable, 0)


def test_totals_and_kinds() -> None:
    why = "no certificate: all 9 candidates fail: 5 leave the corridor, {}"
    collide = why.format("4 collide with their full body")
    no_fail_safe = why.format("1 are valid, but have no fail-safe continuation")
    table = Table(
        (
            Row("a", "most-likely", (), 4, 6, (("keep,left-lane", collide),) * 2),
            Row("b", "most-likely", (), 1, 8, (("stop,left-lane", no_fail_safe),) * 3),
            Row("b", "most-likely", RULES, error="it | broke"),
        )
    )
    assert table.totals() == [("most-likely", (), 5, 5, 14), ("most-likely", RULES, 0, 0, 0)]
    assert [(kind, n) for kind, n, _ in table.kinds()] == [
        ("witnesses exist, none has a fail-safe continuation", 3),
        ("the full body collides", 2),
    ]
    text = table.markdown()
    assert "| most-likely | none | 24 | 5 | 5 | 14 | 74 % |" in text
    assert "error: it \\| broke" in text


@pytest.mark.parametrize(
    ("reason", "kind"),
    [
        ("the ego's body touches another one, or nearly so, at the start", None),
        (
            "no certificate: the checker rejected it (trace: at step 3 0.2 is above)",
            "the checker rejected it",
        ),
        ("no certificate: 12 of -3.5 m are too many; the best", "N of N m are too many"),
    ],
)
def test_other_reasons_are_their_own_kind(reason: str, kind: str | None) -> None:
    assert kind_of(reason) == (kind or reason)


def test_kinds_know_the_words_of_the_planner() -> None:
    """A wording that has changed would fall through to the sentence itself."""
    from sandra.planning.witness import _WORDS

    for words, _ in STAGES[:-1]:
        assert any(words in known for known in _WORDS.values()), words


def test_command(capsys: pytest.CaptureFixture[str], tmp_path: Path, broken: Path) -> None:
    out = tmp_path / "table.md"
    words = ["evaluate", "verdicts", "nothing-safe", "--horizon", "3", "--rules", "none;R_G2"]
    assert main([*words, "--predictions", "most-likely", "--json", "--out", str(out)]) == 0
    data = json.loads(capsys.readouterr().out)
    assert [row["rules"] for row in data["rows"]] == [[], ["R_G2"]]
    assert all(r["unsafe"] + r["reachable"] + r["certified"] == 12 for r in data["rows"])
    assert "| ZAM_NothingSafe-1_1_T-1 | most-likely | R_G2 |" in out.read_text(encoding="utf-8")
    folder = str(broken.parent)
    assert main(["evaluate", "verdicts", folder, "--predictions", "most-likely"]) == 1
    assert "| broken | most-likely | none | error: " in capsys.readouterr().out


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["EMPTY"], "no .xml file"),
        (["merge", "--predictions", "crystal-ball"], "unknown prediction 'crystal-ball'"),
        (["merge", "--workers", "-1"], "number of processes"),
        (["merge", "--rules", "R_G1,,R_G2"], "empty rule"),
        (["nothing-safe", "--horizon", "2", "--out", "EMPTY"], "cannot be written"),
    ],
)
def test_bad_words_are_refused_with_one_line(
    words: list[str], said: str, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    given = [str(tmp_path) if word == "EMPTY" else word for word in words]
    assert main(["evaluate", "verdicts", *given]) == 2
    output = capsys.readouterr()
    assert said in output.err
    assert len(output.err.strip().splitlines()) == 1
    assert output.out == ""
