"""What commands print: tables of at most 80 columns and 20 rows."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from pianorig.console.output import MOST_COLUMNS, MOST_ROWS, table_lines, wrap_text

CELL = st.text(st.characters(categories=("L", "N", "P"), include_characters=" ±"), max_size=70)


def test_numbers_stand_to_the_right_below_their_heading() -> None:
    lines = table_lines(("event", "error"), [("let-off (mm)", "+0.1 ± 1.1"), ("drop (ms)", "−1 ± 5")])
    assert lines == ["event              error", "let-off (mm)  +0.1 ± 1.1", "drop (ms)         −1 ± 5"]


@given(st.lists(st.tuples(CELL, CELL, CELL), max_size=40))
def test_a_table_fits_80_columns_and_20_rows(rows: list[tuple[str, str, str]]) -> None:
    lines = table_lines(("first", "second", "third"), rows)
    assert max(map(len, lines)) <= MOST_COLUMNS
    assert len(lines) <= MOST_ROWS
    if len(lines) < len(rows) + 1:
        assert lines[-1] == f"and {len(rows) - len(lines) + 2} more"


def test_sentences_are_wrapped_and_led() -> None:
    lines = wrap_text("the error of the model is small " * 8, "verdict: ")
    assert max(map(len, lines)) <= MOST_COLUMNS and lines[0].startswith("verdict: the error")
    assert all(line.startswith("  ") for line in lines[1:])
