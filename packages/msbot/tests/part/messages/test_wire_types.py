from __future__ import annotations

import math

import pytest

from msbot.part.messages.message import Message
from msbot.part.messages.wire_types import (
    FLOAT32_MAX,
    FieldCodec,
    codec_for,
    float32,
    float64,
    int8,
    int16,
    int32,
    int64,
    uint8,
    uint16,
    uint32,
    uint64,
)
from msbot_xrce.messages import CdrReader, CdrWriter


def codec(annotation: object) -> FieldCodec:
    found = codec_for(annotation, lambda _: None)
    assert found is not None
    return found


@pytest.mark.parametrize(
    ("annotation", "low", "high", "octets_of_low", "octets_of_high"),
    [
        (uint8, 0, 255, "00", "ff"),
        (uint16, 0, 65535, "0000", "ffff"),
        (uint32, 0, 4294967295, "00000000", "ffffffff"),
        (uint64, 0, 18446744073709551615, "0000000000000000", "ffffffffffffffff"),
        (int8, -128, 127, "80", "7f"),
        (int16, -32768, 32767, "0080", "ff7f"),
        (int32, -2147483648, 2147483647, "00000080", "ffffff7f"),
        (int64, -9223372036854775808, 9223372036854775807, "0000000000000080", "ffffffffffffff7f"),
    ],
)
def test_whole_numbers_have_exactly_the_limits_of_their_width(
    annotation: object, low: int, high: int, octets_of_low: str, octets_of_high: str
) -> None:
    number = codec(annotation)
    assert number.smallest == len(octets_of_low) // 2
    assert not number.fits(low - 1)
    assert not number.fits(high + 1)
    assert not number.fits(1.0)
    for value, octets in ((low, octets_of_low), (high, octets_of_high)):
        assert number.fits(value)
        writer = CdrWriter()
        number.write(writer, value)
        assert writer.finish() == bytes.fromhex(octets)
        assert number.read(CdrReader(bytes.fromhex(octets))) == value


@pytest.mark.parametrize("annotation", [float32, float64])
@pytest.mark.parametrize("value", [0.0, -1.5, 3, FLOAT32_MAX, -FLOAT32_MAX, math.inf, -math.inf])
def test_fractions_take_numbers_and_infinities(annotation: object, value: float) -> None:
    number = codec(annotation)
    assert number.fits(value)
    writer = CdrWriter()
    number.write(writer, value)
    assert number.read(CdrReader(writer.finish())) == value


def test_not_a_number_survives() -> None:
    class Value(Message):
        value: float32

    assert math.isnan(Value.decode(Value(value=math.nan).encode()).value)


@pytest.mark.parametrize(
    ("annotation", "value"),
    [(float32, 1e39), (float32, 10**400), (float32, True), (float32, "1"), (float64, 10**400), (float64, False)],
)
def test_fractions_refuse_what_they_cannot_hold(annotation: object, value: object) -> None:
    assert not codec(annotation).fits(value)
