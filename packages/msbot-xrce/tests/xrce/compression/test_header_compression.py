"""Header compression is exact for all octets, shortest for what our own peers say, and afraid of nothing."""

from __future__ import annotations

import struct
import zlib

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from msbot_xrce import compress, decompress
from msbot_xrce.compression import DEFLATED, DICTIONARY, ESCAPE, FIXED, LARGEST
from msbot_xrce.errors import RemoteProtocolError
from msbot_xrce.messages import (
    Acknack,
    CreateClient,
    Data,
    Delete,
    Fragment,
    GetInfo,
    Header,
    Heartbeat,
    Info,
    ObjectKind,
    ReadData,
    StatusAgent,
    StatusReply,
    Submessage,
    Timestamp,
    WriteData,
    encode_message,
    make_object_id,
    read_request_id,
    write_request_id,
)
from msbot_xrce.messages.submessage import MAX_LENGTH
from tests.damage import damaged, read_or_refused
from tests.xrce.captures import CAPTURES, recorded

TABLE = [
    # Without a session
    ("80000000 00011000 58524345 0100010f aabbccdd 8100 fc01", "1c aabbccdd fc01"),
    ("80000000 00011000 58524345 0100010f aabbccdd 8200 fc01", "5c aabbccdd fc01"),
    ("80000000 00011000 58524345 0100010f aabbccdd 8300 fc01", None),
    ("80000000 00011000 58524345 0100010f aabbccdd 8101 fc01", None),
    ("80000000 02010800 000afffd 02000000", "1d 81"),
    ("80010000 02010800 000afffd 02000000", None),
    ("80000000 02010800 0009fffd 03000000", None),
    ("00000000 aabbccdd 02010800 000afffd 02000000", "1f 00000000 aabbccdd 02010800 000afffd 02000000"),
    # Outside of streams
    ("81000000 04010b00 00005852 43450100 010f00", "1d 00"),
    ("82000000 02010800 000afffd 02000000", "5d 01"),
    ("81000000 06011c00 000afffd 0000010d 58524345 0100010f 00010d00 01000000 00000000", "1d 02"),
    ("81000000 06011c00 000afffd 0001010d 58524345 0100010f 00010d00 01000000 00000000", "1d 03"),
    ("81000000 02010800 0000fffe 01000000", "1d 04"),
    ("81000000 06010800 0000fffe 00000000", "1d 05"),
    ("81000000 03010400 0002fffe", "1d 06"),
    ("82000000 05010600 0002fffe 0000", "5d 07"),
    ("81000000 0c010000", "1d 08"),
    ("81000000 0a010500 0700000080", "1a 0700"),
    ("82000000 0a010500 0700001580", "5a 07000015"),
    ("81000000 0a010500 0700000081", "1a 0700000081"),
    ("81000000 0b010500 0700070080", "1b 0700"),
    ("81000000 0b010500 07000b0080", "1b 07000b00"),
    ("82000000 0b010500 0700070081", "5b 0700070081"),
    ("81000000 0a000500 0007000080", "1e 0a000500 0007000080"),
    ("81000000 0e010800 163e016b a3948a32", "1e 0e010800 163e016b a3948a32"),
    ("81000100 0a010500 0700000080", None),
    # Samples, request ids by rule
    ("81010500 07010800 80050015 0000803f", "00 0500 0000803f"),
    ("82010500 07010800 80050085 0000803f", "47 0500 0000803f"),
    ("81803412 07010800 b2340025 0000803f", "21 3412 0000803f"),
    ("81010500 07010500 80050015 ff000000", "00 0500 ff"),
    ("81010500 07010400 80050015", "00 0500"),
    ("81010500 07010800 80050017 a3d81173", "10 0500 a3d81173"),
    ("82800500 07010800 a0050027 a3d81173", "71 0500 a3d81173"),
    ("81010500 09010800 c0260026 0000803f", "09 0500 0000803f"),
    ("82800500 09010500 c0860086 ff", "6f 0500 ff"),
    ("81010500 09010c00 c0170017 80050017 01000000", "12 0500 05c0 01"),
    ("81010500 09010c00 c0170017 bfff0017 00000000", "12 0500 ffff 00"),
    ("82800500 09010a00 c0270027 a0010027 0100", "73 0500 0160 01"),
    ("81010500 09010800 c0170017 80000017", "12 0500 0000"),
    # Other samples
    ("81010500 07010800 011e0015 0000803f", "14 0500 011e0015 0000803f"),
    ("81010500 07010800 a0050015 0000803f", "14 0500 a0050015 0000803f"),
    ("82800500 07010800 a0050095 0000803f", "74 0500 a0050095 0000803f"),
    ("81010500 09010800 001d0016 0000803f", "15 0500 001d0016 0000803f"),
    ("81010500 09010800 c0170017 00050017", "15 0500 c0170017 00050017"),
    ("81010500 09010800 c0170017 80050027", "15 0500 c0170017 80050027"),
    ("81010500 09010600 c0170017 8005", "15 0500 c0170017 8005"),
    # STATUS and FRAGMENT
    ("81800500 05010600 000a0011 0000", "36 0500 000a11"),
    ("82010500 05010600 000a0123 0000", "56 0500 000a0123"),
    ("81800500 05010600 000a0011 0100", "36 0500 000a0011 0100"),
    ("81800500 0d010400 01020304", "37 0500 01020304"),
    ("82800500 0d030100 01", "78 0500 01"),
    # Whole messages: something is not as it always is
    ("81010500 07010500 80050015 ff", "19 0500 07010500 80050015 ff"),
    ("81010500 07010500 80050015 ff696300", "19 0500 07010500 80050015 ff696300"),
    ("81010500 07000800 80050015 0000803f", "19 0500 07000800 80050015 0000803f"),
    ("81010500 07010300 80050000", "19 0500 07010300 80050000"),
    ("81010500 07010000 80050015", "19 0500 07010000 80050015"),
    ("81010500 09010500 c0260026 ff000000", "19 0500 09010500 c0260026 ff000000"),
    ("81010500 09010300 c02600", "19 0500 09010300 c02600"),
    ("81800500 0d050100 01", "39 0500 0d050100 01"),
    ("81800500 03010400 001b0026", "39 0500 03010400 001b0026"),
    # No form at all
    ("83010500 07010800 80050015 0000803f", None),
    ("81020500 07010800 80050015 0000803f", None),
    ("81010500 070108", None),
    ("81", None),
    ("ff", None),
    ("7f", "1f 7f"),
    ("5f", "1f 5f"),
    ("", "1f"),
]
"""Messages and their short forms; None: as it is."""


