"""The tables that commands print: whole rows in a pipe, no line too long in a terminal."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from msbot_agent.cli.table import LEAST_WRAPPED, table_lines

TITLES = ("part", "beats", "reason")
ROWS = [("knob", "7", "it beats"), ("fan", "1204", "heard again after 3.0 s, " * 4), ("灯", "-", "ok")]


def lines(columns: int | None) -> list[str]:
    return list(table_lines(TITLES, ROWS, columns))


def test_in_a_pipe_a_row_is_one_line() -> None:
    title, knob, fan, lamp = lines(None)
    assert title == "part  beats  reason"
    assert knob == "knob      7  it beats"
    assert fan == f"fan    1204  {ROWS[1][2].strip()}"
    assert lamp == "灯        -  ok"  # that letter is two columns wide


def test_in_a_terminal_the_last_column_goes_on_below() -> None:
    found = lines(60)
    assert len(found) == 6
    assert found[3] == " " * 13 + "s, heard again after 3.0 s, heard again after"
    assert max(map(len, found)) <= 60


def test_in_a_narrow_terminal_cells_are_cut() -> None:
    title, knob, fan, _ = lines(24)
    assert (title, knob) == ("part  beats  reason", "knob      7  it beats")
    assert fan == "fan    1204  heard agai…"


@given(st.lists(st.tuples(*[st.text("ab \x1b[éń灯", max_size=90)] * 4), max_size=6), st.integers(20, 140))
def test_no_line_is_longer_than_the_terminal_is_wide(rows: list[tuple[str, ...]], columns: int) -> None:
    for line in table_lines(("a", "b", "c", "d"), rows, columns):
        assert len(line) + line.count("灯") <= columns
        assert line.isprintable()


@pytest.mark.parametrize("columns", [LEAST_WRAPPED + 13, 80, 100, None])
def test_every_word_of_the_last_column_is_there(columns: int | None) -> None:
    assert " ".join(" ".join(lines(columns)).split()).count("heard again") == 4
