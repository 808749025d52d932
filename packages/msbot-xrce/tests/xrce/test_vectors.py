"""Every recorded message of eProsima's client and agent is understood, and written back octet by octet."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from contextlib import suppress
from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from msbot_xrce import Status, explain
from msbot_xrce.errors import RemoteProtocolError
from msbot_xrce.messages import (
    Create,
    CreateClient,
    Data,
    Format,
    Fragment,
    Header,
    ObjectKind,
    StatusReply,
    Submessage,
    WriteData,
    decode_header,
    encode_message,
    iter_submessages,
)
from msbot_xrce.objects import parse_variant

from .captures import CAPTURES, HEADERLESS_ANSWER, VECTORS, recorded

Message = tuple[Header, list[Submessage]]

MALFORMED_BY_HAND = "udp_raw_malformed"


def decode(packet: bytes) -> Message:
    header = decode_header(packet)
    return header, list(iter_submessages(packet, header.size))


def is_understandable(name: str, packet: bytes, from_client: bool) -> bool:
    """False for the two things that nobody can understand: hand-made nonsense, and answers without a header."""
    return packet != HEADERLESS_ANSWER and not (name == MALFORMED_BY_HAND and from_client)


def messages(name: str) -> Iterator[tuple[bytes, Message]]:
    for record in recorded(name):
        if is_understandable(name, record.packet, record.from_client):
            yield record.packet, decode(record.packet)


def assert_same_but_padding(octets: bytes, again: bytes, read: Callable[[bytes], object]) -> None:
    """The octets are equal, or differ where any octet means the same and ours is zero."""
    assert len(octets) == len(again)
    for place in range(len(octets)):
        if octets[place] != again[place]:
            assert again[place] == 0
            for other in (0x00, 0x02, 0xA5, 0xFF):
                changed = octets[:place] + bytes((other,)) + octets[place + 1 :]
                assert read(changed) == read(octets)


@pytest.mark.parametrize("name", CAPTURES)
def test_every_message_is_written_back_octet_by_octet(name: str) -> None:
    count = 0
    for packet, message in messages(name):
        header, submessages = message
        plain = encode_message(header, submessages, pad_end=False)
        padded = encode_message(header, submessages, pad_end=True)
        assert_same_but_padding(packet, plain if len(plain) == len(packet) else padded, decode)
        assert submessages
        count += 1
    assert count > 0


@pytest.mark.parametrize("name", CAPTURES)
def test_agents_do_not_pad_the_end_and_clients_pad_streams(name: str) -> None:
    for record in recorded(name):
        if name.startswith("udp_raw") and record.from_client:
            continue
        if not is_understandable(name, record.packet, record.from_client):
            continue
        header, submessages = decode(record.packet)
        pad_end = record.from_client and header.stream_id != 0
        assert len(encode_message(header, submessages, pad_end=pad_end)) == len(record.packet)


def test_headerless_answers_are_refused_and_nothing_before_them_is_lost() -> None:
    packets = [record.packet for record in recorded("udp_hardliveliness_alive")]
    assert packets.count(HEADERLESS_ANSWER) == 5
    with pytest.raises(RemoteProtocolError, match="CREATE_CLIENT"):
        decode(HEADERLESS_ANSWER)


def test_hand_made_nonsense_is_read_as_empty_or_refused() -> None:
    outcomes = []
    for record in recorded(MALFORMED_BY_HAND):
        if not record.from_client:
            continue
        try:
            outcomes.append(len(decode(record.packet)[1]))
        except RemoteProtocolError:
            outcomes.append(-1)
    # CREATE_CLIENT; header of 1, of 2, of 4 octets; CREATE beyond the message; CREATE cut short; unknown; GET_INFO
    assert outcomes == [1, -1, -1, 0, -1, -1, 0, 1]


def creates() -> list[tuple[str, Create]]:
    found: dict[tuple[object, ...], tuple[str, Create]] = {}
    for name in CAPTURES:
        for _, (_, submessages) in messages(name):
            for one in submessages:
                if isinstance(one, Create):
                    found.setdefault((one.variant, one.little_endian), (name, one))
    return list(found.values())


def test_every_description_of_an_object_is_understood() -> None:
    refused = []
    kinds: set[tuple[int, int]] = set()
    for _, create in creates():
        try:
            parse_variant(create.variant, little_endian=create.little_endian)
        except RemoteProtocolError:
            refused.append(create.variant.text)
        kinds.add((create.variant.kind, create.variant.format))
    assert refused == ["<dds><nope", "no_such_profile"]
    assert {(kind, Format.XML) for kind in range(ObjectKind.PARTICIPANT, ObjectKind.REPLIER + 1)} <= kinds
    assert {(kind, Format.BINARY) for kind in range(ObjectKind.PARTICIPANT, ObjectKind.DATAREADER + 1)} <= kinds
    assert {(kind, Format.REFERENCE) for kind in (1, 2, 5, 6)} <= kinds


def test_what_the_agent_refused_as_nonsense_is_refused_and_what_it_made_is_understood() -> None:
    asked: dict[int, Create] = {}
    judged = set()
    for _, (_, submessages) in messages("udp_statuses_dds"):
        for one in submessages:
            if isinstance(one, Create):
                asked[one.request_id] = one
            elif isinstance(one, StatusReply) and one.request_id in asked:
                variant = asked[one.request_id].variant
                if one.status == Status.ERR_DDS_ERROR and variant.kind == ObjectKind.TOPIC:
                    with pytest.raises(RemoteProtocolError):
                        parse_variant(variant)
                elif one.status == Status.OK:
                    parse_variant(variant)
                judged.add(one.status)
    assert {Status.OK, Status.OK_MATCHED, Status.ERR_DDS_ERROR, Status.ERR_MISMATCH} <= judged


def test_reuse_of_the_captures_is_judged_as_the_agent_judged_it() -> None:
    definitions: dict[int, object] = {}
    judged = []
    pending: dict[int, Create] = {}
    for _, (_, submessages) in messages("udp_statuses_dds"):
        for one in submessages:
            if isinstance(one, Create):
                pending[one.request_id] = one
            elif isinstance(one, StatusReply) and one.request_id in pending:
                create = pending.pop(one.request_id)
                if one.status in (Status.OK_MATCHED, Status.ERR_MISMATCH):
                    same = definitions.get(create.object_id) == parse_variant(create.variant)
                    assert same == (one.status == Status.OK_MATCHED)
                    judged.append(one.status)
                elif one.status == Status.OK:
                    definitions[create.object_id] = parse_variant(create.variant)
    assert Status.OK_MATCHED in judged
    assert Status.ERR_MISMATCH in judged


def rejoined(name: str) -> Iterator[bytes]:
    """What the fragments of a capture are when put together, per client, direction and stream."""
    pieces: dict[tuple[int, bool, int], dict[int, Fragment]] = {}
    for record in recorded(name):
        if not is_understandable(name, record.packet, record.from_client):
            continue
        header, submessages = decode(record.packet)
        for one in submessages:
            if isinstance(one, CreateClient):
                pieces = {key: value for key, value in pieces.items() if key[0] != record.client}
            elif isinstance(one, Fragment):
                of_stream = pieces.setdefault((record.client, record.from_client, header.stream_id), {})
                of_stream.setdefault(header.sequence_nr, one)
    for of_stream in pieces.values():
        numbers = sorted(of_stream)
        body = b""
        for number, following in pairwise([*numbers, -1]):
            body += of_stream[number].payload
            if of_stream[number].last:
                yield body
                body = b""
            elif following != number + 1:
                body = b""


FRAGMENTED = [name for name in CAPTURES if any(word in name for word in ("big", "fragment", "escape"))]


@pytest.mark.parametrize("name", FRAGMENTED)
def test_rejoined_fragments_are_whole_submessages(name: str) -> None:
    bodies = list(rejoined(name))
    assert bodies
    for body in bodies:
        submessages = list(iter_submessages(body, 0))
        assert submessages
        assert all(isinstance(one, WriteData | Data | Create) for one in submessages)
        again = encode_message(Header(0x81), submessages, pad_end=True)[4:]
        assert_same_but_padding(body, again[: len(body)], lambda octets: list(iter_submessages(octets, 0)))


TEXTS = ["agent_answers_1.txt", "agent_answers_2.txt"]
_OCTETS = re.compile(r"^\s+<- ((?:[0-9a-f]{2} )*[0-9a-f]{2}) \(\d+\)$")


@pytest.mark.parametrize("name", TEXTS)
def test_answers_of_the_agent_to_hand_made_packets_are_written_back(name: str) -> None:
    count = 0
    for line in (VECTORS / name).read_text().splitlines():
        found = _OCTETS.match(line)
        if found:
            packet = bytes.fromhex(found[1])
            message = decode(packet)
            if not message[1]:
                continue
            again = encode_message(*message, pad_end=False)
            assert_same_but_padding(packet, again, decode)
            count += 1
    assert count > 80


_SENT = re.compile(r"^\s+-> ((?:[0-9a-f]{2} )*[0-9a-f]{2})\b")


@pytest.mark.parametrize("name", TEXTS)
def test_hand_made_packets_that_kill_the_genuine_agent_are_read_or_refused(name: str) -> None:
    count = 0
    for line in (VECTORS / name).read_text().splitlines():
        found = _SENT.match(line)
        if found:
            packet = bytes.fromhex(found[1])
            try:
                for one in decode(packet)[1]:
                    if isinstance(one, Create):
                        parse_variant(one.variant, little_endian=one.little_endian)
            except RemoteProtocolError:
                pass
            assert explain(packet)
            count += 1
    assert count > 70


DIALOGUE = re.compile(r"^\s*[\d.]+ [CA]>[CA]\s+(?:\d+ )?([0-9a-f]+)")


@pytest.mark.parametrize("name", ["client_answers.txt", "dialog_lossy.txt", "dialog_hard_liveliness.txt"])
def test_dialogues_are_written_back(name: str) -> None:
    count = 0
    for line in (VECTORS / name).read_text().splitlines():
        found = DIALOGUE.match(line)
        packet = bytes.fromhex(found[1]) if found else HEADERLESS_ANSWER
        # Big-endian payloads are understood but never sent, unknown submessages are skipped.
        by_hand = packet[5] & 1 == 0 or packet[4] == 0x20
        if found and packet != HEADERLESS_ANSWER and not by_hand:
            header, submessages = decode(packet)
            encoded = [encode_message(header, submessages, pad_end=pad) for pad in (False, True)]
            again = next(one for one in encoded if len(one) == len(packet))
            assert_same_but_padding(packet, again, decode)
            count += 1
    assert count > 5


SAMPLES = sorted({record.packet for name in CAPTURES for record in recorded(name) if len(record.packet) <= 200})


@given(st.sampled_from(SAMPLES), st.data())
def test_recorded_messages_with_any_octet_changed_are_read_or_refused(packet: bytes, data: st.DataObject) -> None:
    octets = bytearray(packet)
    for _ in range(data.draw(st.integers(1, 4))):
        octets[data.draw(st.integers(0, len(octets) - 1))] = data.draw(st.integers(0, 255))
    cut = bytes(octets[: data.draw(st.integers(0, len(octets)))]) if data.draw(st.booleans()) else bytes(octets)
    try:
        submessages = decode(cut)[1]
    except RemoteProtocolError:
        submessages = []
    for one in submessages:
        one.encode()
        if isinstance(one, Create):
            with suppress(RemoteProtocolError):
                parse_variant(one.variant, little_endian=one.little_endian)
    assert explain(cut)
