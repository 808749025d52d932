"""Who asked, and which request a reply answers."""

from __future__ import annotations

from hypothesis import given, settings
from hypothesis import strategies as st

from msbot_agent.agent.reply_routing import (
    PendingRequests,
    client_key_of,
    decode_identity,
    encode_identity,
    make_guid,
)
from tests.effort import tries


def test_guid_names_the_client_at_octets_8_to_11() -> None:
    guid = make_guid(b"AGENT-ID", 0xAABBCCDD, 0x0017, 3)
    assert guid == b"AGENT-ID" + bytes.fromhex("aabbccdd 0017 0003")
    assert client_key_of(guid) == 0xAABBCCDD


def test_incarnation_uses_16_bits() -> None:
    assert make_guid(bytes(8), 1, 2, 0x1_0005) == make_guid(bytes(8), 1, 2, 5)


def test_identity_is_laid_out_as_seen_on_the_wire() -> None:
    # seen: udp_reqrep_rep.jsonl, the request with sequence number 2
    guid = bytes.fromhex("010f7f01fd0ea44101000000 00000103")
    octets = bytes.fromhex("010f7f01fd0ea441010000000000010300000000 02000000")
    assert encode_identity(guid, 2) == octets
    assert decode_identity(octets + b"the reply") == (guid, 2)


def test_a_reply_too_short_for_an_identity_has_none() -> None:
    assert decode_identity(bytes(23)) is None


@settings(deadline=None, max_examples=tries(50, 2000))
@given(st.binary(min_size=16, max_size=16), st.integers(0, 2**63 - 1))
def test_identity_round_trip(guid: bytes, sequence_nr: int) -> None:
    assert decode_identity(encode_identity(guid, sequence_nr)) == (guid, sequence_nr)


def test_each_request_is_answered_once() -> None:
    pending = PendingRequests(4)
    pending.add(1, 0x000A)
    assert pending.request_id(1) == 0x000A
    pending.answered(1)
    assert pending.request_id(1) is None
    pending.answered(1)


def test_the_oldest_open_request_gives_way() -> None:
    pending = PendingRequests(2)
    for number in (1, 2, 3):
        pending.add(number, number + 10)
    assert [pending.request_id(number) for number in (1, 2, 3)] == [None, 12, 13]
    assert pending.forgotten == 1
    assert len(pending) == 2
    pending.clear()
    assert len(pending) == 0
