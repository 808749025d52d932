"""Whole messages are told from beheaded and mixed ones."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from msbot_xrce import is_whole
from msbot_xrce.messages import CreateClient, Data, Header, Reset, StatusReply, Submessage, WriteData, encode_message
from tests.xrce.captures import CAPTURES, HEADERLESS_ANSWER, recorded
from tests.xrce.message_table import TABLE, Row

MALFORMED = {"udp_raw_malformed", "udp_raw_bad_handshake", "udp_raw_no_session"}


def seen() -> list[bytes]:
    """Every packet of the captures without a client key in its header."""
    return [
        packet.packet
        for name in CAPTURES
        if name not in MALFORMED
        for packet in recorded(name)
        if packet.packet[0] >= 0x80
    ]


@pytest.mark.parametrize("row", [row for row in TABLE if row.header.client_key is None], ids=lambda row: row.name)
def test_every_kind_of_message_is_whole(row: Row) -> None:
    assert is_whole(row.packet())
    assert is_whole(row.packet(0xFF))


def test_everything_the_genuine_client_and_agent_were_seen_to_send_is_whole() -> None:
    packets = seen()
    assert len(packets) > 1000
    assert [packet.hex() for packet in packets if not is_whole(packet)] == []
    assert is_whole(HEADERLESS_ANSWER)


def test_none_of_these_is_whole_without_its_first_seven_octets() -> None:
    assert [packet.hex() for packet in seen() if is_whole(packet[7:])] == []


@given(st.integers(0x80, 0xFF), st.binary(max_size=32000), st.sampled_from([WriteData, Data]))
def test_a_message_of_one_submessage_is_never_whole_without_its_first_frame(
    session_id: int, payload: bytes, kind: type[WriteData] | type[Data]
) -> None:
    packet = encode_message(Header(session_id, 0x80, 0xFFFF), [kind(0xFFFF, 0xFFFF, payload)], pad_end=False)
    assert is_whole(packet)
    assert not is_whole(packet[7:])


@pytest.mark.parametrize(
    "octets",
    [
        "",
        "81800000",
        "818000000501",
        "0180 0000 aabbcc07 0d000000",  # a key in the header
        "81800000 30010400 00000000",  # no such submessage
        "81800000 05010600 000a0011 0000 aabbccddee",  # something follows
        "81800000 05010700 000a0011 0000",  # cut short
        "80000000 00011000 58524346 0100 010f aabbccdd 81 00 0002",  # another cookie
    ],
)
def test_what_is_not_whole(octets: str) -> None:
    assert not is_whole(bytes.fromhex(octets))


@given(st.binary(max_size=64))
def test_any_octets_are_judged(octets: bytes) -> None:
    assert is_whole(octets) in (True, False)
    assert is_whole(b"\x81\x80\0\0" + octets) in (True, False)


def test_several_submessages_and_padding_are_whole() -> None:
    many: list[Submessage] = [WriteData(1, 0x15, b"abcde"), StatusReply(1, 2, 0), Reset()]
    packet = encode_message(Header(0x81, 1, 2), many, pad_end=True)
    assert is_whole(packet)
    assert not is_whole(packet + bytes(4 - len(packet) % 4) + b"\0")
    login = encode_message(Header(0x80, 0, 0), [CreateClient(1, 0x81, 512, (("a", "b"),))], pad_end=False)
    assert is_whole(login)
