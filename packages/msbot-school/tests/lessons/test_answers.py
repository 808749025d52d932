"""Answers count in the forms in which people write them, and wrong ones in none."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from msbot_school.lessons.lesson import LessonQuestion


@pytest.mark.parametrize(
    "answer",
    ["10", "ten", "Ten", " TEN slots", "10 slots", "10 Plätze", "10.0", "10,0", "zehn", "Zehn Plätze", "10.", "= 10",
     "it is 10", "'10'", "ten!"],
)  # fmt: skip
def test_ten_in_all_its_forms(answer: str) -> None:
    assert LessonQuestion(("10",)).is_right(answer)


@pytest.mark.parametrize(
    "answer",
    ["", "-", "11", "eleven", "elf", "10 or 11", "10 and 11", "1 0", "100", "10%5", "ten not", "x10", "tenfold"],
)
def test_what_is_not_ten(answer: str) -> None:
    assert not LessonQuestion(("10",)).is_right(answer)


@pytest.mark.parametrize("answer", ["6", "6 s", "6s", "6 seconds", "six seconds", "6,0", "6.0 sec", "sechs Sekunden"])
def test_a_number_with_its_unit_in_all_its_spellings(answer: str) -> None:
    assert LessonQuestion(("6",), unit="s").is_right(answer)


@pytest.mark.parametrize("answer", ["6 ms", "6 minutes", "six slots", "6 s 7", "0.6 s", "6 h"])
def test_a_number_in_another_unit_is_wrong(answer: str) -> None:
    assert not LessonQuestion(("6",), unit="s").is_right(answer)


@pytest.mark.parametrize(
    ("answer", "is_right"),
    [("500000", True), ("500,000", True), ("500.000", True), ("500 000", True), ("500 000 bits a second", True),
     ("500 kbit/s", True), ("500 kilobits per second", True), ("500", False), ("500 bit/s", False),
     ("500 Mbit/s", False), ("5000000", False)],
)  # fmt: skip
def test_a_unit_that_stands_in_the_right_answer_is_needed(answer: str, *, is_right: bool) -> None:
    question = LessonQuestion(("500000", "500,000", "500 kbit/s"), unit="bit/s")
    assert question.is_right(answer) is is_right


@pytest.mark.parametrize(
    ("right", "answer"),
    [("celsius rain", "Celsius, rain"), ("celsius rain", "celsius and rain"), ("late", "“Late”."), ("the fan", "fan"),
     ("der Lüfter", "LÜFTER"), ("HelloWorldTopic_1_to_2", "helloworldtopic_1_to_2"), ("%", "%"), ("-", "-")],
)  # fmt: skip
def test_words(right: str, answer: str) -> None:
    assert LessonQuestion((right,)).is_right(answer)


@given(st.integers(0, 99), st.integers(0, 99))
def test_a_number_is_itself_only(right: int, answer: int) -> None:
    assert LessonQuestion((str(right),)).is_right(f"{answer},0 parts") is (right == answer)


@given(st.text(max_size=300), st.text(max_size=40))
def test_whatever_people_write_is_read(right: str, answer: str) -> None:
    LessonQuestion((right,), unit="s").is_right(answer)