@pytest.mark.parametrize(("message", "short"), TABLE)
def test_every_form(message: str, short: str | None) -> None:
    packet = bytes.fromhex(message)
    expected = packet if short is None else bytes.fromhex(short)
    assert decompress(expected) == packet
    form = compress(packet)
    if form[0] == DEFLATED:
        assert len(form) < len(expected)
        form = zlib.decompressobj(-13, zdict=DICTIONARY).decompress(form[1:])
    assert form == expected


@given(st.binary(max_size=64) | st.binary(min_size=4090, max_size=4096))
def test_any_octets_come_back(packet: bytes) -> None:
    short = compress(packet)
    assert decompress(short) == packet
    assert len(short) <= len(packet) + 1


u8 = st.integers(0, 0xFF)
u16 = st.integers(0, 0xFFFF)
few = st.sampled_from([0x80, 0x81, 0x82, 0x83, 0x01, 0x00])
payloads = st.binary(max_size=40) | st.binary(max_size=4).map(lambda octets: octets + bytes(3))
object_ids = st.builds(make_object_id, st.integers(0, 9) | st.integers(0, 0xFFF), st.integers(0, 15))
requests = st.builds(lambda request_id, object_id: struct.pack(">HH", request_id, object_id), u16, object_ids)
submessages: st.SearchStrategy[Submessage] = st.one_of(
    st.builds(WriteData, u16, object_ids, payloads),
    st.builds(Data, u16, object_ids, payloads),
    st.builds(Data, u16, object_ids, st.builds(lambda request, reply: request + reply, requests, payloads)),
    st.builds(StatusReply, u16, object_ids, st.sampled_from([0, 0, 1, 0x80])),
    st.builds(Acknack, u16, st.just(0) | u16, st.just(0x80) | u8),
    st.builds(Heartbeat, u16, u16, st.just(0x80) | u8),
    st.builds(Fragment, payloads, st.booleans()),
    st.builds(GetInfo, u16, u16, u8),
    st.builds(Info, u16, u16),
    st.builds(Delete, u16, object_ids),
    st.builds(ReadData, u16, object_ids, u8),
    st.builds(StatusAgent, u8),
    st.builds(Timestamp, st.integers(0, 10**18)),
    st.builds(CreateClient, st.integers(0, 0xFFFFFFFF), few, u16),
)
headers = st.builds(Header, few, st.sampled_from([0, 1, 0x80]) | u8, st.just(0) | u16, st.integers(0, 0xFFFFFFFF))


