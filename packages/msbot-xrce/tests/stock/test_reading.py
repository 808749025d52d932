"""The model of the stock client's reader: what it takes, and what it cannot."""

from __future__ import annotations

import pytest

from msbot_xrce.messages.message import Heartbeat, Info, StatusAgent, TimestampReply
from msbot_xrce.messages.objects import write_status
from msbot_xrce.messages.submessage import append_submessage, data_submessage
from tests.stock.reading import as_meant, as_stock_client, complaints

DATA = 9
READER, REQUESTER, REPLIER = 0x0016, 0x0017, 0x0018
STATUS = write_status(10, 0x0011, 0)


def data(object_id: int, payload: bytes, request_id: int = 33) -> bytes:
    return data_submessage(DATA, request_id, object_id, payload)


def message(*submessages: bytes) -> bytes:
    body = b""
    for one in submessages:
        body = append_submessage(body, one)
    return body


ALONE = [
    data(READER, b"12345"),
    data(REQUESTER, b"12345678"),
    data(REPLIER, bytes(24) + b"12"),
    STATUS,
    Heartbeat(1, 3, 0x80).encode(),
    StatusAgent(0).encode(),
    Info(10, 0xFFFD).encode(),
    TimestampReply(1, 2, 3).encode(),
]


@pytest.mark.parametrize("body", ALONE, ids=lambda body: f"kind{body[0]}")
def test_what_is_alone_is_read_whole(body: bytes) -> None:
    assert as_stock_client(body) == as_meant(body)
    assert complaints(body) == []


def test_samples_and_requests_may_share_a_message_and_a_reply_may_end_it() -> None:
    body = message(data(READER, b"123"), data(REPLIER, bytes(25)), data(READER, b""), data(REQUESTER, b"1234567"))
    assert len(as_stock_client(body)) == 4
    assert complaints(body) == []


@pytest.mark.parametrize("size", [4, 8, 9, 40, 200])
def test_what_follows_a_reply_is_lost_or_misread(size: int) -> None:
    body = message(data(REQUESTER, bytes(size)), data(READER, b"abcd"), data(READER, b"efgh"))
    assert as_stock_client(body) != as_meant(body)
    assert "a stock client reads" in complaints(body)[0]


def test_the_second_status_of_a_message_is_never_seen() -> None:
    assert "two STATUS" in complaints(message(STATUS, STATUS))[0]
    assert "beside" in complaints(message(data(READER, b"1"), STATUS))[0]


def test_it_counts_to_65535() -> None:
    assert complaints(data(READER, bytes(65_531))) == []
    assert "counts to 65535" in complaints(data(READER, bytes(65_532)))[0]
    assert as_stock_client(data(READER, bytes(70_000))) != as_meant(data(READER, bytes(70_000)))


def test_what_it_does_not_know_it_reads_as_headers() -> None:
    unknown = bytes((0x20, 1, 8, 0)) + STATUS[:8]
    assert [one.kind for one in as_stock_client(unknown)] == [5]
    assert "no stock client knows" in complaints(unknown)[0]
