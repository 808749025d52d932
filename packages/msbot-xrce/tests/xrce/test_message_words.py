"""Octets in words."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from msbot_xrce import explain
from msbot_xrce.messages import (
    Create,
    DeliveryControl,
    Format,
    Header,
    Info,
    ObjectVariant,
    ReadData,
    Submessage,
    encode_message,
)
from msbot_xrce.objects import (
    EndpointQos,
    publisher_variant,
    reader_variant,
    replier_variant,
    topic_variant,
    writer_variant,
)

from .captures import CAPTURES, HEADERLESS_ANSWER, recorded
from .message_table import BIG_ENDIAN, TABLE, Row

LINES = [
    ("81800000 05010600 000a0011 0000", "session 0x81, reliable stream 0x80, message 0"),
    ("81800000 05010600 000a0011 0000", "STATUS of participant 0x0011, request 10: OK"),
    ("01000000 aabbcc07 0a010500 02000005 80", "session 0x01 of client AABBCC07"),
    ("81000000 0a010500 02000005 80", "ACKNACK of reliable stream 0x80: all below 2 has arrived, missing: 2, 4"),
    ("81000000 0a010500 02000000 01", "ACKNACK of best-effort stream 0x01: all below 2 has arrived"),
    ("81000000 0b010500 06000800 80", "HEARTBEAT of reliable stream 0x80: messages 6 to 8 are kept"),
    ("80000000 02010800 000afffd 02000000", "no session"),
    ("80000000 02010800 000afffd 02000000", "GET_INFO about the agent, request 10"),
    ("81000000 03010400 0002fffe", "DELETE the client, request 2"),
    ("81000000 03010400 00020010", "DELETE object 0x0010, request 2"),
    ("81010100 07010900 001f0015 0001020304", "WRITE_DATA to datawriter 0x0015, request 31: 5 bytes 00 01 02 03 04"),
    ("81010100 09010400 001f0016", "DATA from datareader 0x0016, request 31: 0 bytes"),
    ("81010100 07010500 001f0015 00", "WRITE_DATA to datawriter 0x0015, request 31: 1 byte 00"),
    ("81800800 0d030200 6869", "FRAGMENT, the last: 2 bytes 68 69"),
    ("81000000 0c010000", "RESET: all streams start over"),
    ("81000000 04010b00 8500 58524345 0100010f00", "STATUS_AGENT: the request makes no sense"),
    ("81000000 0e010800 00000000 01000000", "TIMESTAMP: 1970-01-01 00:00:00.000000001"),
    (HEADERLESS_ANSWER.hex(), "a C client's answer to GET_INFO, which has no submessage header"),
    ("8100", "not a message: a message of 2 bytes"),
    ("81000000 07010200 0000", "the rest makes no sense: WRITE_DATA: 2 bytes where 4 are needed"),
]


@pytest.mark.parametrize(("octets", "line"), LINES)
def test_words(octets: str, line: str) -> None:
    assert any(one.startswith(line) for one in explain(bytes.fromhex(octets)))


def one_line(submessage: Submessage) -> str:
    return explain(encode_message(Header(0x81), [submessage], pad_end=False))[1]


VALUES: list[tuple[Submessage, str]] = [
    (ReadData(1, 0x16, 0x80), "READ_DATA of datareader 0x0016, request 1, on reliable stream 0x80: one sample"),
    (ReadData(1, 0x16, 0, DeliveryControl(0)), "on no stream: stop"),
    (ReadData(1, 0x16, 1, DeliveryControl(5, 2, 100, 7)), "5 samples, for 2 s, 100 bytes a second, 7 ms apart"),
    (ReadData(1, 0x16, 1, DeliveryControl()), "without end"),
    (Info(10, 0xFFFD, availability=0), "takes no clients, does not know you"),
    (Info(10, 0xFFFD, implementation_status=1), "takes clients, knows your session"),
    (Info(10, 0xFFFE, has_agent=False, availability=None), "INFO about the client, request 10"),
    (Create(9, 0x12, topic_variant("T", "X", 0x11)), "CREATE topic 0x0012, request 9, in binary form, 'T' of type 'X'"),
    (Create(9, 0x13, publisher_variant(0x11), reuse=True), "without a name, of 0x0011, reuse"),
    (
        Create(9, 0x15, writer_variant(0x12, 0x13, EndpointQos(transient_local=True, depth=1))),
        "topic 0x0012, reliable, for late readers too, keeps 1, of 0x0013",
    ),
    (Create(9, 0x16, reader_variant(0x12, 0x14, EndpointQos(False))), "topic 0x0012, best effort, of 0x0014"),
    (Create(9, 0x16, reader_variant(0x12, 0x14, EndpointQos(keep_all=True))), "reliable, keeps all, of 0x0014"),
    (Create(9, 0x18, replier_variant("s", "Q", "P", "q", "p", 0x11)), "service 's', topics 'q' and 'p'"),
    (Create(9, 0x12, ObjectVariant(2, Format.BINARY, blob=b"")), "in a binary form that makes no sense"),
    (Create(9, 0x12, ObjectVariant(2, Format.XML, "x" * 99)), f"by XML '{'x' * 60}...'"),
    (Create(9, 0x11, ObjectVariant(1, 9)), "in the unknown form 9, domain 0"),
]


@pytest.mark.parametrize(("submessage", "words"), VALUES)
def test_words_of_values(submessage: Submessage, words: str) -> None:
    assert words in one_line(submessage)


@pytest.mark.parametrize("row", TABLE + BIG_ENDIAN, ids=lambda row: row.name)
def test_one_line_for_the_header_and_one_for_each_submessage(row: Row) -> None:
    lines = explain(row.packet())
    assert len(lines) == 1 + len(row.submessages)


@pytest.mark.parametrize("name", CAPTURES)
def test_everything_recorded_has_words(name: str) -> None:
    for record in recorded(name):
        lines = explain(record.packet)
        assert lines
        assert all("\n" not in line for line in lines)


@given(st.binary(max_size=80))
def test_any_octets_have_words(octets: bytes) -> None:
    assert explain(octets)


@pytest.mark.parametrize(("reuse", "replace"), [(False, False), (True, False), (False, True), (True, True)])
def test_what_happens_to_an_object_that_is_there_is_told(reuse: bool, replace: bool) -> None:
    create = Create(1, 0x11, topic_variant("t", "T", 0x01), reuse=reuse, replace=replace)
    assert one_line(create).endswith((", reuse" if reuse else "") + (", replace" if replace else ""))
    assert (", replace" in one_line(create), ", reuse" in one_line(create)) == (replace, reuse)


def test_notes_stand_below_their_submessage() -> None:
    packet = bytes.fromhex("8101020007010800 000b0015 0102030407010800 000c0025 05060708")
    lines = explain(packet, lambda header, submessage: [f"{header.sequence_nr}: {type(submessage).__name__}"])
    assert [line.partition(",")[0] for line in lines] == [
        "session 0x81",
        "WRITE_DATA to datawriter 0x0015",
        "2: WriteData",
        "WRITE_DATA to datawriter 0x0025",
        "2: WriteData",
    ]
