"""Classic CDR: alignment, byte order, texts, and what is refused."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Literal

import pytest
from hypothesis import given
from hypothesis import strategies as st

from msbot_xrce.errors import LocalProtocolError, RemoteProtocolError
from msbot_xrce.messages import CdrReader, CdrWriter

NUMBERS = [
    ("u8", 1, 0, 0xFF),
    ("u16", 2, 0, 0xFFFF),
    ("u32", 4, 0, 0xFFFFFFFF),
    ("u64", 8, 0, 0xFFFFFFFFFFFFFFFF),
    ("i8", 1, -0x80, 0x7F),
    ("i16", 2, -0x8000, 0x7FFF),
    ("i32", 4, -0x80000000, 0x7FFFFFFF),
    ("i64", 8, -0x8000000000000000, 0x7FFFFFFFFFFFFFFF),
]


@pytest.mark.parametrize(("verb", "size", "low", "high"), NUMBERS)
@pytest.mark.parametrize("little_endian", [True, False])
@given(data=st.data())
def test_numbers_stand_at_a_multiple_of_their_size(
    verb: str, size: int, low: int, high: int, little_endian: bool, data: st.DataObject
) -> None:
    value = data.draw(st.integers(low, high))
    before = data.draw(st.integers(0, 9))
    writer = CdrWriter(little_endian)
    writer.octets(bytes(before))
    getattr(writer, verb)(value)
    octets = writer.finish()
    place = -(-before // size) * size
    order: Literal["little", "big"] = "little" if little_endian else "big"
    assert octets == bytes(place) + (value & (1 << 8 * size) - 1).to_bytes(size, order)
    reader = CdrReader(octets, little_endian=little_endian)
    reader.octets(before)
    assert getattr(reader, verb)() == value
    assert reader.remaining == 0


@pytest.mark.parametrize(("verb", "low", "high"), [(verb, low, high) for verb, _, low, high in NUMBERS])
def test_numbers_out_of_range_are_refused_when_writing(verb: str, low: int, high: int) -> None:
    for value in (low - 1, high + 1):
        with pytest.raises(LocalProtocolError, match=str(value)):
            getattr(CdrWriter(), verb)(value)


@pytest.mark.parametrize(("verb", "size"), [(verb, size) for verb, size, _, _ in NUMBERS] + [("f32", 4), ("f64", 8)])
def test_numbers_cut_short_are_refused(verb: str, size: int) -> None:
    for left in range(size):
        with pytest.raises(RemoteProtocolError, match="bytes are needed"):
            getattr(CdrReader(bytes(left)), verb)()


@pytest.mark.parametrize("little_endian", [True, False])
@given(value=st.floats())
def test_floats_of_64_bits_are_exact(little_endian: bool, value: float) -> None:
    writer = CdrWriter(little_endian)
    writer.u8(1)
    writer.f64(value)
    reader = CdrReader(writer.finish(), little_endian=little_endian)
    reader.u8()
    read = reader.f64()
    assert read == value or (math.isnan(read) and math.isnan(value))


@given(st.floats(width=32, allow_nan=False))
def test_floats_of_32_bits_round_trip(value: float) -> None:
    writer = CdrWriter()
    writer.f32(value)
    assert CdrReader(writer.finish()).f32() == value


def test_float_too_large_for_32_bits_is_refused_when_writing() -> None:
    with pytest.raises(LocalProtocolError):
        CdrWriter().f32(1e39)


TEXTS = [("", "0100000000"), ("svc", "0400000073766300"), ("Zähler", "080000005ac3a4686c657200")]


@pytest.mark.parametrize(("text", "octets"), TEXTS)
def test_texts(text: str, octets: str) -> None:
    writer = CdrWriter()
    writer.string(text)
    assert writer.finish() == bytes.fromhex(octets)
    assert CdrReader(bytes.fromhex(octets)).string() == text


@given(st.text(st.characters(exclude_characters="\0", codec="utf-8")))
def test_texts_round_trip(text: str) -> None:
    writer = CdrWriter()
    writer.string(text)
    assert CdrReader(writer.finish()).string() == text


def test_text_of_length_0_is_taken_for_empty() -> None:
    # Seen in the genuine agent, which takes it too.
    assert CdrReader(bytes(4)).string() == ""


@pytest.mark.parametrize(
    ("octets", "reason"),
    [
        ("03000000616263", "NUL"),
        ("0400000061006200", "NUL inside"),
        ("02000000ff00", "UTF-8"),
        ("ffffffff6100", "4294967295 bytes are needed where 2 are left"),
        ("030000006100", "3 bytes are needed where 2 are left"),
        ("0300", "4 bytes are needed"),
    ],
)
def test_wrong_texts_are_refused(octets: str, reason: str) -> None:
    with pytest.raises(RemoteProtocolError, match=reason):
        CdrReader(bytes.fromhex(octets)).string()


@pytest.mark.parametrize("text", ["a\0b", "\ud800"])
def test_texts_without_a_form_on_the_wire_are_refused_when_writing(text: str) -> None:
    with pytest.raises(LocalProtocolError):
        CdrWriter().string(text)


def test_booleans() -> None:
    writer = CdrWriter()
    writer.boolean(True)
    writer.boolean(False)
    assert writer.finish() == b"\1\0"
    reader = CdrReader(b"\1\0\2")
    assert (reader.boolean(), reader.boolean()) == (True, False)
    with pytest.raises(RemoteProtocolError, match="a boolean is 2"):
        reader.boolean()


def test_octet_sequences() -> None:
    writer = CdrWriter()
    writer.u8(7)
    writer.octet_sequence(b"ab")
    octets = writer.finish()
    assert octets == bytes.fromhex("07000000 02000000 6162")
    reader = CdrReader(octets)
    reader.u8()
    assert reader.octet_sequence() == b"ab"
    with pytest.raises(RemoteProtocolError):
        CdrReader(bytes.fromhex("ffffff7f6162")).octet_sequence()


def test_alignment_counts_from_the_origin() -> None:
    octets = bytes.fromhex("ffffff 01 02000000 03")
    assert CdrReader(octets, 3).u32() == 0x00000201
    reader = CdrReader(octets, 3, origin=0)
    assert reader.u32() == 2
    reader.align(8)
    assert reader.offset == 8
    assert reader.u8() == 3


def test_align_fills_with_zeros() -> None:
    writer = CdrWriter()
    writer.u8(1)
    writer.align(4)
    writer.align(4)
    assert writer.finish() == b"\1\0\0\0"


def test_nothing_is_read_behind_the_end() -> None:
    reader = CdrReader(bytes(8), 0, 6)
    assert reader.u32() == 0
    with pytest.raises(RemoteProtocolError):
        reader.u32()
    assert reader.remaining == 2
    assert CdrReader(b"ab", 0, 100).remaining == 2


_VERBS = ["u8", "u16", "u32", "u64", "i8", "i16", "i32", "i64", "f32", "f64", "boolean", "string", "octet_sequence"]


@given(st.binary(max_size=40), st.lists(st.sampled_from(_VERBS), max_size=12), st.booleans())
def test_any_octets_are_read_or_refused(octets: bytes, verbs: list[str], little_endian: bool) -> None:
    reader = CdrReader(octets, little_endian=little_endian)
    try:
        for verb in verbs:
            read: Callable[[], object] = getattr(reader, verb)
            read()
    except RemoteProtocolError:
        pass
    assert reader.offset <= len(octets)
