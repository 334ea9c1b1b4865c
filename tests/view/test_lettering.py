"""Text from outside is drawn as it is: plain, clipped, wrapped to a measured width."""

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sandra.view.lettering import LONGEST, fitted, plain, width, wrapped

HOSTILE = [
    "$\\frac{1}{0}$ and $unclosed",
    "line\nbreak\ttab\x00null\x1b[31m",
    "x" * 10_000,
    "漢字 и кириллица 🚗 \u202eevil",
    "\\usepackage{x} {} % #",
    "",
]


@pytest.mark.parametrize("text", HOSTILE)
def test_plain_is_one_short_printable_line(text: str) -> None:
    line = plain(text)
    assert len(line) <= LONGEST
    assert line.isprintable()


def test_plain_keeps_dollars_and_marks_what_is_cut_or_missing() -> None:
    assert plain("$x_1$") == "$x_1$"
    assert plain("abcdef", 4) == "abc…"
    assert plain("a🚗b") == "a□b"
    assert plain("a\n\n b") == "a b"


@settings(max_examples=60, deadline=None)
@given(st.text(max_size=200), st.floats(0.5, 4.0), st.integers(1, 4))
def test_no_line_is_wider_than_asked_nor_are_there_more(
    text: str, limit: float, lines: int
) -> None:
    found = wrapped(text, limit, 9.0, lines=lines)
    assert 1 <= len(found) <= lines
    assert all(width(line, 9.0) <= limit for line in found)


def test_nothing_is_lost_where_there_is_room() -> None:
    text = "empty at step 24: car 20074 leaves no room"
    assert " ".join(wrapped(text, 1.5, 9.0, lines=9)) == text
    assert wrapped(text, 9.0, 9.0) == [text]


def test_the_last_line_says_that_something_is_missing() -> None:
    assert fitted("a long reason that does not fit", 1.0, 9.0).endswith("…")
    assert wrapped("word " * 60, 1.0, 9.0, lines=2)[-1].endswith("…")
    assert not fitted("short", 1.0, 9.0).endswith("…")
