"""The bookkeeping of mutation testing: scores, intervals, the list of survivors."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "scripts"))

from mutation import report, survivors
from mutation.mutant import COMPARISON, OTHER, Mutant

ROOT = Path(__file__).resolve().parents[1]
LIST = ROOT / "tests" / "mutation.toml"


def mutant(after: str, before: str = "if a < b:", kind: str = COMPARISON) -> Mutant:
    return Mutant("src/sandra/logic/x.py", "f", kind, (3, 3), before, after, "")


def entry(after: str, kind: str = survivors.EQUIVALENT) -> survivors.Entry:
    return survivors.Entry("src/sandra/logic/x.py", "f", "if a < b:", after, kind, "because")


def test_each_entry_of_the_list_speaks_of_code_that_is_there() -> None:
    entries = survivors.load(LIST)
    assert entries
    assert len({(e.file, e.function, e.before, e.after) for e in entries}) == len(entries)
    for each in entries:
        lines = (ROOT / each.file).read_text(encoding="utf-8").splitlines()
        assert each.before in " ".join(line.strip() for line in lines), each
        assert each.after != each.before
        assert each.function.rpartition(".")[2] in "\n".join(lines)


def test_scores_leave_out_what_no_test_could_kill() -> None:
    results = [
        (mutant("if a <= b:"), "killed"),
        (mutant("if a > b:"), "timeout"),
        (mutant("if a == b:"), "survived"),
        (mutant("if a != b:"), "survived"),
        (mutant("if a >= b:"), "not covered"),
    ]
    entries = [entry("if a == b:"), entry("if a != b:", survivors.ACCEPTED)]
    found = report.score(5, results, entries)
    assert found == report.Score(5, 5, 2, equivalent=1, accepted=1, unexplained=1)
    assert (found.relevant, found.share) == (4, 0.5)
    assert found.interval() == (0.5, 0.5)
    assert report.score(0, [], []).share == 1.0


def test_a_sample_has_an_interval() -> None:
    """Wilson's interval of 182 in 200, from the literature's formula by hand."""
    low, high = report.Score(1921, 200, 182, 0, 0, 18).interval()
    assert (low, high) == pytest.approx((0.8622, 0.9423), abs=1e-4)


def test_an_entry_explains_its_mutant_only() -> None:
    one = entry("if a <= b:")
    assert survivors.explanation(mutant("if a <= b:"), [one]) is one
    assert survivors.explanation(mutant("if a > b:"), [one]) is None
    assert survivors.explanation(mutant("if a <= b:", before="if a < c:"), [one]) is None


def test_the_template_of_an_entry_is_read_back(tmp_path: Path) -> None:
    texts = ["f('x')", 'f("x\\n")', """f("it's", 'x\\d')"""]
    path = tmp_path / "list.toml"
    written = [survivors.template(mutant(text, kind=OTHER)) for text in texts]
    path.write_text("\n".join(written).replace('reason = ""', 'reason = "because"'), "utf-8")
    assert [each.after for each in survivors.load(path)] == texts
    path.write_text(written[0], "utf-8")
    with pytest.raises(SystemExit, match="entry 1: kind or reason is missing"):
        survivors.load(path)
    path.write_text("[[survivor]]\nfile = 'x'", "utf-8")
    with pytest.raises(SystemExit, match="entry 1"):
        survivors.load(path)
    assert survivors.load(tmp_path / "none.toml") == []


def test_rows_replace_those_of_the_same_room_and_class() -> None:
    score = report.Score(10, 10, 9, 0, 0, 1)
    rows = [report.row("logic", "comparisons", score), report.row("logic", "others", score)]
    document = f"# Title\n\n{report.HEADER}\n\nText.\n"
    once = report.with_rows(document, rows)
    assert once == "\n".join(["# Title", "", report.HEADER, *rows, "", "Text.", ""])
    better = report.row("logic", "others", report.Score(10, 10, 10, 0, 0, 0))
    assert report.with_rows(once, [better]) == once.replace(rows[1], better)
    with pytest.raises(SystemExit, match="no table"):
        report.with_rows("# Title", rows)
