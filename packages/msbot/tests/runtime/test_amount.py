"""One is one."""

from __future__ import annotations

import pytest

from msbot_xrce.counting import amount


@pytest.mark.parametrize(
    ("words", "told"),
    [
        ((0, "file"), "0 files"),
        ((1, "file"), "1 file"),
        ((2, "file"), "2 files"),
        ((1, "person", "people"), "1 person"),
        ((7, "person", "people"), "7 people"),
    ],
)
def test_one_is_one(words: tuple[int, str] | tuple[int, str, str], told: str) -> None:
    assert amount(*words) == told
