from __future__ import annotations

from msbot_xrce.streams.sequence_numbers import last_number


def test_the_number_before_the_first_is_none() -> None:
    assert [last_number(number) for number in (0xFFFF, 0, 7)] == [None, 0, 7]
