"""Framing: headers, order and lengths of submessages, and the table of messages in both directions."""

from __future__ import annotations

from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from msbot_xrce.errors import RemoteProtocolError
from msbot_xrce.messages import (
    Acknack,
    Create,
    CreateClient,
    Data,
    Delete,
    GetInfo,
    Header,
    StatusReply,
    Submessage,
    WriteData,
    decode_header,
    encode_message,
    iter_submessages,
)
from msbot_xrce.objects import parse_variant
from tests.damage import damaged, read_or_refused
from tests.xrce.captures import HEADERLESS_ANSWER
from tests.xrce.message_table import BIG_ENDIAN, TABLE, Row


def decode(packet: bytes) -> tuple[Header, list[Submessage]]:
    header = decode_header(packet)
    return header, list(iter_submessages(packet, header.size))


def without_blob(submessage: Submessage) -> object:
    """A CREATE in binary form with what its blob says: padding within the blob has no meaning."""
    if isinstance(submessage, Create) and submessage.variant.blob is not None:
        says = parse_variant(submessage.variant, little_endian=submessage.little_endian)
        return replace(submessage, variant=replace(submessage.variant, blob=None)), says
    return submessage


@pytest.mark.parametrize("row", TABLE, ids=lambda row: row.name)
def test_value_gives_the_octets_seen_on_the_wire(row: Row) -> None:
    assert encode_message(row.header, row.submessages, pad_end=row.pad_end) == row.packet()


@pytest.mark.parametrize("row", TABLE + BIG_ENDIAN, ids=lambda row: row.name)
@pytest.mark.parametrize("padding", [0x00, 0xA5])
def test_octets_give_the_value_whatever_is_in_the_padding(row: Row, padding: int) -> None:
    header, submessages = decode(row.packet(padding))
    assert header == row.header
    assert [without_blob(one) for one in submessages] == [without_blob(one) for one in row.submessages]


def test_big_endian_create_is_written_back_in_its_own_order() -> None:
    row = next(row for row in BIG_ENDIAN if row.name == "CREATE participant")
    assert encode_message(row.header, row.submessages, pad_end=False) == row.packet()


@pytest.mark.parametrize("octets", ["", "81", "8100", "810000", "00000000", "7f0000aabbcc"])
def test_header_cut_short_is_refused(octets: str) -> None:
    with pytest.raises(RemoteProtocolError):
        decode_header(bytes.fromhex(octets))


@given(st.integers(0, 255), st.integers(0, 255), st.integers(0, 0xFFFF), st.integers(0, 0xFFFFFFFF))
def test_header_round_trip(session_id: int, stream_id: int, sequence_nr: int, key: int) -> None:
    header = Header(session_id, stream_id, sequence_nr, key if session_id < 0x80 else None)
    octets = header.encode()
    assert len(octets) == header.size
    assert decode_header(octets) == header


def test_header_without_a_key_where_one_belongs_has_zeros() -> None:
    assert Header(0x01).encode() == bytes.fromhex("0100000000000000")


@pytest.mark.parametrize("end", ["", "00", "0000", "a5a5a5"])
def test_up_to_3_octets_at_the_end_are_padding(end: str) -> None:
    assert decode(bytes.fromhex("81000000 03010400 0002fffe" + end))[1] == [Delete(2, 0xFFFE)]


def test_unknown_submessages_are_skipped_by_their_length() -> None:
    # Better than the genuine peers, which lose the rest of the message or their place in it.
    packet = bytes.fromhex("81010600 20010500 aabbccddee 000000 ff000000 09010800 000a0016 b6b6b6b6")
    assert decode(packet)[1] == [Data(10, 0x0016, b"\xb6" * 4)]


def test_length_that_reaches_beyond_the_message_is_refused_after_what_stands_before_it() -> None:
    packet = bytes.fromhex("81000000 03010400 000c0012 20010100")
    found = iter_submessages(packet, 4)
    assert next(found) == Delete(12, 0x0012)
    with pytest.raises(RemoteProtocolError, match="submessage 0x20: 1 bytes announced where 0 are left"):
        next(found)


