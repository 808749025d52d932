"""What people mean by a word."""

from __future__ import annotations

import pytest

from msbot.operations.part_names import one_slot, uid_of
from msbot_xrce.errors import ConfigError


@pytest.mark.parametrize(
    ("word", "uid"),
    [
        ("0102030405060708", bytes(range(1, 9))),
        ("01:02:03:04:05:06:07:08", bytes(range(1, 9))),
        ("01-02-03-04-05-06-07-08", bytes(range(1, 9))),
        ("ABCD", None),
        ("010203040506070", None),
        ("0102030405060708g", None),
        ("010203040506070g", None),
    ],
)
def test_a_uid_is_16_hexadecimal_digits(word: str, uid: bytes | None) -> None:
    assert uid_of(word) == uid


def test_capitals_of_a_slot_do_not_matter_when_it_is_clear() -> None:
    assert one_slot("Left", ["Left", "left", "right"]) == "Left"
    assert one_slot("RIGHT", ["left", "right"]) == "right"
    with pytest.raises(ConfigError, match="no slot 'LEFT'"):
        one_slot("LEFT", ["Left", "left"])
    with pytest.raises(ConfigError, match="no slot 'rigth'; did you mean right"):
        one_slot("rigth", ["left", "right"])
    with pytest.raises(ConfigError, match="no slot 'x'; there are none"):
        one_slot("x", [])
