from __future__ import annotations

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from msbot_agent.link.can.adapters.error_frames import CLASSIC_SIZE, FD_SIZE, pack_frame, unpack_frame
from msbot_agent.link.can.protocol.frames import FD_LENGTHS, Frame

standard = st.integers(0, 0x7FF)
extended = st.integers(0, 0x1FFFFFFF)
length_and_dlc = st.one_of(st.integers(0, 8).map(lambda n: (n, 0)), st.integers(9, 15).map(lambda n: (8, n)))
identifier = st.one_of(standard.map(lambda n: (n, False)), extended.map(lambda n: (n, True)))


@st.composite
def frames(draw: st.DrawFn) -> Frame:
    can_id, is_extended = draw(identifier)
    kind = draw(st.sampled_from(["classic", "fd", "remote", "error"]))
    if kind == "fd":
        data = draw(st.sampled_from(FD_LENGTHS).flatmap(lambda size: st.binary(min_size=size, max_size=size)))
        return Frame(can_id, data, is_extended, True, draw(st.booleans()), esi=draw(st.booleans()))
    if kind == "remote":
        length, dlc = draw(length_and_dlc)
        return Frame(can_id, extended=is_extended, remote=True, remote_length=length, long_dlc=dlc)
    if kind == "error":
        return Frame(can_id, draw(st.binary(max_size=8)), error=True)
    length, dlc = draw(length_and_dlc)
    return Frame(can_id, draw(st.binary(min_size=length, max_size=length)), is_extended, long_dlc=dlc)


@given(frames())
@settings(deadline=None)
def test_a_frame_survives_the_kernels_format(frame: Frame) -> None:
    raw = pack_frame(frame)
    assert len(raw) == (FD_SIZE if frame.fd else CLASSIC_SIZE)
    assert unpack_frame(raw) == frame


@given(st.one_of(st.binary(max_size=80), st.binary(min_size=16, max_size=16), st.binary(min_size=72, max_size=72)))
@settings(deadline=None)
def test_any_octets_are_a_frame_or_none(raw: bytes) -> None:
    frame = unpack_frame(raw)
    if frame is not None:
        assert unpack_frame(pack_frame(frame)) == frame


@pytest.mark.parametrize(
    ("raw", "frame"),
    [
        ("23010000 03 000000 0102030000000000", Frame(0x123, b"\1\2\3")),
        ("7856349a 00 000000 0000000000000000", Frame(0x1A345678, extended=True)),
        ("00010040 04 000000 0000000000000000", Frame(0x100, remote=True, remote_length=4)),
        ("08000020 08 000000 0000040200000000", Frame(8, bytes.fromhex("0000040200000000"), error=True)),
        ("23010000 01 01 0000 ff" + 63 * "00", Frame(0x123, b"\xff", fd=True, brs=True)),
        ("23010000 01 06 0000 ff" + 63 * "00", Frame(0x123, b"\xff", fd=True, esi=True)),
        ("23010000 08 00000f 0102030405060708", Frame(0x123, bytes(range(1, 9)), long_dlc=15)),
        ("23010000 03 00000f 0102030000000000", Frame(0x123, b"\1\2\3")),
        ("23010000 08 000010 0102030405060708", Frame(0x123, bytes(range(1, 9)))),
        ("23010000 08 000008 0102030405060708", Frame(0x123, bytes(range(1, 9)))),
        ("23010000 08 000009 0102030405060708", Frame(0x123, bytes(range(1, 9)), long_dlc=9)),
        ("ff070000 08 000000 0102030405060708", Frame(0x7FF, bytes(range(1, 9)))),
        ("23010000 09 000000 0102030000000000", None),
        ("23010080 09 000000 0102030000000000", None),
        ("23010000 41 01 0000 ff" + 63 * "00", None),
        ("23010040 01 01 0000 ff" + 63 * "00", None),
    ],
)
def test_frames_as_linux_writes_them_on_a_little_endian_machine(raw: str, frame: Frame | None) -> None:
    assert unpack_frame(bytes.fromhex(raw)) == frame


def test_what_is_cut_short_or_can_xl_is_no_frame() -> None:
    assert unpack_frame(b"") is None
    assert unpack_frame(bytes(15)) is None
    assert unpack_frame(bytes(2060)) is None