@pytest.mark.parametrize("row", TABLE, ids=lambda row: row.name)
def test_message_cut_anywhere_is_shorter_or_refused_never_an_error_of_another_kind(row: Row) -> None:
    packet = row.packet()
    for end in range(len(packet)):
        try:
            submessages = decode(packet[:end])[1]
        except RemoteProtocolError:
            continue
        assert len(submessages) <= len(row.submessages)


def test_length_longer_than_the_contents_is_taken_and_the_rest_skipped() -> None:
    packet = bytes.fromhex("81000000 05010800 000a0011 0000 ffff 03010400 000c0012")
    assert decode(packet)[1] == [StatusReply(10, 0x0011, 0), Delete(12, 0x0012)]


def test_what_follows_a_create_client_with_properties_is_found_by_contents() -> None:
    client = CreateClient(0x11223344, 0x81, 508, (("uxr_hl", "010000"), ("uxr_sm", "1")))
    packet = encode_message(Header(0x80), [client, Delete(2, 0xFFFE)], pad_end=True)
    assert packet[6:8] == b"\x10\x00"
    assert decode(packet)[1] == [client, Delete(2, 0xFFFE)]


def test_write_data_of_length_0_reaches_to_the_end_of_the_message() -> None:
    packet = bytes.fromhex("81010100 07010000 001f0015 0001020304")
    assert decode(packet)[1] == [WriteData(31, 0x0015, bytes(range(5)))]


@pytest.mark.parametrize("length", [1, 2, 3])
def test_write_data_of_1_to_3_octets_is_refused(length: int) -> None:
    # The genuine agent aborts here.
    with pytest.raises(RemoteProtocolError, match="WRITE_DATA"):
        decode(bytes.fromhex(f"81010100 0701{length:02x}00 001f0015"))


def test_c_clients_answer_without_submessage_header_is_refused_as_an_empty_create_client() -> None:
    header = decode_header(HEADERLESS_ANSWER)
    assert (header.session_id, header.stream_id) == (0x81, 0)
    with pytest.raises(RemoteProtocolError, match="CREATE_CLIENT"):
        list(iter_submessages(HEADERLESS_ANSWER, 4))


def test_rejoined_fragments_are_read_from_offset_0() -> None:
    body = GetInfo(10, 0xFFFD, 2).encode() + Acknack(1, 0, 0x80).encode()
    assert list(iter_submessages(body, 0)) == [GetInfo(10, 0xFFFD, 2), Acknack(1, 0, 0x80)]


def test_padding_stands_between_submessages_and_at_the_end_only_when_asked() -> None:
    acknack = Acknack(1, 0, 0x80)
    plain = encode_message(Header(0x81), [acknack, acknack], pad_end=False)
    assert len(plain) == 4 + 9 + 3 + 9
    assert encode_message(Header(0x81), [acknack, acknack], pad_end=True) == plain + bytes(3)
    assert decode(plain) == decode(plain + bytes(3))


SEEN = [row.packet() for row in TABLE + BIG_ENDIAN]


@given(damaged(st.sampled_from(SEEN)) | st.binary(max_size=80))
def test_any_octets_are_read_or_refused(octets: bytes) -> None:
    read = read_or_refused(decode, octets)
    if read is not None:
        assert_survives_being_sent_on(read[1])


@given(st.integers(0, 15), st.integers(0, 255), st.binary(max_size=60))
def test_any_contents_of_any_submessage_are_read_or_refused(kind: int, flags: int, body: bytes) -> None:
    packet = bytes((0x81, 0x80, 0, 0, kind, flags, len(body), 0)) + body
    submessages = read_or_refused(lambda octets: list(iter_submessages(octets, 4)), packet)
    if submessages is not None:
        assert_survives_being_sent_on(submessages)


def assert_survives_being_sent_on(submessages: list[Submessage]) -> None:
    if all(not isinstance(one, Create) or one.variant.format in (1, 2, 3) for one in submessages):
        again = encode_message(Header(0x81, 0x80), submessages, pad_end=True)
        assert decode(again)[1] == submessages