@given(headers, st.lists(submessages, min_size=1, max_size=3), st.booleans())
def test_any_message_comes_back(header: Header, contents: list[Submessage], pad_end: bool) -> None:
    packet = encode_message(header, contents, pad_end=pad_end)
    assert decompress(compress(packet)) == packet


@given(st.sampled_from([1, 0x80]), u16, st.integers(1, 8), st.binary(max_size=4), st.sampled_from([0x81, 0x82]))
def test_a_sample_of_4_octets_is_one_classic_frame(
    stream_id: int, sequence_nr: int, number: int, payload: bytes, session_id: int
) -> None:
    header = Header(session_id, stream_id, sequence_nr)
    writer, reader = make_object_id(number, ObjectKind.DATAWRITER), make_object_id(number, ObjectKind.DATAREADER)
    write = WriteData(write_request_id(stream_id, sequence_nr), writer, payload)
    data = Data(read_request_id(reader), reader, payload)
    for packet in (encode_message(header, [write], pad_end=True), encode_message(header, [data], pad_end=False)):
        assert len(compress(packet)) == 3 + len(payload)
        assert decompress(compress(packet)) == packet


@given(few, headers, submessages)
def test_one_changed_octet_is_not_lost(octet: int, header: Header, content: Submessage) -> None:
    """What looks almost like a form must not be taken for one."""
    packet = bytearray(encode_message(header, [content], pad_end=True))
    for place in range(len(packet)):
        kept, packet[place] = packet[place], octet
        assert decompress(compress(bytes(packet))) == packet
        packet[place] = kept


@pytest.mark.parametrize("name", CAPTURES)
def test_recorded_traffic_comes_back(name: str) -> None:
    for record in recorded(name):
        assert decompress(compress(record.packet)) == record.packet


packets = st.builds(
    lambda header, contents: encode_message(header, contents, pad_end=True),
    headers,
    st.lists(submessages, min_size=1, max_size=3),
)
forms = damaged(packets.map(compress)) | st.binary(max_size=41)


@given(forms)
@example(b"\x1d\x81")
@example(bytes((DEFLATED, 3, 0)))
def test_any_octets_are_read_or_refused(form: bytes) -> None:
    packet = read_or_refused(decompress, form)
    if packet is not None:
        assert decompress(compress(packet)) == packet


def deflated(short: bytes) -> bytes:
    """A short form squeezed by hand, whether that makes it shorter or not."""
    squeezer = zlib.compressobj(9, zlib.DEFLATED, -13, zdict=DICTIONARY)
    return bytes((DEFLATED,)) + squeezer.compress(short) + squeezer.flush()


