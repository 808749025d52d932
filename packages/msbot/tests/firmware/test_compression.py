"""Header compression: whatever MsBOT squeezes the firmware reads, and the other way round."""

from __future__ import annotations

import zlib

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from tests.firmware.msbot_side import DICTIONARY, RemoteProtocolError, compact, recorded_packets
from tests.firmware.pipe import Firmware

ROOM = 1024


def heads() -> st.SearchStrategy[bytes]:
    """Beginnings of messages."""
    session = st.sampled_from((0x80, 0x81, 0x82, 0x83, 0x01))
    stream = st.sampled_from((0, 1, 0x80, 0x81))
    return st.tuples(session, stream, st.sampled_from((0, 1, 255)), st.sampled_from((0, 32))).map(bytes)


@st.composite
def messages(draw: st.DrawFn) -> bytes:
    """Messages of one submessage that look like those of a part or an agent."""
    packet = draw(heads())
    kind = draw(st.sampled_from((0, 1, 2, 3, 5, 6, 7, 8, 9, 10, 11, 13)))
    object_id = draw(st.sampled_from((0x11, 0x15, 0x85, 0x95, 0x16, 0x86, 0x17, 0x27, 0x37, 0xFFFE)))
    number = packet[2] | packet[3] << 8
    request = draw(
        st.sampled_from((10, 0x8000 | number & 0x1FFF, 0xA000 | number & 0x1FFF, 0xC000 | object_id & 0x3FFF))
    )
    related = draw(st.sampled_from((b"", b"\x80\x05", b"\xbf\xff"))) and request.to_bytes(2, "big")
    body = request.to_bytes(2, "big") + object_id.to_bytes(2, "big") + related + draw(st.binary(max_size=30))
    body += bytes(draw(st.integers(0, 5)))
    if kind in (10, 11):
        body = draw(st.binary(min_size=5, max_size=5)) if draw(st.booleans()) else bytes((2, 0, 2, 0, 0x80))
    if kind == 5:
        body = body[:6]
    flags = draw(st.sampled_from((1, 1, 1, 3, 0)))
    packet += bytes((kind, flags)) + len(body).to_bytes(2, "little") + body
    return packet + bytes(draw(st.sampled_from((0, -len(packet) & 3))))


packets = messages() | st.binary(min_size=1, max_size=300) | st.integers(0, 504).map(lambda at: DICTIONARY[at:][:250])


@given(packet=packets)
def test_what_msbot_sends_the_firmware_reads(firmware: Firmware, packet: bytes) -> None:
    assert firmware.decompress(compact.compress(packet), ROOM) == packet


@given(packet=packets)
def test_what_the_firmware_sends_msbot_reads(firmware: Firmware, packet: bytes) -> None:
    form = firmware.compress(packet)
    assert len(form) <= len(packet) + 1
    assert compact.decompress(form) == packet
    assert firmware.decompress(form, len(packet) + 1) == packet


@given(form=st.binary(max_size=40) | st.tuples(st.just(b"\x5f"), st.binary(max_size=60)).map(b"".join))
@example(form=b"")
@example(form=b"\x5f\x03\x00")
def test_arbitrary_octets_are_read_alike_or_refused_alike(firmware: Firmware, form: bytes) -> None:
    try:
        packet = compact.decompress(form)
    except RemoteProtocolError:
        packet = None
    read = firmware.decompress(form, ROOM)
    if read is None and packet is not None:
        # Only senders of other DEFLATE blocks than the specification allows, and what is too long for the room.
        assert form[:1] == b"\x5f"
        assert len(packet) >= ROOM or has_dynamic_block(form)
    else:
        assert read == packet


def has_dynamic_block(form: bytes) -> bool:
    """Whether a block with codes of its own (type 2) is among the first two blocks of a squeezed form."""
    return form[1] >> 1 & 3 == 2 or form[1] & 1 == 0


@given(packet=packets, cut=st.integers(1, 20), room=st.integers(0, 60))
def test_a_cut_form_or_too_small_a_room_does_no_harm(firmware: Firmware, packet: bytes, cut: int, room: int) -> None:
    """The sanitizers watch."""
    form = compact.compress(packet)
    firmware.decompress(form[:-cut], ROOM)
    whole = firmware.decompress(form, room)
    assert whole is None or whole == packet


def test_the_recorded_traffic_of_genuine_peers(firmware: Firmware) -> None:
    packets = recorded_packets()
    assert len(packets) > 500
    for packet in packets:
        assert firmware.decompress(compact.compress(packet), len(packet) + 1) == packet
        assert compact.decompress(firmware.compress(packet)) == packet


def test_a_match_reaches_back_no_further_than_the_dictionary(firmware: Firmware) -> None:
    longer = b"xy" + DICTIONARY  # zlib never uses the first octet; "y" is the code of a form
    squeezer = zlib.compressobj(9, zlib.DEFLATED, -13, 4, zlib.Z_FIXED, zdict=longer)
    form = b"\x5f" + squeezer.compress(longer[1:41]) + squeezer.flush()
    assert firmware.decompress(form) is None
    with pytest.raises(RemoteProtocolError):
        compact.decompress(form)


def test_a_beat_a_sample_and_the_log_in_are_one_frame_each(firmware: Firmware) -> None:
    beat = bytes.fromhex("81010500 07010800 8005 0017 78563412")
    sample = bytes.fromhex("81800700 07010800 a007 0015 0000803f")
    login = bytes.fromhex("80000000 00011000 58524345 0100010f aabbccdd 8100fc00")
    for packet in (beat, sample, login):
        form = firmware.compress(packet)
        assert len(form) == 7
        assert form == compact.compress(packet)


def test_the_dictionary_is_the_one_of_the_specification(firmware: Firmware) -> None:
    """A message that is nothing but the dictionary comes out of a few octets only if both have the same one."""
    packet = b"\x81\x01\x00\x00" + DICTIONARY[:250]
    form = firmware.compress(packet)
    assert len(form) < 16
    assert compact.decompress(form) == packet
