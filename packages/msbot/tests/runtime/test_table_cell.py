"""What a spreadsheet would take for a formula is a text in our tables."""

from __future__ import annotations

import pytest

from msbot_agent.text.sentence import as_cell


@pytest.mark.parametrize("text", ["=cmd|'/c calc'!A0", "+1+1", "-1-1", "@SUM(A1)", "@SUM(A1", "\t=1", "\r=1", "\n=1"])
def test_a_formula_is_a_text(text: str) -> None:
    assert as_cell(text) == f"'{text}"


@pytest.mark.parametrize("text", ["", "ada", "-1.5", "+3", "-1e-9", "a=1", "-inf", "@late", "@beat.knob"])
def test_words_and_numbers_stay(text: str) -> None:
    assert as_cell(text) == text