@given(forms)
@example(b"\x1d\x81")
def test_any_octets_within_deflate_are_read_as_they_are_without_it_or_refused(short: bytes) -> None:
    packet = read_or_refused(decompress, deflated(short))
    if packet is not None:
        assert decompress(short) == packet


def test_a_short_form_within_deflate_is_the_same_packet() -> None:
    shorts = {compress(record.packet): record.packet for name in CAPTURES for record in recorded(name)}
    plain = {short: packet for short, packet in shorts.items() if short[0] != DEFLATED}
    assert len(plain) > 100
    for short, packet in plain.items():
        assert decompress(deflated(short)) == packet


@pytest.mark.parametrize(
    "short",
    [
        "",
        "00",
        "0005",
        "120500",
        "1205000a",
        "140500001e00",
        "16",
        "160500",
        "1605000a",
        "160500000a001101",
        "160500000a0011010203",
        "1a",
        "1a07",
        "1a070007",
        "1b0700070080ff",
        "1cffffffff00",
        "1d",
        "1d09",
        "1d89",
        "1d0000",
        "20",
        "3a0700",
        "3f",
        "7f",
        "5f",
        "5f00",
        "5fffff",
    ],
)
def test_what_is_no_form_is_refused(short: str) -> None:
    with pytest.raises(RemoteProtocolError, match="compressed"):
        decompress(bytes.fromhex(short))


def squeezed(short: bytes) -> bytes:
    squeezer = zlib.compressobj(9, zlib.DEFLATED, -13, zdict=DICTIONARY)
    return bytes((DEFLATED,)) + squeezer.compress(short) + squeezer.flush()


def test_squeezed_nonsense_is_refused() -> None:
    whole = squeezed(b"\x81" * 50)
    assert decompress(whole) == b"\x81" * 50
    for wrong in (whole[:-1], whole + b"\0", squeezed(b"")):
        with pytest.raises(RemoteProtocolError, match="compressed"):
            decompress(wrong)
    with pytest.raises(RemoteProtocolError, match="squeezed twice"):
        decompress(squeezed(whole))


def test_deflate_gives_no_more_than_a_packet_can_be() -> None:
    most = b"\x81" * (LARGEST - 1)
    assert decompress(squeezed(most)) == most
    with pytest.raises(RemoteProtocolError):
        decompress(squeezed(b"\x81" * 10_000_000))
    large = b"\x81" * LARGEST
    assert compress(large) == large
    assert decompress(compress(large)) == large


@pytest.mark.parametrize("code", [0x00, 0x12, 0x14, 0x17])
def test_no_submessage_is_longer_than_its_length_can_say(code: int) -> None:
    with pytest.raises(RemoteProtocolError, match="bytes"):
        decompress(bytes((code,)) + bytes(LARGEST + 3))


def test_what_cannot_be_shorter_is_escaped_with_one_octet() -> None:
    packet = bytes(range(0x60))
    assert compress(packet) == bytes((ESCAPE,)) + packet


def test_fixed_messages_are_two_octets() -> None:
    for session_id in (0x80, 0x81, 0x82):
        for body in FIXED:
            packet = bytes((session_id, 0, 0, 0)) + body
            assert len(compress(packet)) == 2
            assert decompress(compress(packet)) == packet


def test_a_submessage_of_the_greatest_length_is_the_last_that_is_read() -> None:
    sample = WriteData(0x000A, 0x0015, bytes(range(60)))
    short = compress(encode_message(Header(0x81, 0x80, 5), [sample], pad_end=False))
    assert short.endswith(bytes(range(60)))
    longest = short[:-60] + bytes(MAX_LENGTH - 4)
    whole = WriteData(0x000A, 0x0015, bytes(MAX_LENGTH - 4))
    assert decompress(longest) == encode_message(Header(0x81, 0x80, 5), [whole], pad_end=True)
    with pytest.raises(RemoteProtocolError, match=f"a submessage of {MAX_LENGTH + 1} bytes"):
        decompress(longest + b"x")
