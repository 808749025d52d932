"""Messages of a fixed size look the same on the wire whichever way they are written and read."""

from __future__ import annotations

from enum import IntEnum
from typing import Annotated

import pytest
from hypothesis import given
from hypothesis import strategies as st

from msbot.part.messages.message import Message, fixed_form
from msbot.part.messages.wire_types import Exactly, float32, float64, int8, int64, uint8, uint16
from msbot_xrce.errors import LocalProtocolError, RemoteProtocolError
from msbot_xrce.messages.cdr import CdrReader, CdrWriter
from tests.damage import damaged, read_or_refused


class Vector(Message):
    x: float64
    y: float32
    far: bool


class Pose(Message):
    kind: int8
    at: Vector
    stamp: int64
    small: uint8
    to: Vector


class Named(Message):
    name: str


class Mode(IntEnum):
    OFF = 0
    ON = 1
    BLINK = 7


class Grid(Message):
    mode: Mode
    cells: Annotated[list[uint16], Exactly(3)]
    corners: Annotated[list[Vector], Exactly(2)]
    rows: list[float64]


numbers32 = st.floats(width=32)
vectors = st.builds(Vector, x=st.floats(), y=numbers32, far=st.booleans())
poses = st.builds(
    Pose,
    kind=st.integers(-128, 127),
    at=vectors,
    stamp=st.integers(-(2**63), 2**63 - 1),
    small=st.integers(0, 255),
    to=vectors,
)


def field_by_field(message: Pose) -> bytes:
    """The same message, written by hand."""
    writer = CdrWriter()
    writer.i8(message.kind)
    writer.f64(message.at.x)
    writer.f32(message.at.y)
    writer.boolean(message.at.far)
    writer.i64(message.stamp)
    writer.u8(message.small)
    writer.f64(message.to.x)
    writer.f32(message.to.y)
    writer.boolean(message.to.far)
    return writer.finish()


def test_only_messages_without_texts_and_lists_have_a_fixed_size() -> None:
    assert fixed_form(Pose) is not None
    assert fixed_form(Named) is None
    assert fixed_form(Grid) is None


@given(poses)
def test_the_octets_are_those_of_writing_field_by_field(message: Pose) -> None:
    assert message.encode() == field_by_field(message)
    assert repr(Pose.decode(message.encode())) == repr(message)


@given(damaged(poses.map(Pose.encode)) | st.binary(max_size=60))
def test_whatever_octets_come_the_answer_is_a_message_or_an_error_in_words(octets: bytes) -> None:
    message = read_or_refused(Pose.decode, octets)
    if message is not None:
        assert repr(Pose.decode(message.encode())) == repr(message)


def test_a_boolean_that_is_neither_0_nor_1_is_refused() -> None:
    octets = bytearray(Vector(x=1.0, y=2.0, far=True).encode())
    octets[12] = 2
    with pytest.raises(RemoteProtocolError, match="a boolean is 2"):
        Vector.decode(bytes(octets))


def test_octets_of_another_type_are_refused() -> None:
    with pytest.raises(RemoteProtocolError, match="left over"):
        Vector.decode(bytes(20))
    with pytest.raises(RemoteProtocolError, match="are needed"):
        Vector.decode(bytes(12))


def test_a_number_that_grew_too_large_is_told_with_its_limits() -> None:
    message = Vector(x=1.0, y=2.0, far=False)
    object.__setattr__(message, "y", 1e300)  # nobody can set it: this is what the check behind the check is for
    with pytest.raises(LocalProtocolError, match="cannot be sent"):
        message.encode()


def test_enums_and_arrays_are_written_as_cdr_has_them() -> None:
    grid = Grid(mode=Mode.BLINK, cells=[1, 2, 3], corners=[Vector(), Vector(x=1.0)], rows=[0.5])  # type: ignore[call-arg]
    octets = grid.encode()
    reader = CdrReader(octets)
    assert (reader.u32(), reader.u16(), reader.u16(), reader.u16()) == (7, 1, 2, 3)
    assert Grid.decode(octets) == grid


def test_fields_nobody_sets_are_zeros_of_the_right_number() -> None:
    grid = Grid()  # type: ignore[call-arg]
    assert (grid.mode, grid.cells, len(grid.corners), grid.rows) == (Mode.OFF, [0, 0, 0], 2, [])
    assert grid.corners[0] is not grid.corners[1]


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"mode": 7}, "Grid.mode cannot be 7: Mode needs one of Mode.OFF, Mode.ON, Mode.BLINK"),
        ({"cells": [1, 2]}, "Grid.cells must have exactly 3 elements; it has 2"),
        ({"cells": [1, 2, 65536]}, r"Grid.cells\[2\] cannot be 65536: uint16 needs a whole number from 0 to 65535"),
    ],
)
def test_what_does_not_fit_is_refused_in_words(change: dict[str, object], words: str) -> None:
    with pytest.raises(LocalProtocolError, match=words):
        Grid(**change)  # type: ignore[arg-type]


def test_a_number_that_is_no_member_of_the_enum_is_refused() -> None:
    octets = bytearray(Grid().encode())  # type: ignore[call-arg]
    octets[0] = 9
    with pytest.raises(RemoteProtocolError, match="9 is no Mode"):
        Grid.decode(bytes(octets))


@given(st.lists(st.integers(0, 65535), min_size=3, max_size=3), st.lists(st.floats(), max_size=5))
def test_arrays_and_lists_of_numbers_come_back(cells: list[int], rows: list[float]) -> None:
    grid = Grid(cells=cells, rows=rows)  # type: ignore[call-arg]
    assert repr(Grid.decode(grid.encode())) == repr(grid)
