"""Serial-number arithmetic."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from msbot_xrce.streams.sequence_numbers import NOTHING_YET, distance, is_after

numbers = st.integers(0, 0xFFFF)


@pytest.mark.parametrize(
    ("sequence_nr", "reference", "after"),
    [
        (0, NOTHING_YET, True),
        (0x7FFE, NOTHING_YET, True),
        (0x7FFF, NOTHING_YET, False),
        (0, 0, False),
        (0, 65535, True),
        (65535, 0, False),
        (5, 65530, True),
        (0x8000, 0, False),
        (0, 0x8000, False),
    ],
)
def test_later_numbers_are_less_than_half_a_circle_ahead(sequence_nr: int, reference: int, after: bool) -> None:
    assert is_after(sequence_nr, reference) is after


@given(numbers, numbers)
def test_distances_there_and_back_make_a_circle(a: int, b: int) -> None:
    assert (distance(a, b) + distance(b, a)) % 0x10000 == 0
    assert not (is_after(a, b) and is_after(b, a))
